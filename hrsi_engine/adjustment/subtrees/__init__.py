"""One block on many machines: its nested dissection's subtrees are adjusted by Dask workers, what parts them on top.

| module   | holds                                                                                             |
|----------|---------------------------------------------------------------------------------------------------|
| division | which cameras and points are one *leaf*, and the tree of the *separators* between leaves          |
| leaf     | a leaf: its points and inner cameras eliminated, what is left for its border, the way back        |
| crown    | a separator: what comes from below put together, eliminated, the way back                         |
| descent  | the damped Gauss-Newton loop over leaves and separators that stay on the workers                  |
| loop     | the same behind the face of `gauss_newton.GaussNewton`, for a block that lies on this machine     |

A leaf is made by a call that any worker can make again (it reads a file), every further step by a function of what was
there before, so that Dask computes again what a dying worker takes along. This side holds the values of the separators,
sums, and references.
"""

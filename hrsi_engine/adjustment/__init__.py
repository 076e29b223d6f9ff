"""Bundle block adjustment with RPCs (thesis chapter 5): `adjust` and what it is made of.

| module              | holds                                                                       |
|---------------------|-----------------------------------------------------------------------------|
| options, result     | how to adjust; what an adjustment delivers                                  |
| observations        | which measurements and points take part, in solver order                    |
| pattern             | which cameras share points                                                  |
| equations           | normal equations with the points eliminated: what the solver asks of them   |
| array_equations     | … with NumPy, for every model                                               |
| compiled_equations  | … compiled (kernels, camera_kernels), for image-space models                |
| nested_dissection   | sparse Cholesky factors and inverse on the pattern                          |
| camera_system       | solution of the reduced system, direct or iterative                         |
| gauss_newton        | the damped, reweighted loop                                                 |
| problem             | a block made ready: priors, parts, weak geometry                            |
| intersection        | points from fixed cameras                                                   |
| weights             | robust weight functions                                                     |
| snooping            | blunders among measurements and GCPs                                        |
| variance_components | sigmas of groups of observations                                            |
| drift_prior         | … and of the drifts of the images' corrections                              |
| precision           | cofactors, error ellipses, reliability                                      |
| cross_validation    | each GCP as a check point in turn                                           |
| outcome             | the last solution as an `Adjustment`                                        |
| solver              | `adjust`: the rounds of an adjustment                                       |
"""

from .options import AdjustOptions
from .result import Adjustment, Decision
from .solver import adjust
from .weights import WEIGHTS

__all__ = ["WEIGHTS", "AdjustOptions", "Adjustment", "Decision", "adjust"]

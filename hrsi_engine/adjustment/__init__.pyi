"""Bundle block adjustment with RPCs (thesis chapter 5): `adjust` and its parts.

| module              | contains                                                                    |
|---------------------|-----------------------------------------------------------------------------|
| options, result     | options and result of an adjustment                                         |
| observations        | the measurements and points that are used, in solver order                  |
| equations           | normal equations with the points eliminated, and their solution (a folder)  |
| consensus           | measurements that agree with the others of their points and image pairs     |
| jitter              | vibration along the lines: waves in residuals, and their removal (a folder) |
| image_alignment     | initial values: a robust shift of each image                                |
| gauss_newton        | damped iterations with reweighting                                          |
| problem             | a block prepared: priors, parts, weak geometry                              |
| intersection        | points by fixed cameras                                                     |
| weights             | robust weight functions                                                     |
| blunders            | blunders among measurements and GCPs (a folder)                             |
| variance_components | sigmas of groups of observations                                            |
| drift_prior         | … and of the drifts of the images' corrections                              |
| precision           | cofactors, error ellipses                                                   |
| outcome             | the last solution as an `Adjustment`                                        |
| solver              | `adjust`: the rounds of an adjustment; each GCP as a check point in turn    |
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .options import AdjustOptions as AdjustOptions
from .result import Adjustment as Adjustment
from .result import Decision as Decision
from .solver import adjust as adjust
from .weights import WEIGHTS as WEIGHTS

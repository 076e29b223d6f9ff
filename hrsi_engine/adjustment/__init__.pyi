"""Bundle block adjustment with RPCs (thesis chapter 5): `adjust` and what it is made of.

| module              | holds                                                                       |
|---------------------|-----------------------------------------------------------------------------|
| options, result     | how to adjust; what an adjustment delivers                                  |
| observations        | which measurements and points take part, in solver order                    |
| equations           | normal equations with the points eliminated, and their solution (a folder)  |
| consensus           | measurements that agree with the others of their points and image pairs     |
| jitter              | vibration along the lines: waves in residuals, and their removal (a folder)  |
| image_alignment     | a start in which the images meet: a robust shift of each                     |
| gauss_newton        | the damped, reweighted loop                                                 |
| problem             | a block made ready: priors, parts, weak geometry                            |
| intersection        | points from fixed cameras                                                   |
| weights             | robust weight functions                                                     |
| blunders            | blunders among measurements and GCPs, a folder                              |
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

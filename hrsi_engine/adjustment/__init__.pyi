"""Bundle block adjustment with RPCs (thesis chapter 5): `adjust` and its parts.

| module           | contains                                                                   |
|------------------|----------------------------------------------------------------------------|
| options, result  | options and result of an adjustment                                        |
| observations     | the measurements and points that are used, in solver order                 |
| weights          | robust weight functions                                                    |
| equations/       | normal equations with the points eliminated, and their solution            |
| starting_values/ | agreeing measurements, intersected points, weak geometry                   |
| priors/          | attitude drift common to all images, cameras of an earlier adjustment      |
| external/        | heights and plan observed by a DEM, laser points or a reference orthoimage |
| gauss_newton     | damped iterations with reweighting                                         |
| preparation/     | a block prepared: parts, priors, starting values                           |
| statistics/      | cofactors, error ellipses, variance components of groups of observations   |
| drift_prior      | … and of the drifts of the images' corrections                             |
| jitter/          | vibration along the lines: waves in residuals, and their removal           |
| outcome/         | the last solution as an `Adjustment`                                       |
| blunders/        | blunders among measurements and GCPs                                       |
| solver           | `adjust`: the rounds of an adjustment; each GCP as a check point in turn   |
| following        | an adjustment that follows edits of its block                              |
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .options import AdjustOptions as AdjustOptions
from .result import Adjustment as Adjustment
from .result import Decision as Decision
from .solver import adjust as adjust
from .weights import WEIGHTS as WEIGHTS

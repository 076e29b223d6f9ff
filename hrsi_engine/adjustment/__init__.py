"""Bundle block adjustment with RPCs (thesis chapter 5): `adjust` and what it is made of.

| module       | holds                                                                  |
|--------------|------------------------------------------------------------------------|
| observations | which measurements and points take part, in solver order               |
| normals      | linearised equations, elimination of the points, reduced camera system |
| intersection | points from fixed cameras                                              |
| weights      | robust weight functions                                                |
| solver       | the damped Gauss-Newton loop                                           |
| precision    | covariances of parameters and points                                   |
| result       | what an adjustment delivers                                            |
"""

from .result import Adjustment
from .solver import AdjustOptions, adjust
from .weights import WEIGHTS

__all__ = ["WEIGHTS", "AdjustOptions", "Adjustment", "adjust"]

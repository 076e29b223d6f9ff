"""The observation equations of a block, their reduced normal equations, and the solution of those.

| module               | contains                                                             |
|----------------------|----------------------------------------------------------------------|
| normal_equations     | interface for the solver: normal equations without points, cofactors |
| linearisation        | residuals and derivatives of any part of a block, for all models     |
| elimination          | elimination of the points with NumPy                                 |
| compiled_elimination | … compiled, with the loops of elimination_kernels                    |
| states               | unknowns, priors of the points, sums and cofactors                   |
| pattern              | pairs of cameras with common points                                  |
| nested_dissection    | sparse Cholesky factors and inverse on the pattern                   |
| camera_system        | solution of the reduced system, direct or iterative                  |
"""

from .camera_system import CameraSystem
from .normal_equations import NormalEquations
from .pattern import Pattern, find_pattern, make_diagonal_pattern
from .states import FREE_POINT_SIGMA_M, Cofactors, Normals, PointPriors, State

__all__ = [
    "FREE_POINT_SIGMA_M", "CameraSystem", "Cofactors", "NormalEquations", "Normals", "Pattern", "PointPriors",
    "State", "find_pattern", "make_diagonal_pattern",
]  # fmt: skip

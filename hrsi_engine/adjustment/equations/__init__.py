"""The observation equations of a block, their reduced normal equations, and the solution of those.

| module              | holds                                                                       |
|---------------------|-----------------------------------------------------------------------------|
| states              | unknowns, point priors, and what the solver asks of the normal equations    |
| array_equations     | … with NumPy, for every model                                               |
| compiled_equations  | … compiled (kernels, camera_kernels), for image-space models                |
| pattern             | which cameras share points                                                  |
| nested_dissection   | sparse Cholesky factors and inverse on the pattern                          |
| camera_system       | solution of the reduced system, direct or iterative                         |
"""

from .camera_system import CameraSystem, camera_system
from .compiled import equations_of
from .pattern import Pattern, find_pattern, trivial_pattern
from .states import FREE_POINT_SIGMA_M, Cofactors, Equations, Normals, PointJacobians, PointPriors, State

__all__ = [
    "FREE_POINT_SIGMA_M",
    "CameraSystem",
    "Cofactors",
    "Equations",
    "Normals",
    "Pattern",
    "PointJacobians",
    "PointPriors",
    "State",
    "camera_system",
    "equations_of",
    "find_pattern",
    "trivial_pattern",
]

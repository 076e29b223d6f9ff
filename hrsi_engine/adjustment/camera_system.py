"""Solution of the reduced camera system: symmetric, positive definite, scaled to a unit diagonal.

Small systems are factorised densely (Cholesky), large ones as sparse matrices; `solve` takes one or several
right-hand sides.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import splu

from ..errors import SolveError

Solve = Callable[[np.ndarray], np.ndarray]

DENSE_LIMIT = 1500  # unknowns: below, a dense factorisation is quicker than a sparse one


class CameraSystem:
    """Factor of ``S + diag(prior weight) + damping * diag``."""

    def __init__(self, matrix: sparse.csc_matrix, prior_weight: np.ndarray, damping: float = 0.0) -> None:
        diagonal = matrix.diagonal() + prior_weight
        if not np.all(diagonal > 0.0):
            raise SolveError("the normal equations are not positive definite: the images' cameras are unusable")
        scale = 1.0 / np.sqrt(diagonal)
        scaling = sparse.diags(scale)
        scaled = scaling @ (matrix + sparse.diags(prior_weight)) @ scaling + damping * sparse.identity(len(scale))
        self.size = len(scale)
        self._scale = scale
        self._factor = _empty if not self.size else _dense(scaled) if self.size <= DENSE_LIMIT else _sparse(scaled)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution for ``(u,)`` or ``(u, k)`` right-hand sides."""
        scale = self._scale if right.ndim == 1 else self._scale[:, None]
        return scale * self._factor(scale * right)


def _empty(right: np.ndarray) -> np.ndarray:
    return right


def _dense(matrix: sparse.spmatrix) -> Solve:
    try:
        factor = linalg.cho_factor(matrix.toarray(), lower=True)
    except linalg.LinAlgError as error:
        raise SolveError(
            "the normal equations are singular: add GCPs or tie points, or choose a model with fewer parameters"
        ) from error
    return lambda right: linalg.cho_solve(factor, right)


def _sparse(matrix: sparse.spmatrix) -> Solve:
    factor = splu(
        sparse.csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return factor.solve

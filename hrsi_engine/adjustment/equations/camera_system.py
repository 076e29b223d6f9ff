"""Solution of the reduced camera system by its Cholesky factors (`nested_dissection`), which give the precision too."""

import numpy as np
from scipy import sparse

from ...foundation.errors import SolveError
from ...foundation.thresholds import threshold, thresholds
from .nested_dissection import SparseFactor
from .pattern import Pattern


@thresholds
class SYSTEM:
    """Limits for the use of the last camera system's factors for the next one."""

    nearby: float = threshold(1e-7, "", "relative error of a solution by an earlier matrix's factors")
    nearby_unknowns: int = threshold(500, "unknowns", "number of unknowns from which earlier factors are used again")
    nearby_iterations: int = threshold(10, "iterations", "largest number with earlier factors; each costs 1/20 of new")


class CameraSystem:
    """``S + diag(prior weight)`` and damping times its diagonal, scaled to a unit diagonal.

    It is symmetric, positive definite. Fixed unknowns have a scale of zero, and therefore a solution of zero.
    """

    def __init__(self, pattern: Pattern) -> None:
        self.pattern = pattern
        self.scale = np.ones((pattern.cameras, pattern.parameters))
        self.damping = 0.0
        self._factor = SparseFactor(pattern.graph, pattern.start, pattern.columns, pattern.parameters, pattern.position)
        self._factorised: tuple[np.ndarray, np.ndarray, float] | None = None
        self._cofactors: np.ndarray | None = None  # of the matrix that is factorised

    def compute_damping_cost(self, step: np.ndarray) -> float:
        """Return the contribution of a step ``(cameras, p)`` to the cost by damping alone."""
        if self.damping == 0.0:
            return 0.0
        in_units = np.divide(step, self.scale, out=np.zeros_like(step), where=self.scale > 0.0)
        return self.damping * float(np.sum(in_units**2))

    def factorise(self, blocks: np.ndarray, prior_weight: np.ndarray, damping: float = 0.0) -> None:
        """Factorise the upper ``blocks (blocks, p, p)`` with ``prior_weight (cameras, p)``, infinite where fixed.

        To be called before `solve`; it returns at once if the same matrix is factorised already.
        """
        last = self._factorised
        if last is not None and last[0] is blocks and last[1] is prior_weight and last[2] == damping:
            return
        self._factorised = self._cofactors = None
        pattern, diagonal, fixed = self.pattern, np.arange(self.pattern.parameters), np.isinf(prior_weight)
        total = np.einsum("cpp->cp", blocks[pattern.diagonal]) + np.where(fixed, 0.0, prior_weight)
        if not np.all(fixed | (total > 0.0)):
            raise SolveError("the normal equations are not positive definite: check the RPCs of the images")
        self.scale, self.damping = np.where(fixed, 0.0, 1.0 / np.sqrt(np.where(fixed, 1.0, total))), damping
        result = blocks * self.scale[pattern.rows][:, :, None]
        result *= self.scale[pattern.columns][:, None, :]
        result[pattern.diagonal[:, None], diagonal, diagonal] = 1.0 + damping
        self._factor.factorise(np.asarray(result))
        self._factorised = blocks, prior_weight, damping

    def solve_nearby(
        self, blocks: np.ndarray, prior_weight: np.ndarray, damping: float, right: np.ndarray
    ) -> np.ndarray:
        """Return the solution ``(cameras, p)`` for a matrix near the last one.

        It uses conjugate gradients preconditioned by the factors of the last matrix, if these converge; otherwise the
        matrix is factorised.

        blocks, prior_weight, damping : as of `factorise`; right : (cameras, p)
        """
        has_factors = self._factorised is not None and self._factorised[2] == damping == 0.0
        if has_factors and right.size >= SYSTEM.nearby_unknowns:
            solution = self._solve_by_gradients(blocks, prior_weight, right)
            if solution is not None:
                return solution
        self.factorise(blocks, prior_weight, damping)
        return self.solve(right)

    def _solve_by_gradients(self, blocks: np.ndarray, prior_weight: np.ndarray, right: np.ndarray) -> np.ndarray | None:
        """Return the solution ``(cameras, p)`` by conjugate gradients; None if the factors differ too much.

        They are used if the residual falls, from the first step on, fast enough for `SYSTEM.nearby_iterations`. The
        algorithm is that of Hestenes and Stiefel (1952) with a preconditioner.
        """
        pattern, size = self.pattern, right.size
        upper = sparse.bsr_matrix((blocks, pattern.columns, pattern.start), shape=(size, size))
        lower = upper.T
        doubled = blocks[pattern.diagonal]
        diagonal = np.where(np.isinf(prior_weight), 0.0, prior_weight)

        def times(x: np.ndarray) -> np.ndarray:
            flat = x.ravel()
            matrix = (upper @ flat + lower @ flat).reshape(x.shape)
            return np.asarray(matrix - np.einsum("cij,cj->ci", doubled, x) + diagonal * x)

        solution, residual = np.zeros_like(right), right.copy()
        ahead = self.solve(residual)
        direction, square = ahead, float(np.sum(residual * ahead))
        first, pace = square, SYSTEM.nearby ** (2.0 / SYSTEM.nearby_iterations)
        for passed in range(SYSTEM.nearby_iterations + 1):
            if square <= SYSTEM.nearby**2 * first:
                return solution
            if square > pace**passed * first:  # too slow: more steps would not suffice
                return None
            along = times(direction)
            curvature = float(np.sum(direction * along))
            if not curvature > 0.0:
                return None
            solution += square / curvature * direction
            residual -= square / curvature * along
            ahead = self.solve(residual)
            previous, square = square, float(np.sum(residual * ahead))
            direction = ahead + square / previous * direction
        return None

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution for a right-hand side ``(cameras, p)`` or several ``(cameras, p, k)``."""
        scale = self.scale.reshape(self.scale.shape + (1,) * (right.ndim - 2))
        flat = (scale * right).reshape(self.scale.size, *right.shape[2:])
        return scale * self._factor.solve(flat).reshape(right.shape)

    def project_cofactors(self, rows: sparse.csr_matrix) -> np.ndarray:
        """Return the cofactors ``(k, k)`` of functions of the unknowns with sparse derivatives ``rows (k, c p)``."""
        return self._factor.project_cofactors(sparse.csr_matrix(rows @ sparse.diags(self.scale.ravel())))

    def compute_cofactors(self) -> np.ndarray:
        """Return the blocks of the inverse on the pattern, ``(blocks, p, p)``."""
        if self._cofactors is None:
            inverse = self._factor.invert_on_pattern()
            inverse *= self.scale[self.pattern.rows][:, :, None]
            inverse *= self.scale[self.pattern.columns][:, None, :]
            self._cofactors = inverse
        return self._cofactors

"""Solution of the reduced camera system: symmetric, positive definite, scaled to a unit diagonal.

`DirectSystem` has the Cholesky factors (`nested_dissection`), which also give the precision. Above
`SYSTEM.most_factored` cameras the factors would not fit in memory; `IterativeSystem` then uses conjugate gradients,
preconditioned by the Cholesky factors of neighbourhoods of cameras, and has no precision.
"""

from inspect import signature

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, cg

from ...foundation.errors import SolveError
from ...foundation.thresholds import threshold, thresholds
from .nested_dissection import SparseFactor
from .pattern import Pattern


@thresholds
class SYSTEM:
    """Limits for the choice of the solution method of the camera system."""

    most_factored: int = threshold(
        300_000, "cameras", "largest block solved by Cholesky factors (12 GB for affine models); larger ones by "
        "conjugate gradients"
    )  # fmt: skip
    nearby: float = threshold(1e-7, "", "relative error of a solution by an earlier matrix's factors")
    nearby_unknowns: int = threshold(500, "unknowns", "number of unknowns from which earlier factors are used again")
    nearby_iterations: int = threshold(10, "iterations", "largest number with earlier factors; each costs 1/20 of new")


CG_TOLERANCE = 1e-11  # relative to the right-hand side; further Gauss-Newton steps correct the rest
CG_RELATIVE = "rtol" if "rtol" in signature(cg).parameters else "tol"  # SciPy before 1.12 calls it tol
CG_ITERATIONS = 20_000


class _UnitDiagonal:
    """``S + diag(prior weight)`` and damping times its diagonal, scaled to a unit diagonal.

    Fixed unknowns have a scale of zero, and therefore a solution of zero.
    """

    def __init__(self, pattern: Pattern) -> None:
        self.pattern = pattern
        self.scale = np.ones((pattern.cameras, pattern.parameters))
        self.damping = 0.0

    def compute_damping_cost(self, step: np.ndarray) -> float:
        """Return the contribution of a step ``(cameras, p)`` to the cost by damping alone."""
        if self.damping == 0.0:
            return 0.0
        in_units = np.divide(step, self.scale, out=np.zeros_like(step), where=self.scale > 0.0)
        return self.damping * float(np.sum(in_units**2))

    def scale_blocks(self, blocks: np.ndarray, prior_weight: np.ndarray, damping: float) -> np.ndarray:
        pattern, own, fixed = self.pattern, np.arange(self.pattern.parameters), np.isinf(prior_weight)
        total = np.einsum("cpp->cp", blocks[pattern.diagonal]) + np.where(fixed, 0.0, prior_weight)
        if not np.all(fixed | (total > 0.0)):
            raise SolveError("the normal equations are not positive definite: check the RPCs of the images")
        self.scale, self.damping = np.where(fixed, 0.0, 1.0 / np.sqrt(np.where(fixed, 1.0, total))), damping
        result = blocks * self.scale[pattern.rows][:, :, None]
        result *= self.scale[pattern.columns][:, None, :]
        result[pattern.diagonal[:, None], own, own] = 1.0 + damping
        return np.asarray(result)


class DirectSystem(_UnitDiagonal):
    """Direct solution by sparse Cholesky factors."""

    def __init__(self, pattern: Pattern) -> None:
        super().__init__(pattern)
        self._factor = SparseFactor(pattern.graph, pattern.start, pattern.columns, pattern.parameters, pattern.position)
        self._factorised: tuple[np.ndarray, np.ndarray, float] | None = None
        self._cofactors: np.ndarray | None = None  # of the matrix that is factorised

    def factorise(self, blocks: np.ndarray, prior_weight: np.ndarray, damping: float = 0.0) -> None:
        """Factorise the upper ``blocks (blocks, p, p)`` with ``prior_weight (cameras, p)``, infinite where fixed.

        To be called before `solve`; it returns at once if the same matrix is factorised already.
        """
        last = self._factorised
        if last is not None and last[0] is blocks and last[1] is prior_weight and last[2] == damping:
            return
        self._factorised = self._cofactors = None
        self._factor.factorise(self.scale_blocks(blocks, prior_weight, damping))
        self._factorised = blocks, prior_weight, damping

    def solve_nearby(
        self, blocks: np.ndarray, prior_weight: np.ndarray, damping: float, right: np.ndarray
    ) -> np.ndarray:
        """Return the solution ``(cameras, p)`` for a matrix near the last one; arguments of `factorise` and `solve`.

        It uses conjugate gradients preconditioned by the factors of the last matrix, if these converge.
        """
        has_factors = self._factorised is not None and self._factorised[2] == damping == 0.0
        if has_factors and right.size >= SYSTEM.nearby_unknowns:
            solution = self._solve_by_gradients(blocks, prior_weight, right)
            if solution is not None:
                return solution
        self.factorise(blocks, prior_weight, damping)
        return self.solve(right)

    def _solve_by_gradients(self, blocks: np.ndarray, prior_weight: np.ndarray, right: np.ndarray) -> np.ndarray | None:
        """Return the solution by conjugate gradients, or None if the available factors differ too much from the matrix.

        They are used if the residual falls, from the first step on, fast enough for `SYSTEM.nearby_iterations`.
        """
        pattern, size = self.pattern, right.size
        upper = sparse.bsr_matrix((blocks, pattern.columns, pattern.start), shape=(size, size))
        lower = upper.T
        twice = blocks[pattern.diagonal]
        own = np.where(np.isinf(prior_weight), 0.0, prior_weight)

        def times(x: np.ndarray) -> np.ndarray:
            flat = x.ravel()
            both = (upper @ flat + lower @ flat).reshape(x.shape)
            return np.asarray(both - np.einsum("cij,cj->ci", twice, x) + own * x)

        solution, rest = np.zeros_like(right), right.copy()
        ahead = self.solve(rest)
        direction, square = ahead, float(np.sum(rest * ahead))
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
            rest -= square / curvature * along
            ahead = self.solve(rest)
            before, square = square, float(np.sum(rest * ahead))
            direction = ahead + square / before * direction
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


class IterativeSystem(_UnitDiagonal):
    """Solution by preconditioned conjugate gradients; the methods are those of `DirectSystem`."""

    def __init__(self, pattern: Pattern) -> None:
        super().__init__(pattern)
        size = max(1, 64 // max(pattern.parameters, 1))  # the preconditioner eliminates 64 unknowns together
        self._groups = [np.arange(k, min(k + size, pattern.cameras)) for k in range(0, pattern.cameras, size)]

    def factorise(self, blocks: np.ndarray, prior_weight: np.ndarray, damping: float = 0.0) -> None:
        pattern, p = self.pattern, self.pattern.parameters
        scaled = self.scale_blocks(blocks, prior_weight, damping)
        place, shape = (pattern.columns, pattern.start), (pattern.cameras * p,) * 2
        above = scaled.copy()
        above[pattern.diagonal] = 0.0  # diagonal blocks are complete
        lower = sparse.bsr_matrix((above, *place), shape=shape).T
        self._matrix = sparse.csr_matrix(sparse.bsr_matrix((scaled, *place), shape=shape) + lower)
        self._parts = []
        for group in self._groups:
            chosen = slice(group[0] * p, (group[-1] + 1) * p)
            self._parts.append((chosen, linalg.cho_factor(self._matrix[chosen, chosen].toarray(), lower=True)))

    def solve_nearby(
        self, blocks: np.ndarray, prior_weight: np.ndarray, damping: float, right: np.ndarray
    ) -> np.ndarray:
        self.factorise(blocks, prior_weight, damping)
        return self.solve(right)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution, as `DirectSystem.solve`; raise `SolveError` if the iteration does not converge."""
        if right.ndim == 3:
            return np.stack([self.solve(right[:, :, k]) for k in range(right.shape[2])], axis=2)

        def precondition(residual: np.ndarray) -> np.ndarray:
            result = np.empty_like(residual)
            for chosen, factor in self._parts:
                result[chosen] = linalg.cho_solve(factor, residual[chosen], check_finite=False)
            return result

        b = (self.scale * right).ravel()
        preconditioner = LinearOperator(self._matrix.shape, matvec=precondition)
        x, failed = cg(self._matrix, b, maxiter=CG_ITERATIONS, M=preconditioner, **{CG_RELATIVE: CG_TOLERANCE})
        if failed:
            raise SolveError(
                f"the camera system did not converge in {CG_ITERATIONS} iterations: add GCPs or tie points"
            )
        return self.scale * x.reshape(right.shape)

    def project_cofactors(self, rows: sparse.csr_matrix) -> np.ndarray:
        right = rows.toarray().T.reshape(*self.scale.shape, rows.shape[0])
        return np.asarray(rows @ self.solve(right).reshape(self.scale.size, -1))

    def compute_cofactors(self) -> None:
        """Return None: an iterative solution has no inverse."""


CameraSystem = DirectSystem | IterativeSystem


def choose_camera_system(pattern: Pattern) -> CameraSystem:
    """Return the solver for the pattern's number of cameras."""
    return DirectSystem(pattern) if pattern.cameras <= SYSTEM.most_factored else IterativeSystem(pattern)

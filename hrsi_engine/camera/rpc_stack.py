"""Many RPCs together: a few points on each of thousands of images, without a call for each image.

A call of `RPC` takes as long as the arithmetic of a thousand points, and its first `RPC.localize` also needs a fit.
Here each point has the index of its RPC. NumPy gathers the coefficients for each point; for tens of thousands of points
the compiled loops of `compiled_rpc` are used. The order of terms is that of `rpc_terms`. From a few hundred points per
image on, `RPC` is faster.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..foundation.compiled_code import Arrays, is_wanted
from ..foundation.thresholds import EQUALITY, ITERATIONS, MEMORY
from ..ground.geodesy import metres_per_degree, wrap_degrees
from .rpc import RPC
from .rpc_terms import DERIVATIVES, EVALUATION, QUADRATIC_TERMS, chunks, monomials, slope_of_ratio, solve_pair


class RPCStack:
    """A sequence of RPCs; ``which (n,)`` are the indices of the points' RPCs."""

    def __init__(self, rpcs: Sequence[RPC]) -> None:
        self._rpcs = rpcs
        self._polynomials = np.stack([rpc.polynomials for rpc in rpcs])
        ground = [(r.long_off, r.lat_off, r.height_off, r.long_scale, r.lat_scale, r.height_scale) for r in rpcs]
        image = [(r.samp_off, r.line_off, r.samp_scale, r.line_scale) for r in rpcs]
        self._ground_off, self._ground_scale = np.split(np.array(ground), 2, axis=1)
        self._image_off, self._image_scale = np.split(np.array(image), 2, axis=1)

    def project(self, rpc_index: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return image points ``(n, 2)`` of ground points ``(n, 3)``, see `RPC.project`."""
        if is_wanted(len(ground) >= MEMORY.rows):
            return self._project_by_loops(rpc_index, ground)[0]
        image = np.empty((len(ground), 2))
        for part in chunks(len(ground)):
            rpc_part = rpc_index[part]
            ratios, _, _ = self._compute_ratios(rpc_part, self._normalise(rpc_part, ground[part]))
            image[part] = ratios * self._image_scale[rpc_part] + self._image_off[rpc_part]
        return image

    def project_with_metric_jacobian(self, rpc_index: np.ndarray, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return image points ``(n, 2)`` and derivatives ``(n, 2, 3)``, see `RPC.project_with_metric_jacobian`."""
        if is_wanted(len(ground) >= MEMORY.rows):
            return self._project_by_loops(rpc_index, ground)
        image, jacobian = np.empty((len(ground), 2)), np.empty((len(ground), 2, 3))
        for part in chunks(len(ground)):
            rpc_part = rpc_index[part]
            ratios, slopes = self._compute_slopes(rpc_part, self._normalise(rpc_part, ground[part]), 3)
            image[part] = ratios * self._image_scale[rpc_part] + self._image_off[rpc_part]
            jacobian[part] = slopes * self._image_scale[rpc_part][:, :, None] / self._ground_scale[rpc_part][:, None, :]
        return image, jacobian / metres_per_degree(ground)[:, None, :]

    def px_per_m(self, rpc_index: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the number of pixels per metre at ground points ``(n, 3)``, see `RPC.px_per_m`."""
        _, by_ground = self.project_with_metric_jacobian(rpc_index, ground)
        return np.asarray(np.sqrt(np.abs(np.linalg.det(by_ground[:, :, :2]))))

    def middles(self) -> np.ndarray:
        """Return the centres ``(rpcs, 3)`` lon, lat, height of the domains of the RPCs."""
        return self._ground_off.copy()

    def localize(self, rpc_index: np.ndarray, image: np.ndarray, height_m: np.ndarray | float) -> np.ndarray:
        """Return the ground points ``(n, 3)`` of image points ``(n, 2)`` at heights; NaN if there is none.

        Newton's iteration from the centre of each RPC's domain; points that do not converge inside the domain are
        computed by `RPC.localize`, with the same limits.
        """
        heights = np.broadcast_to(np.asarray(height_m, dtype=np.float64), (len(image),))
        ground = np.empty((len(image), 3))
        has_converged = np.empty(len(image), dtype=bool)
        solve = self._solve_by_loops if is_wanted(len(image) >= MEMORY.rows) else self._solve
        with np.errstate(all="ignore"):
            for part in chunks(len(image)):
                rpc_part = rpc_index[part]
                target = (image[part] - self._image_off[rpc_part]) / self._image_scale[rpc_part]
                height = (heights[part] - self._ground_off[rpc_part, 2]) / self._ground_scale[rpc_part, 2]
                place, least_error = solve(rpc_part, target, height, np.abs(self._image_scale[rpc_part]))
                ground[part, :2] = place * self._ground_scale[rpc_part, :2] + self._ground_off[rpc_part, :2]
                in_domain = (np.abs(place) <= EVALUATION.domain_margin).all(axis=1)
                has_converged[part] = (least_error <= EVALUATION.accepted_px) & in_domain
            ground[:, 2] = heights
            outside = np.abs(ground[:, 0]) > 180.0
            ground[outside, 0] = wrap_degrees(ground[outside, 0])
        failed = np.flatnonzero(~has_converged)
        for number in np.unique(rpc_index[failed]).tolist():
            rows = failed[rpc_index[failed] == number]
            ground[rows] = self._rpcs[number].localize(image[rows], heights[rows]).ground
        return ground

    def _solve(
        self, rpc_index: np.ndarray, target: np.ndarray, height: np.ndarray, scale_px: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised lon, lat ``(n, 2)`` of normalised image points and heights, and the errors in px."""
        normalised = np.zeros((len(rpc_index), 3))
        normalised[:, 2] = height
        best, least_error = normalised[:, :2].copy(), np.full(len(rpc_index), np.inf)
        for _ in range(ITERATIONS.most):
            ratios, slopes = self._compute_slopes(rpc_index, normalised, 2)
            miss = target - ratios
            error = np.abs(miss * scale_px).max(axis=1)
            better = error < least_error
            best[better], least_error[better] = normalised[better, :2], error[better]
            if not (better & (least_error > EQUALITY.rounding)).any():  # converged, or limited by rounding
                break
            a, b, c, d = slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 1, 0], slopes[:, 1, 1]
            normalised[:, :2] += np.column_stack(solve_pair(a, b, c, d, *miss.T))
        return best, least_error

    @cached_property
    def _tables(self) -> Arrays:
        from .compiled_rpc import rpc_tables  # needs numba, and its import takes a second

        return rpc_tables(self._rpcs)

    @cached_property
    def _normalised_tables(self) -> Arrays:
        from .compiled_rpc import normalise_tables

        return normalise_tables(self._tables)

    def _project_by_loops(self, rpc_index: np.ndarray, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the results of `project_with_metric_jacobian` by compiled loops."""
        from .compiled_rpc import project_points

        image, jacobian = np.empty((len(ground), 2)), np.empty((len(ground), 2, 3))
        project_points(self._tables, rpc_index, np.ascontiguousarray(ground), image, jacobian)
        return image, jacobian

    def _solve_by_loops(
        self, rpc_index: np.ndarray, target: np.ndarray, height: np.ndarray, scale_px: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the results of `_solve` by compiled loops."""
        from .compiled_rpc import invert_points

        place, least_error = np.empty((len(rpc_index), 2)), np.empty(len(rpc_index))
        invert_points(
            self._normalised_tables,
            rpc_index,
            target,
            height=height,
            scale_px=scale_px,
            closure_px=EQUALITY.rounding,
            steps=ITERATIONS.most,
            place=place,
            least_px=least_error,
        )
        return place, least_error

    def _normalise(self, rpc_index: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return normalised lon, lat, height ``(n, 3)``."""
        difference = ground - self._ground_off[rpc_index]
        difference[:, 0] = wrap_degrees(difference[:, 0])
        return np.asarray(difference / self._ground_scale[rpc_index])

    def _compute_ratios(
        self, rpc_index: np.ndarray, normalised: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return normalised sample and line, their denominators, each ``(n, 2)``, and the terms ``(n, 20)``."""
        terms = np.ascontiguousarray(monomials(np.ascontiguousarray(normalised.T)).T)
        values = np.einsum("npt,nt->np", self._polynomials[rpc_index], terms)
        return values[:, :2] / values[:, 2:], values[:, 2:], terms

    def _compute_slopes(
        self, rpc_index: np.ndarray, normalised: np.ndarray, axes: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised sample and line ``(n, 2)`` and their derivatives by the first axes ``(n, 2, axes)``."""
        ratios, denominators, terms = self._compute_ratios(rpc_index, normalised)
        slopes = np.empty((len(rpc_index), 2, axes))
        # The derivative of a polynomial: its coefficients times the derivatives of the terms, which are lower terms
        for axis in range(axes):
            lowered = terms[:, :QUADRATIC_TERMS] @ DERIVATIVES[axis].T
            values = np.einsum("npt,nt->np", self._polynomials[rpc_index], lowered)
            slopes[:, :, axis] = slope_of_ratio(values[:, :2], values[:, 2:], ratios, denominators)
        return ratios, slopes

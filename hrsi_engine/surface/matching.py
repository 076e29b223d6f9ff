"""Least-squares matching of points with a height surface: the displacement in three dimensions of best fit.

With the surface S, its gradient g and a displacement d = (e, n, u) of points at (E, N, H) the misclosures are::

    l = S(E + e, N + n) - H - u  =  (-g_e, -g_n, 1) · (change of d)

so slopes of different aspect convert height differences to plan (least-squares 3D surface matching, Gruen and Akca
2005; point-to-plane ICP, Chen and Medioni 1992; of DEMs, Nuth and Kääb 2011). This is linear only within the wavelength
of the relief. Therefore a grid of displacements in plan is searched first: the score is the robust scale of the
misclosures, the height their robust centre. The best local minima are refined, and those that remain separate are
compared: a periodic relief, or none, does not decide. If there are many points in a cell of the surface, their heights
are smoothed first, as its cells smooth the ground.

Neighbouring misclosures are correlated: buildings, trees, the noise of a radar DEM. The covariance is therefore that of
estimating equations summed over *cells* of the ground (sandwich of clustered observations, Liang and Zeger 1986), for
cells of increasing size; the largest covariance is used. The number of independent cells follows from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from ..foundation.robust_scale import MAD_TO_SIGMA, ROBUST
from ..foundation.thresholds import EQUALITY, ITERATIONS, MEMORY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..ground.geodesy import ground_difference_m, move_ground
from .dem import HeightSurface, cell_size_m

#: Displacements for the derivative of grid coordinates, which are linear over about 100 m.
_STEP_M = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]])


@thresholds
class SURFACE_MATCHING:
    """Search, refinement and covariance of the match of points with a surface."""

    most_points: int = threshold(8000, "points", "largest number of points in the refinement")
    coarse_steps: int = threshold(20, "steps", "steps from the middle to the end of the search, at least 1/4 cell")
    in_cell: float = threshold(1.0, "points", "mean number per cell above which their heights are averaged like cells")
    one_sided: float = threshold(2.0, "", "factor of misclosures by objects above a terrain model")
    steepest: float = threshold(1.5, "m/m", "slope above which cells are not used: walls, distorted by interpolation")
    uneven: float = threshold(0.7, "", "curvature of the surface over its slope, from which the weight is zero …")
    noise_alike: float = threshold(0.16, "", "correlation of noise at 1 cell less that at 3", "GLO-30: exp(-d / 300 m)")


@dataclass(frozen=True, eq=False)
class SurfaceMatch:
    """Displacement that fits points to a surface.

    displacement_m : (3,) east, north, up, to be added to the points
    covariance_m2 : (3, 3) covariance of the displacement, from the misclosures of independent cells
    scatter_m : robust standard deviation of the misclosures; before_m : the same without displacement in plan
    points, cells : number of points with a height of the surface, and of independent cells among them
    second_m : (3,) displacement of the next best minimum, None without; second_ratio : its scatter over the best
    offsets_m, scores_m : (k, 2), (k,) displacements in plan and scores of the search, None without a search
    """

    displacement_m: np.ndarray
    covariance_m2: np.ndarray
    scatter_m: float
    points: int
    cells: float
    before_m: float = np.nan
    second_m: np.ndarray | None = None
    second_ratio: float = np.inf
    offsets_m: np.ndarray | None = None
    scores_m: np.ndarray | None = None

    @property
    def is_decided(self) -> bool:
        """Whether the scatter of the next best minimum is significantly larger."""
        return bool(np.log(self.second_ratio) > SIGNIFICANCE.sigmas / np.sqrt(max(self.cells, 1.0)))

    def is_apart_from(self, second: SurfaceMatch, cell_m: float) -> bool:
        """Return whether this is another minimum: farther away than a cell, and significant by the covariances."""
        difference_m = self.displacement_m - second.displacement_m
        chi2 = difference_m @ np.linalg.solve(self.covariance_m2 + second.covariance_m2, difference_m)
        return bool(np.hypot(*difference_m[:2]) > cell_m and chi2 > SIGNIFICANCE.sigmas**2)


def match_surface(
    ground: np.ndarray, surface: HeightSurface, search_m: float, kind: str = "dsm", noise_m: float = 0.0
) -> SurfaceMatch | None:
    """Return the displacement that fits points to a surface; None if too few points have heights in it.

    ground : (n, 3) lon, lat in degrees, ellipsoidal height in metres
    search_m : largest displacement in plan, along each axis
    kind : ``dsm``, or ``dtm``, which has no trees and buildings
    noise_m : standard deviation of the noise of the surface's heights
    """
    return SurfaceMatcher(ground, surface, kind, None, noise_m).search(search_m) if len(ground) else None


class SurfaceMatcher:
    """Matches points, with variances ``(n,)`` of their heights, with a surface; arguments as of `match_surface`."""

    def __init__(
        self,
        ground: np.ndarray,
        surface: HeightSurface,
        kind: str = "dsm",
        variance_m2: np.ndarray | None = None,
        noise_m: float = 0.0,
    ) -> None:
        self.noise_m = noise_m
        self.surface, self.kind, self.cell_m = surface, kind, cell_size_m(surface, ground[0])
        place_m = ground_difference_m(ground, np.broadcast_to(ground[0], ground.shape))[:, :2]
        in_cell = len(ground) * self.cell_m**2 / max(float(np.prod(np.nanmax(place_m, 0) - np.nanmin(place_m, 0))), 1.0)
        largest_count = min(SURFACE_MATCHING.most_points, int(MEMORY.values / (1.0 + 9.0 * in_cell)))
        sample = np.arange(0, len(ground), 1 + len(ground) // largest_count)
        points, self.place_m = ground[sample], place_m[sample]
        self.own_m2 = np.zeros(len(points)) if variance_m2 is None else variance_m2[sample]
        self.height = points[:, 2]
        if in_cell > SURFACE_MATCHING.in_cell:
            # Heights smoothed as the cells of the surface smooth the ground
            height = ground[:, 2]
            valid = np.flatnonzero(np.isfinite(place_m).all(axis=1) & np.isfinite(height))
            usable = np.isfinite(self.place_m).all(axis=1)
            neighbours = KDTree(place_m[valid]).query_ball_point(
                np.where(usable[:, None], self.place_m, 0.0), 1.5 * self.cell_m, np.inf
            )
            count = np.array([len(one) for one in neighbours])
            first = np.repeat(np.arange(len(neighbours)), count)
            second = valid[np.concatenate([*neighbours, []]).astype(np.int64)]
            offset = np.abs(u := (place_m[second] - self.place_m[first]) / self.cell_m)
            weight = np.where(offset < 0.5, 0.75 - offset**2, 0.5 * (1.5 - offset) ** 2).prod(axis=1)
            A = np.column_stack([np.ones(len(u)), u])
            sums = [[np.bincount(first, weight * a * b, len(neighbours)) for b in (*A.T, height[second])] for a in A.T]
            N, h = np.moveaxis(np.array(sums)[:, :3], 2, 0), np.array(sums)[:, 3].T
            fit = np.linalg.solve(N + 1e-6 * np.eye(3), h[..., None])[:, 0, 0]
            self.height = np.where(usable & (count >= SAMPLES.tested), fit, np.nan)
        grid_xy, east, north = (surface.grid_coordinates(move_ground(points, step)[:, :2]) for step in _STEP_M)
        self._at, self._per_m = grid_xy, np.stack([east - grid_xy, north - grid_xy], axis=2) / _STEP_M.max()
        # The part of the ground that contains each point: parts with errors of their own
        offset = np.nan_to_num(self.place_m - np.nanmin(self.place_m, axis=0))
        of_points = float(np.sqrt(SAMPLES.tested * np.prod(offset.max(axis=0)) / len(offset)))
        side = max(SAMPLES.fewest * self.cell_m, of_points)
        self._part = np.unique(np.floor(offset / side).astype(np.int64) @ [1, 1 << 31], return_inverse=True)[1]

    def search(self, search_m: float) -> SurfaceMatch | None:
        """Return the best displacement within ``search_m`` along each axis, together with the next best minimum."""
        offsets, scores, middles = self._search_grid(search_m)
        refined = [self.refine(np.append(offsets[k], middles[k]), search_m) for k in _find_minima(scores)]
        minima = sorted((one for one in refined if one is not None), key=lambda one: one.scatter_m)
        if not minima:
            return None
        inside = [one for one in minima if np.abs(one.displacement_m[:2]).max() <= search_m + self.cell_m]
        best = (inside or minima)[0]
        apart_m = max(self.cell_m, search_m / SURFACE_MATCHING.coarse_steps)  # minima at smaller distances are the same
        # if all minima are outside, the search is not decided
        rivals = [one for one in inside if one.is_apart_from(best, apart_m)] if inside else minima
        second = next(iter(rivals), None)
        return replace(
            best,
            before_m=float(scores[np.argmin(np.abs(offsets).sum(axis=1))]),
            offsets_m=offsets,
            scores_m=scores,
            second_m=None if second is None else second.displacement_m,
            second_ratio=np.inf if second is None else second.scatter_m / best.scatter_m,
        )

    def refine(self, start_m: np.ndarray, reach_m: float) -> SurfaceMatch | None:
        """Return the least-squares displacement near a start; None if too few points have heights.

        The weights are those of Tukey's biweight, about the centre of the shortest half first, and of the smoothness of
        facets.

        start_m : (3,) east, north, up
        reach_m : a priori standard deviation in plan; it makes the normal equations of flat ground regular
        """
        d, ridge, cut = start_m.copy(), np.diag([reach_m**-2, reach_m**-2, 0.0]), ROBUST.rejected
        is_near = False  # relative to the robust centre first, then to the estimate, whose variance is smaller
        for _ in range(ITERATIONS.most):
            # Heights (9, n) at the displaced points, one cell to the east, west, north and south, and two cells
            sides = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
            facets = self._heights(d[:2] + self.cell_m * np.vstack([np.zeros(2), sides, 2.0 * sides]))
            miss = facets[0] - self.height - d[2]
            slope, wide = (
                np.column_stack([h[1] - h[2], h[3] - h[4]]) / (2.0 * k * self.cell_m)
                for k, h in ((1, facets[:5]), (2, facets[[0, 5, 6, 7, 8]]))
            )
            is_valid = np.isfinite(miss) & (np.hypot(*slope.T) < SURFACE_MATCHING.steepest)
            if is_valid.sum() < SAMPLES.trend:
                return None
            q, A = miss[is_valid], np.column_stack([-slope[is_valid], np.ones(is_valid.sum())])
            middle, scale = (float(one[0]) for one in shortest_half(q[None]))
            # the scale is that of typical points; the variances of others differ from it as their own variances do
            usual = scale**2 + 1e-6
            variance = np.maximum(usual + self.own_m2[is_valid] - np.median(self.own_m2[is_valid]), 0.25 * usual)
            t = (q - (0.0 if is_near else middle)) / np.sqrt(variance)
            t *= np.where(t < 0.0, SURFACE_MATCHING.one_sided if self.kind == "dtm" else 1.0, 1.0)
            inner = np.clip(1.0 - (t / cut) ** 2, 0.0, 1.0)
            weight = inner**2 / variance * _weigh_facets(facets[:, is_valid], scale)
            wide_A = np.column_stack([-np.where(np.isfinite(wide[is_valid]), wide[is_valid], 0.0), A[:, 2]])
            B, wide_B, r = np.split(
                _whiten(np.column_stack([A, wide_A, q]), weight, self._part[is_valid]), [3, 6], axis=1
            )
            N, r = B.T @ (weight[:, None] * B), r[:, 0]
            # Derivative of the estimating equations with respect to the displacement, made symmetric and positive
            M = B.T @ (weight[:, None] * wide_B)
            M = 0.5 * (M + M.T)
            of_mean = np.outer(M[:2, 2], M[:2, 2]) / M[2, 2]
            values, axes = np.linalg.eigh(M[:2, :2] - of_mean)
            noise = SURFACE_MATCHING.noise_alike * (min(self.noise_m, scale) / (2.0 * self.cell_m)) ** 2 * weight.sum()
            M[:2, :2] = (axes * np.maximum(values - noise, EQUALITY.negligible * np.abs(values))) @ axes.T + of_mean
            # N contains the noise, so that steps are too short, but never too long, as they would be if M is too small
            step = np.linalg.solve(N + ridge, B.T @ (weight * r))
            size = float(np.hypot(*step[:2]))
            if size < ITERATIONS.settled * self.cell_m and abs(step[2]) < 0.01 * scale:
                if is_near:
                    break
                is_near = True
            d = d + step * min(1.0, 2.0 * self.cell_m / size if size else 1.0)
        # Biweight: mean derivative of the influence function over mean weight
        steady = float(np.sum(inner * (1.0 - 5.0 * (t / cut) ** 2)) / max(np.sum(inner**2), 1e-9))
        N = max(steady, 0.1) * M + ridge
        score = B * (weight * (r - B @ step))[:, None]
        covariance, cells = _sum_over_cells(N, ridge, score, self.place_m[is_valid], self.cell_m)
        return SurfaceMatch(d, covariance, scale, int(is_valid.sum()), cells)

    def _heights(self, offsets_m: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the surface's heights ``(k, n)`` at points displaced by each of ``offsets_m (k, 2)``."""
        places = self._at[rows] + np.einsum("nij,kj->kni", self._per_m[rows], offsets_m)
        return self.surface.heights(places.reshape(-1, 2)).reshape(places.shape[:2])

    def _search_grid(self, search_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return offsets ``(k, 2)`` in plan, with score and height displacement of each; NaN with too few heights."""
        step = max(search_m / SURFACE_MATCHING.coarse_steps, 0.25 * self.cell_m)
        axis = step * np.arange(-int(search_m / step), int(search_m / step) + 1)
        offsets = np.stack(np.meshgrid(axis, axis), axis=2).reshape(-1, 2)
        valid = np.flatnonzero(np.isfinite(self._heights(np.zeros((1, 2)))[0]))
        rows = valid[:: 1 + len(valid) // SAMPLES.large]
        if len(rows) < SAMPLES.trend:
            return offsets, np.full(len(offsets), np.nan), np.zeros(len(offsets))
        miss = np.concatenate([self._heights(part, rows) - self.height[rows] for part in np.array_split(offsets, 16)])
        middle, score = shortest_half(miss)
        score[np.isfinite(miss).sum(axis=1) < EQUALITY.majority * len(rows)] = np.nan
        return offsets, score, middle


def _whiten(values: np.ndarray, weight: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return columns minus a share of their means over parts of the ground.

    The common error of the misclosures in a part (woods, long-wave noise of a radar DEM) is a random effect. With its
    variance u and the variance e of single points, generalised least squares subtract 1 - sqrt(e / (e + n u)) times the
    mean of its n points (Wallace and Hussain 1969).

    values : (n, k), the misclosures last; weight : (n,); part : (n,) number of each point's part, from 0
    """
    total = np.bincount(part, weight) + 1e-12
    means = np.stack([np.bincount(part, weight * column) / total for column in values.T], axis=1)
    points, q = len(values), means[:, -1]
    single = np.average((values[:, -1] - q[part]) ** 2, weights=weight + 1e-12) * points / max(points - len(total), 1)
    of_part = np.average((q - np.average(q, weights=total)) ** 2, weights=total) - single * len(total) / points
    count = total * points / total.sum()
    share = 1.0 - np.sqrt((single + 1e-9) / (single + 1e-9 + count * max(float(of_part), 0.0)))
    return np.asarray(values - share[part, None] * means[part])


def _weigh_facets(facets: np.ndarray, scale: float) -> np.ndarray:
    """Return weights ``(n,)`` of points by how smooth the surface is there.

    At the edge of a wall, or of cells with a wrong height, the slopes of the two sides differ. Such slopes have the
    largest leverage and the least information.

    facets : (9, n) heights at each point, and one cell to its east, west, north and south (the others are not used), m
    scale : standard deviation of the misclosures, m
    """
    weight = np.ones(facets.shape[1])
    for high, low in ((1, 2), (3, 4)):
        bend = np.abs(facets[high] + facets[low] - 2.0 * facets[0])
        ratio = bend / (np.abs(facets[high] - facets[low]) + SIGNIFICANCE.sigmas * scale)
        weight *= np.clip(1.0 - (ratio / SURFACE_MATCHING.uneven) ** 2, 0.0, 1.0) ** 2
    return weight


def shortest_half(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and scale ``(k,)`` of values ``(k, n)`` by the shortest interval that contains half of the known.

    The scale is converted to the standard deviation of a normal distribution; NaN if fewer than two values are known.
    Up to half of the values may be blunders on one side (Rousseeuw and Leroy 1987).
    """
    ordered = np.sort(values, axis=1)  # NaN last
    count = np.isfinite(ordered).sum(axis=1)
    middle, scale = np.full((2, len(values)), np.nan)
    for number in np.unique(count[count > 1]):
        rows, half = np.flatnonzero(count == number), int(number) // 2
        first = (ordered[rows, half:number] - ordered[rows, : number - half]).argmin(axis=1)
        low, high = ordered[rows, first], ordered[rows, first + half]
        middle[rows], scale[rows] = 0.5 * (low + high), 0.5 * MAD_TO_SIGMA * (high - low)
    return middle, scale


def _find_minima(scores: np.ndarray) -> np.ndarray:
    """Return the indices ``(k,)`` of the lowest local minima of a square grid of ``scores``, the lowest first."""
    side = int(np.sqrt(len(scores)))
    grid = np.pad(np.where(np.isfinite(scores), scores, np.inf).reshape(side, side), 1, constant_values=np.inf)
    neighbour_minimum = np.lib.stride_tricks.sliding_window_view(grid, (3, 3)).min(axis=(2, 3)).ravel()
    minima = np.flatnonzero((scores <= neighbour_minimum) & np.isfinite(scores))
    return minima[np.argsort(scores[minima])][: SAMPLES.tested]


def _sum_over_cells(
    N: np.ndarray, ridge: np.ndarray, score: np.ndarray, place_m: np.ndarray, cell_m: float
) -> tuple[np.ndarray, float]:
    """Return the covariance of the displacement by estimating equations summed over cells, and the number of these.

    With the derivative N of the equations and their sums s_c over cells it is N^-1 (sum s_c s_c') N^-1 (Liang and Zeger
    1986). The size of the cells is doubled until few are left; the largest covariance is returned.

    N, ridge : (3, 3) derivative, and its part by the prior in plan; score : (n, 3) estimating equations of the points
    place_m : (n, 2) east, north; cell_m : side of the smallest cells
    Result: ``(3, 3)`` m²; number of points divided by the variance factor of the largest sums.
    """
    inverse, single = np.linalg.inv(N), score.T @ score + 1e-9 * N
    largest, meat, side, offset_m = 1.0, single, cell_m, place_m - place_m.min(axis=0)
    while True:
        _, cell_index = np.unique(np.floor(offset_m / side).astype(np.int64) @ [1, 1 << 31], return_inverse=True)
        cells = int(cell_index.max()) + 1
        if cells < SAMPLES.fewest:
            break
        sums = np.stack([np.bincount(cell_index, column, cells) for column in score.T], axis=1)
        cell_meat = sums.T @ sums * cells / (cells - 3.0)
        factor = float(np.trace(np.linalg.solve(single, cell_meat))) / 3.0
        if factor > largest:
            largest, meat = factor, cell_meat
        side *= 2.0
    return inverse @ (meat + ridge) @ inverse, len(score) / largest

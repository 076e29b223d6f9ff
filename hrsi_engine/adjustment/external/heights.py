"""Heights of a DEM and of laser points as robustly weighted observations of the tie points' heights.

The observed height of a point is the one at its present position. Trees, buildings, clouds and holes make some of these
heights wrong by many standard deviations, which residuals hardly show in weak geometry: the point follows the height.
So each height is compared with that from the rays alone. With the cofactor q of the adjusted height, in which all
observed heights of the point have the weight w, that of the rays alone is q / (1 - q w), and with the mean t of these
heights

    height by rays = adjusted - (t - adjusted) q w / (1 - q w)        variance q / (1 - q w)

An observation (of a *source*) is a height for one point, or for the mean of several points around it, each with its
share. Its difference from the rays' height has the variance sigma² + q (q of the mean), most of which is that of the
rays in weak geometry; a doubtful height has its variance increased accordingly. `shared_errors` determines weights by
fit: alone, in groups, over all sources. A DEM that has to determine single points, whose rays hardly have a height,
keeps its weight there: they have little effect on the cameras.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from ...block.orthoimage import DEM, divide_area
from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import EQUALITY, REDUNDANCY, SAMPLES, threshold, thresholds
from ...ground.geodesy import metres_per_degree, move_ground
from ...ground.operation_uses import largest_sigma_m
from ...surface.dem import RAY_TRACING, HeightSurface, surface_heights
from ..equations import FREE_POINT_SIGMA_M, PointPriors
from ..source_results import HeightAgreement
from .shared_errors import (
    CommonError,
    ErrorSource,
    GroupHistory,
    OtherOffsets,
    SourceFit,
    compare_groups,
    estimate_sigma_factor,
)


@thresholds
class HEIGHTS:
    """Limits for the test of observed heights."""

    dem_whole: float = threshold(
        0.8,
        "",
        "part of a DEM's standard deviation that is an error common to all cells",
        "GLO-30: 4 m LE90 with noise of 1 to 3 m",
    )
    alike_m: float = threshold(100.0, "m", "side of cells whose heights are one observation in the jitter estimate")


class HeightRows(NamedTuple):
    """Observed heights at the points' present positions: one row for each point of each observation.

    point, of : (r,) index of the point and of the observation; share : (r,) of the point in the observation's mean,
        their sum 1
    height : (r,) ellipsoidal, at the point
    sigma_m, group : (o,) of the observations, and their group
    """

    point: np.ndarray
    of: np.ndarray
    share: np.ndarray
    height: np.ndarray
    sigma_m: np.ndarray
    group: np.ndarray


class HeightSource(ErrorSource, Protocol):
    """Interface of a source of heights."""

    def observe_heights(self, ground: np.ndarray, cofactors: np.ndarray) -> HeightRows:
        """Return the observed heights at the points' positions ``ground (m, 3)``, with their cofactors (m, 3, 3)."""


@dataclass(frozen=True, eq=False)
class DemHeights:
    """The heights of a DEM: the points ``(k,)`` for which they can be used, and their standard deviation."""

    dem: HeightSurface
    points: np.ndarray
    sigma_m: float
    tile: np.ndarray
    groups: tuple[str, ...]
    name: str = "DEM"
    determines_points: bool = True
    can_be_biased_as_a_whole: bool = True

    @classmethod
    def select_points(cls, dem: HeightSurface, points: np.ndarray, ground: np.ndarray, sigma_m: float) -> DemHeights:
        """Return the heights of a DEM for ``points (k,)`` of ``ground (m, 3)``, grouped by parts of the area."""
        part, names = divide_area(ground[points])
        return cls(dem, points, sigma_m, part, names)

    @property
    def common_m(self) -> float:
        return DEM.by_part * self.sigma_m

    @property
    def overall_m(self) -> float:
        datum_m = largest_sigma_m(getattr(self.dem, "operations", ()))[1]
        return float(np.hypot(DEM.by_all * self.sigma_m, datum_m))

    @property
    def weighting_sigma_m(self) -> float:
        return float(np.hypot(HEIGHTS.dem_whole * self.sigma_m, self.overall_m))

    def observe_heights(self, ground: np.ndarray, cofactors: np.ndarray) -> HeightRows:
        """Return the heights of the DEM at the points' positions, steep cells with larger standard deviations.

        In plan a point is known to the standard deviations of its cofactors. At a wall the height of the DEM changes
        there by more than its own standard deviation, and would alternate between roof and ground.
        """
        present = ground[self.points]
        height = surface_heights(self.dem, present[:, :2])
        finite = np.flatnonzero(np.isfinite(height))
        present, height, points, count = present[finite], height[finite], self.points[finite], len(finite)
        variance = np.full(count, self.sigma_m**2)
        for axis in (0, 1):
            step = np.zeros((count, 3))
            step[:, axis] = np.sqrt(np.maximum(cofactors[points, axis, axis], 0.0)) + EQUALITY.position_m
            change = [surface_heights(self.dem, move_ground(present, sign * step)[:, :2]) - height for sign in (-1, 1)]
            variance += np.nan_to_num(np.abs(change).max(axis=0)) ** 2
        return HeightRows(points, np.arange(count), np.ones(count), height, np.sqrt(variance), self.tile[finite])


class RpcHeights(NamedTuple):
    """Heights of points by the original RPCs: indices, heights ``(k,)``, and their common standard deviation."""

    points: np.ndarray
    height: np.ndarray
    sigma_m: float


@dataclass(frozen=True, eq=False)
class HeightObservations:
    """All sources of heights for the points of a block.

    free : (m,) True for points without surveyed height, for which heights can be observed
    estimate : True if the sources' sigmas are estimated
    by_rpcs : the block's height by the RPCs, used if sources contradict one another; None: not used
    surveyed : (g,) points with surveyed heights, which are compared with contradicting sources: a DEM can be wrong as a
        whole, and two GCPs that agree have more weight
    """

    sources: tuple[HeightSource, ...]
    free: np.ndarray
    estimate: bool = True
    by_rpcs: RpcHeights | None = None
    surveyed: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    memory: GroupHistory = field(default_factory=GroupHistory)

    def add_to_priors(
        self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray, by_cell: bool = False
    ) -> PointPriors:
        """Return the priors with the sources' heights at present positions, weighted by how well they fit.

        priors : of the points, with the heights of the last pass; ground : (m, 3) positions
        cofactors : (m, 3, 3) V^-1 of the positions for fixed cameras, with the ``priors``, m²
        by_cell : True if each height has the weight of its own sigma, after the median deviation of its source is
            subtracted: for the estimation of image errors that change along the lines, by which heights deviate, but
            which they do not share
        """
        count = len(ground)
        information, moment = np.zeros(count), np.zeros(count)
        is_seen, is_held = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        for one in self.fit_sources(priors, ground, cofactors):
            rows = one.rows
            is_used, weights, off_m = one.factor > 0.0, one.weights, 0.0
            if by_cell and len(one.difference_m):
                is_used, off_m = np.ones_like(is_used), float(np.median(one.difference_m))
                weights = 1.0 / (one.sigma_factor * rows.sigma_m) ** 2
            weight = rows.share * weights[rows.of]
            if by_cell:  # the heights of one cell share their error and count as one
                cell = np.floor(ground[rows.point] * metres_per_degree(ground[rows.point]) / HEIGHTS.alike_m)[:, :2]
                _, number, count_of = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
                weight = weight / count_of[number]
            information += np.bincount(rows.point, weight, count)
            moment += np.bincount(rows.point, weight * (rows.height - off_m - ground[rows.point, 2]), count)
            is_held[rows.point[is_used[rows.of]]] = True
            is_seen[rows.point] = True
        target, weights, observed = priors.target.copy(), priors.weight.copy(), priors.observed.copy()
        free = 1.0 / FREE_POINT_SIGMA_M**2
        unobserved = priors.observed[:, 2] & self.free & ~is_seen
        weights[unobserved, 2], observed[unobserved, 2] = free, False
        # The weak priors that keep the equations regular are moved to the points: from a distance they would bias them
        regular = ~observed & (weights == free)
        target[regular] = ground[regular]
        target[is_seen, 2] = ground[is_seen, 2] + moment[is_seen] / np.maximum(information[is_seen], free)
        weights[is_seen, 2] = np.maximum(information[is_seen], free)
        observed[is_seen, 2] = is_held[is_seen]
        return replace(priors, target=target, weight=weights, observed=observed)

    def fit_sources(
        self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray
    ) -> list[SourceFit[HeightRows]]:
        """Return each source's observations at the present positions, with their fit and weights; as `add_to_priors`.

        The heights h by the rays alone follow from the present ones g = (1 - q w) h + q w t, with the cofactors q and
        the targets t and weights w of the present priors; their variances are q / (1 - q w).
        """
        judged: list[SourceFit[HeightRows]] = []
        for source in self.sources:
            rows = source.observe_heights(ground, cofactors)
            q, w = cofactors[rows.point, 2, 2], priors.weight[rows.point, 2]
            by_rays = np.maximum(1.0 - q * w, REDUNDANCY.tested)
            held_by = priors.target[rows.point, 2] - ground[rows.point, 2]
            miss = rows.height - ground[rows.point, 2] + held_by * (1.0 / by_rays - 1.0)
            count = len(rows.sigma_m)
            one = SourceFit(
                source,
                rows,
                np.bincount(rows.of, rows.share * miss, count),
                np.bincount(rows.of, rows.share**2 * q / by_rays, count),
            )
            if self.estimate:
                one.sigma_factor = estimate_sigma_factor(one)
            one.weigh_by_fit(np.ones(count, dtype=bool))
            judged.append(one)
        # Differences of the surveyed heights that are used from the height by the rays alone
        points = self.surveyed[priors.observed[self.surveyed, 2]]
        points = points[:: -(-len(points) // SAMPLES.dense) or 1]
        q, w = cofactors[points, 2, 2], priors.weight[points, 2]
        by_rays = np.maximum(1.0 - q * w, REDUNDANCY.tested)
        miss, variance = (priors.target[points, 2] - ground[points, 2]) / by_rays, q / by_rays + 1.0 / w
        if len(points) > 2:  # sigmas of surveys are often guesses: their scatter is used
            variance = variance * max(float(robust_sigma((miss - np.median(miss)) / np.sqrt(variance))), 1.0) ** 2
        others = [OtherOffsets(miss, variance, CommonError(RAY_TRACING.accuracy_m, False))]
        if self.by_rpcs is not None:
            by_rpcs, sigma_m = self.by_rpcs, self.by_rpcs.sigma_m
            offset_m = np.array([np.median(by_rpcs.height - ground[by_rpcs.points, 2])])
            others.append(OtherOffsets(offset_m, np.array([sigma_m**2]), CommonError(sigma_m, True)))
        outlying = compare_groups(judged, self.memory, others)
        self.memory.surveys = (int(outlying[0].sum()) if outlying else 0), len(miss)
        for one in judged:
            one.reduce_shared_weights()
        return judged

    def find_unweighted_variance(
        self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray, precise: np.ndarray
    ) -> np.ndarray:
        """Return the variances ``(m,)`` of heights from a DEM's common error, as far as its weights do not include it.

        It is scaled by the DEM's share in the cameras' position; ``precise (m, 3, 3)`` are cofactors with the cameras'.
        """
        of_cameras, variance = np.maximum(precise[:, 2, 2] - cofactors[:, 2, 2], 0.0), np.zeros(len(ground))
        for one in self.fit_sources(priors, ground, cofactors):
            if isinstance(one.source, DemHeights) and one.weight > 0.0:
                beyond_m2 = max(one.source.weighting_sigma_m**2 - 1.0 / one.weight, 0.0)
                variance += np.minimum(of_cameras * one.weight, 1.0) ** 2 * beyond_m2
        return variance

    def summarise_sources(
        self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray, precise: np.ndarray
    ) -> tuple[tuple[HeightAgreement, ...], list[SourceFit[HeightRows]]]:
        """Return the agreement of each source with the adjusted points, and the fit of its observations.

        ``precise (m, 3, 3)`` are the cofactors of the positions including those of the cameras.
        """
        judged = self.fit_sources(priors, ground, cofactors)
        total = sum(one.weight for one in judged)
        of_cameras = np.maximum(precise[:, 2, 2] - cofactors[:, 2, 2], 0.0)
        return tuple(
            replace(_summarise_source(one, ground, total, cofactors[:, 2, 2], of_cameras), gcps=self.memory.surveys)
            for one in judged
            if len(one.difference_m)
        ), judged


def _summarise_source(
    one: SourceFit[HeightRows], ground: np.ndarray, total: float, of_points: np.ndarray, of_cameras: np.ndarray
) -> HeightAgreement:
    """Return a source's agreement with the adjusted points.

    ground : (m, 3) adjusted; total : weights of all sources in the block's height, 1/m²
    of_points, of_cameras : (m,) variances of the heights with fixed cameras, and by the cameras' errors, m²
    """
    rows, is_used = one.rows, one.factor > 0.0
    count = len(one.difference_m)
    differences = np.bincount(rows.of, rows.share * (ground[rows.point, 2] - rows.height), count)
    used_m, left_out_m = differences[is_used], differences[~is_used]
    cofactor = np.bincount(rows.of, rows.share**2 * of_points[rows.point] + rows.share * of_cameras[rows.point], count)
    return HeightAgreement(
        source=one.source.name,
        observations=count,
        left_out=int((~is_used).sum()),
        determines=float(np.sum(np.minimum(one.weights * cofactor, 1.0))),
        rmse_m=float(np.sqrt(np.mean(used_m**2))) if used_m.size else float("nan"),
        left_out_median_m=float(np.median(left_out_m)) if left_out_m.size else float("nan"),
        sigma_m=float(one.sigma_factor * np.median(rows.sigma_m)),
        sigma_factor=one.sigma_factor,
        share=one.weight / total if total > 0.0 else float("nan"),
        alone_m=one.offset_m,
        groups=tuple(one.groups),
    )

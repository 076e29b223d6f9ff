"""Laser points as heights of the tie points around them.

A laser point is the mean height of the ground in its footprint, where there is no tie point. The tie points within some
metres determine the ground's shape: their heights z, at d from the laser point, are a plane with blunders (roofs,
canopy)::

    z_i = a + s d_i + e_i        s ~ N(0, slope sigma²)        e_i ~ N(0, scatter² + (roughness |d_i|)²)

solved for the level a and the slope s by iterated reweighting. The laser height h then observes each of these tie
points at ``h + s d_i``, and their mean, with the shares ``1 / var e_i``, at the height of the laser. Its variance is
the laser's own (as stated in its file, and a common part) and that of the ground between: the slope's standard
deviation times the mean distance, that of the laser's plan position times the slope, and the ground's roughness.

Planes are estimated again when the block has moved.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...block.laser import LASER_HEIGHT, LaserPoints
from ...foundation.large_arrays import finite_rows
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import EQUALITY, SAMPLES, threshold, thresholds
from ...ground.geodesy import LocalFrame, ground_difference_m, metres_per_degree
from ..source_results import LaserOutcome
from .heights import HeightRows
from .shared_errors import SourceFit

NAME = "laser"


@thresholds
class LASER_FIT:
    """Limits for the comparison of laser heights with the heights of tie points."""

    slope_sigma: float = threshold(0.2, "m/m", "a priori standard deviation of the ground's slope")
    roughness: float = threshold(0.02, "m/m", "standard deviation of the ground about the plane, per distance")
    place_sigma_m: float = threshold(
        4.0, "m", "error of a laser point in plan", "ICESat-2: 3.5 m (Luthcke et al. 2021)"
    )
    track_sigma_m: float = threshold(0.1, "m", "sigma of the error common to a track: orbit and pointing")
    overall_sigma_m: float = threshold(0.05, "m", "sigma of the error common to all laser points: tides, datum")
    uneven_m: float = threshold(2.0, "m", "largest scatter of tie points about the plane of a laser point in use")
    moved_m: float = threshold(1.0, "m", "shift of the block in plan after which the planes are fitted again")


PLANE_ROUNDS = 5
NO_TIES_NEAR, UNEVEN = "no tie points near it", "tie points near it are at different heights"
MISFIT = "does not fit the block"


class Planes(NamedTuple):
    """Planes of the ground: slope (n, 2), its covariance (n, 2, 2), shares of the points (n, k), scatter (n,)."""

    slope: np.ndarray
    covariance: np.ndarray
    share: np.ndarray
    scatter_m: np.ndarray


def fit_planes(away_m: np.ndarray, height_m: np.ndarray, is_near: np.ndarray) -> Planes:
    """Return the planes through the points ``is_near`` (mask) at ``away_m (n, k, 2)`` from places, ``height_m (n, k)``.

    Points that deviate from the plane by more than `ROBUST.full_weight` times their scatter lose their weight.
    """
    rough = (LASER_FIT.roughness * np.linalg.norm(away_m, axis=2)) ** 2
    level = np.nanmedian(np.where(is_near, height_m, np.nan), axis=1)
    scatter = np.full(len(level), EQUALITY.position_m)
    weight = np.where(is_near, 1.0, 0.0)
    design = np.concatenate([np.ones((*away_m.shape[:2], 1)), np.where(is_near[..., None], away_m, 0.0)], axis=2)
    height = np.where(is_near, height_m - level[:, None], 0.0)
    prior = np.diag([1e-9, LASER_FIT.slope_sigma**-2, LASER_FIT.slope_sigma**-2])
    for _ in range(PLANE_ROUNDS):
        w = weight / (scatter[:, None] ** 2 + rough)
        normal = np.einsum("nki,nk,nkj->nij", design, w, design) + prior
        solution = np.linalg.solve(normal, np.einsum("nki,nk,nk->ni", design, w, height)[..., None])[..., 0]
        left = np.abs(height - np.einsum("nki,ni->nk", design, solution))
        middle = np.nanmedian(np.where(is_near, left, np.nan), axis=1)
        is_redundant = is_near.sum(axis=1) > 3
        scatter = np.where(is_redundant, np.maximum(1.4826 * middle, EQUALITY.position_m), EQUALITY.position_m)
        t = left / np.sqrt(scatter[:, None] ** 2 + rough)
        weight = np.where(is_near, (ROBUST.full_weight / np.maximum(t, ROBUST.full_weight)) ** 3, 0.0)
    covariance = np.linalg.inv(normal)[:, 1:, 1:]
    share = weight / (scatter[:, None] ** 2 + rough)
    return Planes(solution[:, 1:], covariance, share / share.sum(axis=1, keepdims=True), scatter)


@dataclass(eq=False)
class LaserHeights:
    """The heights of laser points as observations of the tie points around them.

    laser : the points; usable : (n,) indices of those without reasons against their use
    ties : (k,) indices of the points of the adjustment that they may observe
    reach_m : largest distance from a laser point; sigma_m : of every laser height, added to that of its file
    """

    laser: LaserPoints
    usable: np.ndarray
    ties: np.ndarray
    reach_m: float
    sigma_m: float
    name: str = NAME
    determines_points: bool = False
    can_be_biased_as_a_whole: bool = False
    common_m: float = LASER_FIT.track_sigma_m
    chosen: np.ndarray = field(init=False)  #: (o,) indices of the laser points with tie points, in the order of `rows`
    uneven: np.ndarray = field(init=False)  #: (…,) indices of those whose tie points have no common height
    _planned: _TiesOfPoints | None = None

    def __post_init__(self) -> None:
        names, track = np.unique(self.laser.track, return_inverse=True)
        self.groups = tuple(f"track {name}" if name else "track without a name" for name in names.tolist())
        self._track = track

    @property
    def overall_m(self) -> float:
        return float(np.hypot(LASER_FIT.overall_sigma_m, self.laser.operation_sigma_m[1]))

    weighting_sigma_m = overall_m

    def observe_heights(self, ground: np.ndarray, _cofactors: np.ndarray) -> HeightRows:
        """Return the laser heights at the tie points around them, reduced along the plane of the ground.

        ground : (m, 3) positions of all points; tie points are assigned again if they moved by more than
            `LASER_FIT.moved_m`
        """
        plan = self._planned
        if plan is None or plan.shift_m(ground) > LASER_FIT.moved_m:
            plan = self._planned = self._find_ties(ground)
            self.chosen, self.uneven = plan.laser, plan.uneven
        lasers = self.laser.ground[plan.laser[plan.of]]
        away_m = ground_difference_m(lasers, ground[plan.point])[:, :2]
        height = lasers[:, 2] - np.einsum("rc,rc->r", plan.slope[plan.of], away_m)
        return HeightRows(plan.point, plan.of, plan.share, height, plan.sigma_m, self._track[plan.laser])

    def report_points(self, judged: SourceFit[HeightRows], ground: np.ndarray) -> LaserOutcome:
        """Return the result of each laser point, by the fit ``judged`` of its observation to ``ground (m, 3)``."""
        count, rows = len(self.laser), judged.rows
        reason = self.laser.doubt.astype("U64")
        reason[self.usable] = NO_TIES_NEAR
        reason[self.uneven] = UNEVEN
        reason[self.chosen] = np.where(judged.factor > 0.0, "", MISFIT)
        for group in judged.groups:
            if group.left_out:
                reason[self.chosen[rows.group == self.groups.index(group.name)]] = f"its track {MISFIT}"
        ties, residual, sigma = np.zeros(count, dtype=np.int64), np.full(count, np.nan), np.full(count, np.nan)
        ties[self.chosen] = np.bincount(rows.of, minlength=len(self.chosen))
        weighted_difference = rows.share * (rows.height - ground[rows.point, 2])
        residual[self.chosen] = np.bincount(rows.of, weighted_difference, len(self.chosen))
        sigma[self.chosen] = judged.sigma_factor * rows.sigma_m
        return LaserOutcome(self.laser, reason, ties, residual, sigma)

    def _find_ties(self, ground: np.ndarray) -> _TiesOfPoints:
        """Return the tie points that each laser point observes, and the planes of the ground between them."""
        laser = self.laser.ground[self.usable]
        placed = self.ties[finite_rows(ground[self.ties])]
        if not len(laser) or not len(placed):
            return _TiesOfPoints.make_empty(ground)
        frame = LocalFrame(*ground[placed[0]])
        ties, places = ground[placed], laser
        flat, at = frame.from_ground(ties)[:, :2], frame.from_ground(places)[:, :2]
        distance, near = cKDTree(flat).query(at, k=min(SAMPLES.fewest, len(placed)), distance_upper_bound=self.reach_m)
        distance, near = distance.reshape(len(at), -1), near.reshape(len(at), -1)
        kept = np.flatnonzero(np.isfinite(distance).any(axis=1))
        if not len(kept):
            return _TiesOfPoints.make_empty(ground)
        there = np.isfinite(distance[kept])
        index = np.where(there, near[kept], 0)
        away = np.where(there[..., None], flat[index] - at[kept][:, None], 0.0)
        planes = fit_planes(away, ties[index, 2], there)
        even = planes.scatter_m <= LASER_FIT.uneven_m
        own = np.nan_to_num(self.laser.sigma_m[self.usable[kept]], nan=LASER_HEIGHT.sigma_m)
        mean_away = np.einsum("nk,nkc->nc", planes.share, away)
        between = np.einsum("nc,ncd,nd->n", mean_away, planes.covariance, mean_away)
        rough = np.einsum("nk,nk->n", planes.share**2, (LASER_FIT.roughness * np.linalg.norm(away, axis=2)) ** 2)
        place_sigma_m = np.hypot(LASER_FIT.place_sigma_m, self.laser.operation_sigma_m[0])
        place = (place_sigma_m * np.linalg.norm(planes.slope, axis=1)) ** 2 / 2.0
        sigma = np.sqrt(own**2 + self.sigma_m**2 + between + rough + place)
        of, column = np.nonzero((there & (planes.share > 0.0))[even])
        return _TiesOfPoints(
            laser=self.usable[kept[even]],
            uneven=self.usable[kept[~even]],
            point=placed[index[even][of, column]],
            of=of,
            share=planes.share[even][of, column],
            slope=planes.slope[even],
            sigma_m=sigma[even],
            middle=ground[placed].mean(axis=0),
            placed=placed,
        )


class _TiesOfPoints(NamedTuple):
    """Tie points that laser points observe: point, of, share (r,); laser, slope, sigma_m (o, …); mean position."""

    laser: np.ndarray
    uneven: np.ndarray
    point: np.ndarray
    of: np.ndarray
    share: np.ndarray
    slope: np.ndarray
    sigma_m: np.ndarray
    middle: np.ndarray
    placed: np.ndarray

    @classmethod
    def make_empty(cls, ground: np.ndarray) -> _TiesOfPoints:
        """Return an empty assignment of tie points."""
        none = np.zeros(0, dtype=np.int64)
        return cls(
            laser=none,
            uneven=none,
            point=none,
            of=none,
            share=np.zeros(0),
            slope=np.zeros((0, 2)),
            sigma_m=np.zeros(0),
            middle=np.full(3, np.nan),
            placed=none,
        )

    def shift_m(self, ground: np.ndarray) -> float:
        """Return the distance in plan by which the mean tie point has moved, m; infinite without tie points.

        ground : (m, 3) present positions of all points
        """
        if not len(self.placed):
            return np.inf
        offset_m = (ground[self.placed, :2].mean(axis=0) - self.middle[:2]) * metres_per_degree(ground[:1])[0, :2]
        return float(np.hypot(*offset_m))

"""Heights of the ground as observations of the tie points' heights: a DEM's, those of laser points; robustly, together.

The height that holds a point is the one at its present position. Trees, buildings, clouds and holes make some of these
heights wrong by many standard deviations, which hardly shows in weak geometry: the point simply follows. So each height
is judged against the one that the rays alone give. With the cofactor q of the adjusted height, in which all heights
that hold the point have the weight w, that of the rays alone is q / (1 - q w), and with t for the mean of these heights

    height by rays = adjusted - (t - adjusted) q w / (1 - q w)        variance q / (1 - q w)

An observation (of a *source*) is a height for one point, or for the mean of several that stand around it, each with its
share. Its difference from the rays' height has the variance sigma² + q (q of the mean). Its weight, the inverse of that
variance, stays as it is up to `FITTING` standard deviations and falls to nothing at `WRONG`; in weak geometry most of
the variance is that of the rays, so a doubtful height gets a variance that makes up for it. Differences are counted
from the middle of their source (a block without height control may lie off as a whole, which must not silence a DEM).

Observations come in *groups* that share errors: the points of one laser track, the cells of one part of a DEM; and a
source has an error of its own. With the standard deviation c of what a group shares and the weight W of the group, the
group is worth W / (1 + c² W); so its weights are divided by 1 + c² W, and those of a source likewise: thousands of
heights of a DEM count as few. Where a DEM is there to hold single points whose rays hardly tell a height, it keeps its
weight there: the cameras have little from these. Whole groups are tested against one another, over all sources: what
they say of the block's height is robustly joined (`agree_on`), and a group that lies off by more than `GROUP_WRONG` of
its standard deviations is named and left out.

The sigma of a source is a variance component: the factor by which its differences, within groups, are larger or smaller
than their standard deviations let expect, as far as these are not those of the rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from ..foundation.robust_scale import robust_sigma
from ..ground.geodesy import ground_difference_m
from ..surface.dem import HeightSurface, surface_heights
from .equations import FREE_POINT_SIGMA_M, PointPriors
from .result import HeightAgreement, HeightGroup

LOST = 1e-3  # weight factor below which a height counts as left out
FITTING, WRONG = 2.5, 4.0
CUT_AT, CUTS = 2.5, 20
LEAST_BY_RAYS = 1e-4  # share of a height that comes from rays; below, nothing judges what holds it
GROUP_WRONG = 3.5  # standard deviations beyond which a group disagrees with the others
DECIDED_BY = 4.0  # by how much (chi²) one opinion on the block's height must be better than another one
LEAST_OF_GROUP = 3  # observations, below which a group is judged by its members alone
BELIEVED = 20.0  # observations that the sigma as given counts for in its variance component
SIGMA_FACTORS, HALVINGS = (0.5, 5.0), 12  # of a sigma, and steps to find one
DEM_TILE_M, DEM_TILES = 500.0, 4  # least side of the parts of a DEM that are tested as such; most of them a side
DEM_COMMON = 0.4  # of a DEM's sigma: what the cells of a part share, and again what all of it shares


class HeightRows(NamedTuple):
    """Observed heights at the points as they lie: one row for each point that an observation speaks of.

    point, of : (r,) index of the point and of the observation; share : (r,) of the observation's mean, their sum 1
    height : (r,) ellipsoidal, at the point
    sigma_m, group : (o,) of the observations, and their group
    """

    point: np.ndarray
    of: np.ndarray
    share: np.ndarray
    height: np.ndarray
    sigma_m: np.ndarray
    group: np.ndarray


class HeightSource(Protocol):
    """Where heights come from."""

    @property
    def name(self) -> str:
        """What reports call it."""

    @property
    def groups(self) -> Sequence[str]:
        """Names of its groups."""

    @property
    def holds_points(self) -> bool:
        """Whether it is there to hold single points too, not the block alone."""

    @property
    def wrong_together(self) -> bool:
        """Whether one fault may spoil all of it."""

    @property
    def common_m(self) -> float:
        """Standard deviation of what a group shares."""

    @property
    def overall_m(self) -> float:
        """Standard deviation of what all of the source shares."""

    def rows(self, ground: np.ndarray) -> HeightRows:
        """Return the heights for points at ``ground (m, 3)``."""


@dataclass(frozen=True, eq=False)
class DemHeights:
    """The heights of a DEM: which points ``(k,)`` it may hold, and with what standard deviation."""

    dem: HeightSurface
    points: np.ndarray
    sigma_m: float
    tile: np.ndarray
    groups: tuple[str, ...]
    name: str = "DEM"
    holds_points: bool = True
    wrong_together: bool = True

    @classmethod
    def of(cls, dem: HeightSurface, points: np.ndarray, ground: np.ndarray, sigma_m: float) -> DemHeights:
        """Return the heights of a DEM for ``points (k,)`` of ``ground (m, 3)``, in parts of the area."""
        if not len(points):
            return cls(dem, points, sigma_m, np.zeros(0, dtype=np.int64), ())
        away = ground_difference_m(ground[points], np.broadcast_to(ground[points[0]], (len(points), 3)))[:, :2]
        low, size = away.min(axis=0), np.ptp(away, axis=0)
        side = max(DEM_TILE_M, float(size.max()) / DEM_TILES)
        columns, rows = np.maximum(np.ceil(size / side), 1).astype(int)
        place = np.minimum(((away - low) / side).astype(np.int64), [columns - 1, rows - 1])
        numbers, tile = np.unique(place[:, 1] * columns + place[:, 0], return_inverse=True)
        names = []
        for number in range(len(numbers)):
            lon, lat = np.median(ground[points[tile == number], :2], axis=0)
            names.append(f"part about {lon:.4f}, {lat:.4f}")
        return cls(dem, points, sigma_m, tile, tuple(names))

    @property
    def common_m(self) -> float:
        return DEM_COMMON * self.sigma_m

    @property
    def overall_m(self) -> float:
        return DEM_COMMON * self.sigma_m

    def rows(self, ground: np.ndarray) -> HeightRows:
        """Return the heights of the DEM where the points lie."""
        height = surface_heights(self.dem, ground[self.points, :2])
        known = np.flatnonzero(np.isfinite(height))
        count = len(known)
        return HeightRows(
            self.points[known], np.arange(count), np.ones(count), height[known], np.full(count, self.sigma_m),
            self.tile[known],
        )  # fmt: skip


@dataclass(eq=False)
class Judged:
    """What is thought of a source's observations.

    rows : the observations as they were judged
    miss_m, of_rays : (o,) height - height by rays, and the variance of the latter
    sigma_factor : the variance component
    factor : (o,) of the weight by how well an observation fits, 0 where it is left out
    left : (o,) share of the weight that is left where errors are shared
    groups : what the groups say; offset_m : what all say of the block's height together; weight : 1/m², of that
    """

    source: HeightSource
    rows: HeightRows
    miss_m: np.ndarray
    of_rays: np.ndarray
    sigma_factor: float = 1.0
    factor: np.ndarray = field(default_factory=lambda: np.zeros(0))
    left: np.ndarray = field(default_factory=lambda: np.zeros(0))
    groups: list[HeightGroup] = field(default_factory=list)
    offset_m: float = float("nan")
    weight: float = 0.0

    @property
    def variance(self) -> np.ndarray:
        """Variances ``(o,)`` that the differences should have."""
        return np.asarray((self.sigma_factor * self.rows.sigma_m) ** 2 + self.of_rays)

    def fit(self, trusted: np.ndarray) -> None:
        """Find how well each observation fits the ``trusted (o,)`` ones; the others are left out."""
        self.factor = np.zeros(len(self.miss_m))
        if trusted.any():
            sigma = np.sqrt(self.variance[trusted])
            middle, scale = _core(self.miss_m[trusted], sigma)
            self.factor[trusted] = falling(np.abs(self.miss_m[trusted] - middle) / (scale * sigma))

    def share_out(self) -> None:
        """Find what is left of the weights where groups, and all of the source, share errors."""
        source, group, count = self.source, self.rows.group, len(self.source.groups)
        weight = self.factor / self.variance
        of_group = np.bincount(group, weight, count)
        left = 1.0 / (1.0 + source.common_m**2 * of_group)
        total = float((of_group * left).sum())
        self.left = left[group] / (1.0 + source.overall_m**2 * total)
        if source.holds_points:
            self.left = self.left ** (1.0 - self.of_rays / self.variance)
        weight = weight * self.left
        self.weight = float(weight.sum())
        if self.weight > 0.0:
            self.offset_m = float(weight @ self.miss_m / self.weight)


@dataclass(frozen=True, eq=False)
class HeldHeights:
    """All sources of heights that hold points of a block.

    free : (m,) which points may be held: those whose height no survey gives
    estimate : whether the sources' sigmas are estimated
    """

    sources: tuple[HeightSource, ...]
    free: np.ndarray
    estimate: bool = True

    def apply(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> PointPriors:
        """Return the priors with the sources' heights at positions ``(m, 3)``, weighted by how well they fit.

        ``cofactors (m, 3, 3)`` are those of the positions, for the cameras as they are, under the ``priors``.
        """
        count = len(ground)
        information, moment = np.zeros(count), np.zeros(count)
        seen, held = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        for one in self.judge(priors, ground, cofactors):
            rows = one.rows
            with np.errstate(divide="ignore"):
                variance = one.variance / (one.factor * one.left) - one.of_rays
            weight = rows.share / variance[rows.of]
            information += np.bincount(rows.point, weight, count)
            moment += np.bincount(rows.point, weight * (rows.height - ground[rows.point, 2]), count)
            held[rows.point[one.factor[rows.of] > 0.0]] = True
            seen[rows.point] = True
        target, weights, observed = priors.target.copy(), priors.weight.copy(), priors.observed.copy()
        free = 1.0 / FREE_POINT_SIGMA_M**2
        gone = priors.observed[:, 2] & self.free & ~seen
        weights[gone, 2], observed[gone, 2] = free, False
        # The weak priors that only keep equations regular follow the block: from afar they would pull, and cost nothing
        regular = ~observed & (weights == free)
        target[regular] = ground[regular]
        target[seen, 2] = ground[seen, 2] + moment[seen] / np.maximum(information[seen], free)
        weights[seen, 2] = np.maximum(information[seen], free)
        observed[seen, 2] = held[seen]
        return replace(priors, target=target, weight=weights, observed=observed)

    def judge(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> list[Judged]:
        """Return what the sources say at positions ``(m, 3)``, and how well each observation fits; as `apply`."""
        judged = []
        for source in self.sources:
            rows = source.rows(ground)
            q, w = cofactors[rows.point, 2, 2], priors.weight[rows.point, 2]
            by_rays = np.maximum(1.0 - q * w, LEAST_BY_RAYS)
            held_by = priors.target[rows.point, 2] - ground[rows.point, 2]
            miss = rows.height - ground[rows.point, 2] + held_by * (1.0 / by_rays - 1.0)
            count = len(rows.sigma_m)
            one = Judged(
                source, rows, np.bincount(rows.of, rows.share * miss, count),
                np.bincount(rows.of, rows.share**2 * q / by_rays, count),
            )  # fmt: skip
            if self.estimate:
                one.sigma_factor = _sigma_factor(one)
            one.fit(np.ones(count, dtype=bool))
            judged.append(one)
        _compare(judged)
        for one in judged:
            one.share_out()
        return judged

    def agreement(
        self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray
    ) -> tuple[tuple[HeightAgreement, ...], list[Judged]]:
        """Return how each source agrees with the adjusted points, and what was thought of its observations."""
        judged = self.judge(priors, ground, cofactors)
        total = sum(one.weight for one in judged)
        return tuple(_agreement(one, ground, total) for one in judged if len(one.miss_m)), judged


def falling(t: np.ndarray) -> np.ndarray:
    """Return the weight of a height ``t`` standard deviations off: 1 up to `FITTING`, 0 from `WRONG` (Hampel 1974)."""
    factor = np.clip((WRONG - t) / (WRONG - FITTING), 0.0, 1.0)
    return np.where(factor > LOST, factor, 0.0)


def _core(apart: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Return the median of the bulk of the differences and by how much their sigmas are too small (1 or more).

    Differences far from the median are cut off again and again: a quarter of treetops must not widen the scale.
    """
    middle, scale = float(np.median(apart)), np.inf
    core = np.ones(len(apart), dtype=bool)
    for _ in range(CUTS):
        t = (apart - middle) / sigma
        scale = max(float(robust_sigma(t[core])), 1.0)
        inside = np.abs(t) <= CUT_AT * scale
        middle = float(np.median(apart[inside]))
        if np.array_equal(inside, core):
            break
        core = inside
    return middle, scale


def _sigma_factor(one: Judged) -> float:
    """Return the factor of a source's sigmas that makes the differences within its groups as large as they should be.

    Observations count as far as their own sigma, not that of the rays, makes their variance.
    """
    rows = one.rows
    apart, own = np.full(len(one.miss_m), np.nan), rows.sigma_m**2
    for group in range(len(one.source.groups)):
        here = rows.group == group
        if here.sum() >= LEAST_OF_GROUP:
            apart[here] = one.miss_m[here] - np.median(one.miss_m[here])
    known = np.isfinite(apart)
    if not known.any():
        return 1.0
    telling = float((own[known] / (own + one.of_rays)[known]) @ (own[known] / (own + one.of_rays)[known]))
    low, high = SIGMA_FACTORS
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        wide = robust_sigma(apart[known] / np.sqrt(middle**2 * own[known] + one.of_rays[known])) < 1.0
        low, high = (low, middle) if wide else (middle, high)
    return float(np.sqrt((BELIEVED + telling * low * high) / (BELIEVED + telling)))


def _opinions(one: Judged, source: int) -> list[Opinion]:
    """Return what the groups of a source say of the block's height."""
    found = []
    for group in range(len(one.source.groups)):
        here = one.rows.group == group
        if here.sum() < LEAST_OF_GROUP:
            continue
        miss, variance = one.miss_m[here], one.variance[here]
        middle, scale = _core(miss, np.sqrt(variance))
        core = np.abs(miss - middle) <= CUT_AT * scale * np.sqrt(variance)
        own = 0.5 * np.pi * scale**2 / float((1.0 / variance[core]).sum())  # of a median
        found.append(Opinion(source, group, middle, own + one.source.common_m**2, int(here.sum())))
    return found


def _compare(judged: Sequence[Judged]) -> None:
    """Test the groups of all sources against one another; leave out those that lie off."""
    opinions = [opinion for number, one in enumerate(judged) for opinion in _opinions(one, number)]
    sources = [SharedError(one.source.overall_m, one.source.wrong_together) for one in judged]
    off, decided, middle = agree_on(opinions, sources)
    for opinion, wrong in zip(opinions, off.tolist(), strict=True):
        one = judged[opinion.source]
        one.groups.append(HeightGroup(
            one.source.groups[opinion.group], opinion.observations, opinion.offset_m - middle,
            float(np.hypot(np.sqrt(opinion.variance), one.source.overall_m)), wrong, wrong and decided,
        ))  # fmt: skip
    for number, one in enumerate(judged):
        wrong_groups = [opinion.group for opinion, wrong in zip(opinions, off, strict=True)
                        if wrong and opinion.source == number]  # fmt: skip
        if decided and wrong_groups:
            one.fit(~np.isin(one.rows.group, wrong_groups))


class Opinion(NamedTuple):
    """What a group says of the block's height: its offset and variance; from how many observations of which source."""

    source: int
    group: int
    offset_m: float
    variance: float
    observations: int


class SharedError(NamedTuple):
    """What all of a source may be off by: standard deviation, and whether one fault may spoil all of it at once."""

    sigma_m: float
    wrong_together: bool


def agree_on(opinions: Sequence[Opinion], sources: Sequence[SharedError]) -> tuple[np.ndarray, bool, float]:
    """Return which opinions are wrong, whether that is decided, and what the others say.

    With the block's height m, a shared error b of each source (standard deviation s), and opinions o of variance v, the
    squares ``b² / s²`` of the sources and ``(o - m - b)² / v`` of the opinions, each cut at `GROUP_WRONG`², are made as
    small as possible over all m that an opinion has. A DEM that stands on trees is one fault, however many its parts;
    of laser tracks each has to be wrong by itself. It is not decided where a height that contradicts the best one is
    nearly as good: two tracks that differ, say.
    """
    offset = np.array([one.offset_m for one in opinions])
    if len(offset) < 2:
        return np.zeros(len(offset), dtype=bool), True, float(offset.sum())
    variance = np.array([one.variance for one in opinions])
    of = np.array([one.source for one in opinions])
    tried = [_joined_at(float(m), offset, variance, of, sources) for m in offset]
    costs = np.array([cost for cost, _ in tried])
    best = int(np.argmin(costs + 1e-9 * variance))
    wrong = tried[best][1]
    decided = not any((at & ~wrong).any() for cost, at in tried if cost < costs[best] + DECIDED_BY)
    weight = ~wrong / (variance + np.array([sources[k].sigma_m for k in of]) ** 2)
    return wrong, decided, float(weight @ offset / weight.sum())


def _joined_at(
    m: float, offset: np.ndarray, variance: np.ndarray, of: np.ndarray, sources: Sequence[SharedError]
) -> tuple[float, np.ndarray]:
    """Return the sum of squares with the block's height m, and which opinions are wrong then."""
    limit, total = GROUP_WRONG**2, 0.0
    wrong = np.zeros(len(offset), dtype=bool)
    for number in np.unique(of):
        here, source = np.flatnonzero(of == number), sources[number]
        shared = np.append(0.0, offset[here] - m)
        own = (shared / source.sigma_m) ** 2
        penalty = np.minimum(own, limit) if source.wrong_together else own
        squares = (offset[here] - m - shared[:, None]) ** 2 / variance[here]
        cost = penalty + np.minimum(squares, limit).sum(axis=1)
        chosen = int(np.argmin(cost))
        total += float(cost[chosen])
        wrong[here] = (squares[chosen] > limit) | (own[chosen] > limit)
    return total, wrong


def _agreement(one: Judged, ground: np.ndarray, total: float) -> HeightAgreement:
    rows, used = one.rows, one.factor > 0.0
    at = np.bincount(rows.of, rows.share * (ground[rows.point, 2] - rows.height), len(one.miss_m))
    within, out = at[used], at[~used]
    return HeightAgreement(
        source=one.source.name,
        observations=len(at),
        left_out=int((~used).sum()),
        rmse_m=float(np.sqrt(np.mean(within**2))) if within.size else float("nan"),
        left_out_median_m=float(np.median(out)) if out.size else float("nan"),
        sigma_m=float(one.sigma_factor * np.median(rows.sigma_m)),
        sigma_factor=one.sigma_factor,
        share=one.weight / total if total > 0.0 else float("nan"),
        alone_m=one.offset_m,
        groups=tuple(one.groups),
    )

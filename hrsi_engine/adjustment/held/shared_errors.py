"""External heights and positions whose errors are correlated: weights by fit, joint weights, outlying groups.

An observation is judged against the position by the rays alone (`miss_m`, with the variance of the rays). The variance
of the difference is sigma² + that of the rays. Its weight, the inverse of that variance, stays as it is up to `fitting`
standard deviations and falls to zero at `wrong` (thresholds: `SOURCE_FIT`). Differences are counted from the median of
their source: a block without control may lie off as a whole, which must not silence a DEM.

Observations come in *groups* with a common error: the points of one laser track, the cells of one part of a DEM or of
an orthoimage; and a source has an error that all its observations share. With the standard deviation c of a group's
common error and the sum W of its weights, the group is worth W / (1 + c² W); so its weights are divided by 1 + c² W,
and those of a source likewise: thousands of heights of a DEM count as few. Whole groups are tested against one another,
over all sources: their offsets are combined robustly (`find_outlying_groups`), and a group that lies off by more than
`group_wrong` of its standard deviations is named and left out. Where that moves the block so that the group fits again,
and with it the block moves back, the adjustment would never end: a group that has come back `most_returns` times stays
out.

The sigma of a source is a variance component: the factor by which its differences, within groups, are larger or smaller
than their standard deviations let expect, as far as these are not those of the rays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import threshold, thresholds
from ..result import SourceGroup


@thresholds
class SOURCE_FIT:
    """Which external heights and positions fit, alone and in groups."""

    fitting: float = threshold(
        2.5, "sigma", "one with a smaller error keeps its weight", "redescending weights (Hampel 1974)"
    )
    wrong: float = threshold(4.0, "sigma", "one with a larger error has none", "redescending weights (Hampel 1974)")
    left_out: float = threshold(1e-3, "", "factor of the weight below which an observation counts as left out")
    core: float = threshold(2.5, "robust sigma", "differences farther from the median do not count")
    group_wrong: float = threshold(3.5, "sigma", "a group with a larger error contradicts the others")
    decided: float = threshold(4.0, "chi²", "by which a place of the block must be better to decide on groups")
    most_returns: int = threshold(3, "returns", "a group that has come back so often stays out")
    least_of_group: int = threshold(3, "observations", "a group of fewer is judged by its members alone")
    prior_redundancy: float = threshold(20.0, "observations", "weight of the given sigma in its variance")
    sigma_factors: tuple[float, float] = threshold((0.5, 5.0), "", "least and largest factor of a sigma")


CUTS, HALVINGS = 20, 12  # most steps that find the bulk of the differences, and steps that find a sigma


class ErrorSource(Protocol):
    """What shares errors."""

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
    def can_be_biased_as_a_whole(self) -> bool:
        """Whether one fault may spoil all of it."""

    @property
    def common_m(self) -> float:
        """Standard deviation of what a group shares."""

    @property
    def overall_m(self) -> float:
        """Standard deviation of what all of the source shares, by which contradictions are tested."""

    @property
    def weighed_m(self) -> float:
        """The same, by which all of it weighs in the block's place: `overall_m` or more."""


class SourceRows(Protocol):
    """Observations of a source: their standard deviations and groups ``(o,)``."""

    @property
    def sigma_m(self) -> np.ndarray:
        """Standard deviations ``(o,)``."""

    @property
    def group(self) -> np.ndarray:
        """Number of each one's group ``(o,)``."""


ObservedRows = TypeVar("ObservedRows", bound=SourceRows)


@dataclass(eq=False)
class SourceFit(Generic[ObservedRows]):
    """What is thought of a source's observations.

    rows : the observations as they were judged
    miss_m, of_rays : (o,) observed - what the rays alone say, and the variance of the latter
    sigma_factor : the variance component
    factor : (o,) of the weight by how well an observation fits, 0 where it is left out
    left : (o,) share of the weight that is left where errors are shared
    groups : what the groups say; offset_m : what all say of the block's place together; weight : 1/m², of that
    """

    source: ErrorSource
    rows: ObservedRows
    miss_m: np.ndarray
    of_rays: np.ndarray
    sigma_factor: float = 1.0
    factor: np.ndarray = field(default_factory=lambda: np.zeros(0))
    left: np.ndarray = field(default_factory=lambda: np.zeros(0))
    groups: list[SourceGroup] = field(default_factory=list)
    offset_m: float = float("nan")
    weight: float = 0.0

    @property
    def variance(self) -> np.ndarray:
        """Variances ``(o,)`` that the differences should have."""
        return np.asarray((self.sigma_factor * self.rows.sigma_m) ** 2 + self.of_rays)

    @property
    def weights(self) -> np.ndarray:
        """Weights ``(o,)`` of the observations in the adjustment: 0 where they are left out."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / (self.variance / (self.factor * self.left) - self.of_rays))

    def weigh_by_fit(self, trusted: np.ndarray) -> None:
        """Find how well each observation fits the ``trusted (o,)`` ones; the others are left out."""
        self.factor = np.zeros(len(self.miss_m))
        if trusted.any():
            sigma = np.sqrt(self.variance[trusted])
            middle, scale = _find_core(self.miss_m[trusted], sigma)
            self.factor[trusted] = hampel_weight(np.abs(self.miss_m[trusted] - middle) / (scale * sigma))

    def reduce_shared_weights(self) -> None:
        """Find what is left of the weights where groups, and all of the source, share errors."""
        source, group, count = self.source, self.rows.group, len(self.source.groups)
        weight = self.factor / self.variance
        of_group = np.bincount(group, weight, count)
        left = 1.0 / (1.0 + source.common_m**2 * of_group)
        total = float((of_group * left).sum())
        self.left = left[group] / (1.0 + source.weighed_m**2 * total)
        if source.holds_points:
            self.left = self.left ** (1.0 - self.of_rays / self.variance)
        weight = weight * self.left
        self.weight = float(weight.sum())
        if self.weight > 0.0:
            self.offset_m = float(weight @ self.miss_m / self.weight)


def hampel_weight(t: np.ndarray) -> np.ndarray:
    """Return the factor of the weight of an observation that is ``t`` standard deviations off (Hampel 1974).

    It is 1 up to `SOURCE_FIT.fitting` and 0 from `SOURCE_FIT.wrong`.
    """
    factor = np.clip((SOURCE_FIT.wrong - t) / (SOURCE_FIT.wrong - SOURCE_FIT.fitting), 0.0, 1.0)
    return np.where(factor > SOURCE_FIT.left_out, factor, 0.0)


def _find_core(apart: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Return the median of the bulk of the differences and by how much their sigmas are too small (1 or more).

    Differences far from the median are cut off again and again: a quarter of treetops must not widen the scale.
    """
    middle, scale = float(np.median(apart)), np.inf
    core = np.ones(len(apart), dtype=bool)
    for _ in range(CUTS):
        t = (apart - middle) / sigma
        scale = max(float(robust_sigma(t[core])), 1.0)
        inside = np.abs(t) <= SOURCE_FIT.core * scale
        middle = float(np.median(apart[inside]))
        if np.array_equal(inside, core):
            break
        core = inside
    return middle, scale


def estimate_sigma_factor(one: SourceFit[Any]) -> float:
    """Return the factor of a source's sigmas that makes the differences within its groups as large as they should be.

    Observations count as far as their own sigma, not that of the rays, makes their variance.
    """
    rows = one.rows
    apart, own = np.full(len(one.miss_m), np.nan), rows.sigma_m**2
    for group in range(len(one.source.groups)):
        here = rows.group == group
        if here.sum() >= SOURCE_FIT.least_of_group:
            apart[here] = one.miss_m[here] - np.median(one.miss_m[here])
    known = np.isfinite(apart)
    if not known.any():
        return 1.0
    telling = float(np.sum((own / (own + one.of_rays))[known] ** 2))
    low, high = SOURCE_FIT.sigma_factors
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        wide = robust_sigma(apart[known] / np.sqrt(middle**2 * own[known] + one.of_rays[known])) < 1.0
        low, high = (low, middle) if wide else (middle, high)
    return float(
        np.sqrt((SOURCE_FIT.prior_redundancy + telling * low * high) / (SOURCE_FIT.prior_redundancy + telling))
    )


def _collect_offsets(one: SourceFit[Any], source: int) -> list[GroupOffset]:
    """Return what the groups of a source say of the block's place."""
    found = []
    for group in range(len(one.source.groups)):
        here = one.rows.group == group
        if here.sum() < SOURCE_FIT.least_of_group:
            continue
        miss, variance = one.miss_m[here], one.variance[here]
        middle, scale = _find_core(miss, np.sqrt(variance))
        core = np.abs(miss - middle) <= SOURCE_FIT.core * scale * np.sqrt(variance)
        own = 0.5 * np.pi * scale**2 / float((1.0 / variance[core]).sum())  # of a median
        found.append(GroupOffset(source, group, middle, own + one.source.common_m**2, int(here.sum())))
    return found


@dataclass(eq=False)
class GroupHistory:
    """Groups (source, group) that were left out last, and how often each came back, in the passes of an adjustment.

    ``surveys`` are the surveyed heights that contradict what the block lies on, and all of them.
    """

    left_out: set[tuple[str, int]] = field(default_factory=set)
    returns: Counter[tuple[str, int]] = field(default_factory=Counter)
    surveys: tuple[int, int] = (0, 0)

    def decide_exclusion(self, group: tuple[str, int], decided: bool) -> bool:
        """Return whether a group is left out that is ``decided`` to be wrong, or not; take it down."""
        self.returns[group] += group in self.left_out and not decided
        left_out = decided or self.returns[group] >= SOURCE_FIT.most_returns
        (self.left_out.add if left_out else self.left_out.discard)(group)
        return left_out


def compare_groups(
    judged: Sequence[SourceFit[Any]], memory: GroupHistory, beside: Sequence[OtherOffsets] = ()
) -> list[np.ndarray]:
    """Test the groups of all sources against one another; leave out those that lie off.

    ``memory`` is that of the passes before; ``beside`` is what else says where the block lies. Returned are masks of
    those of its offsets that contradict the others.
    """
    opinions = [opinion for number, one in enumerate(judged) for opinion in _collect_offsets(one, number)]
    sources = [CommonError(one.source.overall_m, one.source.can_be_biased_as_a_whole) for one in judged]
    said = len(opinions)
    if opinions:
        for other in beside:
            pairs = zip(other.offset_m.tolist(), other.variance.tolist(), strict=True)
            opinions += [GroupOffset(len(sources), k, *pair, 1) for k, pair in enumerate(pairs)]
            sources.append(other.common)
    off, decided, middle = find_outlying_groups(opinions, sources)
    of_others = np.split(off[said:], np.cumsum([len(other.offset_m) for other in beside])[:-1]) if opinions else []
    opinions = opinions[:said]
    left_out = [
        memory.decide_exclusion((judged[opinion.source].source.name, opinion.group), sure)
        for opinion, sure in zip(opinions, decided[:said].tolist(), strict=True)
    ]
    for opinion, wrong, sure in zip(opinions, off[:said].tolist(), left_out, strict=True):
        one = judged[opinion.source]
        one.groups.append(SourceGroup(
            one.source.groups[opinion.group], opinion.observations, opinion.offset_m - middle,
            float(np.hypot(np.sqrt(opinion.variance), one.source.overall_m)), wrong or sure, sure,
        ))  # fmt: skip
    for number, one in enumerate(judged):
        wrong_groups = [opinion.group for opinion, sure in zip(opinions, left_out, strict=True)
                        if sure and opinion.source == number]  # fmt: skip
        if wrong_groups:  # with all that could be judged go the small ones that could not
            all_wrong = one.source.can_be_biased_as_a_whole and len(wrong_groups) == len(one.groups)
            one.weigh_by_fit(~np.isin(one.rows.group, wrong_groups) & (not all_wrong))
    return of_others


class GroupOffset(NamedTuple):
    """What a group says of the block's place: its offset and variance; from how many observations of which source."""

    source: int
    group: int
    offset_m: float
    variance: float
    observations: int


class CommonError(NamedTuple):
    """What all of a source may be off by: standard deviation, and whether one fault may spoil all of it at once."""

    sigma_m: float
    can_be_biased_as_a_whole: bool


class OtherOffsets(NamedTuple):
    """What other observations than those of the sources say of the block's place: offsets and variances ``(k,)``."""

    offset_m: np.ndarray
    variance: np.ndarray
    common: CommonError


def find_outlying_groups(
    opinions: Sequence[GroupOffset], sources: Sequence[CommonError]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return which group offsets are wrong, of which of them that is certain, and the weighted mean of the others.

    With the block's height, or its place along an axis, m, a common error b of each source (standard deviation s), and
    group offsets o of variance v, the squares ``b² / s²`` of the sources and ``(o - m - b)² / v`` of the groups, each
    cut at `SOURCE_FIT.group_wrong`², are minimised over all m that equal an offset. A DEM that stands on trees is one
    fault, however many its parts; of laser tracks each has to be wrong by itself. It is not certain where a group is
    right at a place that is nearly as good: one of two tracks that differ, say.
    """
    offset = np.array([one.offset_m for one in opinions])
    if len(offset) < 2:
        return np.zeros(len(offset), dtype=bool), np.zeros(len(offset), dtype=bool), float(offset.sum())
    variance = np.array([one.variance for one in opinions])
    of = np.array([one.source for one in opinions])
    tried = [chi2_at_offset(float(m), offset, variance, of, sources) for m in offset]
    costs = np.array([cost for cost, _ in tried])
    best = int(np.argmin(costs + 1e-9 * variance))
    wrong = tried[best][1]
    decided = np.logical_and.reduce([at for cost, at in tried if cost < costs[best] + SOURCE_FIT.decided])
    weight = ~wrong / (variance + np.array([sources[k].sigma_m for k in of]) ** 2)
    return wrong, decided, float(weight @ offset / weight.sum())


def chi2_at_offset(
    m: float, offset: np.ndarray, variance: np.ndarray, of: np.ndarray, sources: Sequence[CommonError]
) -> tuple[float, np.ndarray]:
    """Return chi² of the group offsets for a common block offset m, and the mask of outlying groups."""
    limit, total = SOURCE_FIT.group_wrong**2, 0.0
    wrong = np.zeros(len(offset), dtype=bool)
    for number in np.unique(of):
        here, source = np.flatnonzero(of == number), sources[number]
        shared = np.append(0.0, offset[here] - m)
        own = (shared / source.sigma_m) ** 2
        penalty = np.minimum(own, limit) if source.can_be_biased_as_a_whole else own
        squares = (offset[here] - m - shared[:, None]) ** 2 / variance[here]
        cost = penalty + np.minimum(squares, limit).sum(axis=1)
        chosen = int(np.argmin(cost))
        total += float(cost[chosen])
        wrong[here] = (squares[chosen] > limit) | (own[chosen] > limit)
    return total, wrong

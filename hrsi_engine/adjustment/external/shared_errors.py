"""External heights and positions with correlated errors: weights by fit, joint weights, outlying groups.

An observation is compared with the position by the rays alone (`difference_m`, with their variance). The variance of
the difference is sigma² + that of the rays. Its weight, the inverse of that variance, is unchanged up to `fitting`
standard deviations and falls to zero at `wrong` (thresholds: `SOURCE_FIT`). Differences are relative to the median of
their source: an offset of a block without GCPs must not exclude a DEM.

Observations come in *groups* with a common error: the points of one laser track, the cells of one part of a DEM or of
an orthoimage; and a source has an error that all its observations share. With the standard deviation c of a group's
common error and the sum W of its weights, the group has the weight W / (1 + c² W); so its weights are divided by 1 + c²
W, and those of a source in the same way: thousands of heights of a DEM have the weight of a few. Whole groups are
tested against one another, over all sources: their offsets are combined robustly (`find_outlying_groups`), and a group
whose offset exceeds `group_wrong` of its standard deviations is reported and left out. If the group fits the block
without it, and the block changes back with it, the adjustment would not converge: a group that has returned
`most_returns` times stays excluded.

The sigma of a source is a variance component: the factor between its differences, within groups, and their expected
standard deviations, without the part of the rays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from ...foundation.robust_scale import ROBUST, robust_sigma
from ...foundation.thresholds import ITERATIONS, REDUNDANCY, SIGNIFICANCE, threshold, thresholds
from ..source_results import SourceGroup


@thresholds
class SOURCE_FIT:
    """Limits for residuals of external heights and positions, singly and in groups."""

    least_of_group: int = threshold(3, "observations", "fewest observations of a group that is tested")
    sigma_factors: tuple[float, float] = threshold((0.5, 5.0), "", "limits of the estimated factor of a sigma")


CUTS, HALVINGS = 20, 12  # most steps for the bulk of the differences; steps for a sigma


class ErrorSource(Protocol):
    """Interface of a source whose observations share errors."""

    @property
    def name(self) -> str:
        """Name of the source in reports."""

    @property
    def groups(self) -> Sequence[str]:
        """Names of the source's groups."""

    @property
    def determines_points(self) -> bool:
        """True if the source also serves to determine single points, not only the block."""

    @property
    def can_be_biased_as_a_whole(self) -> bool:
        """True if one error (such as a wrong vertical datum) can shift every observation of the source."""

    @property
    def common_m(self) -> float:
        """Standard deviation of the common error of a group."""

    @property
    def overall_m(self) -> float:
        """Standard deviation of the common error of the whole source, for the test of contradictions."""

    @property
    def weighting_sigma_m(self) -> float:
        """The same for the weight of the whole source in the block's position: `overall_m` or more."""


class SourceRows(Protocol):
    """Observations of a source: their standard deviations and groups ``(o,)``."""

    @property
    def sigma_m(self) -> np.ndarray:
        """Standard deviations ``(o,)``."""

    @property
    def group(self) -> np.ndarray:
        """Number of each observation's group ``(o,)``."""


ObservedRows = TypeVar("ObservedRows", bound=SourceRows)


@dataclass(eq=False)
class SourceFit(Generic[ObservedRows]):
    """Fit of a source's observations to the block, and their weights.

    rows : the observations that were tested
    difference_m, of_rays : (o,) observed minus position by the rays alone, and the variance of the latter
    sigma_factor : the variance component
    factor : (o,) factor of the weight by the observation's fit, 0 if it is left out
    left : (o,) factor of the weight because of shared errors
    groups : results of the groups; offset_m : weighted mean offset of all observations; weight : of that, 1/m²
    """

    source: ErrorSource
    rows: ObservedRows
    difference_m: np.ndarray
    of_rays: np.ndarray
    sigma_factor: float = 1.0
    factor: np.ndarray = field(default_factory=lambda: np.zeros(0))
    left: np.ndarray = field(default_factory=lambda: np.zeros(0))
    groups: list[SourceGroup] = field(default_factory=list)
    offset_m: float = float("nan")
    weight: float = 0.0

    @property
    def variance(self) -> np.ndarray:
        """Expected variances ``(o,)`` of the differences."""
        return np.asarray((self.sigma_factor * self.rows.sigma_m) ** 2 + self.of_rays)

    @property
    def weights(self) -> np.ndarray:
        """Weights ``(o,)`` of the observations in the adjustment, 0 for those left out."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / (self.variance / (self.factor * self.left) - self.of_rays))

    def weigh_by_fit(self, trusted: np.ndarray) -> None:
        """Set the weight factors by the fit to the ``trusted (o,)`` observations; the others are left out."""
        self.factor = np.zeros(len(self.difference_m))
        if trusted.any():
            sigma = np.sqrt(self.variance[trusted])
            middle, scale = _find_core(self.difference_m[trusted], sigma)
            self.factor[trusted] = hampel_weight(np.abs(self.difference_m[trusted] - middle) / (scale * sigma))

    def reduce_shared_weights(self) -> None:
        """Reduce the weights for the errors that groups, and the whole source, share."""
        source, group, count = self.source, self.rows.group, len(self.source.groups)
        weight = self.factor / self.variance
        of_group = np.bincount(group, weight, count)
        left = 1.0 / (1.0 + source.common_m**2 * of_group)
        self.left = left[group] / (1.0 + source.weighting_sigma_m**2 * float((of_group * left).sum()))
        if source.determines_points:
            self.left = self.left ** (1.0 - self.of_rays / self.variance)
        weight = weight * self.left
        self.weight = float(weight.sum())
        if self.weight > 0.0:
            self.offset_m = float(weight @ self.difference_m / self.weight)


def hampel_weight(t: np.ndarray) -> np.ndarray:
    """Return the weight factor of an observation with an error of ``t`` standard deviations (Hampel 1974).

    It is 1 up to `ROBUST.full_weight` and 0 from `ROBUST.rejected`.
    """
    factor = np.clip((ROBUST.rejected - t) / (ROBUST.rejected - ROBUST.full_weight), 0.0, 1.0)
    return np.where(factor > REDUNDANCY.tested, factor, 0.0)


def _find_core(difference: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Return the median of the bulk of the differences, and the factor by which their sigmas are too small (1 or more).

    Differences far from the median are removed repeatedly: a quarter of canopy heights must not enlarge the scale.

    difference, sigma : (k,) observed minus computed, and its standard deviation, m
    """
    middle, scale = float(np.median(difference)), np.inf
    core = np.ones(len(difference), dtype=bool)
    for _ in range(CUTS):
        t = (difference - middle) / sigma
        scale = max(float(robust_sigma(t[core])), 1.0)
        inside = np.abs(t) <= ROBUST.full_weight * scale
        middle = float(np.median(difference[inside]))
        if np.array_equal(inside, core):
            break
        core = inside
    return middle, scale


def estimate_sigma_factor(one: SourceFit[Any]) -> float:
    """Return the factor of a source's sigmas with which the differences within its groups have their expected size.

    Observations are weighted by the share of their own variance, against that of the rays.
    """
    rows = one.rows
    difference, variance = np.full(len(one.difference_m), np.nan), rows.sigma_m**2
    for group in range(len(one.source.groups)):
        in_group = rows.group == group
        if in_group.sum() >= SOURCE_FIT.least_of_group:
            difference[in_group] = one.difference_m[in_group] - np.median(one.difference_m[in_group])
    finite = np.isfinite(difference)
    if not finite.any():
        return 1.0
    telling = float(np.sum((variance / (variance + one.of_rays))[finite] ** 2))
    low, high = SOURCE_FIT.sigma_factors
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        wide = robust_sigma(difference[finite] / np.sqrt(middle**2 * variance[finite] + one.of_rays[finite])) < 1.0
        low, high = (low, middle) if wide else (middle, high)
    return float(np.sqrt((REDUNDANCY.common + telling * low * high) / (REDUNDANCY.common + telling)))


@dataclass(eq=False)
class GroupHistory:
    """Groups (source, group) left out in the last pass, and how often each returned, in the passes of an adjustment.

    ``surveys`` are the numbers of surveyed heights that contradict the sources, and of all compared ones.
    """

    left_out: set[tuple[str, int]] = field(default_factory=set)
    returns: Counter[tuple[str, int]] = field(default_factory=Counter)
    surveys: tuple[int, int] = (0, 0)

    def decide_exclusion(self, group: tuple[str, int], decided: bool) -> bool:
        """Return True if a group is to be left out, ``decided`` as wrong or after many returns; update the history."""
        self.returns[group] += group in self.left_out and not decided
        left_out = decided or self.returns[group] >= ITERATIONS.repeated
        (self.left_out.add if left_out else self.left_out.discard)(group)
        return left_out


def compare_groups(
    judged: Sequence[SourceFit[Any]], memory: GroupHistory, beside: Sequence[OtherOffsets] = ()
) -> list[np.ndarray]:
    """Test the groups of all sources against one another; leave out those with outlying offsets.

    judged : fits of the sources; their ``groups`` are filled, and weights of groups left out become zero
    memory : history of earlier passes, updated
    beside : offsets by other observations (surveyed heights, RPCs), which are tested too
    Result: for each of ``beside`` the mask ``(k,)`` of its offsets that contradict the others; empty without groups
    """
    group_offsets: list[GroupOffset] = []
    for number, one in enumerate(judged):
        for group in range(len(one.source.groups)):
            in_group = one.rows.group == group
            if in_group.sum() < SOURCE_FIT.least_of_group:
                continue
            miss, variance = one.difference_m[in_group], one.variance[in_group]
            center, scale = _find_core(miss, np.sqrt(variance))
            core = np.abs(miss - center) <= ROBUST.full_weight * scale * np.sqrt(variance)
            of_median = 0.5 * np.pi * scale**2 / float((1.0 / variance[core]).sum())  # variance of a median
            offset_variance = of_median + one.source.common_m**2
            group_offsets.append(GroupOffset(number, group, center, offset_variance, len(miss)))
    sources = [CommonError(one.source.overall_m, one.source.can_be_biased_as_a_whole) for one in judged]
    said = len(group_offsets)
    if group_offsets:
        for other in beside:
            pairs = zip(other.offset_m.tolist(), other.variance.tolist(), strict=True)
            group_offsets += [GroupOffset(len(sources), k, *pair, 1) for k, pair in enumerate(pairs)]
            sources.append(other.common)
    off, decided, middle = find_outlying_groups(group_offsets, sources)
    of_others = np.split(off[said:], np.cumsum([len(other.offset_m) for other in beside])[:-1]) if group_offsets else []
    group_offsets = group_offsets[:said]
    left_out = [
        memory.decide_exclusion((judged[one_group.source].source.name, one_group.group), sure)
        for one_group, sure in zip(group_offsets, decided[:said].tolist(), strict=True)
    ]
    for one_group, wrong, sure in zip(group_offsets, off[:said].tolist(), left_out, strict=True):
        one = judged[one_group.source]
        one.groups.append(
            SourceGroup(
                one.source.groups[one_group.group],
                one_group.observations,
                one_group.offset_m - middle,
                float(np.hypot(np.sqrt(one_group.variance), one.source.overall_m)),
                wrong or sure,
                sure,
            )
        )
    for number, one in enumerate(judged):
        wrong_groups = [
            one_group.group
            for one_group, sure in zip(group_offsets, left_out, strict=True)
            if sure and one_group.source == number
        ]
        if wrong_groups:  # if all large groups are wrong, small ones are too
            all_wrong = one.source.can_be_biased_as_a_whole and len(wrong_groups) == len(one.groups)
            one.weigh_by_fit(~np.isin(one.rows.group, wrong_groups) & (not all_wrong))
    return of_others


class GroupOffset(NamedTuple):
    """Offset of the block's position by a group, with variance and number of observations, and its source."""

    source: int
    group: int
    offset_m: float
    variance: float
    observations: int


class CommonError(NamedTuple):
    """Common error of a source: standard deviation, and whether one error can shift the whole source at once."""

    sigma_m: float
    can_be_biased_as_a_whole: bool


class OtherOffsets(NamedTuple):
    """Offsets of the block's position by other observations than those of the sources: with variances ``(k,)``."""

    offset_m: np.ndarray
    variance: np.ndarray
    common: CommonError


def find_outlying_groups(
    group_offsets: Sequence[GroupOffset], sources: Sequence[CommonError]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the masks of wrong and of certainly wrong group offsets, and the weighted mean of the others.

    With the block's height, or its position along an axis, m, a common error b of each source (standard deviation s),
    and group offsets o of variance v, the squares ``b² / s²`` of the sources and ``(o - m - b)² / v`` of the groups,
    each cut at `ROBUST.outlier`², are minimised over all m that equal an offset. The canopy in a DEM is one
    error, for any number of its parts; laser tracks are wrong independently. It is not certain that a group is wrong if
    it is right with another m of nearly the same cost: for example one of two tracks that differ.
    """
    offset = np.array([one.offset_m for one in group_offsets])
    if len(offset) < 2:
        return np.zeros(len(offset), dtype=bool), np.zeros(len(offset), dtype=bool), float(offset.sum())
    variance = np.array([one.variance for one in group_offsets])
    source_of_group = np.array([one.source for one in group_offsets])
    trials = [chi2_at_offset(float(m), offset, variance, source_of_group, sources) for m in offset]
    costs = np.array([cost for cost, _ in trials])
    best = int(np.argmin(costs + 1e-9 * variance))
    outlying_best = trials[best][1]
    decided = np.logical_and.reduce([mask for cost, mask in trials if cost < costs[best] + SIGNIFICANCE.decisive])
    weight = ~outlying_best / (variance + np.array([sources[k].sigma_m for k in source_of_group]) ** 2)
    return outlying_best, decided, float(weight @ offset / weight.sum())


def chi2_at_offset(
    m: float, offset: np.ndarray, variance: np.ndarray, source_of_group: np.ndarray, sources: Sequence[CommonError]
) -> tuple[float, np.ndarray]:
    """Return chi² of the group offsets for a common block offset m, and the mask of outlying groups."""
    limit, total = ROBUST.outlier**2, 0.0
    outlying = np.zeros(len(offset), dtype=bool)
    for number in np.unique(source_of_group):
        rows_of_source, source = np.flatnonzero(source_of_group == number), sources[number]
        candidates = np.append(0.0, offset[rows_of_source] - m)
        source_squares = (candidates / source.sigma_m) ** 2
        penalty = np.minimum(source_squares, limit) if source.can_be_biased_as_a_whole else source_squares
        squares = (offset[rows_of_source] - m - candidates[:, None]) ** 2 / variance[rows_of_source]
        cost = penalty + np.minimum(squares, limit).sum(axis=1)
        best = int(np.argmin(cost))
        total += float(cost[best])
        outlying[rows_of_source] = (squares[best] > limit) | (source_squares[best] > limit)
    return total, outlying

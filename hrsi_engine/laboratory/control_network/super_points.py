"""Super-point matching (thesis §3.3.2): the two roots and starting points with the most correspondences.

A hypothesis names a root and a starting leaf in both sets. The starting leaves fix the rotation, and every leaf has its
distance from the root and its angle from the starting leaf; two leaves correspond (eq. 3.3) when they are each
other's closest within the tolerances of distance and angle. The hypothesis with the most correspondences is chosen,
then that with the smallest sum of squared differences in units of the tolerances.

The search gives what trying all hypotheses gives. `bound_votes` bounds the number of every pair of roots from above;
pairs are evaluated from the largest bound down until no bound reaches what was found (or what is more than chance),
and so are the starting points within a pair of roots. For m and n points with l leaves a root the bounds cost
``O(m n)`` (see `bound_votes`), an evaluated pair of roots ``O(k + h k)`` for its k leaf pairs of like distance and the
h of them that may win; the exhaustive search costs ``O(m n l^4)``.

Two measures show whether the best hypothesis is right. ``log10_nfa``: how many hypotheses of as many correspondences
would appear by chance in two unrelated sets (number of false alarms; Desolneux, Moisan and Morel 2000). ``runner_up``:
the most correspondences of a hypothesis that puts the root somewhere else or turns it otherwise.

**Votes.** Every root's leaves are counted in a histogram over distance and direction. A rotation shifts the directions,
so the number of leaves of one root that meet a leaf of the other is a circular correlation of two histograms, summed
over the distances. After a Fourier transform over the directions it is one matrix product a frequency for all pairs of
roots at once. The second histogram is widened by the tolerances and by the bins, so that no correspondence is lost: the
votes bound the true number from above. With R bins of distance and B of direction they cost
``O(m n B (R + log B))``, whatever the number of leaves.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy import fft
from scipy.stats import binom

from ...foundation.progress import Progress, advance, silent, stage
from ...foundation.thresholds import threshold, thresholds
from .leaves import Leaves, Tolerance, find_leaves, find_mutual_best, rotate_offset, wrap_angle


@thresholds
class SUPER_POINTS:
    """Bounds for pairs of roots by votes, and tests of the best pair against chance and rivals."""

    rival_share: float = threshold(0.75, "", "correspondences of another match over those of the best, if ambiguous")
    shared: float = threshold(0.3, "", "share of common correspondences from which two hypotheses are one")
    log10_nfa: float = threshold(-3.0, "log10", "largest number of false alarms", "Desolneux, Moisan and Morel 2000")
    cells_per_batch: int = threshold(2_000_000, "cells", "most products of leaf pairs and starting points in memory")
    sectors: int = threshold(360, "sectors", "sectors of the rotation for counting leaf pairs")
    rounding_rad: float = threshold(1e-9, "rad", "tolerance for rounding at the edge of an interval")
    rival_gradient: float = threshold(0.2, "", "displacement of a root over its distance, by relief, in one match")
    rival_turn_rad: float = threshold(np.radians(15.0), "rad", "largest difference of rotations in one match")
    directions: int = threshold(256, "bins", "number of bins of direction of vote histograms")
    ring_px: float = threshold(4.0, "px", "width of the bins of distance of vote histograms")
    pairs_per_batch: int = threshold(40_000, "pairs", "number of pairs of roots in memory, about 120 MB")


_SECTOR_RAD = 2.0 * np.pi / SUPER_POINTS.sectors

FOUND, AMBIGUOUS, NO_MATCH = "found", "ambiguous", "no match"


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Roots, starting leaves, scale and rotation, and the correspondences: indices ``(k, 2)`` with the roots first."""

    roots: tuple[int, int]
    starts: tuple[int, int]
    scale: float
    rotation_rad: float
    pairs: np.ndarray
    cost: float

    @property
    def count(self) -> int:
        """Correspondences, the roots included."""
        return len(self.pairs)


@dataclass(frozen=True, eq=False)
class SuperPointMatch:
    """The winner (None where nothing is more than chance), its status, and what that rests on."""

    status: str
    best: Hypothesis | None
    runner_up: int
    log10_nfa: float
    evaluated_pairs: int  # of roots


class LeafPairs(NamedTuple):
    """Leaf pairs of two roots with similar distances: rows into the two leaf tables, (k,) each, and what they need.

    turn_rad : rotation that each pair implies; allowed_rad : tolerance of the angle; radial : squared difference of
    distance in units of the tolerance
    """

    first: np.ndarray
    second: np.ndarray
    turn_rad: np.ndarray
    allowed_rad: np.ndarray
    radial: np.ndarray


def find_correspondences(pairs: LeafPairs, start: int) -> tuple[np.ndarray, float]:
    """Return the rows of ``pairs`` that correspond when row ``start`` is the starting points, and their cost."""
    angular = (wrap_angle(pairs.turn_rad - pairs.turn_rad[start]) / pairs.allowed_rad) ** 2
    compatible = np.flatnonzero(angular <= 1.0)
    cost = pairs.radial[compatible] + angular[compatible]
    mutual = compatible[find_mutual_best(pairs.first[compatible], pairs.second[compatible], cost)]
    return mutual, float(np.sum(pairs.radial[mutual] + angular[mutual]))


def bound_support(pairs: LeafPairs, least_count: int) -> np.ndarray:
    """Return for every row as starting points how many first leaves have a partner at all, ``(k,)``.

    Rows that fewer than ``least_count`` leaf pairs agree with get 0: those are counted in sectors, ``O(k)``.
    """
    bounds = np.zeros(len(pairs.first), dtype=int)
    # How many leaf pairs may allow the rotation of each, ``(k,)``: at least as many as do
    low = np.floor((pairs.turn_rad - pairs.allowed_rad) / _SECTOR_RAD).astype(int)
    high = np.ceil((pairs.turn_rad + pairs.allowed_rad) / _SECTOR_RAD).astype(int)
    width = np.minimum(high - low, SUPER_POINTS.sectors)
    low %= SUPER_POINTS.sectors
    begun, ended = (np.bincount(edge, minlength=2 * SUPER_POINTS.sectors + 1) for edge in (low, low + width))
    votes = (begun - ended).cumsum()[:-1].reshape(2, SUPER_POINTS.sectors).sum(axis=0)
    agreeing_pairs = votes[np.floor(pairs.turn_rad / _SECTOR_RAD).astype(int) % SUPER_POINTS.sectors]
    rows = np.flatnonzero(agreeing_pairs >= least_count)
    if not len(rows):
        return bounds
    group = np.flatnonzero(np.r_[True, np.diff(pairs.first) > 0])
    step = max(1, SUPER_POINTS.cells_per_batch // len(pairs.first))
    for start in range(0, len(rows), step):
        part = rows[start : start + step]
        turn = np.abs(pairs.turn_rad[None, :] - pairs.turn_rad[part, None])
        is_compatible = np.minimum(turn, 2.0 * np.pi - turn) <= pairs.allowed_rad[None, :] + SUPER_POINTS.rounding_rad
        bounds[part] = np.logical_or.reduceat(is_compatible, group, axis=1).sum(axis=1)
    return bounds


@dataclass(frozen=True, eq=False)
class RootPairs:
    """Two sets of super points and the bounds of all pairs of roots, ``(scales, m, n)``, roots included."""

    first: np.ndarray
    second: np.ndarray
    tolerance: Tolerance
    reach_px: float
    scales: tuple[float, ...]
    bounds: np.ndarray
    _leaves: dict[tuple[int, int, float], Leaves] = field(default_factory=dict)

    def find_leaves(self, view: int, root: int, scale: float) -> Leaves:
        """Return the leaves of a root of the first (0) or second (1) set, in px of the first."""
        key = view, root, scale
        if key not in self._leaves:
            reach = self.reach_px + (float(self.tolerance.limit_px(np.array(self.reach_px))) if view else 0.0)
            self._leaves[key] = find_leaves((self.first, self.second)[view] / scale, root, reach)
        return self._leaves[key]

    def iterate_roots(self) -> Iterator[tuple[int, tuple[int, int], float]]:
        """Yield bound, roots and scale from the largest bound down."""
        for flat in np.argsort(-self.bounds, axis=None, kind="stable"):
            scale, i, j = np.unravel_index(flat, self.bounds.shape)
            yield int(self.bounds[scale, i, j]), (int(i), int(j)), self.scales[scale]

    def iterate_hypotheses(
        self, roots: tuple[int, int], scale: float, least_count: int
    ) -> Iterator[tuple[int, Callable[[], Hypothesis]]]:
        """Yield bound and evaluation of hypotheses of two roots that reach ``least_count``, most promising first."""
        first_leaves, second_leaves = self.find_leaves(0, roots[0], 1.0), self.find_leaves(1, roots[1], scale)
        # The leaf pairs within the tolerance of the distance, by the first leaf, then the second
        difference = second_leaves.distance_px[None, :] - first_leaves.distance_px[:, None]
        allowed = self.tolerance.limit_px(first_leaves.distance_px)
        i, j = np.nonzero(np.abs(difference) <= allowed[:, None])
        turn = wrap_angle(second_leaves.angle_rad[j] - first_leaves.angle_rad[i])
        pairs = LeafPairs(
            i, j, turn, self.tolerance.limit_rad(first_leaves.distance_px[i]), (difference[i, j] / allowed[i]) ** 2
        )
        bounds = bound_support(pairs, least_count - 1) + 1

        def evaluate(start: int) -> Hypothesis:
            rows, cost = find_correspondences(pairs, start)
            index = np.column_stack([first_leaves.rows[pairs.first[rows]], second_leaves.rows[pairs.second[rows]]])
            starts = int(first_leaves.rows[pairs.first[start]]), int(second_leaves.rows[pairs.second[start]])
            return Hypothesis(roots, starts, scale, float(pairs.turn_rad[start]), np.vstack([roots, index]), cost)

        for start in np.argsort(-bounds, kind="stable")[: np.count_nonzero(bounds >= least_count)].tolist():
            yield int(bounds[start]), partial(evaluate, start)


def bound_root_pairs(
    first: np.ndarray,
    second: np.ndarray,
    tolerance: Tolerance,
    reach_px: float,
    scales: tuple[float, ...],
    progress: Progress = silent,
) -> RootPairs:
    """Return two sets of super points with the bounds of all pairs of roots; arguments as `match_super_points`."""
    reach_px = min(reach_px, max(float(np.hypot(*np.ptp(first, axis=0))), 1.0))
    bounds = []
    for number, scale in enumerate(scales):
        advance(progress, number / len(scales), "control network: voting")
        bounds.append(bound_votes(first, second, tolerance, reach_px, scale) + 1)
    return RootPairs(first, second, tolerance, reach_px, scales, np.stack(bounds))


def match_super_points(
    first: np.ndarray,
    second: np.ndarray,
    tolerance: Tolerance,
    reach_px: float = np.inf,
    scales: tuple[float, ...] = (1.0,),
    progress: Progress = silent,
) -> SuperPointMatch:
    """Return the pair of control networks with the most correspondences.

    first, second : (m, 2) and (n, 2) super points; reach_px : leaves farther from their root do not count;
    scales : px of the second image for one of the first, each is tried
    """
    if min(len(first), len(second)) < 2:
        return SuperPointMatch(NO_MATCH, None, 0, 0.0, 0)
    sets = bound_root_pairs(first, second, tolerance, reach_px, scales, stage(progress, 0.0, 0.7))
    # The best hypothesis if it is more than chance, and how many pairs of roots were evaluated
    best: Hypothesis | None = None
    significant_counts = compute_significant_counts(sets)
    least_of_all, evaluated = int(significant_counts.min()), 0
    for number, (bound, roots, scale) in enumerate(sets.iterate_roots()):
        if bound < (least_of_all if best is None else best.count):
            break
        if number % 64 == 0:
            advance(stage(progress, 0.7, 1.0), 1.0 - 1.0 / (1.0 + number / 1024.0), "control network: comparing roots")
        required_count = max(int(significant_counts[roots[0]]), 0 if best is None else best.count)
        if bound >= required_count:
            evaluated += 1
            best = _find_better(sets, roots, scale, required_count, best)
    if best is None:
        return SuperPointMatch(NO_MATCH, None, 0, 0.0, evaluated)
    # The most correspondences of another hypothesis, 0 where none has nearly as many or all are chance
    runner_up = 0
    significant_counts = np.maximum(
        compute_significant_counts(sets), int(np.ceil(SUPER_POINTS.rival_share * best.count))
    )
    for bound, roots, scale in sets.iterate_roots():
        if bound <= runner_up or bound < significant_counts.min():
            break
        for support, evaluate in sets.iterate_hypotheses(
            roots, scale, max(int(significant_counts[roots[0]]), runner_up + 1)
        ):
            if support <= runner_up:
                break
            rival = evaluate()
            if rival.count > runner_up and rival.count >= significant_counts[roots[0]] and is_rival(sets, best, rival):
                runner_up = rival.count
    status = AMBIGUOUS if runner_up >= SUPER_POINTS.rival_share * best.count else FOUND
    # log10 of how many hypotheses with as many correspondences chance is expected to make
    leaves, share = _estimate_chance(sets, best.roots[0])
    chance = binom.logsf(best.count - 1 - GIVEN, leaves, share)
    return SuperPointMatch(
        status, best, runner_up, float(np.log10(_count_hypotheses(sets)) + chance / np.log(10.0)), evaluated
    )


def _find_better(
    sets: RootPairs, roots: tuple[int, int], scale: float, required_count: int, best: Hypothesis | None
) -> Hypothesis | None:
    """Return the best hypothesis of two roots if it has as many correspondences as wanted and beats ``best``."""
    for support, evaluate in sets.iterate_hypotheses(roots, scale, required_count):
        if support < required_count:
            break
        hypothesis = evaluate()
        if hypothesis.count >= required_count and (best is None or _sort_key(hypothesis) < _sort_key(best)):
            best, required_count = hypothesis, hypothesis.count
    return best


def find_likely_hypotheses(sets: RootPairs, largest_number: int) -> list[Hypothesis]:
    """Return the best hypothesis of each of the pairs of roots with the largest bounds, chance or not."""
    candidates = (
        _find_better(sets, roots, scale, 3, None) for _, roots, scale in islice(sets.iterate_roots(), largest_number)
    )
    return sorted((hypothesis for hypothesis in candidates if hypothesis is not None), key=_sort_key)


def _sort_key(hypothesis: Hypothesis) -> tuple:
    """Return what orders hypotheses, the best one first; the indices make it unique."""
    return -hypothesis.count, hypothesis.cost, hypothesis.scale, hypothesis.roots, hypothesis.starts


def is_rival(sets: RootPairs, best: Hypothesis, rival: Hypothesis) -> bool:
    """Return whether a hypothesis puts its root or its leaves elsewhere than the winner does.

    One that shares leaf pairs with the winner is the same match, seen from a root on a roof or a slope.
    """
    common_pairs = set(map(tuple, best.pairs.tolist())) & set(map(tuple, rival.pairs.tolist()))
    if len(common_pairs) >= SUPER_POINTS.shared * rival.count:
        return False
    offset = sets.first[rival.roots[0]] - sets.first[best.roots[0]]
    predicted = sets.second[best.roots[1]] + rotate_offset(offset, best.rotation_rad, best.scale)
    distance_px = float(np.hypot(*(sets.second[rival.roots[1]] - predicted))) / best.scale
    turn = abs(float(wrap_angle(np.array(rival.rotation_rad - best.rotation_rad))))
    return (
        distance_px > 2.0 * sets.tolerance.base_px + SUPER_POINTS.rival_gradient * np.hypot(*offset)
        or turn > SUPER_POINTS.rival_turn_rad
    )


def compute_significant_counts(sets: RootPairs) -> np.ndarray:
    """Return for each root of the first set from how many correspondences a hypothesis is more than chance, (m,)."""
    leaves, share = np.array([_estimate_chance(sets, root) for root in range(len(sets.first))]).T
    return binom.isf(10.0**SUPER_POINTS.log10_nfa / _count_hypotheses(sets), leaves, share).astype(int) + 1 + GIVEN


GIVEN = 2  # root and starting point correspond by construction


def _count_hypotheses(sets: RootPairs) -> float:
    """Return how many hypotheses there are: roots and starting points of both sets."""
    m, n = len(sets.first), len(sets.second)
    return float(sets.bounds.size) * m * n


def _estimate_chance(sets: RootPairs, root: int) -> tuple[int, float]:
    """Return how many leaves of a root are free, and how often one finds a partner by chance."""
    leaves = find_leaves(sets.first, root, sets.reach_px)
    area = max(float(np.prod(np.ptp(sets.second, axis=0))), 1.0) / sets.scales[0] ** 2
    share = np.minimum(4.0 * sets.tolerance.limit_px(leaves.distance_px) ** 2 * len(sets.second) / area, 1.0)
    return max(len(leaves.rows) - 1, 1), float(np.mean(share)) if len(share) else 1.0


def bound_votes(
    first: np.ndarray, second: np.ndarray, tolerance: Tolerance, reach_px: float, scale: float = 1.0
) -> np.ndarray:
    """Return the largest possible number of correspondences of each pair of roots, leaves only, ``(m, n)`` int.

    first : (m, 2), second : (n, 2) positions; scale : px of the second image for one of the first
    """
    rings = int(np.ceil(reach_px / SUPER_POINTS.ring_px)) + 1
    counts = np.zeros((len(first), rings, SUPER_POINTS.directions), dtype=np.float32)
    for root in range(len(first)):
        leaves = find_leaves(first, root, reach_px)
        ring = (leaves.distance_px / SUPER_POINTS.ring_px).astype(int)
        direction = np.floor(leaves.angle_rad / _STEP).astype(int) % SUPER_POINTS.directions
        np.add.at(counts[root], (ring, direction), 1.0)
    # The conjugate spectrum of the counts ``(frequencies, roots, rings)``, times that ``(frequencies, rings, roots)``
    # of where a leaf would find a partner, some roots at a time
    spectrum = np.ascontiguousarray(np.conj(fft.rfft(counts, axis=2)).transpose(2, 0, 1))
    bounds = np.zeros((len(first), len(second)), dtype=np.int32)
    step = max(1, SUPER_POINTS.pairs_per_batch // max(len(first), 1))
    for start in range(0, len(second), step):
        roots = range(start, min(start + step, len(second)))
        leaf_images = np.stack([_widen_leaves(second / scale, root, tolerance, reach_px, rings) for root in roots])
        votes = np.matmul(spectrum, np.ascontiguousarray(fft.rfft(leaf_images, axis=2).transpose(2, 1, 0)))
        largest_votes = fft.irfft(votes, SUPER_POINTS.directions, axis=0).max(axis=0)
        bounds[:, roots.start : roots.stop] = np.rint(largest_votes).astype(np.int32)
    return bounds


_STEP = 2.0 * np.pi / SUPER_POINTS.directions


def _widen_leaves(points: np.ndarray, root: int, tolerance: Tolerance, reach_px: float, rings: int) -> np.ndarray:
    """Return 1 in the bins ``(rings, directions)`` of which a leaf may meet one of this root's leaves, else 0."""
    inner = np.arange(rings) * SUPER_POINTS.ring_px
    allowed = tolerance.limit_px(inner + SUPER_POINTS.ring_px)  # grows outwards, that of the angle inwards
    angle = np.minimum(tolerance.limit_rad(np.maximum(inner, 1e-3)), np.pi)
    leaves = find_leaves(points, root, reach_px + float(allowed[-1]))
    nearest, farthest = (inner - allowed)[:, None], (inner + SUPER_POINTS.ring_px + allowed)[:, None]
    ring, leaf = np.nonzero((leaves.distance_px >= nearest) & (leaves.distance_px <= farthest))
    # The rotation may lie half a bin to either side, and the first leaf anywhere in its bin.
    low = np.ceil((leaves.angle_rad[leaf] - angle[ring]) / _STEP - 1.5).astype(int)
    high = np.floor((leaves.angle_rad[leaf] + angle[ring]) / _STEP + 0.5).astype(int)
    # 1 in the bins ``low … high`` of each arc, float32, directions wrapped
    change = np.zeros((rings, 3 * SUPER_POINTS.directions + 1), dtype=np.int32)
    start = low % SUPER_POINTS.directions
    np.add.at(change, (ring, start), 1)
    np.add.at(change, (ring, start + (np.minimum(high, low + SUPER_POINTS.directions - 1) - low) + 1), -1)
    covered = (
        change.cumsum(axis=1)[:, : 3 * SUPER_POINTS.directions].reshape(rings, 3, SUPER_POINTS.directions).sum(axis=1)
    )
    return (covered > 0).astype(np.float32)

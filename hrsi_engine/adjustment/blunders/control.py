"""Detection of wrong GCPs and of the wrong part of each: in groups, so that two blunders do not mask each other.

**Which GCPs.** Of the m GCPs at most half may be wrong. First the half that agrees best is found: all subsets are
tested if they are few, otherwise sets that begin with the worst GCPs and with random ones and are concentrated
(Rousseeuw and Van Driessen 1999), each with the cofactors of the adjustment (`discrepancies`), without solving it
again. Then GCPs are added again one by one, the least suspicious first, until the next one is significantly wrong
(forward search, Atkinson and Riani 2000; Rosner 1983): the remaining ones are rejected. Each is tested for its best
explanation, and all GCPs and explanations share the error probability of the block.

**Which part.** The height, the ground position, or the measurement on one image: the part that explains most for its
number of unknowns. If survey and measurement explain it equally well, or neither does, both are rejected.

**The usual size of errors** is estimated from the GCPs: their stated sigmas are often guesses, and errors of the model
add to them. The variance factor is that of the GCPs without the tested group; plan, heights and measurements have their
own factors if they are significantly worse, so that surveys with overstated sigmas (1000 m in plan, for a point that is
used for its height only) do not reduce the factor of the others. It is never below one, and stated sigmas have the
weight of `REDUNDANCY.stated` observations. A coordinate without weight is not tested.

**Many GCPs**, distributed over a large block: each is compared with its neighbourhood, the GCPs whose discrepancies
depend most on its own. The most suspicious one comes first; a rejected GCP is left out of all later tests, by the same
cofactors.

**Ambiguity**: if another group of the same size explains nearly as much, the GCPs that are not in both are undecided:
both groups are reported and kept. So are two halves of a block that disagree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import special

from ...foundation.thresholds import EQUALITY, ITERATIONS, REDUNDANCY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from .discrepancies import HEIGHT, IMAGE, PLAN, Discrepancies


@thresholds
class GCP_TESTS:
    """Limits for the detection of wrong GCPs, of their wrong parts, and of ambiguity."""

    starts: int = threshold(12, "starts", "random starts of the search for groups", "Rousseeuw and Van Driessen 1999")


@dataclass(frozen=True, eq=False)
class Explanation:
    """The part of a GCP that may be wrong: ``height``, ``ground``, ``image`` (a measurement), or ``all``.

    out : indices of the observations to leave out
    """

    what: str
    out: np.ndarray


@dataclass(frozen=True, eq=False)
class Suspect:
    """A GCP that is wrong, or one of two groups of which one is wrong.

    gcp : index into the points tested; what : see `Explanation`; row : the wrong measurement (-1: none)
    statistic : its error in standard deviations; error : (3,) m east, north, up, or (2,) px
    group, rivals : GCPs of two groups of which one is wrong, but it is ambiguous which; empty if it is clear
    """

    gcp: int
    what: str
    row: int
    statistic: float
    error: np.ndarray
    group: tuple[int, ...] = ()
    rivals: tuple[int, ...] = ()

    @property
    def is_clear(self) -> bool:
        """True if this GCP is unambiguously the wrong one."""
        return not self.rivals

    @property
    def concerned(self) -> tuple[int, ...]:
        """All GCPs that may be wrong."""
        return (*self.group, *self.rivals) or (self.gcp,)


@dataclass(frozen=True)
class VarianceFactor:
    """Variance factors of the GCPs without a group, with degrees of freedom: pooled, and of kinds that are worse."""

    pooled: float
    freedom: float
    worse: tuple[tuple[float, float], ...]

    @classmethod
    def estimate(cls, remaining: Discrepancies, squares: float, freedom: float) -> VarianceFactor:
        """Return the factors of the remaining GCPs, from their sum of squares and its degrees of freedom."""
        stated = REDUNDANCY.stated
        pooled = max((max(squares, 0.0) + stated) / (freedom + stated), 1.0)
        worse = []
        for kind in (PLAN, HEIGHT, IMAGE):
            of_kind = remaining.kind == kind
            shares, total = remaining.s.diagonal()[of_kind].sum(), float(np.sum(remaining.u[of_kind] ** 2))
            if shares < 0.5:
                continue
            ratio = (total + stated) / (shares + stated)
            if special.fdtrc(shares + stated, freedom + stated, ratio / pooled) < SIGNIFICANCE.level:
                worse.append((ratio, shares + stated))
        return cls(pooled, freedom + stated, tuple(worse))

    def compute_surprise(self, test: float, dimensions: int) -> float:
        """Return -log of the probability that a test value is reached by chance."""
        if dimensions == 0:
            return 0.0
        chances = [
            special.fdtrc(dimensions, freedom, test / dimensions / variance)
            for variance, freedom in ((self.pooled, self.freedom), *self.worse)
        ]
        return min(-float(np.log(max(*chances, 1e-300))), 1e4)

    @property
    def largest(self) -> float:
        """The largest of the factors, at least 1."""
        return max(self.pooled, *(variance for variance, _ in self.worse), 1.0)


def find_suspect_gcps(control: Discrepancies, sigmas: float) -> list[Suspect]:
    """Return the GCPs that are wrong or undecided; ``sigmas`` state the error probability for the whole block."""
    gcps = len(control.points)
    if gcps < 2:
        return []
    if gcps <= SAMPLES.dense:
        return _SuspectSearch(control, sigmas, gcps).find_suspect_gcps()
    suspects = []  # one neighbourhood after the other
    first = np.flatnonzero(np.r_[True, control.point[1:] != control.point[:-1]])
    related = np.add.reduceat(np.add.reduceat(control.s**2, first, axis=0), first, axis=1)
    related /= np.sqrt(related.diagonal()[:, None] * related.diagonal())
    waiting, present = np.ones(gcps, dtype=bool), np.ones(gcps, dtype=bool)
    excluded, inverse = np.zeros(0, dtype=np.int64), np.zeros((0, 0))  # measurements of GCPs that are clearly wrong
    suspicion = _compute_suspicion(control, excluded, inverse)
    while waiting.any():
        centre = int(np.argmax(np.where(waiting, suspicion, -1.0)))
        order = np.argsort(-np.where(present, related[centre], -1.0), kind="stable")
        neighbourhood = order[: min(SAMPLES.dense, int(present.sum()))]
        judged, neighbourhood = neighbourhood[: SAMPLES.dense // 2], np.sort(neighbourhood)
        waiting[judged] = False
        clear_suspects = []
        for one in _SuspectSearch(
            control.select_gcps(neighbourhood, excluded, inverse), sigmas, gcps
        ).find_suspect_gcps():
            group, rivals = (tuple(neighbourhood[list(members)].tolist()) for members in (one.group, one.rivals))
            said = replace(one, gcp=int(neighbourhood[one.gcp]), group=group, rivals=rivals)
            if not np.isin(said.concerned, judged).any():  # it is decided in its own neighbourhood
                continue
            suspects.append(said)
            waiting[list(said.concerned)] = False
            clear_suspects += [said.gcp] if said.is_clear else []
        if clear_suspects:
            present[clear_suspects] = False
            excluded = control.find_measurements(np.flatnonzero(~present).tolist())
            inverse = control.invert_subset(excluded)
            suspicion = _compute_suspicion(control, excluded, inverse)
    return suspects


def _compute_suspicion(control: Discrepancies, excluded: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Return the largest -log probability of each GCP's explanations, ``(g,)``, without observations ``excluded``.

    Only the GCP's own part of S is used, so that no further matrix of the size of S is needed.
    """
    factor, surprise = VarianceFactor(1.0, 1e9, ()), np.zeros(len(control.points))
    for gcp in range(len(control.points)):
        of_gcp = control.select_gcps(np.array([gcp]), excluded, inverse)
        tests = (factor.compute_surprise(*of_gcp.test_subset(one.out)) for one in _list_explanations(of_gcp, 0))
        surprise[gcp] = max(tests, default=0.0)
    return surprise


class _SuspectSearch:
    """The search for wrong GCPs in one block, or in one neighbourhood."""

    def __init__(self, control: Discrepancies, sigmas: float, tests: int) -> None:
        self.control, self.gcps = control, len(control.points)
        self.squares, self.freedom = control.test_subset(np.arange(len(control.u)))
        explanations = sum(len(_list_explanations(control, gcp)) for gcp in range(self.gcps)) / max(self.gcps, 1)
        self.limit = 0.5 * sigmas**2 + np.log(tests * explanations)  # -log probability

    def find_suspect_gcps(self) -> list[Suspect]:
        """Return the wrong or undecided GCPs; empty if the GCPs as a whole and each of their observations agree."""
        consistent = special.chdtrc(max(self.freedom, 1), self.squares) > SIGNIFICANCE.level
        factor = VarianceFactor(1.0, 1e9, ())
        if consistent and all(
            factor.compute_surprise(*self.control.test_subset(one.out)) < self.limit
            for gcp in range(self.gcps)
            for one in _list_explanations(self.control, gcp)
        ):
            return []
        group = self.readmit_consistent_gcps(self.find_core(self.gcps // 2))
        return self.decide(group) if group else []

    def test_group(self, group: tuple[int, ...]) -> tuple[float, int]:
        """Return the decrease of the sum of squares without a group of GCPs, and its dimensions."""
        return self.control.test_subset(self.control.find_measurements(group))

    def estimate_variance_factor(self, group: tuple[int, ...], remaining: Discrepancies) -> VarianceFactor:
        """Return the variance factor of the GCPs that remain without a group, ``remaining``."""
        squares, dimensions = self.test_group(group)
        return VarianceFactor.estimate(remaining, self.squares - squares, self.freedom - dimensions)

    # ---- which GCPs ------------------------------------------------------------------------------------------------

    def find_core(self, size: int) -> tuple[int, ...]:
        """Return the group of ``size`` GCPs without which the others agree best."""
        if special.binom(self.gcps, size) <= SAMPLES.large:
            return max(combinations(range(self.gcps), size), key=lambda group: self.test_group(group)[0])
        rng = np.random.default_rng(1)  # reproducible starts
        single = np.array([self.test_group((gcp,))[0] for gcp in range(self.gcps)])
        starts = [np.argsort(-single)[:size], *(rng.permutation(self.gcps)[:size] for _ in range(GCP_TESTS.starts))]
        successor: dict[tuple[int, ...], tuple[int, ...]] = {}  # steps that several starts share
        ended = {self._concentrate(tuple(sorted(start.tolist())), successor): None for start in starts}
        return max(ended, key=lambda group: self.test_group(group)[0])

    def _concentrate(
        self, group: tuple[int, ...], successor: dict[tuple[int, ...], tuple[int, ...]]
    ) -> tuple[int, ...]:
        """Return a group whose GCPs are those that disagree most with the others, iterated from ``group``.

        ``successor`` stores the successor of each group.
        """
        for _ in range(ITERATIONS.most):
            if group not in successor:
                # the GCPs that disagree most with those outside the group, as many as the group has
                excluded = self.control.find_measurements(group)
                inverse, test_value = self.control.invert_subset(excluded), np.zeros(self.gcps)
                remaining = self.control.exclude(excluded, inverse)
                parts = [np.flatnonzero(self.control.point[excluded] == gcp) for gcp in group]
                test_value[list(group)] = self.control.test_parts(excluded, parts, inverse)
                for gcp in set(range(self.gcps)) - set(group):
                    test_value[gcp], _ = remaining.test_subset(remaining.find_measurements((gcp,)))
                successor[group] = tuple(sorted(np.argsort(test_value)[-len(group) :].tolist()))
            if successor[group] == group:
                break
            group = successor[group]
        return group

    def readmit_consistent_gcps(self, group: tuple[int, ...]) -> tuple[int, ...]:
        """Return a group without its GCPs that are not significantly wrong; these are accepted again one by one."""
        surprise = dict.fromkeys(group, 0.0)
        while group:
            everything = self.control.exclude(self.control.find_measurements(group))
            factor = self.estimate_variance_factor(group, everything)
            lowest, candidate = np.inf, -1
            for gcp in sorted(group, key=lambda gcp: surprise[gcp]):  # in the last order: few are tested completely
                # The largest -log probability of the GCP's explanations, with the others of the group left out
                remaining, largest = self._leave_out_others(group, gcp), 0.0
                for one in _list_explanations(remaining, gcp):
                    largest = max(largest, factor.compute_surprise(*remaining.test_subset(one.out)))
                    if largest > lowest:
                        break
                surprise[gcp] = largest
                if (surprise[gcp], gcp) < (lowest, candidate) or candidate < 0:
                    lowest, candidate = surprise[gcp], gcp
            if lowest > self.limit:
                break
            group = tuple(gcp for gcp in group if gcp != candidate)
        return group

    def _leave_out_others(self, group: tuple[int, ...], gcp: int) -> Discrepancies:
        """Return the discrepancies of a GCP with the other GCPs of its group left out."""
        excluded_gcps = tuple(one for one in group if one != gcp)
        return self.control.reduce_to(
            self.control.find_observations((gcp,)), self.control.find_measurements(excluded_gcps)
        )

    # ---- which part, and whether it is clear -----------------------------------------------------------------------

    def decide(self, group: tuple[int, ...]) -> list[Suspect]:
        """Return the wrong GCPs of a group, each with its wrong part, and one entry for all undecided ones."""
        factor = self.estimate_variance_factor(group, self.control.exclude(self.control.find_measurements(group)))
        alternatives = list(self._list_alternatives(group, factor))
        if 2 * len(group) == self.gcps:  # two halves: neither of them is a majority
            alternatives = [tuple(sorted(set(range(self.gcps)) - set(group)))]
        certain = set(group).intersection(*alternatives) if alternatives else set(group)
        suspects = [self._explain_gcp(group, gcp, factor) for gcp in sorted(certain)]
        undecided = tuple(sorted(set(group) - certain))
        if undecided:
            rivals = tuple(sorted(set().union(*alternatives) - set(group)))
            worst = max((self._explain_gcp(group, gcp, factor) for gcp in undecided), key=lambda one: one.statistic)
            suspects.append(replace(worst, group=undecided, rivals=rivals))
        return suspects

    def _list_alternatives(self, group: tuple[int, ...], factor: VarianceFactor) -> Iterator[tuple[int, ...]]:
        """Yield other groups of the same size that explain nearly as much."""
        best, _ = self.test_group(group)
        limit = best - max(SIGNIFICANCE.decisive * factor.largest, EQUALITY.alike * best)
        candidates: Iterable[tuple[int, ...]] = combinations(range(self.gcps), len(group))
        if special.binom(self.gcps, len(group)) > SAMPLES.large:  # only one GCP exchanged
            outside = sorted(set(range(self.gcps)) - set(group))
            candidates = (tuple(sorted((set(group) - {one}) | {candidate})) for one in group for candidate in outside)
        for candidate in candidates:
            if candidate != group and self.test_group(candidate)[0] >= limit:
                yield candidate

    def _explain_gcp(self, group: tuple[int, ...], gcp: int, factor: VarianceFactor) -> Suspect:
        """Return the wrong part of a GCP, with the others of its group left out: all of it if the part is ambiguous."""
        remaining = self._leave_out_others(group, gcp)
        total, _ = remaining.test_subset(remaining.find_measurements((gcp,)))
        tests = {one: remaining.test_subset(one.out) for one in _list_explanations(remaining, gcp)}
        score = {one: test / factor.largest - SIGNIFICANCE.decisive * rank for one, (test, rank) in tests.items()}
        best = max(score, key=lambda one: score[one])
        limit = score[best] - max(SIGNIFICANCE.decisive, EQUALITY.alike * score[best])
        # height and ground position differ in size only; a measurement is a different explanation
        rivals = [one for one in score if score[one] >= limit and "image" in (one.what, best.what) and one is not best]
        unexplained = total - tests[best][0] > max(SIGNIFICANCE.decisive * factor.largest, EQUALITY.alike * total)
        observations = best.out
        if rivals or unexplained:
            best = Explanation("all", remaining.find_observations((gcp,)))
            observations = np.flatnonzero((remaining.point == gcp) & (remaining.kind != IMAGE))
        row = int(remaining.row[observations[0]]) if best.what == "image" else -1
        error = np.zeros(2 if row >= 0 else 3)
        error[remaining.axis[observations]] = remaining.estimate_errors(observations)
        test = total if best.what == "all" else tests[best][0]
        return Suspect(gcp, best.what, row, float(np.sqrt(test / factor.pooled)), error)


def _list_explanations(control: Discrepancies, gcp: int) -> list[Explanation]:
    """Return the possible errors of a GCP; its height alone only if it has a surveyed plan position as well."""
    of_gcp = control.point == gcp
    survey = np.flatnonzero(of_gcp & (control.kind != IMAGE))
    height = np.flatnonzero(of_gcp & (control.kind == HEIGHT))
    explanations = [Explanation("ground", survey)] if len(survey) else []
    if len(height) and len(survey) > len(height):
        explanations.append(Explanation("height", height))
    rows = control.row[of_gcp & (control.kind == IMAGE)]
    explanations += [Explanation("image", np.flatnonzero(of_gcp & (control.row == row))) for row in np.unique(rows)]
    return explanations

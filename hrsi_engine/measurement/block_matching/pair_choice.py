"""Choice of the pairs of a block that are matched: by probes, so that every image has several links.

Each of K edge-disjoint spanning trees over the images connects the block by itself: every image then has K pairs or
more, and K pairs must fail before the block is divided. The trees are chosen one after the other by the largest number
of agreeing features (Kruskal, 1956). Pairs that fail are removed and the trees are computed again, with preference for
pairs already found; failed pairs are thus replaced by the next best. Further pairs are added where geometry requires
them: a pair with a sufficient convergence angle, and pairs that cover all parts of an image.

The number of pairs tried is limited to a multiple of the number of images.

**Probes** predict how well two images will match, at a small fraction of the cost of matching. The strongest features
of both overviews are compared within bands along the epipolar lines, as wide as the errors of the RPCs. Correct matches
have one common offset across the lines, wrong ones are anywhere in the band: the largest number of matches with offsets
within 4 px of each other is the estimate of the number of correct matches. Sun, season, view angles and overlap all
influence this number, even if they are unknown.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import minimum_spanning_tree

from ...block.block import Image
from ...block.sliding_footprints import GroundRange
from ...foundation.thresholds import GRIDS
from ...foundation.workers.scheduling import PartResult
from ..tile_matching.epipolar import compute_epipolar_deviation
from .coarse import compute_epipolar_lines, reduce_rpc
from .overlaps import CHOICE
from .overview import match_in_bands


class Probe(NamedTuple):
    """Result of the probe of a pair.

    agreeing : number of features with one common offset; convergence_deg : angle between the lines of sight
    cells : bit masks of the parts of the first and of the second image that contain agreeing features
    """

    first: int
    second: int
    agreeing: int
    convergence_deg: float
    cells: tuple[int, int]


@dataclass(frozen=True, eq=False)
class ProbeJob:
    """An image and its candidates, with the reduction factors of their overviews and their strongest features."""

    first: Image
    others: tuple[Image, ...]
    steps: tuple[int, ...]  #: of the first and the other images
    heights: tuple[GroundRange, ...]
    margin_px: float
    features: tuple[PartResult, ...]  #: of the first and the other images


def probe_pairs(job: ProbeJob) -> PartResult:
    """Return ``agreeing (k,)`` and ``cells (k, 2)`` for the first image and each of the others."""
    agreeing = np.zeros(len(job.others), dtype=np.int64)
    cells = np.zeros((len(job.others), 2), dtype=np.int64)
    first_rpc = reduce_rpc(job.first.rpc, job.steps[0])
    reference = job.features[0]
    xy = (reference["xy"] - (job.steps[0] - 1) / 2.0) / job.steps[0]
    for k, partner in enumerate(job.others):
        step, theirs, heights = job.steps[k + 1], job.features[k + 1], job.heights[k]
        second_rpc = reduce_rpc(partner.rpc, step)
        second_xy = (theirs["xy"] - (step - 1) / 2.0) / step
        lines = compute_epipolar_lines(first_rpc, second_rpc, xy, heights)
        usable = np.flatnonzero(np.isfinite(lines.origin).all(axis=1))
        pairs = match_in_bands(
            reference["descriptors"][usable],
            theirs["descriptors"],
            lines.select(usable),
            second_xy,
            job.margin_px / step,
        )
        if not len(pairs):
            continue
        places = xy[usable[pairs[:, 0]]], second_xy[pairs[:, 1]]
        across = compute_epipolar_deviation(
            first_rpc, second_rpc, *places, 0.5 * (heights.low_m + heights.high_m)
        ).across_px
        order = np.argsort(across)
        count = np.searchsorted(across[order], across[order] + CHOICE.agreeing_px, side="right") - np.arange(len(order))
        best = int(np.argmax(count))
        agreeing_rows = order[best : best + int(count[best])]
        agreeing[k] = len(agreeing_rows)
        sizes = np.array(job.first.known_size) / job.steps[0], np.array(partner.known_size) / step
        for side, (place, size) in enumerate(zip(places, sizes, strict=True)):
            cell = np.clip(np.floor(GRIDS.parts * place[agreeing_rows] / size), 0, GRIDS.parts - 1).astype(np.int64)
            cells[k, side] = int(np.bitwise_or.reduce(1 << (cell[:, 1] * GRIDS.parts + cell[:, 0])))
    return {"agreeing": agreeing, "cells": cells}


NumberPair = tuple[int, int]


class PairChoice:
    """Chooses the pairs of a block in rounds.

    images : their number; probes : probes of overlapping pairs
    trees : number of edge-disjoint spanning trees; most_pairs : limit of the number of pairs tried
    """

    def __init__(self, images: int, probes: Sequence[Probe], trees: int, most_pairs: int) -> None:
        self.images, self.trees, self.most_pairs = images, trees, most_pairs
        self.probes = {(probe.first, probe.second): probe for probe in probes}
        self.found: set[NumberPair] = set()
        self.failed: set[NumberPair] = set()
        self.rounds = 0

    @property
    def tried(self) -> int:
        """Number of pairs that were tried."""
        return len(self.found) + len(self.failed)

    @property
    def room(self) -> int:
        """Number of pairs that can still be tried."""
        return self.most_pairs - self.tried

    def choose_round(self) -> list[NumberPair]:
        """Return the pairs to be tried next, the most promising first; empty if the choice is complete."""
        self.rounds += 1
        if self.rounds > CHOICE.rounds or self.room <= 0:
            return []
        # Edge-disjoint spanning trees with the largest sum of ratings
        candidates = [
            pair
            for pair, probe in self.probes.items()
            if pair not in self.failed and (pair in self.found or probe.agreeing > CHOICE.chance)
        ]
        selected: set[NumberPair] = set()
        for _ in range(self.trees):
            if not candidates:
                break
            rating = np.array([self._rate_pair(pair) for pair in candidates])
            found_worth = 1.0 + rating.max()  # matched pairs precede all others, so that they remain selected
            first, second = np.array(candidates).T
            # positive, since a cost of 0 means no edge
            cost = 2.0 * found_worth - rating - found_worth * np.array([pair in self.found for pair in candidates])
            graph = coo_matrix((cost, (first, second)), shape=(self.images, self.images))
            forest = minimum_spanning_tree(graph).tocoo()
            selected |= set(zip(forest.row.tolist(), forest.col.tolist(), strict=True))
            candidates = [pair for pair in candidates if pair not in selected]
        selected |= self._choose_by_geometry(selected)
        # Pairs of images without a significant probe, since the probe can be wrong
        of_image, selected_by_image = self._group_by_image(self.probes), self._group_by_image(selected)
        supplement: set[NumberPair] = set()
        for number, pairs in of_image.items():
            if number in selected_by_image or any(pair in self.found for pair in pairs):
                continue
            tries = CHOICE.last_tries - sum(pair in self.failed for pair in pairs)
            untried = [pair for pair in pairs if pair not in self.failed]
            supplement |= set(sorted(untried, key=self._rate_pair)[::-1][: max(tries, 0)])
        selected |= supplement
        new = [pair for pair in selected if pair not in self.found and pair not in self.failed]
        return sorted(new, key=lambda pair: (-self._rate_pair(pair), pair))[: self.room]

    def tell(self, pair: NumberPair, is_matched: bool) -> None:
        """Record whether a pair matched; a pair recorded as matched can be changed to failed later."""
        self.found.discard(pair)
        self.failed.discard(pair)
        (self.found if is_matched else self.failed).add(pair)

    def list_similar_pairs(self, image: int) -> list[NumberPair]:
        """Return the probed pairs of an image, those with the smallest angle between their views first."""
        pairs_of_image = [pair for pair in self.probes if image in pair]
        return sorted(pairs_of_image, key=lambda pair: (self.probes[pair].convergence_deg, pair))

    def _rate_pair(self, pair: NumberPair) -> float:
        return float(self.probes[pair].agreeing)

    def _choose_by_geometry(self, selected: set[NumberPair]) -> set[NumberPair]:
        """Return a pair with a convergence angle for images without one, and pairs that cover more parts of images."""
        supplement: set[NumberPair] = set()
        of_image = self._group_by_image(pair for pair in self.probes if pair not in self.failed)
        selected_by_image = self._group_by_image(selected)
        for number, pairs in of_image.items():
            reliable = [pair for pair in pairs if self.probes[pair].agreeing > CHOICE.chance]
            selected_pairs = selected_by_image.get(number, [])
            if all(self.probes[pair].convergence_deg < CHOICE.wanted_angle_deg for pair in selected_pairs):
                wide = [pair for pair in reliable if self.probes[pair].convergence_deg >= CHOICE.wanted_angle_deg]
                supplement |= set(sorted(wide, key=self._rate_pair)[-1:])
            covered = 0
            for pair in selected_pairs:
                covered |= self._cells_of_image(pair, number)
            lacking = ~covered & ((1 << GRIDS.parts**2) - 1)
            added = {pair: (self._cells_of_image(pair, number) & lacking).bit_count() for pair in reliable}
            fill = max(reliable, key=lambda pair: (added[pair], self._rate_pair(pair)), default=None)
            if fill is not None and added[fill]:
                supplement.add(fill)
        return supplement

    def _cells_of_image(self, pair: NumberPair, image: int) -> int:
        return self.probes[pair].cells[0 if pair[0] == image else 1]

    @staticmethod
    def _group_by_image(pairs: Iterable[NumberPair]) -> dict[int, list[NumberPair]]:
        by_image: dict[int, list[NumberPair]] = {}
        for pair in pairs:
            for number in pair:
                by_image.setdefault(number, []).append(pair)
        return by_image

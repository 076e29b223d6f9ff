"""Choice of the pairs of a block that are matched: by probes, such that every image has several links.

Each of K spanning trees over the images, none of whose pairs another one has, holds the block together by itself: an
image then hangs on K pairs at least, and K pairs must fail before the block falls apart. The trees are those with the
most agreeing features, one after the other (Kruskal, 1956). Pairs that fail are taken out and the trees are made anew,
with those that were found already; so failed pairs are replaced by the next best. What geometry wants besides, a pair
with an angle for heights and all parts of an image covered, is added.

The number of pairs tried is bounded by a multiple of the number of images.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import minimum_spanning_tree

from .overlaps import CHOICE
from .probes import Probe

NumberPair = tuple[int, int]


class PairChoice:
    """Chooses the pairs of a block round by round.

    images : their number; probes : what is known of pairs that overlap
    trees : number of edge-disjoint spanning trees; most_pairs : that are tried in all
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
        """Number of pairs that may still be tried."""
        return self.most_pairs - self.tried

    def choose_round(self) -> list[NumberPair]:
        """Return the pairs to try now, the most promising first; none where the choice is done."""
        self.rounds += 1
        if self.rounds > CHOICE.rounds or self.room <= 0:
            return []
        wanted = self._choose_trees()
        wanted |= self._choose_by_geometry(wanted)
        # Pairs of the images that no probe gives hope: the probe may be wrong
        of_image, chosen = self._group_by_image(self.probes), self._group_by_image(wanted)
        more: set[NumberPair] = set()
        for number, pairs in of_image.items():
            if number in chosen or any(pair in self.found for pair in pairs):
                continue
            left = CHOICE.last_tries - sum(pair in self.failed for pair in pairs)
            untried = [pair for pair in pairs if pair not in self.failed]
            more |= set(sorted(untried, key=self._rate_pair)[::-1][: max(left, 0)])
        wanted |= more
        new = [pair for pair in wanted if pair not in self.found and pair not in self.failed]
        return sorted(new, key=lambda pair: (-self._rate_pair(pair), pair))[: self.room]

    def tell(self, pair: NumberPair, found: bool) -> None:
        """Record whether a pair matched; a pair that matched may fail later."""
        self.found.discard(pair)
        self.failed.discard(pair)
        (self.found if found else self.failed).add(pair)

    def list_similar_pairs(self, image: int) -> list[NumberPair]:
        """Return the probed pairs of an image, those with the smallest angle between their views first."""
        own = [pair for pair in self.probes if image in pair]
        return sorted(own, key=lambda pair: (self.probes[pair].convergence_deg, pair))

    def _rate_pair(self, pair: NumberPair) -> float:
        probe = self.probes[pair]
        return probe.agreeing * (CHOICE.narrow_worth if probe.convergence_deg < CHOICE.narrow_deg else 1.0)

    def _choose_trees(self) -> set[NumberPair]:
        """Return the pairs of the spanning trees of greatest worth, none in two of them."""
        left = [pair for pair, probe in self.probes.items()
                if pair not in self.failed and (pair in self.found or probe.agreeing > CHOICE.chance)]  # fmt: skip
        chosen: set[NumberPair] = set()
        for _ in range(self.trees):
            if not left:
                break
            worth = np.array([self._rate_pair(pair) + CHOICE.found_worth * (pair in self.found) for pair in left])
            first, second = np.array(left).T
            cost = 2.0 * CHOICE.found_worth - worth  # positive: a cost of 0 would be no edge
            forest = minimum_spanning_tree(
                coo_matrix((cost, (first, second)), shape=(self.images, self.images))
            ).tocoo()
            chosen |= set(zip(forest.row.tolist(), forest.col.tolist(), strict=True))
            left = [pair for pair in left if pair not in chosen]
        return chosen

    def _choose_by_geometry(self, wanted: set[NumberPair]) -> set[NumberPair]:
        """Return a pair for each image that has none with an angle, and one for each that is not covered."""
        more: set[NumberPair] = set()
        of_image = self._group_by_image(pair for pair in self.probes if pair not in self.failed)
        chosen = self._group_by_image(wanted)
        for number, pairs in of_image.items():
            good = [pair for pair in pairs if self.probes[pair].agreeing > CHOICE.chance]
            own = chosen.get(number, [])
            if all(self.probes[pair].convergence_deg < CHOICE.wanted_angle_deg for pair in own):
                wide = [pair for pair in good if self.probes[pair].convergence_deg >= CHOICE.wanted_angle_deg]
                more |= set(sorted(wide, key=self._rate_pair)[-1:])
            covered = 0
            for pair in own:
                covered |= self._cells_of_image(pair, number)
            lacking = ~covered & ((1 << CHOICE.cells**2) - 1)
            added = {pair: (self._cells_of_image(pair, number) & lacking).bit_count() for pair in good}
            fill = max(good, key=lambda pair: (added[pair], self._rate_pair(pair)), default=None)
            if fill is not None and added[fill]:
                more.add(fill)
        return more

    def _cells_of_image(self, pair: NumberPair, image: int) -> int:
        return self.probes[pair].cells[0 if pair[0] == image else 1]

    @staticmethod
    def _group_by_image(pairs: Iterable[NumberPair]) -> dict[int, list[NumberPair]]:
        by_image: dict[int, list[NumberPair]] = {}
        for pair in pairs:
            for number in pair:
                by_image.setdefault(number, []).append(pair)
        return by_image

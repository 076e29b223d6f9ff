"""Reliability of the links between images: closures of triangles, weak links, bridges, connections of each image.

A link is a pair with matches. Three links i-j, j-k, i-k form a triangle: a point p of i that is matched at q in j and
at r in k must be at the position that the link j-k predicts for q, from the common displacement of its matches near q.
The median of the closures of many points is near 0 if all three links are correct, and arbitrary if one of them is
false, for example because of repeated patterns. A link is excluded if two more of its triangles are open than closed;
the worst is excluded first, together with its open triangles.

A link without a loop (a bridge of the graph of links) is not checked. An image that is connected only by such a link
with few matches is excluded, since they are in one part of it only. Bridges are found by random numbers (Pritchard and
Thurimella, 2011): each link outside a spanning tree has one, which is added modulo 2 to all links of the tree between
its ends; a link of the tree whose sum is 0 is not in a loop.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import cKDTree

from ...block.block import Image
from ...foundation.thresholds import SAMPLES, threshold, thresholds
from ..tile_matching.epipolar import EPIPOLAR
from .coarse import COARSE
from .joining import BlockMatches, group_by_pair
from .pair_choice import NumberPair

_YEAR = "simulated year, seeds up to 30; 2026-11-22 (docs/many_dates.md)"


@thresholds
class LINKS:
    """Conditions for a reliable link (pair of matched images)."""

    near_px: float = threshold(40.0, "px", "largest distance of a predicted point from the third link's matches")
    weak_matches: int = threshold(16, "matches", "matches of a link below which other links are preferred", _YEAR)
    strong_links: int = threshold(2, "links", "number of links with more matches at which it is dropped")
    smallest_part: int = threshold(3, "images", "images of the smallest separate part that is used")
    displaced_px: float = threshold(32.0, "px", "smallest offset of an image with a wrong RPC")
    displaced_factor: float = threshold(8.0, "", "… relative to the median offset of the block")


class ImageLink(NamedTuple):
    """A link by the indices of its images.

    matches : number of matches kept; closed, open : number of its triangles; sound : whether its matches are used
    """

    first: int
    second: int
    matches: int
    closed: int
    open: int
    sound: bool


class ImageConnection(NamedTuple):
    """Connection of an image to the others of its block.

    links : number of its reliable links; images : number of images connected to it directly or indirectly, with itself
    tried : number of its pairs that were tried; reason : why it has no reliable link; empty if it has one
    """

    image: str
    links: int
    images: int
    tried: int
    reason: str = ""

    @property
    def sentence(self) -> str:
        """The connection as a sentence."""
        if not self.links:
            return f"{self.image}: connected to no other image ({self.reason})"
        partners = "1 other image" if self.links == 1 else f"{self.links} other images"
        return f"{self.image}: connected to {partners} by reliable matches, in a block of {self.images} images"


def judge_links(matches: BlockMatches) -> list[ImageLink]:
    """Return all links with the numbers of their closed and open triangles, and whether they are reliable."""
    rows = group_by_pair(matches)
    # Open and closed triangles of links; those with too few common points are in neither list
    open_: list[tuple[NumberPair, ...]] = []
    closed: list[tuple[NumberPair, ...]] = []
    stars: dict[int, list[int]] = {}
    for first, second in rows:
        stars.setdefault(first, []).append(second)
    trees: dict[NumberPair, cKDTree] = {}
    for centre, partners in stars.items():
        for j, k in combinations(sorted(partners), 2):
            third = next((pair for pair in ((j, k), (k, j)) if pair in rows), None)
            if third is None:
                continue
            closure = _compute_closure(
                matches, rows[centre, third[0]], rows[centre, third[1]], third, rows[third], trees
            )
            if closure is not None:
                triangle = (centre, third[0]), (centre, third[1]), third
                (closed if closure <= EPIPOLAR.mode_px else open_).append(triangle)
    strong = np.array([pair for pair, of_pair in rows.items() if len(of_pair) >= LINKS.weak_matches]).ravel()
    sound = {
        pair: len(of_pair) >= LINKS.weak_matches
        or min(np.sum(strong == number) for number in pair) < LINKS.strong_links
        for pair, of_pair in rows.items()
    }
    in_open, in_closed = _count_triangles(open_), _count_triangles(closed)
    open_triangles, closed_triangles = open_, closed
    while open_triangles:
        more_open = _count_triangles(open_triangles)
        more_open.subtract(_count_triangles(closed_triangles))
        worst = max(
            {pair for triangle in open_triangles for pair in triangle}, key=lambda pair: (more_open[pair], pair)
        )
        if more_open[worst] < LINKS.strong_links:
            break
        sound[worst] = False
        open_triangles, closed_triangles = (
            [t for t in triangles if worst not in t] for triangles in (open_triangles, closed_triangles)
        )
    return [
        ImageLink(*pair, len(match_rows), in_closed[pair], in_open[pair], sound[pair])
        for pair, match_rows in rows.items()
    ]


def _count_triangles(triangles: Sequence[tuple[NumberPair, ...]]) -> Counter[NumberPair]:
    """Return the number of the given triangles that contain each link."""
    return Counter(pair for triangle in triangles for pair in triangle)


def _compute_closure(
    matches: BlockMatches,
    first: np.ndarray,
    second: np.ndarray,
    third: NumberPair,
    between: np.ndarray,
    trees: dict[NumberPair, cKDTree],
) -> float | None:
    """Return the median closure of a triangle in px; None if too few points are in all three links."""
    _, a, b = np.intersect1d(matches.track[first], matches.track[second], return_indices=True)
    q, r = matches.second_xy[first[a]], matches.second_xy[second[b]]
    if len(a) < SAMPLES.tested:
        return None
    if third not in trees:
        trees[third] = cKDTree(matches.first_xy[between])
    count = min(SAMPLES.tested, len(between))
    distance, neighbours = trees[third].query(q, k=count, distance_upper_bound=LINKS.near_px)
    distance, neighbours = distance.reshape(len(q), count), neighbours.reshape(len(q), count)
    has_neighbour = np.isfinite(distance)
    usable = has_neighbour[:, 0]
    if usable.sum() < SAMPLES.tested:
        return None
    step = matches.second_xy[between] - matches.first_xy[between]
    # Local displacement relative to the affine map of the complete link, because of rotations between the images
    terms = np.column_stack([np.ones(len(between)), matches.first_xy[between]])
    affine = np.linalg.lstsq(terms, step, rcond=None)[0]
    closure = step - terms @ affine
    nearest = np.where(has_neighbour[:, :, None], closure[np.where(has_neighbour, neighbours, 0)], np.nan)
    expected = np.column_stack([np.ones(len(q)), q]) @ affine
    expected[usable] += np.nanmedian(nearest[usable], axis=1)
    return float(np.median(np.hypot(*(q + expected - r)[usable].T)))


def cut_weak_bridges(links: Sequence[ImageLink]) -> list[ImageLink]:
    """Return the links; bridges with few matches that alone connect an image are marked as not reliable.

    Parts that are then too small, next to a larger block, are also excluded.
    """
    sound = [link for link in links if link.sound]
    loops = _LinkGraph(sound)
    cut = {
        (link.first, link.second)
        for link, bridge in zip(sound, loops.bridge, strict=True)
        if bridge and link.matches < COARSE.enough and min(loops.size[link.first], loops.size[link.second]) == 1
    }
    remaining = [link for link in sound if (link.first, link.second) not in cut]
    size = _LinkGraph(remaining).together
    largest = max(size.values(), default=0)
    cut |= {(link.first, link.second) for link in remaining if size[link.first] < min(LINKS.smallest_part, largest)}
    return [link._replace(sound=link.sound and (link.first, link.second) not in cut) for link in links]


def find_bridges(links: Sequence[ImageLink]) -> list[tuple[ImageLink, list[int]]]:
    """Return the reliable links without a loop, each with the images of the smaller part that it connects."""
    sound = [link for link in links if link.sound]
    bridges = []
    for place in np.flatnonzero(_LinkGraph(sound).bridge).tolist():
        link = sound[place]
        part = _LinkGraph([*sound[:place], *sound[place + 1 :]]).part
        sides = [
            [number for number, component in part.items() if component == part.get(end)] or [end]
            for end in (link.first, link.second)
        ]
        bridges.append((link, min(sides, key=len)))
    return bridges


class _LinkGraph:
    """The graph of links: its bridges, and its connected components with and without bridges.

    bridge : (links,) whether the link is a bridge
    size : by image, the number of images in its component without bridges
    part, together : by image, its connected component, and the number of images in it
    """

    def __init__(self, links: Sequence[ImageLink]) -> None:
        pairs = np.array([link[:2] for link in links], dtype=np.int64).reshape(-1, 2)
        numbers, ends = np.unique(pairs, return_inverse=True)
        ends, count = ends.reshape(-1, 2), len(numbers)
        _, part = connected_components(_build_adjacency(ends, count), directed=False)
        # An additional root connected to one image of every component makes one tree of all
        heads = np.unique(part, return_index=True)[1]
        rooted = np.concatenate([ends, np.column_stack([np.full(len(heads), count), heads])])
        order, parent = breadth_first_order(_build_adjacency(rooted, count + 1), count, directed=False)
        in_tree = (parent[ends[:, 0]] == ends[:, 1]) | (parent[ends[:, 1]] == ends[:, 0])
        cycle_key = np.zeros(count + 1, dtype=np.uint64)
        keys = np.random.default_rng(0).integers(1, 2**63, len(ends), dtype=np.uint64)
        np.bitwise_xor.at(cycle_key, ends[~in_tree].ravel(), np.repeat(keys[~in_tree], 2))
        for image in order[:0:-1].tolist():
            cycle_key[parent[image]] ^= cycle_key[image]
        lower = np.where(parent[ends[:, 0]] == ends[:, 1], ends[:, 0], ends[:, 1])
        self.bridge = in_tree & (cycle_key[lower] == 0)
        _, looped = connected_components(_build_adjacency(ends[~self.bridge], count), directed=False)
        names = numbers.tolist()
        self.size = dict(zip(names, np.bincount(looped)[looped].tolist(), strict=True))
        self.part = dict(zip(names, part.tolist(), strict=True))
        self.together = dict(zip(names, np.bincount(part)[part].tolist(), strict=True))


def _build_adjacency(pairs: np.ndarray, count: int) -> coo_matrix:
    return coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))


def drop_unreliable_links(matches: BlockMatches, links: Sequence[ImageLink]) -> BlockMatches:
    """Return the matches of reliable links only, in both orders of the images."""
    sound = {frozenset(link[:2]) for link in links if link.sound}
    keep = np.zeros(len(matches), dtype=bool)
    for pair, rows in group_by_pair(matches).items():
        keep[rows] = frozenset(pair) in sound
    return matches.select(keep)


def find_displaced_images(offsets_px: Mapping[NumberPair, float]) -> dict[int, float]:
    """Return the images whose RPCs differ strongly from those of all others, and the difference in pixels.

    ``offsets_px`` are the offsets of the RPCs of each pair across the epipolar lines. An image is displaced if the
    median of its offsets is several times that of the block; its pairs are then removed for the test of the others.
    """
    remaining: dict[NumberPair, float] = dict(offsets_px)
    displaced: dict[int, float] = {}
    while len(remaining) >= 3:
        usual = float(np.median(list(remaining.values())))
        limit = max(LINKS.displaced_px, LINKS.displaced_factor * usual)
        of_image: dict[int, list[float]] = {}
        for pair, offset in remaining.items():
            for number in pair:
                of_image.setdefault(number, []).append(offset)
        median = {number: float(np.median(offsets)) for number, offsets in of_image.items() if len(offsets) > 1}
        worst = max(median, key=lambda number: median[number], default=None)
        if worst is None or median[worst] <= limit:
            return displaced
        displaced[worst] = median[worst]
        remaining = {pair: offset for pair, offset in remaining.items() if worst not in pair}
    return displaced


def summarise_connections(
    images: Sequence[Image],
    usable: Sequence[int],
    links: Sequence[ImageLink],
    trials: Mapping[int, int],
    reasons: Mapping[int, str],
) -> tuple[ImageConnection, ...]:
    """Return for each usable image its number of reliable links, and the number of images connected with it."""
    sound = [link for link in links if link.sound]
    count = Counter(number for link in sound for number in link[:2])
    component_size = _LinkGraph(sound).together
    faults: dict[int, str] = {}
    for link in sorted(set(links) - set(sound), key=lambda link: (link.matches, link)):
        for number, partner in (link[:2], link[1::-1]):
            faults[number] = (
                f"its matches with {images[partner].id} contradict those of other images"
                if link.open
                else f"it has only {link.matches} matches, with {images[partner].id}, and no third image confirms them"
            )
    return tuple(
        ImageConnection(
            images[number].id,
            count[number],
            component_size.get(number, 1),
            int(trials.get(number, 0)),
            "" if count[number] else reasons.get(number, faults.get(number, "no pair of it has consistent matches")),
        )
        for number in usable
    )

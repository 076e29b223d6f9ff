"""Where the control network begins: super points of a part of the first window found in the whole second window.

A part of about 400 x 400 pixels has about a hundred super points, as in the thesis. In a larger window relief bends the
network, and the number of pairs of roots would grow with the square of the area; so parts are tried one by one, those
near the middle first, until one of them is found in the second window.

Geometry may not determine where few super points repeat (wide angles, other dates, small overlap). Where features vote
clearly for one similarity, interest points that look similar are paired near where it puts them (`find_feature_seeds`).
Else the likeliest hypotheses are compared by what their nodes look like (`find_grey_seeds`).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.progress import Progress, advance, silent, stage
from ...foundation.thresholds import threshold, thresholds
from ..interest_points.points import select_best_per_cell
from .growth import agrees_with_neighbours
from .leaves import NETWORK_PAIRS, Tolerance, find_mutual_best, rotate_offset
from .network import NO_FATHER, Network
from .super_points import (
    AMBIGUOUS,
    SUPER_POINTS,
    Hypothesis,
    SuperPointMatch,
    bound_root_pairs,
    find_likely_hypotheses,
    is_rival,
    match_super_points,
)
from .views import NetworkWindow, correlate_patches


@thresholds
class SEEDING:
    """Which super points a network begins with, and when its first nodes are accepted."""

    cell_px: float = threshold(100.0, "px", "side of a cell", "thesis section 3.3: 110 in 400 x 400 px")
    points_per_cell: int = threshold(7, "points", "super points in a cell", "thesis section 3.3: 110 in 400 x 400 px")
    part_px: float = threshold(400.0, "px", "side of a part of the first window", "thesis section 3.3: 400 x 400 px")
    fewest_points: int = threshold(8, "points", "fewest super points of a part, and of the second window")
    fewest_nodes: int = threshold(8, "nodes", "fewest correlated nodes of a first network", NETWORK_PAIRS)
    smallest_node_share: float = threshold(0.3, "", "… and smallest share of all nodes (chance: 0.05)", NETWORK_PAIRS)
    consistency_px: float = threshold(4.0, "px", "largest difference of a first node from its neighbours (relief)")
    grey_reaches: tuple[float, float] = threshold((1.0, 0.6), "", "shares of the reach that are tried", NETWORK_PAIRS)
    feature_reach_px: float = threshold(8.0, "px", "largest distance from the position by features", NETWORK_PAIRS)
    feature_spread_px: float = threshold(0.75, "px", "largest epipolar scatter of such a network", NETWORK_PAIRS)
    likely_pairs: int = threshold(150, "pairs", "most probable pairs of roots that are correlated", NETWORK_PAIRS)


class Seed(NamedTuple):
    """A first network, the hypothesis that it comes from, and how many correspondences the best rival had.

    largest_spread_px : robust standard deviation from the epipolar geometry of all, above which what grows from it is
    no match
    """

    network: Network
    hypothesis: Hypothesis
    runner_up: int
    largest_spread_px: float = np.inf


class SeedOptions(NamedTuple):
    """Tolerance and reach of super-point networks, scales to try, least correlation of two nodes' patches."""

    tolerance: Tolerance
    reach_px: float
    scales: tuple[float, ...]
    correlation: float


def split_into_parts(view: NetworkWindow, rows: np.ndarray) -> list[np.ndarray]:
    """Return the super points of each part of the first window, parts near the middle first."""
    count = np.maximum(np.rint(view.size / SEEDING.part_px), 1).astype(int)
    number = np.minimum((view.xy[rows] / (view.size / count)).astype(int), count - 1)
    cells = np.stack(np.meshgrid(*map(np.arange, count)), axis=-1).reshape(-1, 2)
    from_middle = np.hypot(*(((cells + 0.5) / count - 0.5) * view.size).T)
    parts = [rows[(number == cells[part]).all(axis=1)] for part in np.argsort(from_middle, kind="stable")]
    return [part for part in parts if len(part) >= SEEDING.fewest_points]


def find_seeds(
    first: NetworkWindow,
    second: NetworkWindow,
    options: SeedOptions,
    attempts: list[SuperPointMatch],
    progress: Progress = silent,
    similarity: np.ndarray | None = None,
) -> Iterator[Seed]:
    """Yield first networks, most trustworthy first; every super-point match is noted in ``attempts``.

    ``similarity (2, 3)`` is where features put the first window's points, if they determine it.
    """
    # The thesis takes the strongest points of a whole window; cells do the same for windows of any size
    per_cell = SEEDING.cell_px, SEEDING.points_per_cell
    ours, theirs = (select_best_per_cell(view.points, *per_cell) for view in (first, second))
    parts = split_into_parts(first, ours) if len(theirs) >= SEEDING.fewest_points else []
    for number, rows in enumerate(parts):
        part = stage(progress, number / len(parts), (number + 1) / len(parts))
        criteria = options.tolerance, options.reach_px, options.scales
        match = match_super_points(first.xy[rows], second.xy[theirs], *criteria, part)
        attempts.append(match)
        if match.best is not None and match.status != AMBIGUOUS:
            network = make_network(match.best, first, second, rows, theirs, options.correlation)
            if _has_enough_nodes(network, match.best):
                yield Seed(network, match.best, match.runner_up)
    if similarity is not None and not any(match.status == AMBIGUOUS for match in attempts):
        yield from find_feature_seeds(first, second, similarity, options)
    for match, rows in zip(list(attempts), parts, strict=True):
        advance(progress, 1.0, "control network: comparing grey values")
        if match.status != AMBIGUOUS:
            yield from find_grey_seeds(first, second, rows, theirs, options)


def find_grey_seeds(
    first: NetworkWindow, second: NetworkWindow, rows: np.ndarray, theirs: np.ndarray, options: SeedOptions
) -> Iterator[Seed]:
    """Yield the network of the hypothesis of which most nodes look similar, if no other has nearly as many."""
    tested, hypotheses = [], []
    for share in SEEDING.grey_reaches:
        reach_px = share * options.reach_px
        sets = bound_root_pairs(first.xy[rows], second.xy[theirs], options.tolerance, reach_px, options.scales)
        hypotheses += find_likely_hypotheses(sets, SEEDING.likely_pairs)
    for hypothesis in hypotheses:
        network = make_network(hypothesis, first, second, rows, theirs, options.correlation)
        if _has_enough_nodes(network, hypothesis):
            tested.append((len(network), network, hypothesis))
    if not tested:
        return
    largest_count, network, best = max(tested, key=lambda entry: entry[0])
    rivals = [count for count, _, rival in tested if is_rival(sets, best, rival)]
    if max(rivals, default=0) < SUPER_POINTS.rival_share * largest_count:
        yield Seed(network, best, max(rivals, default=0))


def find_feature_seeds(
    first: NetworkWindow, second: NetworkWindow, similarity: np.ndarray, options: SeedOptions
) -> Iterator[Seed]:
    """Yield the network of the interest points that look similar near where a similarity puts them."""
    matrix, shift = similarity[:, :2], similarity[:, 2]
    neighbours = cKDTree(second.xy).query_ball_point(first.xy @ matrix.T + shift, SEEDING.feature_reach_px)
    a = np.repeat(np.arange(len(neighbours)), [len(rows) for rows in neighbours])
    b = np.array([row for rows in neighbours for row in rows], dtype=int)
    correlation = correlate_patches(first, second, first.xy[a], second.xy[b], np.broadcast_to(matrix, (len(a), 2, 2)))
    likely = np.flatnonzero(correlation >= options.correlation)
    selected = likely[find_mutual_best(a[likely], b[likely], -correlation[likely])]
    if len(selected) < SEEDING.fewest_nodes:
        return
    # The root is the node nearest to the middle of all
    distance_px = np.hypot(*(first.xy[a[selected]] - np.median(first.xy[a[selected]], axis=0)).T)
    selected = selected[np.argsort(distance_px, kind="stable")]
    scale, turn = float(np.hypot(*matrix[:, 0])), float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    hypothesis = Hypothesis((-1, -1), (-1, -1), scale, turn, np.column_stack([a, b])[selected], 0.0)
    all_rows = np.arange(max(len(first.xy), len(second.xy)))
    network = make_network(hypothesis, first, second, all_rows, all_rows, options.correlation)
    if _has_enough_nodes(network, hypothesis):
        yield Seed(network, hypothesis, 0, SEEDING.feature_spread_px)


def _has_enough_nodes(network: Network, hypothesis: Hypothesis) -> bool:
    """Return whether enough nodes look similar: in number, and of the hypothesis's correspondences."""
    return len(network) >= max(SEEDING.fewest_nodes, SEEDING.smallest_node_share * hypothesis.count)


def make_network(
    best: Hypothesis,
    first: NetworkWindow,
    second: NetworkWindow,
    rows: np.ndarray,
    theirs: np.ndarray,
    least_correlation: float,
) -> Network:
    """Return a hypothesis as a network: the root and its leaves, ``rows`` and ``theirs`` of the two windows' points.

    Nodes are left out that do not look similar under the hypothesis's rotation and scale, or do not agree with their
    neighbours.
    """
    a, b = rows[best.pairs[:, 0]], theirs[best.pairs[:, 1]]
    father, generation = np.zeros(len(a), dtype=int), np.ones(len(a), dtype=int)
    father[0], generation[0] = NO_FATHER, 0
    matrix = rotate_offset(np.eye(2), best.rotation_rad, best.scale).T
    matrices = np.broadcast_to(matrix, (len(a), 2, 2))
    correlation = correlate_patches(first, second, first.xy[a], second.xy[b], matrices)
    complete = Network(
        a,
        b,
        father,
        generation=generation,
        correlation=correlation,
        first=first.xy[a],
        second=second.xy[b],
        matrix=matrix,
    )
    network = complete.select(correlation >= least_correlation)
    return network.select(agrees_with_neighbours(network, SEEDING.consistency_px))

"""Which pairs are matched, which links hold: on graphs and matches whose truth is known."""

from itertools import combinations

import numpy as np
import pytest
import simulated_blocks as blocks
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from hrsi.hrsi_engine.block.sliding_footprints import GroundRange
from hrsi.hrsi_engine.measurement.block_matching.coarse import COARSE
from hrsi.hrsi_engine.measurement.block_matching.joining import BlockMatches
from hrsi.hrsi_engine.measurement.block_matching.links import (
    LINKS,
    ImageLink,
    cut_weak_bridges,
    drop_unreliable_links,
    find_bridges,
    find_displaced_images,
    judge_links,
)
from hrsi.hrsi_engine.measurement.block_matching.overlaps import CHOICE, Overlap, choose_probes
from hrsi.hrsi_engine.measurement.block_matching.pair_choice import PairChoice, Probe, ProbeJob, probe_pairs
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import transfer

ALL_CELLS = (511, 511)


def seasons(images: int, seed: int = 1) -> list[Probe]:
    """Return probes of images over a year: neighbours in time agree well, opposite seasons by chance."""
    rng = np.random.default_rng(seed)
    day = np.sort(rng.uniform(0.0, 365.0, images))
    probes = []
    for a, b in combinations(range(images), 2):
        apart = min(abs(day[a] - day[b]), 365.0 - abs(day[a] - day[b]))
        agreeing = int(rng.poisson(120.0 * np.exp(-apart / 40.0) + 2.0))
        probes.append(Probe(a, b, agreeing, float(rng.uniform(0.0, 30.0)), ALL_CELLS))
    return probes


def run_choice(choice: PairChoice, succeeds) -> None:
    while pairs := choice.choose_round():
        for pair in pairs:
            choice.tell(pair, succeeds(pair))


def parts(images: int, pairs: set[tuple[int, int]]) -> int:
    first, second = np.array(sorted(pairs)).T
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(images, images))
    return int(connected_components(graph, directed=False)[0])


@pytest.mark.parametrize("images", [40, 200])
def test_pairs_grow_with_the_images_and_any_three_failures_leave_one_block(images: int):
    """Four edge-disjoint trees: whatever three pairs of the choice are taken away, the block is in one piece."""
    choice = PairChoice(images, seasons(images), 4, 5 * images)
    run_choice(choice, lambda pair: True)
    assert 4 * (images - 1) <= choice.tried <= 5 * images
    rng = np.random.default_rng(2)
    pairs = sorted(choice.found)
    degree = np.bincount(np.array(pairs).ravel(), minlength=images)
    assert degree.min() >= 4
    weakest = int(np.argmin(degree))  # the worst place to lose pairs
    for _ in range(20):
        own = [pair for pair in pairs if weakest in pair]
        lost = {own[k] for k in rng.choice(len(own), 3, replace=False)}
        assert parts(images, set(pairs) - lost) == 1


def test_failed_pairs_are_replaced():
    """A third of the pairs fail at random: still one block, within the bound of tries."""
    images = 40
    rng = np.random.default_rng(3)
    fails = {(probe.first, probe.second): rng.random() < 0.33 for probe in seasons(images)}
    choice = PairChoice(images, seasons(images), 4, 5 * images)
    run_choice(choice, lambda pair: not fails[pair])
    assert parts(images, choice.found) == 1
    assert choice.tried <= 5 * images and len(choice.failed) > 30


def test_hopeless_images_cost_three_tries_each_and_harm_nobody():
    images, hopeless = 40, {3, 11, 17, 20, 28, 31, 35, 39}
    probes = [
        probe._replace(agreeing=min(probe.agreeing, CHOICE.chance)) if {probe.first, probe.second} & hopeless else probe
        for probe in seasons(images)
    ]
    choice = PairChoice(images, probes, 4, 5 * images)
    run_choice(choice, lambda pair: not set(pair) & hopeless)
    tries = [pair for pair in choice.failed if set(pair) & hopeless]
    assert len(tries) <= CHOICE.last_tries * len(hopeless)
    assert parts(images, choice.found) == 1 + len(hopeless)


def test_an_image_without_an_angle_gets_one():
    """Views 0 to 4 look alike and match best; 5 to 9 look from elsewhere."""
    probes = [
        Probe(a, b, 200 if b < 5 else 40, 1.0 if (a < 5) == (b < 5) else 15.0, ALL_CELLS)
        for a, b in combinations(range(10), 2)
    ]
    choice = PairChoice(10, probes, 1, 50)
    run_choice(choice, lambda pair: True)
    for image in range(10):
        angles = [choice.probes[pair].convergence_deg for pair in choice.found if image in pair]
        assert max(angles) >= 15.0


def test_what_an_image_s_pairs_leave_open_is_covered():
    probes = [Probe(0, 1, 100, 10.0, (0b000000111, 511)), Probe(0, 2, 50, 10.0, (0b111111000, 511)),
              Probe(1, 2, 90, 10.0, ALL_CELLS)]  # fmt: skip
    choice = PairChoice(3, probes, 1, 10)
    assert (0, 2) in choice.choose_round()


def test_only_near_views_are_probed_where_there_are_many():
    images = 300
    overlaps = [Overlap(a, b, 1.0) for a, b in combinations(range(images), 2)]
    angle = np.array([0.1 * abs(pair.first - pair.second) for pair in overlaps])
    rows = choose_probes(overlaps, angle)
    assert len(rows) <= CHOICE.partners * images
    nearest = {(k, k + 1) for k in range(images - 1)}
    assert nearest <= {(overlaps[row].first, overlaps[row].second) for row in rows}


# ---- links -----------------------------------------------------------------------------------------------------------


def block_matches(images: int, false: dict[tuple[int, int], tuple[float, float]], few: set = frozenset()):
    """Return matches of all pairs of images that are shifted copies, rotated a little; false links lead elsewhere."""
    rng = np.random.default_rng(4)
    shift = rng.uniform(-30.0, 30.0, (images, 2))
    turn = rng.uniform(-0.05, 0.05, images)
    ground = rng.uniform(50.0, 950.0, (600, 2))

    def seen(image: int, xy: np.ndarray) -> np.ndarray:
        c, s = np.cos(turn[image]), np.sin(turn[image])
        return (xy - 500.0) @ np.array([[c, -s], [s, c]]).T + 500.0 + shift[image]

    rows: dict[str, list[np.ndarray]] = {"track": [], "first": [], "second": [], "first_xy": [], "second_xy": []}
    for a in range(images):
        own = rng.choice(600, 250, replace=False)
        for b in range(a + 1, images):
            chosen = own[rng.random(250) < 0.7]
            if (a, b) in few:
                chosen = chosen[: LINKS.weak_matches - 4]
            rows["track"].append(a * 1000 + chosen)
            rows["first"].append(np.full(len(chosen), a))
            rows["second"].append(np.full(len(chosen), b))
            rows["first_xy"].append(seen(a, ground[chosen]))
            wrong = np.array(false.get((a, b), (0.0, 0.0)))
            rows["second_xy"].append(seen(b, ground[chosen]) + wrong + rng.normal(0.0, 0.2, (len(chosen), 2)))
    columns = {name: np.concatenate(parts) for name, parts in rows.items()}
    count = len(columns["track"])
    return BlockMatches(
        **columns, sigma_px=np.full(count, 0.1), quality=np.ones(count), kind=np.full(count, "corner"),
        height_m=np.zeros(count),
    )  # fmt: skip


def test_false_links_are_found_by_closures_and_nothing_else():
    """Links that lie 12 px beside the truth, all alike: no test of the pair alone can see that."""
    false = {(0, 3): (12.0, 0.0), (2, 4): (0.0, -9.0)}
    matches = block_matches(6, false)
    links = judge_links(matches)
    assert {(link.first, link.second) for link in links if not link.sound} == set(false)
    kept = drop_unreliable_links(matches, links)
    assert not any(((kept.first == a) & (kept.second == b)).any() for a, b in false)
    assert len(kept) == len(matches) - sum(link.matches for link in links if not link.sound)


def test_of_a_single_triangle_nobody_knows():
    assert all(link.sound for link in judge_links(block_matches(3, {(0, 1): (12.0, 0.0)})))


def test_weak_links_go_where_both_images_have_better_ones():
    links = judge_links(block_matches(5, {}, few={(1, 3)}))
    assert [(link.first, link.second) for link in links if not link.sound] == [(1, 3)]
    lonely = judge_links(block_matches(2, {}, few={(0, 1)}))
    assert lonely[0].sound


def links_of(pairs: dict[tuple[int, int], int]) -> list[ImageLink]:
    return [ImageLink(*pair, matches, 0, 0, True) for pair, matches in pairs.items()]


def test_an_image_on_no_loop_is_left_out_unless_its_link_is_strong():
    """0 to 3 are a ring, 4 and 5 hang on it by one link each, 6 on 5; 7 and 8 have each other only."""
    few, many = LINKS.weak_matches, COARSE.enough
    ring = {(0, 1): few, (1, 2): few, (2, 3): few, (0, 3): few}
    links = cut_weak_bridges(links_of(ring | {(3, 4): many - 1, (2, 5): many, (5, 6): many - 1, (7, 8): many}))
    assert {(link.first, link.second) for link in links if link.sound} == set(ring) | {(2, 5)}
    assert [(link[:2], held) for link, held in find_bridges(links)] == [((2, 5), [5])]


def test_bridges_are_those_whose_loss_parts_the_block():
    rng = np.random.default_rng(8)
    for _ in range(30):
        pairs = {(int(min(a, b)), int(max(a, b))): 5 for a, b in rng.integers(0, 12, (13, 2)) if a != b}
        found = {link[:2] for link, _ in find_bridges(links_of(pairs))}
        expected = {pair for pair in pairs if parts(12, set(pairs) - {pair}) > parts(12, set(pairs))}
        assert found == expected


def test_two_blocks_with_one_link_stay_and_the_smaller_one_is_named():
    large, small = list(combinations(range(4), 2)), list(combinations(range(4, 7), 2))
    links = cut_weak_bridges(links_of(dict.fromkeys([*large, *small, (3, 4)], LINKS.weak_matches)))
    assert all(link.sound for link in links)
    assert [(link[:2], sorted(held)) for link, held in find_bridges(links)] == [((3, 4), [4, 5, 6])]
    assert cut_weak_bridges([]) == [] and find_bridges([]) == []


def test_displaced_rpcs_are_named_and_not_their_partners():
    rng = np.random.default_rng(5)
    wrong = {4: 180.0, 9: 90.0}
    offsets = {}
    for a, b in combinations(range(12), 2):
        if rng.random() < 0.5:
            offsets[a, b] = float(abs(rng.normal(0.0, 4.0)) + wrong.get(a, 0.0) + wrong.get(b, 0.0))
    found = find_displaced_images(offsets)
    assert set(found) == set(wrong)
    # A block whose RPCs are all far off has no such images
    assert (
        find_displaced_images({pair: 60.0 + offset for pair, offset in offsets.items() if not set(pair) & set(wrong)})
        == {}
    )


@pytest.mark.parametrize("beside_px", [0.3, 38.0])
def test_features_agree_where_they_lie_at_one_offset(beside_px: float):
    """Equal descriptors at every place of the band, as of fields and roofs, are no agreement."""
    first, second = blocks.images(2)
    rng, heights = np.random.default_rng(4), GroundRange(190.0, 210.0)
    xy, beside = rng.uniform(300.0, 700.0, (300, 2)), rng.uniform(-beside_px, beside_px, (300, 2))
    descriptors = rng.random((300, 128), dtype=np.float32) ** 4
    features = tuple({"xy": one, "descriptors": descriptors} for one in (
        xy, transfer(first.rpc, second.rpc, xy, np.full(300, 200.0)) + beside))  # fmt: skip
    agreeing = probe_pairs(ProbeJob(first, (second,), (1, 1), (heights,), 40.0, features))["agreeing"][0]
    assert agreeing > 250 if beside_px < 1.0 else agreeing < 60

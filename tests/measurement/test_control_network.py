"""Control networks: thresholds, the search against trying everything, simulated truth, real pairs."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from long_tests import mark_beyond
from network_scenes import FALSE_PX, TEXTURES, across_epipolar, by_trying_everything, point_sets, true_pair, turned

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.control_network import (
    AMBIGUOUS,
    FOUND,
    NO_MATCH,
    ControlNetworkOptions,
    match_windows,
    matching,
)
from hrsi.hrsi_engine.laboratory.control_network.growth import select_consistent
from hrsi.hrsi_engine.laboratory.control_network.leaves import (
    Tolerance,
    compute_distance_difference,
    compute_effective_distances,
    make_tolerance,
)
from hrsi.hrsi_engine.laboratory.control_network.leaves import rotate_offset as turned_offset
from hrsi.hrsi_engine.laboratory.control_network.matching import SCALE, vote_by_features
from hrsi.hrsi_engine.laboratory.control_network.super_points import match_super_points
from hrsi.hrsi_engine.measurement.interest_points import Area

TOLERANCE = Tolerance(1.5, 0.01)
S2P = "s2p_triplet_phr"


# ---- thresholds (eqs. 3.4-3.6) -----------------------------------------------------------------------------------


@pytest.mark.parametrize("slope_deg", [-30.0, 0.0, 12.5, 40.0])
def test_effective_distance_is_a_projection(slope_deg: float):
    """The two sensors see a segment on the slope as its length across their own lines of sight (fig. 3.9)."""
    incidence = 17.0, 23.0
    slope = np.radians(slope_deg)
    segment = 10.0 * np.array([np.cos(slope), np.sin(slope)])
    seen = []
    for sign, angle in zip((1.0, -1.0), np.radians(incidence), strict=True):
        across = np.array([np.cos(angle), sign * np.sin(angle)])  # across the line of sight
        seen.append(abs(segment @ across))
    np.testing.assert_allclose(compute_effective_distances(10.0, incidence, slope_deg), seen, rtol=1e-12)
    assert compute_distance_difference(10.0, incidence, slope_deg) == pytest.approx(seen[0] - seen[1])


def test_distance_difference_as_in_figure_3_10():
    """Equal incidence angles: nothing on flat ground or from the zenith, growing with both, 2 sin sin."""
    slopes, angles = np.meshgrid([0.0, 10.0, 20.0, 30.0], [0.0, 10.0, 20.0, 30.0])
    table = np.array([compute_distance_difference(1.0, (angle, angle), slopes[0]) for angle in angles[:, 0]])
    np.testing.assert_allclose(table, 2.0 * np.sin(np.radians(angles)) * np.sin(np.radians(slopes)), atol=1e-15)
    assert np.all(np.diff(table, axis=0)[:, 1:] > 0.0) and np.all(np.diff(table, axis=1)[1:] > 0.0)


def test_tolerance():
    """A maximum within 5 x 5 px tolerates 2 px or less at its root, and what the slope makes of a distance."""
    allowed = make_tolerance(2.0, (10.0, 10.0), 5.0)
    assert allowed.base_px <= 2.0
    assert allowed.limit_px(100.0) - allowed.limit_px(0.0) == pytest.approx(
        200.0 * np.sin(np.radians(10)) * np.sin(np.radians(5))
    )
    assert make_tolerance(2.0, (30.0, 5.0), 10.0) == make_tolerance(2.0, (5.0, 30.0), -10.0)


# ---- super points: the same as trying everything -----------------------------------------------------------------


SETS = {
    "no outliers": (point_sets(1, 9, 0), np.inf, (1.0,)),
    "a third outliers": (point_sets(2, 7, 4), np.inf, (1.0,)),
    "half outliers": (point_sets(3, 9, 6), np.inf, (1.0,)),
    "short reach": (point_sets(4, 11, 1), 120.0, (1.0,)),
    "scales": (point_sets(5, 8, 2, scale=1.3), np.inf, (1.0, 1.15, 1.3)),
    "noise": (point_sets(6, 9, 2, noise_px=0.8), np.inf, (1.0,)),
}


@pytest.mark.parametrize("name", SETS)
def test_search_finds_what_trying_everything_finds(name: str):
    (first, second, true), reach_px, scales = SETS[name]
    count, cost, pairs = by_trying_everything(first, second, TOLERANCE, reach_px, scales)
    found = match_super_points(first, second, TOLERANCE, reach_px, scales)
    assert found.status == FOUND and found.log10_nfa < -3.0
    assert found.best.count == count
    assert found.best.cost == pytest.approx(cost, rel=1e-9)
    assert {tuple(pair) for pair in found.best.pairs.tolist()} == pairs
    assert len(pairs & true) >= 0.8 * len(pairs)


@pytest.mark.parametrize("seed", range(3))
def test_unrelated_sets_do_not_match(seed: int):
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(0.0, 400.0, (2, 100, 2))
    assert match_super_points(first, second, Tolerance(2.0, 0.03), 200.0).status == NO_MATCH


def test_many_super_points_with_outliers():
    first, second, true = point_sets(11, 60, 60)
    found = match_super_points(2.0 * first, 2.0 * second, Tolerance(2.0, 0.02), 150.0)
    right = {tuple(pair) for pair in found.best.pairs.tolist()} & true
    assert found.status == FOUND
    assert len(right) >= 0.9 * found.best.count >= 20
    assert found.evaluated_pairs < 0.05 * 120 * 120


def test_a_regular_grid_is_ambiguous():
    x, y = np.meshgrid(np.arange(8) * 31.0, np.arange(8) * 31.0)
    grid = np.column_stack([x.ravel(), y.ravel()])
    second = turned_offset(grid, 0.6) + np.random.default_rng(2).normal(0.0, 0.3, grid.shape)
    found = match_super_points(grid, second, Tolerance(2.0, 0.02), 150.0)
    assert found.status == AMBIGUOUS
    assert found.runner_up >= 0.75 * found.best.count


def test_a_pattern_that_is_there_twice_is_ambiguous():
    first, second, _ = point_sets(12, 40, 10)
    twice = np.vstack([second, turned_offset(second, 1.0) + (900.0, 0.0)])
    assert match_super_points(first, second, TOLERANCE).status == FOUND
    assert match_super_points(first, twice, TOLERANCE).status == AMBIGUOUS


# ---- networks and maps -------------------------------------------------------------------------------------------


def test_what_lies_across_the_epipolar_lines_is_left_out():
    """Relief moves points along them; 2.5 px across cannot be relief, though the neighbours would let it pass."""
    rng = np.random.default_rng(3)
    first = rng.uniform(0.0, 400.0, (300, 2))
    along, across = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    relief = 6.0 * np.sin(first[:, 0] / 40.0) * np.cos(first[:, 1] / 55.0)
    second = first @ np.array([[0.98, 0.05], [-0.03, 1.01]]).T + relief[:, None] * along
    second += rng.normal(0.0, 0.05, second.shape)
    wrong, high = np.arange(0, 300, 20), np.arange(10, 300, 20)
    second[wrong] += 2.5 * across
    second[high] += 2.5 * along  # a roof
    good, residual, distance = select_consistent(first, second, np.ones(300, dtype=bool), np.eye(2), consistency_px=6.0)
    assert not good[wrong].any()
    assert good[high].all()
    assert residual[wrong].max() < 6.0  # the neighbours alone are content
    np.testing.assert_allclose(np.abs(distance[wrong]), 2.5, atol=0.5)
    assert good.sum() >= 300 - len(wrong) - 3  # 4 sigma


# ---- whole windows -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rotation_deg", mark_beyond(1, "rendered", [45.0, 0.0, 315.0]))
@pytest.mark.parametrize("texture", mark_beyond(1, "rendered", TEXTURES))
def test_homogeneous_texture(texture: str, rotation_deg: float):
    """Hundreds of correspondences (the thesis has 264 to 641 on 400 x 400 px) and none of them false."""
    pair = true_pair(texture, 400, rotation_deg)
    found = match_windows(pair.first, pair.second)
    error = np.hypot(*(found.positions.second - pair.carried(found.positions.first)).T)
    assert found.status == FOUND
    assert len(found) >= 400
    assert np.sum(error > FALSE_PX) == 0
    assert np.median(error) < 0.1
    assert abs((found.rotation_deg - rotation_deg + 180.0) % 360.0 - 180.0) < 0.3


@pytest.mark.rendered
def test_scale_is_free_within_its_range():
    pair = true_pair("forest", 500, 60.0, scale=0.5, relief_px=3.0)
    found = match_windows(pair.first, pair.second, ControlNetworkOptions(scales=(0.45, 0.55), share=1.0))
    error = np.hypot(*(found.positions.second - pair.carried(found.positions.first)).T)
    assert len(found) >= 40
    assert found.scale == pytest.approx(0.5, abs=0.01)
    assert np.sum(error > FALSE_PX) == 0


def test_windows_of_an_image_give_positions_in_the_image():
    pair = true_pair("grass", 400)
    found = match_windows(pair.first, pair.second, None, Area(40, 60, 340, 340), Area(20, 30, 390, 390))
    assert len(found) >= 150
    assert np.all(found.positions.first.min(axis=0) >= (40, 60))
    assert np.hypot(*(found.positions.second - pair.carried(found.positions.first)).T).max() < FALSE_PX


@pytest.mark.rendered
def test_points_stay_out_of_nodata():
    pair = true_pair("grass", 400)
    valid = np.ones((400, 400), bool)
    valid[150:260, :] = False
    found = match_windows(ArrayRaster(np.where(valid, pair.first.grey, 0), valid), pair.second)
    line = found.positions.first[:, 1]
    assert np.sum(line < 150) > 50 and np.sum(line > 260) > 50
    assert not np.any((line >= 145) & (line < 265))


def mirrored(window: ArrayRaster) -> ArrayRaster:
    return ArrayRaster(np.ascontiguousarray(window.grey[:, ::-1]), window.valid)


@pytest.mark.parametrize("other", mark_beyond(1, "thorough", ["mirrored", "elsewhere"]))
def test_other_ground_does_not_match(other: str):
    """Another piece of the same texture, and the mirror image, in which no rotation fits."""
    first = true_pair("forest", 400, seed=3).first
    second = mirrored(first) if other == "mirrored" else true_pair("forest", 400, seed=4).first
    found = match_windows(first, second)
    assert (found.status, len(found)) == (NO_MATCH, 0)
    assert "no common control network" in found.message
    assert np.isnan(found.rotation_deg)


@pytest.mark.rendered
def test_repeated_texture_is_ambiguous():
    """A planting on a regular grid: every shift by a row looks the same."""
    rng = np.random.default_rng(6)
    y, x = np.mgrid[:400, :400]
    plants = np.exp(3.0 * (np.cos(2 * np.pi * x / 25.0) + np.cos(2 * np.pi * y / 25.0)))
    views = [400.0 + 100.0 * plants / plants.std() + rng.normal(0.0, 3.0, plants.shape) for _ in range(2)]
    found = match_windows(*(ArrayRaster(view.astype(np.uint16), np.ones(view.shape, bool)) for view in views))
    assert (found.status, len(found)) == (AMBIGUOUS, 0)
    assert "the texture repeats" in found.message


def test_nothing_to_match():
    flat = ArrayRaster(np.full((300, 300), 500, np.uint16), np.ones((300, 300), bool))
    hidden = ArrayRaster(flat.grey, np.zeros((300, 300), bool))
    textured = true_pair("grass", 300).first
    for other in (flat, hidden):
        found = match_windows(textured, other)
        assert found.status == NO_MATCH
        assert "second window has" in found.message


def test_wrong_use():
    window = true_pair("grass", 100).first
    with pytest.raises(InputError, match="no interest points 'corners'"):
        match_windows(window, window, ControlNetworkOptions(detector="corners"))
    with pytest.raises(InputError, match="less than 32 x 32"):
        match_windows(window, window, None, Area(200, 200, 300, 300))
    with pytest.raises(Cancelled):
        match_windows(window, window, progress=lambda fraction, message="": False)


def test_large_windows_are_refused(monkeypatch):
    window = true_pair("grass", 100).first
    limits = replace(matching.CONTROL_NETWORK, largest_window_px=99 * 100)
    monkeypatch.setattr(matching, "CONTROL_NETWORK", limits)
    with pytest.raises(InputError, match="100 x 100 pixels is too large"):
        match_windows(window, window)


@pytest.mark.parametrize(
    ("folder", "names", "window", "degrees", "height_m", "least"),
    mark_beyond(
        1,
        "real",
        [
            (S2P, ("img_01.tif", "img_02.tif"), (300, 300, 400), 45.0, 206.0, 264),
            (S2P, ("img_01.tif", "img_03.tif"), (400, 560, 400), 315.0, 206.0, 264),
            ("kahramanmaras_phr4", ("post_event_img1.tif", "post_event_img2.tif"), (100, 300, 500), 45.0, 704.0, 264),
            ("ventoux_phr_pair", ("left_image.tif", "right_image.tif"), (0, 0, 490), 315.0, 537.0, 100),
        ],
    ),
)
def test_real_pairs_turned(real_data: Path, folder: str, names: tuple, window: tuple, degrees: float, height_m, least):
    """Hundreds of correspondences on 400 x 400 px, at most 1 % farther than 1.5 px from their epipolar line."""
    images = [open_image(str(real_data / folder / name)) for name in names]
    sample, line, side = window
    cut = [ArrayRaster(*image.raster.read(sample, line, side, side)) for image in images]
    other = turned(cut[1], degrees)
    found = match_windows(cut[0], other.window)
    first, second = found.positions.first + (sample, line), other.back(found.positions.second) + (sample, line)
    across = across_epipolar(images[0].rpc, images[1].rpc, first, second, height_m)
    far = np.mean(np.abs(across) > FALSE_PX)
    assert found.status == FOUND
    assert len(found) >= least
    assert far <= 0.01


@pytest.mark.rendered
def test_features_tell_where_the_second_window_shows_the_first():
    """Windows with origins of their own, looked at as they are and reduced: the map is that of the images' pixels."""
    pair = true_pair("grass", 400, 30.0, scale=0.8)
    windows = Area(40, 60, 390, 380), Area(20, 10, 400, 400)
    for most_px in (SCALE.glance_px, 60_000):
        vote = vote_by_features(pair.first, pair.second, *windows, most_px=most_px)
        assert vote.scales[0] < 0.8 < vote.scales[1]
        xy = np.random.default_rng(5).uniform(100.0, 300.0, (50, 2))
        away = xy @ vote.affine[:, :2].T + vote.affine[:, 2] - pair.carried(xy)
        assert np.median(np.hypot(*away.T)) < 4.0  # pixels: relief moves points by up to 5 x 0.8


class Seen(NamedTuple):
    """Resampled pixels of an image, and the map from the original's pixels to them."""

    raster: ArrayRaster
    matrix: np.ndarray
    shift: np.ndarray

    def back(self, xy: np.ndarray) -> np.ndarray:
        """Return where points ``(n, 2)`` are in the image as it was."""
        return (xy - self.shift) @ np.linalg.inv(self.matrix).T


def resampled(image: ArrayRaster, scale: float, degrees: float) -> Seen:
    """Return an image turned from sample towards line and scaled, in a frame that holds all of it."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = scale * np.array([[cos, -sin], [sin, cos]])
    samples, lines = image.size
    corners = np.array([[0, 0], [samples - 1, 0], [0, lines - 1], [samples - 1, lines - 1]]) @ matrix.T
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    frame = tuple(int(length) for length in high - low + 1)
    affine = np.column_stack([matrix, -low])
    grey = image.grey.astype(np.float32)
    if scale < 1.0:  # the blur of a pixel to that of a larger one
        grey = cv2.GaussianBlur(grey, (0, 0), 0.5 * np.sqrt(scale**-2 - 1.0))
    grey = cv2.warpAffine(grey, affine, frame, flags=cv2.INTER_CUBIC)
    valid = cv2.warpAffine(image.valid.astype(np.uint8), affine, frame, flags=cv2.INTER_NEAREST)
    valid = cv2.erode(valid, np.ones((9, 9), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(bool)
    grey = np.where(valid, np.clip(np.rint(grey), 1, 65535), 0).astype(np.uint16)
    return Seen(ArrayRaster(grey, valid), matrix, -low)


@pytest.mark.real
@pytest.mark.parametrize(
    ("folder", "names", "scale", "degrees", "height_m"),
    [
        # 28 % in common: windows of 300 px a side have no root in common
        ("ventoux_phr_pair", ("left_image.tif", "right_image.tif"), 0.6, 272.0, 537.0),
        # two dates, 20 degrees apart
        ("kahramanmaras_phr4", ("pre_event_img1.tif", "post_event_img2.tif"), 0.6, 201.0, 704.0),
        (S2P, ("img_01.tif", "img_03.tif"), 1.7, 285.0, 206.0),
    ],
)
def test_hard_pairs_begin_where_features_say(
    real_data: Path, folder: str, names: tuple, scale: float, degrees: float, height_m
):
    """The second image resampled and turned, which is not told."""
    images = [open_image(str(real_data / folder / name)) for name in names]
    first, second = (ArrayRaster(*image.raster.read(0, 0, *image.raster.size)) for image in images)
    seen = resampled(second, scale, degrees)
    found = match_windows(first, seen.raster)
    assert found.status == FOUND and len(found) >= 40
    across = across_epipolar(
        images[0].rpc, images[1].rpc, found.positions.first, seen.back(found.positions.second), height_m
    )
    assert np.abs(across).max() < 2.0 / min(scale, 1.0)  # 2 px of the coarser image


def test_what_scatters_about_its_own_geometry_is_no_match(monkeypatch):
    pair, every = true_pair("grass", 200), matching.find_seeds
    for largest_px, status in ((0.75, FOUND), (1e-6, NO_MATCH)):
        monkeypatch.setattr(
            matching, "find_seeds",
            lambda *given, largest=largest_px: (seed._replace(largest_spread_px=largest) for seed in every(*given)),
        )  # fmt: skip
        assert match_windows(pair.first, pair.second, ControlNetworkOptions(scales=(1.0, 1.0))).status == status

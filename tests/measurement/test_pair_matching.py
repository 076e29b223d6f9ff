"""Matching of two windows against rendered images whose true correspondences are known, and on real images."""

import pickle

import cv2
import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond
from scipy import ndimage

from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.measurement.tile_matching import pair_matching
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import (
    check_rpc_consistency,
    compute_epipolar_deviation,
    match_descriptors,
    transfer,
)
from hrsi.hrsi_engine.measurement.tile_matching.features import detect_tile_points
from hrsi.hrsi_engine.measurement.tile_matching.options import TILE_MATCH
from hrsi.hrsi_engine.measurement.tile_matching.pair_matching import (
    ImageTile,
    TileMatchOptions,
    TilePairGeometry,
    _Task,
    match_tile,
    transfer_points,
)
from hrsi.hrsi_engine.measurement.tile_matching.types import TileFrame

HALF = 200.0
SIZE = int(2 * HALF) + 1
RELIEF_M = 12.0
BIAS = (4.0, -3.0)


def sheet(size=1100, seed=4) -> np.ndarray:
    """Return a fractal texture of the ground, 0.5 m a cell, centred on the block."""
    rng = np.random.default_rng(seed)
    layers = (
        2.0 ** (0.7 * octave)
        * cv2.resize(rng.normal(size=(size >> octave, size >> octave)), (size, size), interpolation=cv2.INTER_CUBIC)
        for octave in range(1, 6)
    )
    return (600 + 120 * cv2.GaussianBlur(sum(layers), (0, 0), 1.5)).astype(np.float32)


def hill_m(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """Return heights above the block's: gentle waves."""
    return RELIEF_M * np.sin(east / 70.0) * np.cos(north / 90.0)


def camera(view: int, gsd_m: float = 1.0):
    return blocks.oblique_rpc(*blocks.VIEWS[view], gsd_m=gsd_m, half_px=HALF / gsd_m, heading=0.1 * view)


def on_ground(rpc, xy: np.ndarray) -> np.ndarray:
    """Return where image points meet the waves, by iterating the height."""
    height = np.full(len(xy), blocks.HEIGHT)
    for _ in range(12):
        ground, _ = rpc.localize(xy, height)
        height = blocks.HEIGHT + hill_m(*from_centre(ground).T[:2])
    return rpc.localize(xy, height)[0]


def from_centre(ground: np.ndarray) -> np.ndarray:
    return ground_difference_m(ground, np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (len(ground), 1)))


def rendered(view: int, gsd_m: float = 1.0, gain: float = 1.0, noise: float = 3.0) -> ImageTile:
    """Return what a camera sees of the waves."""
    rpc, size = camera(view, gsd_m), int(2 * HALF / gsd_m) + 1
    xy = np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1).reshape(-1, 2).astype(float)
    metres, texture = from_centre(on_ground(rpc, xy)), sheet()
    middle = (texture.shape[0] - 1) / 2.0
    column, row = (metres[:, 0] / 0.5 + middle).reshape(size, size), (middle - metres[:, 1] / 0.5).reshape(size, size)
    blurred = cv2.GaussianBlur(texture, (0, 0), 0.9 * gsd_m)
    grey = cv2.remap(blurred, column.astype(np.float32), row.astype(np.float32), cv2.INTER_CUBIC)
    grey = gain * grey + np.random.default_rng(view).normal(0, noise, grey.shape)
    return ImageTile(grey.astype(np.float32), np.ones(grey.shape, bool))


def geometry(view: int = 1, gsd_m: float = 1.0, bias=BIAS, **more) -> TilePairGeometry:
    """Return the geometry of view 0 and another, whose RPC is off by ``bias`` pixels."""
    wrong = camera(view, gsd_m).shift(*bias)
    margins = {"margin_px": (20.0, 20.0)} | more
    return TilePairGeometry(camera(0), wrong, blocks.HEIGHT - 40.0, blocks.HEIGHT + 40.0, **margins)


def errors(matches, view: int = 1, gsd_m: float = 1.0) -> np.ndarray:
    """Return found - true positions in the second image (px)."""
    return matches.second_xy - camera(view, gsd_m).project(on_ground(camera(0), matches.first_xy))


@pytest.fixture(scope="module")
def pair() -> tuple[ImageTile, ImageTile]:
    return rendered(0), rendered(1, gain=0.7)


@pytest.fixture(scope="module")
def found(pair):
    return match_tile(*pair, geometry())


def test_matches_are_true_and_as_precise_as_they_say(found):
    error = errors(found)
    ratio = 1.4826 * np.median(np.abs(error / found.sigma_px[:, None]))
    distance = np.linalg.norm(error, axis=1)
    assert len(found) > 500
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.mean(distance > 1.0) == 0.0
    assert np.abs(error.mean(axis=0)).max() < 0.02
    assert 0.4 < ratio < 2.0  # the rendering itself puts grey values to 1/32 of a cell (OpenCV's remap)
    assert (np.ptp(found.first_xy, axis=0) > 0.7 * SIZE).all()


def test_known_matches_are_the_seeds(pair, found, monkeypatch: pytest.MonkeyPatch):
    """With enough of them no features are detected, and the points are as many and as precise; with few they are."""
    seeds = np.column_stack([found.first_xy, np.round(found.second_xy)])[:: len(found) // 60]  # as coarse as overviews

    def refuse(*_: object) -> None:
        raise AssertionError("features are detected")

    monkeypatch.setattr(pair_matching, "detect_sift_features", refuse)
    matches = match_tile(*pair, geometry(seeds=seeds))
    assert len(matches) > 0.97 * len(found)
    assert np.sqrt(np.mean(errors(matches) ** 2)) < 1.03 * np.sqrt(np.mean(errors(found) ** 2))
    with pytest.raises(AssertionError):
        match_tile(*pair, geometry(seeds=seeds[: TILE_MATCH.fewest_seeds - 1]))


def test_bias_and_height_come_out(found):
    """Across the epipolar lines the bias is known; the apparent height differs by what lies along them."""
    both = transfer(camera(0), camera(1), np.full((1, 2), HALF), blocks.HEIGHT + np.array([100.0]))
    line = (both - transfer(camera(0), camera(1), np.full((1, 2), HALF), blocks.HEIGHT - 100.0))[0]
    normal = np.array([-line[1], line[0]]) / np.linalg.norm(line)
    # the RPC predicts `bias` too far, so that observed - predicted is its negative
    assert abs(found.bias_px @ normal + np.array(BIAS) @ normal) < 0.05
    truth = on_ground(camera(0), found.first_xy)[:, 2]
    assert np.std(found.height_m - truth) < 0.3


@pytest.mark.thorough
def test_points_depend_on_the_first_window_alone(pair, found):
    """Whole pixels, the same for other partners; tiles and results go through pickle unchanged."""
    other = match_tile(pair[0], rendered(2), geometry(2))
    points = {tuple(p) for p in pair[0].to_image(detect_tile_points(pair[0], TileMatchOptions()))}
    for matches in (found, other):
        assert {tuple(p) for p in matches.first_xy} <= points
    assert len({tuple(p) for p in found.first_xy} & {tuple(p) for p in other.first_xy}) > 200
    again = pickle.loads(pickle.dumps(match_tile))(*pickle.loads(pickle.dumps(pair)), geometry())
    np.testing.assert_array_equal(again.second_xy, found.second_xy)


def test_descriptors_match_as_lowe_defines_it():
    """Nearest to one another, and nearer than 0.8 of the second (Lowe 2004): by all distances, row by row."""
    rng = np.random.default_rng(12)
    first = rng.normal(size=(120, 32))
    # each has a partner and a rival, so near that the ratios of their distances lie about the limit
    second = np.concatenate([first + 0.05 * rng.normal(size=first.shape) * scale for scale in (1.0, 1.25)])
    first, second = (one / np.linalg.norm(one, axis=1, keepdims=True) for one in (first, second))
    distance = np.linalg.norm(first[:, None] - second[None], axis=2)
    expected = []
    for row, away in enumerate(distance):
        nearest, rival = np.argsort(away)[:2]
        if distance[:, nearest].argmin() == row and away[nearest] < 0.8 * away[rival]:
            expected.append((row, int(nearest)))
    pairs = match_descriptors(first.astype(np.float32), second.astype(np.float32), 0.8)
    assert list(zip(*(index.tolist() for index in pairs), strict=True)) == expected
    assert 30 < len(expected) < 90


def test_half_resolution_and_origin(pair):
    """A second image of 2 m pixels, as tile whose first pixel is not the image's: positions stay full-resolution."""
    coarse = rendered(1, gsd_m=2.0)
    tile = ImageTile(coarse.pixels[10:, 20:], coarse.valid[10:, 20:], origin_px=(20.0, 10.0))
    matches = match_tile(pair[0], tile, geometry(gsd_m=2.0, bias=(2.0, -1.0)))
    error = errors(matches, gsd_m=2.0)
    assert len(matches) > 150
    assert np.sqrt(np.mean(error**2)) < 0.12


def test_transfer_finds_points_at_known_heights(pair, found):
    third = rendered(2)
    few = found.select(np.arange(0, len(found), 3))
    truth = on_ground(camera(0), few.first_xy)[:, 2]
    matches = transfer_points(pair[0], third, geometry(2, bias=(0.5, -0.5)), few.first_xy, truth)
    error = np.linalg.norm(errors(matches, 2), axis=1)
    assert len(matches) > 0.6 * len(few)
    assert {tuple(p) for p in matches.first_xy} <= {tuple(p) for p in few.first_xy}
    assert np.sqrt(np.mean(error**2)) < 0.15


def test_the_search_reaches_as_far_as_heights_and_margins_say(pair):
    """Along the lines: the margin and what 40 m of height move; across: the margin alone. View 1 has pixels of 2 m."""
    own = geometry(gsd_m=2.0, margin_px=(12.0, 3.0))
    frame = TileFrame(pair[0], rendered(1, gsd_m=2.0), own)
    corners = np.array([[x, y] for x in (0.0, SIZE - 1.0) for y in (0.0, SIZE - 1.0)])
    at = [own.second.project(own.first.localize(corners, blocks.HEIGHT + up)[0]) for up in (-40.0, 0.0, 40.0)]
    aside = [own.second.project(own.first.localize(corners[:1] + step, blocks.HEIGHT)[0])
             for step in ([0.0, 0.0], [1.0, 0.0], [0.0, 1.0])]  # fmt: skip
    scale = np.sqrt(abs(np.linalg.det(np.vstack([aside[1] - aside[0], aside[2] - aside[0]]))))  # px of view 1 per px
    moved = max(np.hypot(*(at[k] - at[1]).T).max() for k in (0, 2))
    along, across = frame.reach_px
    assert across == pytest.approx(3.0 / scale, rel=0.01)
    assert along == pytest.approx((12.0 + moved) / scale, rel=0.1)  # a pixel is not as wide in all directions


def test_the_sharper_image_gets_the_resolution_of_the_other(pair):
    """Pixels of 1 m beside such of 2 m: a band of 0.5 and 2 px of the coarser image, and what its pixels blur."""
    second = rendered(1, gsd_m=2.0)
    task = _Task(TileFrame(pair[0], second, geometry(gsd_m=2.0)), TileMatchOptions(), np.array([[200, 200]]))
    own, other = task.images("middle")
    grey = pair[0].pixels.astype(float)
    smooth = np.hypot(0.5 * 2.0, 0.5 * np.sqrt(2.0**2 - 1.0))  # a pixel of 2 m is a box; of 1 m there is one already
    expected = ndimage.gaussian_filter(grey, smooth, truncate=6.0) - ndimage.gaussian_filter(grey, 4.0, truncate=6.0)
    inner = np.s_[30:-30, 30:-30]
    assert np.abs(own.grey[inner] - expected[inner]).max() < 0.01 * expected[inner].std()
    grey = second.pixels.astype(float)
    expected = ndimage.gaussian_filter(grey, 0.5, truncate=6.0) - ndimage.gaussian_filter(grey, 2.0, truncate=6.0)
    assert np.abs(other.grey[inner] - expected[inner]).max() < 0.01 * expected[inner].std()


def test_without_features_the_prediction_is_enough(pair):
    options = TileMatchOptions(features=0, windows_px=(31,), most_points=200, bands=("fine",))
    known = geometry(bias=(0.5, -0.4), margin_px=(4.0, 3.0), height_sigma_m=6.0)
    matches = match_tile(*pair, known, options)
    assert len(matches) > 80
    assert np.mean(np.linalg.norm(errors(matches), axis=1) > 1.0) < 0.01


def test_matches_that_agree_by_chance_are_none():
    """Points anywhere in a band of 256 px, as pairs without common ground give: no offset is theirs."""
    rng = np.random.default_rng(31)
    first = rng.uniform(0.0, SIZE, (300, 2))
    true = transfer(camera(0), camera(1), first, blocks.HEIGHT)
    chance = check_rpc_consistency(
        camera(0), camera(1), first, true + rng.uniform(-128.0, 128.0, (300, 2)), blocks.HEIGHT
    )
    away = np.concatenate([rng.normal(0.0, 0.5, (60, 2)), rng.uniform(-128.0, 128.0, (240, 2))])
    told = check_rpc_consistency(camera(0), camera(1), first, true + away, blocks.HEIGHT)
    assert chance.good.sum() < 20
    assert told.good[:60].sum() >= 55
    assert told.good[60:].sum() < 20


@pytest.mark.parametrize("what", mark_beyond(1, "thorough", ["other place", "nodata", "water"]))
def test_nothing_is_found_where_there_is_nothing(pair, what: str):
    """Nodata and flat water on the left of the second image, or quite another place: no wrong points."""
    first, second = pair
    grey, valid, rng = second.pixels.copy(), second.valid.copy(), np.random.default_rng(3)
    part = np.s_[:, : SIZE // 2]
    if what == "nodata":
        valid[part] = False
    if what == "water":
        grey[part] = 300.0 + rng.normal(0.0, 3.0, grey[part].shape)
    if what == "other place":
        grey = grey[::-1, ::-1].copy()
    matches = match_tile(first, ImageTile(grey, valid), geometry())
    if what == "other place":
        assert len(matches) == 0
        return
    assert len(matches) > 100
    assert matches.second_xy[:, 0].min() > SIZE // 2 - (0 if what == "nodata" else 3)
    assert np.linalg.norm(errors(matches), axis=1).max() < 1.0


def test_no_points_on_water_noise_and_nodata():
    rng = np.random.default_rng(0)
    noise = (500.0 + rng.normal(0.0, 4.0, (300, 300))).astype(np.float32)
    for grey in (noise, np.full_like(noise, 9.0)):
        assert len(detect_tile_points(ImageTile(grey, np.ones(grey.shape, bool)), TileMatchOptions())) == 0
    tile = rendered(0)
    valid = np.ones(tile.pixels.shape, bool)
    valid[:, 150:] = False
    points = detect_tile_points(ImageTile(tile.pixels, valid), TileMatchOptions())
    assert len(points) and points[:, 0].max() < 150


def test_same_view_matches_are_judged_without_epipolar_lines():
    """Two RPCs of the same view have no epipolar direction: false matches still fail."""
    rng = np.random.default_rng(1)
    rpc = camera(0)
    xy = rng.uniform(20, SIZE - 20, (300, 2))
    seen = xy + (1.5, -0.7) + rng.normal(0, 0.1, xy.shape)
    seen[:40] += rng.uniform(-60, 60, (40, 2))
    good = check_rpc_consistency(rpc, rpc, xy, seen, blocks.HEIGHT).good
    assert good[40:].mean() > 0.95
    assert good[:40].sum() <= 2


REAL = {  # images, their folder, height (m), across-epipolar NMAD (px) of OpenCV's SIFT with MAGSAC, least matches
    "triplet": ("s2p_triplet_phr", ("img_01.tif", "img_03.tif"), 206.0, 0.161, 3000),
    "dates": ("kahramanmaras_phr4", ("pre_event_img2.tif", "post_event_img1.tif"), 704.0, 0.258, 5 * 85),
    "ventoux": ("ventoux_phr_pair", ("left_image.tif", "right_image.tif"), 537.0, 0.193, 400),
}


@pytest.mark.parametrize("name", REAL)
@pytest.mark.real
def test_real_pairs_beat_sift(real_data, name: str):
    """Scatter across the epipolar lines (norm of the 4-vector of both images, so / sqrt 2) ≤ 0.7 of SIFT's."""
    folder, files, height, baseline, least = REAL[name]
    images = [open_image(str(real_data / folder / file)) for file in files]
    tiles = []
    for image in images:
        grey, valid = image.raster.read(0, 0, *image.size)
        tiles.append(ImageTile(grey.astype(np.float32), valid))
    pair_of = TilePairGeometry(images[0].rpc, images[1].rpc, height - 40.0, height + 40.0, margin_px=(20.0, 20.0))
    matches = match_tile(*tiles, pair_of)
    across = compute_epipolar_deviation(
        images[0].rpc, images[1].rpc, matches.first_xy, matches.second_xy, height
    ).across_px
    nmad = 1.4826 * np.median(np.abs(across - np.median(across))) / np.sqrt(2.0)
    assert len(matches) >= least
    assert nmad <= 0.7 * baseline


def test_points_are_spread_though_a_quarter_is_sharper():
    grey = sheet(400)
    grey[:200, :200] = 600.0 + 5.0 * (grey[:200, :200] - 600.0)
    points = detect_tile_points(ImageTile(grey, np.ones(grey.shape, bool)), TileMatchOptions(most_points=200))
    assert np.bincount((points >= 200) @ [1, 2], minlength=4).min() > 30

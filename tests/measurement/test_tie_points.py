"""Automatic tie points against rendered images whose true correspondences are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.block import Image, Role, assemble
from hrsi.hrsi_engine.errors import Cancelled, InputError
from hrsi.hrsi_engine.geodesy import ground_difference_m
from hrsi.hrsi_engine.measurement.epipolar import epipolar_miss, transfer
from hrsi.hrsi_engine.measurement.features import FeatureStore
from hrsi.hrsi_engine.measurement.matching import mutual_matches, rpc_consistent
from hrsi.hrsi_engine.measurement.tie_points import TieOptions, find_tie_points
from hrsi.hrsi_engine.measurement.tracks import consistent_tracks, spread

HALF = 350.0


class Pixels:
    """An array as a raster."""

    def __init__(self, grey: np.ndarray, valid: np.ndarray | None = None) -> None:
        self.grey = grey
        self.valid = np.ones(grey.shape, bool) if valid is None else valid
        self.size = (grey.shape[1], grey.shape[0])

    def read(self, sample, line, samples, lines):
        window = np.s_[line : line + lines, sample : sample + samples]
        return self.grey[window], self.valid[window]


def ortho_texture(size=1400, seed=4) -> np.ndarray:
    """Fractal noise, 1 m a pixel, centred on the block."""
    rng = np.random.default_rng(seed)
    sheet = sum(
        2.0 ** (0.7 * octave)
        * cv2.resize(rng.normal(size=(size >> octave, size >> octave)), (size, size), interpolation=cv2.INTER_CUBIC)
        for octave in range(1, 6)
    )
    return (600 + 120 * cv2.GaussianBlur(sheet, (0, 0), 1.0)).astype(np.float32)


def rendered(view: int, texture: np.ndarray, bias_px=(0.0, 0.0)) -> Image:
    """Return an image of flat ground with its RPC off by ``bias_px``."""
    tilt = blocks.VIEWS[view]
    rpc = blocks.oblique_rpc(*tilt, half_px=HALF, heading=0.1 * view)
    size = int(2 * HALF) + 1
    xy = np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1).reshape(-1, 2).astype(float)
    ground, _ = rpc.localize(xy, blocks.HEIGHT)
    metres = ground_difference_m(ground, np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (len(ground), 1)))
    centre = (texture.shape[0] - 1) / 2.0
    column = (metres[:, 0] + centre).astype(np.float32).reshape(size, size)
    row = (centre - metres[:, 1]).astype(np.float32).reshape(size, size)
    grey = cv2.remap(texture, column, row, cv2.INTER_CUBIC)
    grey += np.random.default_rng(view).normal(0, 3, grey.shape)
    wrong = rpc.shifted(*bias_px)
    return Image(f"view{view}", wrong, (size, size), raster=Pixels(grey.astype(np.uint16)))


@pytest.fixture(scope="module")
def triplet():
    texture = ortho_texture()
    return [rendered(0, texture), rendered(1, texture, (4.0, -3.0)), rendered(2, texture, (-6.0, 2.0))]


@pytest.fixture(scope="module")
def found(triplet):
    return find_tie_points(triplet, TieOptions(heights_m=(100.0, 300.0), margin_px=40.0))


def test_ties_are_where_the_truth_is(triplet, found):
    """Positions of a track on all views lead to one point of the flat scene, within the sigma they are given."""
    block = assemble(triplet, [], [found.image_points])
    bias = np.array([(0.0, 0.0), (4.0, -3.0), (-6.0, 2.0)])
    metres = np.full((len(block.points), 3, 2), np.nan)
    for index, image in enumerate(triplet):
        rows = np.flatnonzero(block.measurements.image == index)
        ground, _ = image.rpc.localize(block.measurements.xy[rows] + bias[index], blocks.HEIGHT)
        metres[block.measurements.point[rows], index] = ground_difference_m(
            ground, np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (len(ground), 1))
        )[:, :2]
    apart = metres - np.nanmean(metres, axis=1, keepdims=True)
    rmse_px = np.sqrt(np.nanmean(apart**2))  # of a coordinate; ground pixels are 1 m
    print(
        f"{len(block.points)} tracks, {found.matches}, RMSE {rmse_px:.3f} px, worst {np.nanmax(np.abs(apart)):.2f} px"
    )
    assert len(block.points) > 300
    assert np.all(block.points.role == Role.TIE)
    assert (block.rays_per_point() == 3).sum() > 100
    assert rmse_px < TieOptions().sigma_px
    assert np.nanmean(np.abs(apart) > 1.0) < 0.005  # a match in two hundred slides along its epipolar line


def test_ties_are_spread(triplet, found):
    sizes = np.array([image.size for image in triplet])
    for index, image in enumerate(triplet):
        xy = found.image_points.xy[found.image_points.image_ids == image.id]
        cells = np.unique(np.floor(4 * xy / sizes[index]).astype(int), axis=0)
        assert len(cells) >= 14, image.id


def test_same_points_again(triplet, found):
    again = find_tie_points(triplet, TieOptions(heights_m=(100.0, 300.0), margin_px=40.0))
    np.testing.assert_array_equal(again.image_points.xy, found.image_points.xy)
    np.testing.assert_array_equal(again.image_points.ids, found.image_points.ids)


def test_no_points_on_nodata():
    texture = ortho_texture()
    first, second = rendered(0, texture), rendered(1, texture)
    valid = np.ones(second.raster.grey.shape, bool)
    valid[:, :300] = False
    second.raster.valid = valid
    ties = find_tie_points([first, second], TieOptions(heights_m=(100.0, 300.0), margin_px=40.0)).image_points
    assert len(ties) > 100
    assert ties.xy[ties.image_ids == "view1", 0].min() > 300


def test_flat_images_give_no_points_but_a_warning():
    texture = np.full((1400, 1400), 500.0, np.float32)
    images = [rendered(0, texture), rendered(1, texture)]
    for image in images:
        image.raster.grey[:] = 500
    result = find_tie_points(images, TieOptions(heights_m=(100.0, 300.0)))
    assert len(result.image_points) == 0
    assert "0 matches" in result.warnings[0]


def test_images_apart_are_an_error(triplet):
    from dataclasses import replace

    far = replace(triplet[1], rpc=replace(triplet[1].rpc, long_off=triplet[1].rpc.long_off + 1.0))
    with pytest.raises(InputError, match="no two images overlap"):
        find_tie_points([triplet[0], far])


def test_images_without_pixels_are_an_error():
    with pytest.raises(InputError, match="two images with pixels"):
        find_tie_points(blocks.images(2))


def test_cancel(triplet):
    with pytest.raises(Cancelled):
        find_tie_points(triplet, progress=lambda fraction, message: False)


def test_keypoints_of_a_blob_are_at_its_centre():
    """SIFT positions count from the centre of the first pixel: a rendered blob is found where it was put."""
    line, sample = np.mgrid[0:200, 0:200]
    centre = (101.3, 96.7)
    grey = 500 + 300 * np.exp(-((sample - centre[0]) ** 2 + (line - centre[1]) ** 2) / (2 * 4.0**2))
    image = Image("blob", blocks.oblique_rpc(0, 0, half_px=100), (200, 200), raster=Pixels(grey.astype(np.uint16)))
    xy = FeatureStore(image, 50).tile(0).xy
    assert np.linalg.norm(xy - centre, axis=1).min() < 0.15


def test_epipolar_miss_tells_height_and_offset():
    """A point at 260 m, measured with an offset across the line, comes back with both."""
    first, second = blocks.images(2)
    ground = blocks.ground(30, 3)
    ground[:, 2] = 260.0
    xy1, xy2 = first.rpc.project(ground), second.rpc.project(ground)
    line = transfer(first.rpc, second.rpc, xy1, 300.0) - transfer(first.rpc, second.rpc, xy1, 200.0)
    normal = np.column_stack([-line[:, 1], line[:, 0]]) / np.linalg.norm(line, axis=1)[:, None]
    miss = epipolar_miss(first.rpc, second.rpc, xy1, xy2 + 2.5 * normal, 150.0)
    np.testing.assert_allclose(miss.height_m, 260.0, atol=0.01)
    np.testing.assert_allclose(miss.across_px, 2.5, atol=0.01)


def test_geometry_filter_finds_the_few_true_among_many_false():
    first, second = blocks.images(2)
    rng = np.random.default_rng(2)
    ground = blocks.ground(200, 3)
    xy1, xy2 = first.rpc.project(ground), second.rpc.project(ground) + (7.0, -4.0) + rng.normal(0, 0.2, (200, 2))
    false = np.arange(200) >= 60
    xy2[false] += rng.uniform(-300, 300, (140, 2))
    good = rpc_consistent(first.rpc, second.rpc, xy1, xy2, 150.0)
    assert good[~false].mean() > 0.9
    assert good[false].sum() <= 3


def test_mutual_matches_find_a_permutation():
    rng = np.random.default_rng(0)
    first = rng.normal(size=(3000, 128)).astype(np.float32)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    order = rng.permutation(3000)
    second = first[order] + rng.normal(0, 0.01, first.shape).astype(np.float32)
    i, j = mutual_matches(first, second)
    np.testing.assert_array_equal(order[j], i)
    assert len(i) == 3000


def test_contradictory_tracks_are_dropped():
    image = np.array([0, 1, 2, 0, 1, 2, 0])
    first, second = np.array([0, 1, 3, 4, 5]), np.array([1, 2, 4, 5, 6])  # the second track meets image 0 twice
    np.testing.assert_array_equal(consistent_tracks(first, second, image), [0, 0, 0, -1, -1, -1, -1])


def test_spread_keeps_the_longest_in_each_cell():
    track = np.array([0, 0, 1, 1, 1, 2, 2])
    image = np.array([0, 1, 0, 1, 2, 0, 1])
    keep = spread(track, image, np.zeros((7, 2)), np.zeros(3), np.full((3, 2), 100.0), per_cell=1)
    np.testing.assert_array_equal(keep, [False, True, False])

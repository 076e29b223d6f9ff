"""Automatic tie points against rendered images whose true correspondences are known."""

from dataclasses import replace

import numpy as np
import pytest
import rendered_blocks as scenes
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.workers.scheduling import open_scheduler
from hrsi.hrsi_engine.measurement.block_matching.joining import (
    BlockMatches,
    build_tracks,
    drop_outliers,
    select_tracks_by_cell,
)
from hrsi.hrsi_engine.measurement.block_matching.search import count_points_per_cell
from hrsi.hrsi_engine.measurement.block_matching.star import plan_cells
from hrsi.hrsi_engine.measurement.tie_options import TieOptions
from hrsi.hrsi_engine.measurement.tie_points import find_tie_points
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import (
    check_rpc_consistency,
    compute_epipolar_deviation,
    transfer,
)
from hrsi.hrsi_engine.surface.grid_surface import ConstantHeight

OPTIONS = TieOptions(margin_px=40.0)


@pytest.fixture(scope="module")
def triplet():
    return scenes.triplet()


@pytest.fixture(scope="module")
def found(triplet):
    return find_tie_points(triplet, OPTIONS)


def test_ties_are_where_the_truth_is(triplet, found):
    """Positions of a track on all views lead to one point of the flat scene, within the sigma they are given."""
    apart, views = scenes.ground_spread_m(triplet, found.image_points)
    rmse_px = np.sqrt(np.mean(apart**2))  # of a coordinate; ground pixels are 1 m
    tracks = len(found.ground)
    assert tracks > 500
    assert np.sum(views == 3) / 3 > 400
    assert rmse_px < 0.1
    assert np.mean(np.abs(apart) > 1.0) < 1e-3
    median_sigma = np.median(found.image_points.sigma_px)
    assert 0.4 < rmse_px / median_sigma < 2.5  # the sigmas mean something


def test_ground_of_tracks(found):
    """Approximate positions: the RPCs are off by up to 6 px of 1 m, and parallax turns that into height."""
    away = np.abs(found.ground[:, 2] - blocks.HEIGHT)
    assert np.median(away) < 25.0
    assert found.ground.shape == (len(np.unique(found.image_points.ids)), 3)


def test_ties_are_spread(triplet, found):
    sizes = np.array([image.size for image in triplet])
    for index, image in enumerate(triplet):
        xy = found.image_points.xy[found.image_points.image_ids == image.id]
        cells = np.unique(np.floor(4 * xy / sizes[index]).astype(int), axis=0)
        assert len(cells) >= 14, image.id


@pytest.mark.thorough
def test_result_does_not_depend_on_threads(triplet, found):
    for threads in (1, 3):
        again = find_tie_points(triplet, OPTIONS, scheduler=open_scheduler(threads=threads))
        np.testing.assert_array_equal(again.image_points.xy, found.image_points.xy)
        np.testing.assert_array_equal(again.image_points.ids, found.image_points.ids)


@pytest.mark.thorough
def test_rpcs_off_by_far_more_than_the_search_margin(triplet):
    """The search widens by itself: 80 px against a margin of 16."""
    far = [triplet[0], replace(triplet[1], rpc=triplet[1].rpc.shift(20.0, 80.0))]
    ties = find_tie_points(far, TieOptions(margin_px=16.0))
    assert len(ties.ground) > 300


@pytest.mark.rendered
def test_terrain_of_a_surface_gives_the_same_points(triplet, found):
    ties = find_tie_points(triplet, OPTIONS, surface=ConstantHeight(blocks.HEIGHT))
    assert len(ties.ground) > 0.9 * len(found.ground)
    apart, _ = scenes.ground_spread_m(triplet, ties.image_points)
    assert np.sqrt(np.mean(apart**2)) < 0.1


@pytest.mark.thorough
def test_small_windows_find_what_large_ones_find(triplet, found, monkeypatch):
    """Images matched everywhere: nothing depends on where in the image a window lies, and seams lose little."""
    from hrsi.hrsi_engine.measurement.block_matching import star

    monkeypatch.setattr(star, "MEMORY", replace(star.MEMORY, window_px=240))
    ties = find_tie_points(triplet[:2], OPTIONS)
    whole = {pair[:2]: pair.matches for pair in found.pairs}["view0", "view1"]
    assert ties.pairs[0].matches > 0.8 * whole


@pytest.mark.large
def test_windows_of_large_images(triplet, monkeypatch):
    """Images that count as large are matched in small windows, as exactly as others."""
    from hrsi.hrsi_engine.measurement.block_matching import star

    monkeypatch.setattr(star, "TIE_WINDOWS", replace(star.TIE_WINDOWS, full_px=400, window_px=128))
    ties = find_tie_points(triplet, replace(OPTIONS, cells=5))
    apart, views = scenes.ground_spread_m(triplet, ties.image_points)
    for image in triplet:
        xy = ties.image_points.xy[ties.image_points.image_ids == image.id]
        assert len(np.unique(np.floor(5 * xy / image.size).astype(int), axis=0)) >= 18
        assert len(xy) < 6 * 25 * 2
    assert np.sqrt(np.mean(apart**2)) < 0.1
    assert np.sum(views == 3) > 60


@pytest.mark.parametrize("large", mark_beyond(1, "rendered", [False, True]))
def test_dense_points(triplet, found, monkeypatch, large):
    """More points, everywhere, and still where the truth is; large images are then matched everywhere, too."""
    from hrsi.hrsi_engine.measurement.block_matching import star

    if large:
        monkeypatch.setattr(star, "TIE_WINDOWS", replace(star.TIE_WINDOWS, full_px=400))
    ties = find_tie_points(triplet, replace(OPTIONS, dense=True))
    apart, _ = scenes.ground_spread_m(triplet, ties.image_points)
    assert len(ties.ground) > (1.0 if large else 1.5) * len(found.ground)  # windows' borders have no points
    assert np.sqrt(np.mean(apart**2)) < 0.15  # windows of 15 px have a quarter of the pixels of those of 31 px
    for image in triplet:
        xy = ties.image_points.xy[ties.image_points.image_ids == image.id]
        assert len(np.unique(np.floor(8 * xy / image.size).astype(int), axis=0)) >= 60


def test_no_points_on_nodata():
    texture = scenes.ortho_texture()
    first, second = scenes.rendered(0, texture), scenes.rendered(1, texture)
    valid = np.ones(second.raster.grey.shape, bool)
    valid[:, :300] = False
    second.raster.valid = valid
    ties = find_tie_points([first, second], OPTIONS).image_points
    assert len(ties) > 100
    assert ties.xy[ties.image_ids == "view1", 0].min() > 300


def test_flat_images_give_no_points_but_a_warning():
    texture = np.full((1400, 1400), 500.0, np.float32)
    images = [scenes.rendered(0, texture), scenes.rendered(1, texture)]
    for image in images:
        image.raster.grey[:] = 500
    result = find_tie_points(images)
    assert len(result.image_points) == 0
    assert [warning.partition(":")[0] for warning in result.warnings] == ["view0", "view1"]


@pytest.mark.rendered
def test_clouds_and_water_give_no_points(triplet):
    """A cloud that only one image has, and smooth water in both."""
    images = [replace(image, raster=ArrayRaster(image.raster.grey.copy())) for image in triplet[:2]]
    rng = np.random.default_rng(1)
    for image in images:
        image.raster.grey[450:, :] = 300 + rng.normal(0, 3, image.raster.grey[450:, :].shape)
    line, sample = np.mgrid[0:701, 0:701]
    cloud = np.hypot(line - 180, sample - 200) < 150
    images[1].raster.grey[cloud] = 4000 + rng.normal(0, 30, cloud.sum())
    ties = find_tie_points(images, OPTIONS).image_points
    xy = ties.xy[ties.image_ids == "view1"]
    assert len(xy) > 60
    assert not (np.hypot(xy[:, 1] - 180, xy[:, 0] - 200) < 140).any()
    assert not (xy[:, 1] > 465).any()


@pytest.mark.thorough
def test_image_without_match_is_named(triplet):
    noise = replace(
        scenes.rendered(3, np.full((1400, 1400), 500.0, np.float32)),
        raster=ArrayRaster(np.random.default_rng(9).normal(500, 90, (701, 701)).astype(np.uint16)),
    )
    result = find_tie_points([*triplet[:2], noise], OPTIONS)
    assert len(result.ground) > 300
    assert any(warning.startswith("view3: no tie points") for warning in result.warnings)
    assert "view3" not in result.image_points.image_ids


def test_images_apart_are_an_error(triplet):
    far = replace(triplet[1], rpc=replace(triplet[1].rpc, long_off=triplet[1].rpc.long_off + 1.0))
    with pytest.raises(InputError, match=r"no two images of .* overlap"):
        find_tie_points([triplet[0], far])


# ---- geometry and tracks -------------------------------------------------------------------------------------------


def test_epipolar_miss_tells_height_and_offset():
    """A point at 260 m, measured with an offset across the line, comes back with both."""
    first, second = blocks.images(2)
    ground = blocks.ground(30, 3)
    ground[:, 2] = 260.0
    xy1, xy2 = first.rpc.project(ground), second.rpc.project(ground)
    line = transfer(first.rpc, second.rpc, xy1, 300.0) - transfer(first.rpc, second.rpc, xy1, 200.0)
    normal = np.column_stack([-line[:, 1], line[:, 0]]) / np.linalg.norm(line, axis=1)[:, None]
    miss = compute_epipolar_deviation(first.rpc, second.rpc, xy1, xy2 + 2.5 * normal, 150.0)
    np.testing.assert_allclose(miss.height_m, 260.0, atol=0.01)
    np.testing.assert_allclose(miss.across_px, 2.5, atol=0.01)


def test_geometry_filter_finds_the_few_true_among_many_false():
    first, second = blocks.images(2)
    rng = np.random.default_rng(2)
    ground = blocks.ground(200, 3)
    xy1, xy2 = first.rpc.project(ground), second.rpc.project(ground) + (7.0, -4.0) + rng.normal(0, 0.2, (200, 2))
    false = np.arange(200) >= 60
    xy2[false] += rng.uniform(-300, 300, (140, 2))
    good = check_rpc_consistency(first.rpc, second.rpc, xy1, xy2, 150.0).good
    assert good[~false].mean() > 0.9
    assert good[false].sum() <= 3


def test_land_beyond_water_stays_and_repeated_patterns_beyond_a_gap_go():
    """Two shores 170 px apart; the farther one holds 2 % of the matches. One period of a pattern is 85 px of parallax.

    Over the gap a slope of one half would explain the 85 px; matches as dense as these allow no such step.
    """
    images = blocks.images(2)
    shore = np.stack(np.meshgrid(np.arange(1000.0, 2000.0, 15.0), np.arange(1000.0, 1600.0, 15.0)), axis=-1)
    beyond = np.stack(np.meshgrid(np.arange(1400.0, 1500.0, 15.0), np.arange(1770.0, 1850.0, 15.0)), axis=-1)
    shore, beyond = shore.reshape(-1, 2), beyond.reshape(-1, 2)
    first_xy = np.vstack([shore, beyond])
    height = 200.0 + 10.0 * np.sin(first_xy[:, 1] / 300.0)
    second_xy = transfer(images[0].rpc, images[1].rpc, first_xy, height)
    many, number = len(first_xy), np.zeros(len(first_xy), np.int64)
    metre = transfer(images[0].rpc, images[1].rpc, first_xy, height + 1.0) - second_xy
    far = np.arange(many) >= len(shore)
    for parallax_px, stays in ((3.0, True), (85.0, False), (-85.0, False)):
        metres = far * parallax_px / np.linalg.norm(metre, axis=1)
        moved_xy = transfer(images[0].rpc, images[1].rpc, first_xy, height + metres)
        matches = BlockMatches(np.arange(many), number, number + 1, first_xy, moved_xy, np.full(many, 0.05),
                               np.ones(many), np.full(many, "automatic"), height + metres)  # fmt: skip
        kept = np.isin(np.arange(many), drop_outliers(matches, images).track)
        assert kept[~far].all()
        assert (kept[far] == stays).all()


@pytest.mark.parametrize(("camera_px", "stays"), [(0.2, True), (3.0, False)])
def test_small_errors_of_cameras_cost_no_match(camera_px, stays):
    """Cameras err by some tenths of a pixel along their track, far more than precise matches; not by pixels."""
    first, second = (one.rpc for one in blocks.images(2))
    rng, many = np.random.default_rng(2), 400
    xy, height = rng.uniform(1000.0, 2000.0, (many, 2)), np.full(many, 200.0)
    second_xy, number = transfer(first, second, xy, height), np.zeros(many, np.int64)
    angle, wrong = rng.uniform(0.0, 2.0 * np.pi, many), np.arange(many) < 40
    second_xy += wrong[:, None] * camera_px * np.column_stack([np.cos(angle), np.sin(angle)])
    matches = BlockMatches(np.arange(many), number, number + 1, xy, second_xy, np.full(many, 0.01),
                           np.ones(many), np.full(many, "automatic"), height)  # fmt: skip
    kept = np.isin(np.arange(many), drop_outliers(matches, blocks.images(2), islands=True).track)
    assert kept[~wrong].all() and (kept[wrong].all() if stays else kept[wrong].mean() < 0.2)


def test_a_large_image_gets_enough_points_at_a_bounded_cost():
    image = Image("large", blocks.oblique_rpc(0.0, 0.0), (30_000, 30_000))
    rows = plan_cells(image, 10, count_points_per_cell(TieOptions(), image))
    wanted, measured = (sum(getattr(cell, name) for row in rows for cell in row) for name in ("enough", "most"))
    assert 100 <= wanted <= 500  # six parameters of a camera to 0.1 sigma
    assert 2 * wanted <= measured <= 1500  # some fail, and tracks are chosen from the rest


def test_contradictory_tracks_are_dropped():
    image = np.array([0, 1, 2, 0, 1, 2, 0])
    first, second = np.array([0, 1, 3, 4, 5]), np.array([1, 2, 4, 5, 6])  # the second track meets image 0 twice
    np.testing.assert_array_equal(build_tracks(first, second, image), [0, 0, 0, -1, -1, -1, -1])


def test_spread_keeps_the_longest_in_each_cell():
    track = np.array([0, 0, 1, 1, 1, 2, 2])
    image = np.array([0, 1, 0, 1, 2, 0, 1])
    keep = select_tracks_by_cell(track, image, np.zeros((7, 2)), np.zeros(3), np.full((3, 2), 100.0), np.ones(3, int))
    np.testing.assert_array_equal(keep, [False, True, False])

"""Where all matches of a block put a point in an image, and what completion makes of it."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.block.sliding_footprints import GroundRange
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.measurement.block_matching import search
from hrsi.hrsi_engine.measurement.block_matching.coarse import CoarseJob
from hrsi.hrsi_engine.measurement.block_matching.joining import BlockMatches
from hrsi.hrsi_engine.measurement.block_matching.relative_cameras import RelativeCameras, estimate_relative_cameras
from hrsi.hrsi_engine.measurement.tie_points import find_tie_points
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import transfer

VIEWS, SIDE, LAST = 6, 1000, 5
PREDICTED_PX = 1.0  # what a search of 2 px around a place forgives easily


@pytest.fixture(scope="module")
def year() -> lab.BlockSimulation:
    """Six views of hilly ground; their RPCs are off by several pixels, each by its own."""
    spec = lab.SceneSpec(relief_m=60.0, seed=5)
    taken = lab.draw_acquisitions(VIEWS, spec.lat_deg, spec.seed)
    views = lab.make_views_of_dates(lab.SENSORS["pleiades"], taken, 1, (SIDE, SIDE), 500.0, 20.0, spec.seed)
    return lab.simulate_block(spec, views, lab.PointCounts(0, 0, 400), lab.Noise())


def exact(year: lab.BlockSimulation) -> dict[int, dict[int, np.ndarray]]:
    """Return the exact positions of the points, by image and point."""
    truth = year.truth.image_points
    return {image: dict(zip(truth.point[truth.image == image].tolist(), truth.xy[truth.image == image], strict=True))
            for image in range(VIEWS)}  # fmt: skip


def matches_of(year: lab.BlockSimulation, pairs: list[tuple[int, int]], noise_px: float = 0.1) -> BlockMatches:
    rng, seen, rows = np.random.default_rng(6), exact(year), []
    for a, b in pairs:
        rows += [(1000 * a + point, a, b, xy, seen[b][point] + rng.normal(0.0, noise_px, 2))
                 for point, xy in seen[a].items() if point in seen[b]]  # fmt: skip
    track, first, second, first_xy, second_xy = (np.array(column) for column in zip(*rows, strict=True))
    count = len(track)
    return BlockMatches(
        track, first, second, first_xy, second_xy, np.full(count, noise_px), np.ones(count), np.full(count, "corner"),
        np.full(count, float(np.median(year.truth.ground[:, 2]))),
    )  # fmt: skip


def misses_px(year: lab.BlockSimulation, cameras: RelativeCameras | None, first: int, second: int) -> np.ndarray:
    """Return how far points lie from where they are predicted, with cameras and heights or by the raw RPCs."""
    images, seen = year.block.images, exact(year)
    common = [point for point in seen[first] if point in seen[second]]
    xy, found = (np.array([seen[image][point] for point in common]) for image in (first, second))
    if cameras is None:
        height = year.truth.ground[common, 2]
        return np.hypot(*(transfer(images[first].rpc, images[second].rpc, xy, height) - found).T)
    job = CoarseJob(images[first], images[second], (1, 1), GroundRange(0.0, 1.0), 128.0)
    estimate = cameras.estimate(job, first, second)
    geometry = estimate.geometry
    place = transfer(geometry.first, geometry.second, xy, geometry.heights_at(xy)) + geometry.bias_px
    return np.hypot(*(place - found).T)


def test_pairs_that_were_never_matched_are_predicted_through_third_images(year: lab.BlockSimulation):
    """A star of image 0 ties all others to one another; the heights between points are interpolated."""
    cameras = estimate_relative_cameras(matches_of(year, [(0, k) for k in range(1, VIEWS)]), year.block.images)
    assert cameras is not None
    for first, second in ((1, 2), (3, LAST), (LAST, 1)):
        raw, predicted = misses_px(year, None, first, second), misses_px(year, cameras, first, second)
        assert np.median(raw) > 3.0 * PREDICTED_PX
        assert np.median(predicted) < PREDICTED_PX


def test_an_image_without_matches_is_sought_as_far_as_the_others_are_off(year: lab.BlockSimulation):
    pairs = [(a, b) for a in range(LAST) for b in range(a + 1, LAST)]
    cameras = estimate_relative_cameras(matches_of(year, pairs), year.block.images)
    assert cameras.sigma_px[LAST] > 2.0 * cameras.sigma_px[:LAST].max()


def test_false_matches_do_not_move_the_cameras(year: lab.BlockSimulation):
    matches = matches_of(year, [(0, k) for k in range(1, VIEWS)])
    matches.second_xy[::12] += (25.0, -15.0)
    cameras = estimate_relative_cameras(matches, year.block.images)
    assert np.median(misses_px(year, cameras, 1, 2)) < PREDICTED_PX


def test_without_matches_there_are_no_cameras(year: lab.BlockSimulation):
    matches = matches_of(year, [(0, 1)])
    assert estimate_relative_cameras(matches.select(np.zeros(len(matches), bool)), year.block.images) is None


@pytest.mark.rendered
def test_points_are_completed_in_images_that_miss_them(monkeypatch: pytest.MonkeyPatch):
    """Four images: points that the second shares with the last two are on the first, which no star asks."""
    side, spec = 240, lab.SceneSpec(relief_m=20.0, seed=8)
    taken = lab.draw_acquisitions(12, spec.lat_deg, spec.seed)[5:7]
    views = lab.make_views_of_dates(lab.SENSORS["pleiades"], taken, 2, (side, side), 190.0, 12.0, spec.seed)
    block = lab.simulate_block(spec, views, lab.PointCounts(0, 0, 20), lab.Noise())
    images = [replace(image, raster=ArrayRaster(lab.make_renderer(block, image.id).window(0, 0, side, side)))
              for image in block.block.images]  # fmt: skip

    def on_all() -> int:
        _, rays = np.unique(find_tie_points(images).image_points.ids, return_counts=True)
        return int(np.sum(rays == len(images)))

    completed = on_all()
    monkeypatch.setattr(search, "TIE_SEARCH", replace(search.TIE_SEARCH, completed_partners=len(images)))
    stars = on_all()
    assert completed > 1.2 * stars > 0

"""Interest points: seams, masks, data types, simulated truth, real images."""

from functools import partial

import numpy as np
import object_scenes as scenes
import pytest
from long_tests import mark_beyond
from scipy.ndimage import gaussian_filter
from scipy.stats import chi2

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.foundation.pixel_filters import BLUR
from hrsi.hrsi_engine.foundation.thresholds import MEMORY
from hrsi.hrsi_engine.io.rasters.images import GdalRaster
from hrsi.hrsi_engine.laboratory.interest_points import (
    DETECTORS,
    CornerOptions,
    DetectionOptions,
    InterestPoints,
    corners,
    detect_interest_points,
    detectors,
    select_best_per_cell,
)
from hrsi.hrsi_engine.laboratory.simulation import BlockSimulation
from hrsi.hrsi_engine.measurement.interest_points import STRONG_QUALITY, Area, CentreOptions, windows
from hrsi.hrsi_engine.measurement.interest_points.corners import CORNER_DETECTION, compute_structure_tensor
from hrsi.hrsi_engine.measurement.interest_points.gravity_centres import find_gravity_centres
from hrsi.hrsi_engine.measurement.interest_points.level_regions import BRIGHT, DARK, HOMOGENEOUS, LevelRegions
from hrsi.hrsi_engine.measurement.interest_points.outlines import GradientImage, Outlines, measure_outlines
from hrsi.hrsi_engine.measurement.interest_points.shapes import SHAPE, compute_size_tolerance, fit_polygons
from hrsi.hrsi_engine.measurement.targets.measuring import measure_target

EVERY_DETECTOR = pytest.mark.parametrize("detector", DETECTORS)
#: For tests in which the centres, which need whole regions, take most of the time.
FASTER_DETECTORS = pytest.mark.parametrize("detector", mark_beyond(2, "thorough", DETECTORS))


@pytest.fixture(scope="module")
def small_objects() -> BlockSimulation:
    """A pair with many tanks of about 15 px."""
    return scenes.scene(0.55, 700, seed=8)


@pytest.fixture(scope="module")
def large_objects() -> BlockSimulation:
    """A pair with tanks and roundabouts of about 40 px."""
    return scenes.scene(1.4, 1000, seed=8)


@pytest.fixture(scope="module")
def pixels(small_objects: BlockSimulation) -> np.ndarray:
    return scenes.rendered(small_objects, "image_1").window(0, 0, 700, 700)


def same_points(first: InterestPoints, second: InterestPoints, tolerance_px: float) -> None:
    """Both tables hold the same points, whatever their order."""
    assert len(first) == len(second)
    a, b = (points.select(np.lexsort(np.rint(points.xy * 10.0).T)) for points in (first, second))
    np.testing.assert_allclose(a.xy, b.xy, atol=tolerance_px)
    assert a.kind.tolist() == b.kind.tolist()


def window_of(grey: np.ndarray) -> windows.DetectionWindow:
    """A whole image as a window, all of it usable."""
    area = Area(0, 0, grey.shape[1], grey.shape[0])
    return windows.DetectionWindow(area, area, grey.astype(np.float32), np.ones(grey.shape, dtype=bool))


def test_contrast_is_relative_to_its_surroundings():
    """Noise of 5 about 100 and of 40 about 900: mean 0 and deviation 1; over a floor of 20 the first has 1/4."""
    rng = np.random.default_rng(3)
    grey = np.hstack([rng.normal(100.0, 5.0, (512, 512)), rng.normal(900.0, 40.0, (512, 512))])
    left, right = np.s_[128:384, 128:384], np.s_[128:384, 640:896]  # no cell of the other half within reach
    for floor, deviation in ((1e-6, 1.0), (20.0, 0.25)):
        found = windows.normalise(window_of(grey), windows.ImageStatistics(None, 0.0, floor))
        for part, expected in ((left, deviation), (right, 1.0)):
            assert found[part].std() == pytest.approx(expected, rel=0.02)  # of 65536 and of 25600 pixels: 0.5 %
            assert found[part].mean() == pytest.approx(0.0, abs=0.05)


def test_quality_of_a_whole_outline_is_that_of_its_precision():
    """A bright disc without noise: contrast and outline score 1, so rmse and sigma alone lower the fifth power."""
    column, row = np.meshgrid(np.arange(128.0), np.arange(128.0))
    share = np.clip(12.5 - np.hypot(column - 63.3, row - 62.8), 0.0, 1.0)  # of a pixel on the edge
    grey = 200.0 + 400.0 * share + np.random.default_rng(2).normal(0.0, 1.0, share.shape)
    statistics = windows.ImageStatistics(None, 1.0, 20.0)
    (centre,) = find_gravity_centres(window_of(grey), statistics, CentreOptions())
    tolerance = compute_size_tolerance(SHAPE.polygon_tolerance, centre.size_px[None])[0]
    sigma = centre.sigma_px
    assert np.hypot(*(centre.xy - [63.3, 62.8])) < 0.1
    radius = np.hypot(*(centre.outline - centre.xy).T)
    assert centre.rmse_px == pytest.approx(
        np.std(radius), rel=0.15
    )  # of the edge points about the ellipse through them
    assert centre.quality**5 == pytest.approx((1.0 - centre.rmse_px / tolerance) * (1.0 - sigma / 0.25), rel=1e-4)


def test_peaks_are_those_of_a_paraboloid():
    """A turned one, whose cross term moves the peak along both axes; closed form."""
    Q, peak = np.array([[2.0, 0.6], [0.6, 1.0]]), np.array([3.3, 2.8])
    column, row = np.meshgrid(np.arange(7.0), np.arange(7.0))
    away = np.stack([column, row], axis=-1) - peak
    strength = 10.0 - 0.5 * np.einsum("rci,ij,rcj->rc", away, Q, away)
    offset = corners.compute_peak_offsets(strength, np.array([3]), np.array([3]))
    np.testing.assert_allclose(offset, [peak - 3.0], atol=1e-12)


def test_sigmas_of_corners_are_those_of_the_normal_equations(pixels: np.ndarray):
    """Intersection of edge elements (Förstner and Gülch 1987): noise² N⁻¹ over pixels, mean of both axes."""
    window, noise = window_of(pixels[:512, :512]), 30.0
    statistics = windows.ImageStatistics(None, noise, 50.0)
    peaks = corners.find_corner_peaks(window, statistics, CornerOptions(), corners.compute_foerstner_strength)
    tensor = compute_structure_tensor(windows.normalise(window, statistics))
    strength = corners.compute_foerstner_strength(tensor, CornerOptions())
    expected = []
    for xy, own in zip(peaks.xy, peaks.strength, strict=True):
        near = [(r, c) for r in range(int(xy[1]) - 1, int(xy[1]) + 3) for c in range(int(xy[0]) - 1, int(xy[0]) + 3)]
        row, column = next(place for place in near if strength[place] == own)
        N = np.array(
            [[tensor.xx[row, column], tensor.xy[row, column]], [tensor.xy[row, column], tensor.yy[row, column]]]
        )
        pixels_in_patch = 4.0 * np.pi * CORNER_DETECTION.patch_px**2  # of a Gaussian's squared weights
        variance = (noise / 50.0) ** 2 / pixels_in_patch * np.trace(np.linalg.inv(N.astype(float))) / 2.0
        expected.append(np.hypot(corners.CORNER_PEAKS.model_sigma_px, np.sqrt(variance)))
    assert len(expected) > 50 and np.median(expected) > 1.05 * corners.CORNER_PEAKS.model_sigma_px  # noise counts
    np.testing.assert_allclose(peaks.sigma_px, expected, rtol=1e-4)


@FASTER_DETECTORS
def test_windows_leave_no_seams(monkeypatch, pixels: np.ndarray, detector: str):
    """The same points, to float32 rounding, in one window and in windows with cores of 384 px."""
    whole = detect_interest_points(ArrayRaster(pixels), detector)
    monkeypatch.setattr(detectors, "tile_region", partial(windows.tile_region, step=384))
    assert len(windows.tile_region(Area(0, 0, 700, 700), 384)) == 4
    same_points(whole, detect_interest_points(ArrayRaster(pixels), detector), 1e-3)
    same_points(whole, detect_interest_points(ArrayRaster(pixels), detector, DetectionOptions(threads=3)), 1e-3)


@FASTER_DETECTORS
def test_grey_scale_does_not_matter(pixels: np.ndarray, detector: str):
    """8 bit loses a little; 16 bit, float and inverted grey values give the same points."""
    found = detect_interest_points(ArrayRaster(pixels), detector)
    same_points(found, detect_interest_points(ArrayRaster(pixels.astype(np.float32) * 0.25 + 3.0), detector), 1e-3)
    # Dark spots are found again less often than bright ones and told so: all must be the same, whatever their quality
    every = DetectionOptions(centres=CentreOptions(quality=0.05))
    counts = [
        len(detect_interest_points(ArrayRaster(grey), detector, every))
        for grey in (pixels, 3000.0 - pixels.astype(np.float32))
    ]
    assert counts[0] == pytest.approx(counts[1], rel=0.05)
    byte = detect_interest_points(ArrayRaster((pixels / 8.0).astype(np.uint8)), detector)
    _, near = scenes.pairs(found.xy, byte.xy, 1.0)
    assert len(near) > 0.85 * len(found)


@EVERY_DETECTOR
def test_nodata_and_saturation_are_left_out(pixels: np.ndarray, detector: str):
    valid = np.ones(pixels.shape, bool)
    valid[200:400, 300:500] = False
    grey = pixels.copy()
    grey[~valid] = 0
    found = detect_interest_points(ArrayRaster(grey, valid), detector)
    pixel = np.rint(found.xy).astype(int)
    assert valid[pixel[:, 1], pixel[:, 0]].all()
    assert len(found) > 20
    saturated = np.minimum(pixels, 700)
    found = detect_interest_points(ArrayRaster(saturated), detector)
    area = windows.find_saturated_areas(saturated.astype(np.float32), 700.0)
    pixel = np.rint(found.xy).astype(int)
    assert area.mean() > 0.02
    assert not area[pixel[:, 1], pixel[:, 0]].any()


@EVERY_DETECTOR
def test_flat_images_have_no_points(detector: str):
    assert len(detect_interest_points(ArrayRaster(np.full((300, 300), 7, np.uint16)), detector)) == 0
    nothing = np.zeros((300, 300), bool)
    assert len(detect_interest_points(ArrayRaster(np.zeros((300, 300), np.uint16), nothing), detector)) == 0


def test_spreading_keeps_the_best_of_each_cell(pixels: np.ndarray):
    every = detect_interest_points(ArrayRaster(pixels), "harris")
    spread = every.select(select_best_per_cell(every, 100.0, 3))
    cells = [tuple(cell) for cell in np.floor((spread.xy + 0.5) / 100.0)]
    assert max(map(cells.count, cells)) == 3
    assert len(set(cells)) == len({tuple(cell) for cell in np.floor((every.xy + 0.5) / 100.0)})
    first = np.all(np.floor((every.xy + 0.5) / 100.0) == cells[0], axis=1)
    assert every.quality[first].max() in spread.quality


def test_super_points_are_the_strongest(pixels: np.ndarray):
    found = detect_interest_points(ArrayRaster(pixels), "harris")
    strong = found.kind == "super"
    assert 0.05 < strong.mean() < 0.35
    assert found.strength[strong].min() > found.strength[~strong].max()


def test_failures(pixels: np.ndarray):
    with pytest.raises(InputError, match="choose one of harris"):
        detect_interest_points(ArrayRaster(pixels), "sift")
    with pytest.raises(InputError, match="choose a larger one"):
        detect_interest_points(ArrayRaster(pixels), "harris", region=Area(690, 0, 800, 100))
    with pytest.raises(Cancelled):
        detect_interest_points(ArrayRaster(pixels), "harris", progress=lambda fraction, message="": False)


@pytest.mark.parametrize(
    ("size", "most_px"), mark_beyond(1, "rendered", [("small_objects", 0.10), ("large_objects", 0.05)])
)
def test_centres_are_where_the_truth_says(request, size: str, most_px: float):
    """Tanks and roundabouts of 15 and 40 px: every one is found; limits are those wanted of a coordinate."""
    simulated = request.getfixturevalue(size)
    parts = [
        scenes.centre_errors(
            scenes.true_objects(simulated, scenes.rendered(simulated, view)), points, ("tank", "island")
        )
        for view, points in zip(scenes.VIEWS, scenes.detected(simulated, "centres"), strict=True)
    ]
    errors, found = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    assert len(found) >= 20
    assert found.mean() >= 0.97
    assert scenes.rms(errors) <= most_px


def test_default_centres_repeat(small_objects: BlockSimulation):
    """Counted strictly, the points of the command's threshold in both views: nine in ten of the objects' shapes.

    Of all, blobs among them, at least as many as their quality says, which is their chance to be found again.
    """
    strong = [points.select(points.quality >= STRONG_QUALITY) for points in scenes.detected(small_objects, "centres")]
    shapes = [points.select(points.kind != "blob") for points in strong]
    share, of_shapes = (
        scenes.repeatability(small_objects, *(points.xy for points in both)) for both in (strong, shapes)
    )
    assert of_shapes >= 0.9
    assert share >= np.mean(strong[0].quality)


def test_blobs_are_where_spots_are():
    """Gaussian spots of both signs and unequal axes on noise: every one a blob, its centre to a tenth of a pixel."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:400, :400].astype(float)
    grey, true, sign = 500.0 + rng.normal(0.0, 2.0, (400, 400)), [], []
    for column in range(5):
        for row in range(5):
            centre = 60.0 + 70.0 * np.array([column, row]) + rng.uniform(-3.0, 3.0, 2)
            turn, bright = rng.uniform(0.0, np.pi), 1.0 if (column + row) % 2 else -1.0
            u = (x - centre[0]) * np.cos(turn) + (y - centre[1]) * np.sin(turn)
            v = (y - centre[1]) * np.cos(turn) - (x - centre[0]) * np.sin(turn)
            grey += bright * 150.0 * np.exp(-0.5 * ((u / 3.5) ** 2 + (v / 2.5) ** 2))
            true.append(centre)
            sign.append(bright)
    found = detect_interest_points(ArrayRaster(grey.astype(np.float32)), "centres", scenes.CANDIDATES)
    spots, near = scenes.pairs(np.array(true), found.xy, 2.0)
    assert len(spots) == len(true)
    assert scenes.rms(found.xy[near] - np.array(true)) < 0.1
    np.testing.assert_array_equal(np.sign(found.contrast[near]), np.array(sign)[spots])


def test_objects_have_their_centre_size_direction_and_contrast():
    """Ellipses, rectangles and pentagons of known outline, turned, blurred, with noise: all that is told of them.

    Centre, area's moments and their directions are those of the outline's polygon, by Green's theorem.
    """
    rng, side, rows, finer = np.random.default_rng(3), 56, 4, 5
    grey, true = np.zeros((rows * side, rows * side)), []
    y, x = (np.mgrid[: side * finer, : side * finer] + 0.5) / finer - 0.5
    for number, (row, column) in enumerate(np.ndindex(rows, rows)):
        kind, sign = ("ellipse", "rectangle", "region")[number % 3], (1.0, -1.0)[number % 2]
        turn, half = rng.uniform(0.0, np.pi), np.array([rng.uniform(12.0, 16.0), rng.uniform(7.0, 10.0)])
        t = np.arange(120) * np.pi / 60.0
        if kind == "region":
            t = np.sort(np.arange(5) + rng.uniform(-0.2, 0.2, 5)) * 2.0 * np.pi / 5.0
        outline = half * np.column_stack([np.cos(t), np.sin(t)])
        if kind == "rectangle":
            outline = half * [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        outline = side / 2.0 + rng.uniform(-2.0, 2.0, 2) + outline @ axes
        after = np.roll(outline, -1, axis=0)
        inside = np.ones_like(x, dtype=bool)
        for (x0, y0), (x1, y1) in zip(outline, after, strict=True):
            inside &= (x1 - x0) * (y - y0) >= (y1 - y0) * (x - x0)
        part = sign * 100.0 * inside.reshape(side, finer, side, finer).mean(axis=(1, 3))
        grey[row * side : (row + 1) * side, column * side : (column + 1) * side] = part
        cross = outline[:, 0] * after[:, 1] - after[:, 0] * outline[:, 1]
        centre = ((outline + after) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())
        p, q = outline - centre, after - centre
        cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
        both = (p + q)[:, :, None] * (p + q)[:, None, :] + p[:, :, None] * p[:, None, :] + q[:, :, None] * q[:, None, :]
        moments = (both * cross[:, None, None]).sum(axis=0) / (12.0 * cross.sum())
        values, vectors = np.linalg.eigh(moments)
        # of an ellipse the variance along a semi-axis a is a²/4, of a rectangle with half sides a it is a²/3
        size = 2.0 * np.sqrt((3.0 if kind == "rectangle" else 4.0) * values[::-1])
        true.append((kind, sign, centre + side * np.array([column, row]), size, vectors[:, 1]))
    blurred = gaussian_filter(500.0 + grey, 0.6) + rng.normal(0.0, 2.0, grey.shape)
    found = detect_interest_points(ArrayRaster(blurred.astype(np.float32)), "centres")
    told, errors = [], []
    for kind, sign, centre, size, direction in true:
        k = int(np.argmin(np.hypot(*(found.xy - centre).T)))
        assert found.contrast[k] == pytest.approx(sign * 100.0, abs=3.0)
        assert kind in ("region", found.kind[k])
        told.append(found.kind[k])
        if found.kind[k] != kind:
            continue  # of pentagons some are ellipses within the tolerance
        assert np.hypot(*(found.xy[k] - centre)) < 0.1  # px, what is wanted of a coordinate
        assert found.size_px[k] == pytest.approx(size, rel=0.02)
        along = np.array([np.cos(found.azimuth_rad[k]), np.sin(found.azimuth_rad[k])])
        assert abs(along @ direction) > np.cos(np.radians(1.0 if kind != "region" else 6.0))
        assert -np.pi / 2.0 <= found.azimuth_rad[k] <= np.pi / 2.0
        assert found.rmse_px[k] < 0.3
        errors.append((kind, (found.xy[k] - centre) @ np.linalg.solve(found.covariance_px2[k], found.xy[k] - centre)))
    assert told.count("region") >= 2
    for kind in ("ellipse", "rectangle"):
        # of n errors in two coordinates chi2(2 n), with a factor of two for the stated sigmas
        squares = [square for one, square in errors if one == kind]
        low, high = chi2.ppf([0.001, 0.999], 2 * len(squares))
        assert low / 4.0 < sum(squares) < 4.0 * high


@pytest.mark.parametrize(("sign", "scale"), [(BRIGHT, 1), (DARK, 1), (BRIGHT, 2), (HOMOGENEOUS, 1)])
def test_edge_points_of_a_disc_lie_on_its_circle(sign: int, scale: int):
    """From a rough region: distances, normals and slopes are those of the blurred edge of a disc of 100 grey values."""
    centre, radius, blur = np.array([31.3, 29.6]), 13.4, 0.6
    y, x = (np.mgrid[: 64 * 8, : 64 * 8] + 0.5) / 8.0 - 0.5
    inside = np.hypot(x - centre[0], y - centre[1]) < radius
    grey = gaussian_filter(100.0 * inside.reshape(64, 8, 64, 8).mean(axis=(1, 3)), blur)
    slopes = GradientImage((500.0 + (sign or 1) * grey).astype(np.float32), np.ones((64, 64), dtype=bool), 0.5)
    side = 64 // scale
    row, column = np.nonzero(grey.reshape(side, scale, side, scale).mean(axis=(1, 3)) > 70.0)
    if sign == HOMOGENEOUS:  # what is even ends some pixels before the edge
        row, column = np.nonzero(np.hypot(x - centre[0], y - centre[1])[4::8, 4::8] < radius - BLUR.edge_px)
    pixels = np.column_stack([column, row]).astype(np.int32)
    regions = LevelRegions(pixels, np.array([0, len(pixels)]), np.array([scale]), np.array([sign]))
    found = measure_outlines(slopes, regions)
    count = int(found.count[0])
    inner = radius - (BLUR.edge_px if sign == HOMOGENEOUS else 0.0)
    assert count == pytest.approx(2.0 * np.pi * inner / scale, rel=0.15)  # about a pixel of the region apart
    assert found.found[0, :count].all() and not found.found[0, count:].any()
    xy, normal = found.xy[0, :count], found.normal[0, :count]
    away = xy - centre
    assert np.abs(np.hypot(*away.T) - radius).max() < 0.25
    assert np.hypot(*away.T).mean() == pytest.approx(radius, abs=0.05)
    np.testing.assert_allclose(np.hypot(*normal.T), 1.0, atol=1e-6)
    assert np.sum(normal * away, axis=1).min() > 0.95 * radius  # within 18 degrees of outwards
    turned = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2.0 * np.pi, rel=0.06)  # once around, in order
    # the normal density of all that blurs: the optics, a pixel's area, the Gaussian of the slope
    width = np.sqrt(blur**2 + 1.0 / 12.0 + BLUR.sigma_px**2)
    assert np.median(found.slope[0, :count]) == pytest.approx(100.0 / np.sqrt(2.0 * np.pi) / width, rel=0.1)


def test_a_polygon_of_points_on_a_circle_is_as_rough_as_its_chords():
    """Each of 40 points lies R (1 - cos 9 deg) outside the middle of its neighbours; white errors have 1.5 squares."""
    turn, radius = 2.0 * np.pi * np.arange(40) / 40.0, 12.0
    normal = np.zeros((1, 48, 2))
    normal[0, :40] = np.column_stack([np.cos(turn), np.sin(turn)])
    found = (np.arange(48) < 40)[None]
    outlines = Outlines([50.0, 60.0] + radius * normal, normal, np.ones((1, 48)), found, np.array([40]))
    grey = GradientImage(np.zeros((9, 9), dtype=np.float32), np.ones((9, 9), dtype=bool), 1.0)
    shape = fit_polygons(outlines, grey, np.array([1.0]))
    assert shape.good[0] and shape.closed[0] == 1.0
    np.testing.assert_allclose(shape.xy[0], [50.0, 60.0], atol=1e-9)
    assert shape.rmse_px[0] == pytest.approx(radius * (1.0 - np.cos(np.pi / 20.0)) / np.sqrt(1.5), rel=1e-6)
    # the second moment of a regular polygon's area is R² (2 + cos 9 deg) / 12 along any axis
    diameter = 4.0 * radius * np.sqrt((2.0 + np.cos(np.pi / 20.0)) / 12.0)
    np.testing.assert_allclose(shape.size_px[0], diameter, rtol=1e-6)


@pytest.mark.rendered
def test_roofs_near_a_rough_position(small_objects: BlockSimulation):
    """Of roofs of 10 px most are measured from 2 px off, and at most one is mistaken for something beside it."""
    raster = scenes.rendered(small_objects, "image_1")
    truth = scenes.true_objects(small_objects, raster)
    rng = np.random.default_rng(1)
    roofs = truth.centre[truth.kind == "roof"][:30]
    found = np.array([measure_target(raster, roof + rng.uniform(-2.0, 2.0, 2)).xy for roof in roofs])
    away = np.hypot(*(found - roofs).T)
    assert np.isfinite(away).mean() >= 0.6
    assert np.nanmedian(away) <= 0.15
    assert np.sum(away > 1.0) <= 1


def test_grey_roofs_between_bright_and_dark(small_objects: BlockSimulation):
    """Roofs have no closed grey level among crowns and shadows: the even inside finds them; limits as for tanks."""
    points = scenes.detected(small_objects, "centres")[0]
    truth = scenes.true_objects(small_objects, scenes.rendered(small_objects, "image_1"))
    strong = points.select(points.quality >= STRONG_QUALITY)
    errors, found = scenes.centre_errors(truth, strong, ("roof",))
    assert found.mean() >= 0.5
    assert scenes.rms(errors) <= 0.10


@pytest.mark.rendered
def test_pan_and_multispectral_centres_agree(large_objects: BlockSimulation):
    """At 1:4 ellipses agree to half a PAN pixel, an eighth of an MS pixel; Harris's maxima are 2 PAN px apart."""
    pan, ms = (scenes.rendered(large_objects, "image_1", band) for band in ("pan", "green"))
    errors = {}
    for detector in ("centres", "harris"):
        coarse, fine = (detect_interest_points(image, detector, scenes.CANDIDATES) for image in (ms, pan))
        there = scenes.carried(large_objects, coarse.xy, ms, pan)
        a, b = scenes.pairs(there, fine.xy, 4.0)
        same = scenes.alike(coarse.select(a), fine.select(b), 4.0)
        a, b = a[same], b[same]
        errors[detector] = scenes.rms(fine.xy[b] - there[a])
        whole = coarse.kind[a] == "ellipse"
        if whole.any():
            errors["ellipses"] = scenes.rms(fine.xy[b[whole]] - there[a[whole]])
    assert errors["ellipses"] < 0.5
    assert errors["centres"] < 0.6 * errors["harris"]


@pytest.mark.parametrize(
    "name",
    mark_beyond(1, "real", [
        "s2p_triplet_phr/img_01.tif", "kahramanmaras_phr4/pre_event_img1.tif", "ventoux_phr_pair/left_image.tif",
        "qb2_gcp/qb2_basic1b.tif", "formats/nitf_rpc00b/wv3_20.NTF",
    ]),
)  # fmt: skip
@EVERY_DETECTOR
def test_real_images_have_points_in_every_quarter(real_data, name: str, detector: str):
    raster = GdalRaster(str(real_data / name))
    found = detect_interest_points(raster, detector, scenes.CANDIDATES)
    quarters = np.bincount((found.xy > np.array(raster.size) / 2.0) @ [1, 2], minlength=4)
    assert quarters.min() >= (2 if detector == "centres" else 50)


def test_windows_of_a_large_image_fit_into_memory_and_share_little():
    read_px = np.array([(core.right - core.left + 512) * (core.bottom - core.top + 512)
                        for core in windows.tile_region(Area(0, 0, 20_000, 20_000))])  # fmt: skip
    assert read_px.max() < 3 * MEMORY.values and read_px.sum() < 2.0 * 20_000**2

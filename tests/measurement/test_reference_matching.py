"""GCPs from an orthoimage: their accuracy against simulated truth, and what must be refused or named."""

from dataclasses import replace

import numpy as np
import pytest
import reference_scenes as scenes
from gdal_files import write_raster
from long_tests import mark_beyond
from scipy import ndimage

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.block.orthoimage import divide_area
from hrsi.hrsi_engine.io.rasters.ortho_rasters import open_reference
from hrsi.hrsi_engine.laboratory.simulation import OrientationError
from hrsi.hrsi_engine.measurement.reference.checks import (
    ImageGcps,
    ReferenceAccuracy,
    compute_reference_shift,
    contradiction,
    describe_far_shifts,
    describe_shifts,
    drop_wrong_parts,
)
from hrsi.hrsi_engine.measurement.reference.matching import (
    ReferenceControl,
    choose_places,
    find_agreement,
    match_reference,
)
from hrsi.hrsi_engine.measurement.reference.options import ReferenceOptions
from hrsi.hrsi_engine.measurement.reference.predicted_patches import predict_patch, read_patch
from hrsi.hrsi_engine.measurement.window_matching.correlation import (
    compute_orientation_field,
    correlate_orientations,
    find_correlation_peak,
)
from hrsi.hrsi_engine.surface.dem import cell_size_m

OPTIONS = ReferenceOptions(points=60)
EXACT = ReferenceAccuracy(0.5, 0.5)


@pytest.fixture(scope="module")
def scene() -> scenes.Scene:
    return scenes.make(images=2)


@pytest.fixture(scope="module")
def control(scene: scenes.Scene) -> ReferenceControl:
    return match_reference(scene.images, scene.reference, scene.terrain, OPTIONS)


def rmse_px(scene: scenes.Scene, control: ReferenceControl) -> float:
    """Return the RMSE of a coordinate of all used matches against the true cameras."""
    errors = [
        scene.true_error_px(number, control.ground[part.places[part.used]], part.xy[part.used])
        for number, part in enumerate(control.images)
    ]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def test_positions_are_right_to_a_fraction_of_a_pixel(scene, control):
    assert [part.refusal for part in control.images] == ["", ""]
    assert all(part.used.sum() > 25 for part in control.images)
    print("RMSE", rmse_px(scene, control))
    assert rmse_px(scene, control) < 0.03  # noise of 11 bits on 41 x 41 pixels


def test_heights_are_those_of_the_dem(scene, control):
    terrain = scene.simulated.scene.terrain
    np.testing.assert_allclose(control.ground[:, 2], terrain.height_at(control.ground), atol=1e-6)


@pytest.mark.rendered
def test_reference_of_another_season(scene):
    grey = scenes.another_season(scene.reference.raster.grey)
    changed = replace(scene.reference, raster=ArrayRaster(grey))
    control = match_reference(scene.images[:1], changed, scene.terrain, OPTIONS)
    found = control.images[0]
    assert found.used.sum() > 0.5 * len(found.used) > 10
    error = scene.true_error_px(0, control.ground[found.places], found.xy)[found.used]
    print("RMSE", np.sqrt(np.mean(error**2)))
    assert np.sqrt(np.mean(error**2)) < 0.2
    assert 0.2 < np.sqrt(np.mean((error / found.sigma_px[found.used, None]) ** 2)) < 2.0  # sigmas tell the truth


@pytest.mark.rendered
def test_coarser_reference_with_another_band_and_a_large_bias():
    error = OrientationError(position_m=(110.0, -70.0, 20.0))
    scene = scenes.make(seed=2, size=700, ratio=2.6, band="red", error=error)
    control = match_reference(scene.images, scene.reference, scene.terrain, OPTIONS)
    found = control.images[0]
    assert found.step == pytest.approx(2.6, rel=0.1)
    assert np.hypot(*found.offset_px[found.used].mean(axis=0)) > 130.0
    print("RMSE", rmse_px(scene, control), "px,", rmse_px(scene, control) / found.step, "of the reference's")
    assert found.used.sum() > 15
    assert rmse_px(scene, control) < 0.15 * found.step


def test_sigmas_hold_where_only_the_directions_of_gradients_agree(scene):
    """Bright and dark exchanged: least squares refuses every place. A peak half a pixel off would be the next one."""
    inverted = replace(scene.reference, raster=ArrayRaster((2000.0 - scene.reference.raster.grey).astype(np.float32)))
    control = match_reference(scene.images[:1], inverted, scene.terrain, replace(OPTIONS, points=9))
    found = control.images[0]
    assert found.used.sum() >= 6
    error = scene.true_error_px(0, control.ground[found.places], found.xy)[found.used]
    assert np.sqrt(np.mean(error**2)) < found.sigma_px[found.used].min()
    assert found.sigma_px[found.used].max() < 0.5


def test_places_are_where_the_texture_is(scene):
    """Stripes of 60 px with noise between flat ones of 60 px: the middle of every window lies in a stripe."""
    lines, samples = scene.reference.raster.grey.shape
    noise = np.random.default_rng(6).normal(500.0, 60.0, (lines, samples))
    stripes = (np.arange(samples) % 120 >= 60) & np.ones((lines, 1), dtype=bool)
    reference = replace(scene.reference, raster=ArrayRaster(np.where(stripes, noise, 500.0).astype(np.float32)))
    places = choose_places(scene.images[:1], reference, scene.terrain, 60, 31)
    column = reference.to_pixels(places[:, :2])[:, 0] % 120
    assert len(places) > 20
    assert np.all((column > 60.0) & (column < 120.0))


def test_another_place_is_refused(scene):
    turned = replace(scene.reference, raster=ArrayRaster(np.ascontiguousarray(scene.reference.raster.grey.T[::-1])))
    control = match_reference(scene.images[:1], turned, scene.terrain, OPTIONS)
    assert control.images[0].agreement is None
    assert control.images[0].refusal
    assert not control.images[0].used.any()


def test_reference_that_does_not_cover_the_image_is_refused(scene):
    far = replace(scene.reference, to_pixels=lambda lonlat: scene.reference.to_pixels(lonlat) + 1e6)
    control = match_reference(scene.images[:1], far, scene.terrain, OPTIONS)
    assert "no textured window" in control.images[0].refusal


def shifted(scene: scenes.Scene, east_m: float, north_m: float) -> scenes.Scene:
    """Return the scene with its reference displaced on the ground."""
    step = np.array([east_m, north_m]) / scene.simulated.scene.chart.scale
    old = scene.reference
    moved = replace(
        old, to_pixels=lambda p: old.to_pixels(p - step), to_lonlat=lambda pixels: old.to_lonlat(pixels) + step
    )
    return replace(scene, reference=moved)


@pytest.mark.parametrize(
    ("east_m", "north_m", "noticed"),
    mark_beyond(2, "rendered", [(80.0, -60.0, True), (0.0, 0.0, False), (3.0, 4.0, False)]),
)
def test_displaced_reference_is_noticed(scene, east_m, north_m, noticed):
    moved = shifted(scene, east_m, north_m)
    control = match_reference(moved.images, moved.reference, moved.terrain, replace(OPTIONS, points=30))
    shifts = [
        compute_reference_shift(image, part, control.ground, EXACT)
        for image, part in zip(moved.images, control.images, strict=True)
    ]
    true = reference_error(scene)
    for shift, own in zip(shifts, true, strict=True):
        # the DEM does not move with the reference: 100 m aside its heights are wrong by metres
        aside = np.hypot(shift.east_m - own[0] + east_m, shift.north_m - own[1] + north_m)
        assert aside < (3.0 if noticed else 0.3)
        assert shift.stated and shift.bias_m == pytest.approx(4.4, rel=0.1)  # 6 urad from 700 km
    text = " ".join(describe_shifts(shifts))
    assert bool(text) == noticed
    assert describe_far_shifts(shifts) == (describe_shifts(shifts) if noticed else [])  # 100 m are 23 sigmas
    if noticed:
        assert "all 2 images" in text and "differ from the reference by" in text and "ERR_BIAS" in text


def reference_error(scene: scenes.Scene) -> list[np.ndarray]:
    """Return by how much each vendor's RPC puts the ground in the middle of its image beside the truth, metres."""
    errors = []
    for image, camera in zip(scene.images, scene.simulated.truth.cameras, strict=True):
        middle = camera.image_to_ground(image.centre_px[None], 250.0)
        by_rpc, _ = image.rpc.localize(image.centre_px[None], 250.0)
        errors.append((by_rpc - middle)[0, :2] * scene.simulated.scene.chart.scale)
    return errors


def shifted_corner(scene: scenes.Scene, control: ReferenceControl, by_m: float) -> tuple[ReferenceControl, np.ndarray]:
    """Return what is found where the north-eastern third of the reference lies off, and which places are there."""
    middle = np.quantile(control.ground[:, :2], 0.66, axis=0)
    corner = (control.ground[:, :2] > middle).all(axis=1)
    images = []
    for image, found in zip(scene.images, control.images, strict=True):
        _, by_ground = image.rpc.project_with_metric_jacobian(control.ground[found.places])
        step = by_ground[:, :, :2] @ (by_m / np.sqrt(2.0) * np.ones(2))
        images.append(replace(found, offset_px=found.offset_px + np.where(corner[found.places, None], step, 0.0)))
    return replace(control, images=tuple(images)), corner


def test_a_corner_of_the_reference_that_lies_off_is_named_and_left_out(scene, control):
    accuracy = ReferenceAccuracy(5.0, 3.0)
    assert drop_wrong_parts(scene.images, control, accuracy)[1] == []
    moved, corner = shifted_corner(scene, control, 15.0)
    kept, wrong = drop_wrong_parts(scene.images, moved, accuracy)
    assert len(wrong) >= 1
    lonlat = np.array([[part.lon_deg, part.lat_deg] for part in wrong])
    assert (lonlat > np.median(control.ground[:, :2], axis=0)).all()
    size = [np.hypot(part.east_m, part.north_m) for part in wrong]
    np.testing.assert_allclose(max(size), 15.0, atol=1.5)
    for found in kept.images:
        assert corner[found.places[found.used]].mean() < 0.3 * corner[found.places].mean()
    assert drop_wrong_parts(scene.images, shifted_corner(scene, control, 2.0)[0], accuracy)[1] == []


@pytest.mark.rendered
def test_surveyed_gcps_contradict_a_displaced_reference(scene):
    block, truth = scene.simulated.block, scene.simulated.truth
    moved = shifted(scene, 12.0, 16.0)
    control = match_reference(moved.images, moved.reference, moved.terrain, replace(OPTIONS, points=30))
    gcps = []
    for number, image in enumerate(block.images):
        rows = np.flatnonzero(truth.image_points.image == number)
        points = truth.image_points.point[rows]
        sigma = np.tile([0.1, 0.2], (len(rows), 1))
        gcps.append(ImageGcps(image.id, truth.ground[points], sigma, truth.image_points.xy[rows]))
    found = contradiction(moved.images, control, gcps, EXACT)
    assert found is not None and found.is_excessive
    assert (found.east_m, found.north_m) == pytest.approx((-12.0, -16.0), abs=0.1)
    assert "the reference is not used" in found.message
    honest = contradiction(
        scene.images, match_reference(scene.images, scene.reference, scene.terrain, OPTIONS), gcps, EXACT
    )
    assert honest is not None and not honest.is_excessive
    assert np.hypot(honest.east_m, honest.north_m) < 0.1
    assert contradiction(moved.images, control, [], EXACT) is None


def test_points_of_a_reference_together_are_no_better_than_it_is():
    """The mean of independent errors of these sigmas is as large as that of errors that an orthoimage shares."""
    rng = np.random.default_rng(1)
    ground = np.column_stack([rng.uniform(0.0, 0.05, (400, 2)), np.zeros(400)])
    part, names = divide_area(ground)
    draws = 4000
    shared = 0.8 * rng.normal(size=(draws, 1)) + 0.4 * rng.normal(size=(draws, len(names)))[:, part]
    own = np.sqrt(1.0 - 0.8**2 - 0.4**2) * rng.normal(size=(draws, 400))
    sigma_xy, sigma_h = ReferenceAccuracy(2.0, 1.0).compute_sigmas(ground)
    assert sigma_xy / np.sqrt(400) == pytest.approx(2.0 * (shared + own).mean(axis=1).std(), rel=0.05)
    assert sigma_xy / np.sqrt(400) > 1.6 > sigma_h / np.sqrt(400) > 0.4
    assert ReferenceAccuracy(2.0, 1.0).compute_sigmas(ground[:1]) == pytest.approx((2.0, 1.0))


# ---- parts -----------------------------------------------------------------------------------------------------


def test_prediction_looks_like_the_image_with_the_true_camera(scene):
    """With the true RPC the predicted patch is the image but for noise and blur."""
    true = replace(scene.images[0], rpc=scene.simulated.truth.rpcs[0].rpc)
    origin, shape = np.array([150.0, 140.0]), (90, 110)
    seen = read_patch(true.raster, origin, shape, 1.0)
    predicted = predict_patch(
        true, scene.reference, scene.terrain, origin, shape, 1.0, np.zeros(2), 4.0, scene.reference.gsd_m
    )
    assert predicted.valid.all()
    assert np.corrcoef(seen.grey.ravel(), predicted.grey.ravel())[0, 1] > 0.98
    reduced = read_patch(true.raster, origin, (30, 36), 3.0)
    means = ndimage.uniform_filter(seen.grey, 3)[1::3, 1::3][:28, :34]
    assert np.corrcoef(reduced.grey[:28, :34].ravel(), means.ravel())[0, 1] > 0.9  # a third of a pixel aside


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gradient_directions_find_a_shift_whatever_the_contrast(sign):
    rng = np.random.default_rng(3)
    grey = ndimage.gaussian_filter(rng.normal(0.0, 1.0, (140, 150)), 2.0) * 500.0
    search = compute_orientation_field(grey.astype(np.float32), np.ones(grey.shape, dtype=bool))
    window = sign * 0.3 * grey[23:83, 41:111] + rng.normal(0.0, 5.0, (60, 70))
    peak = find_correlation_peak(
        correlate_orientations(
            compute_orientation_field(window.astype(np.float32), np.ones(window.shape, dtype=bool)), search
        )
    )
    assert peak.shift == pytest.approx([41.0, 23.0], abs=0.3)
    assert peak.contrast > 9.0 and peak.rival < 0.6


@pytest.mark.parametrize("gain", [1.0, -7.0])
def test_directions_are_doubled_and_strengths_saturate(gain):
    """Ramps of a half, one and two median slopes have 1/3, 1/2 and 2/3; gain and sign do not matter, angles double."""
    turn, x = np.radians(25.0), np.arange(90.0)
    ramp = np.cos(turn) * x[None] + np.sin(turn) * x[:61, None]
    grey = gain * np.hstack([0.5 * ramp, ramp, 2.0 * ramp]).astype(np.float32)
    found = compute_orientation_field(grey, np.ones(grey.shape, dtype=bool))[30, [45, 135, 225]]
    np.testing.assert_allclose(np.abs(found), [1.0 / 3.0, 1.0 / 2.0, 2.0 / 3.0], rtol=0.02)
    np.testing.assert_allclose(np.angle(found), 2.0 * turn, atol=0.01)


@pytest.mark.parametrize("false_share", [0.0, 0.6])
def test_agreement_follows_an_affine_bias_among_false_matches(false_share):
    rng = np.random.default_rng(4)
    xy = rng.uniform(0, 3000, (300, 2))
    truth = np.array([[12.0, 1.5, -0.4], [-31.0, 0.3, 0.8]])
    centre = half = np.array([1500.0, 1500.0])
    design = np.column_stack([np.ones(300), (xy - centre) / half])
    offset = design @ truth.T + rng.normal(0.0, 0.1, (300, 2))
    false = rng.random(300) < false_share
    offset[false] = truth[:, 0] + rng.uniform(-8.0, 8.0, (int(false.sum()), 2))
    found = find_agreement(xy, offset, centre, half, 8.0, 1.5)
    assert found is not None and found.chance_log10 < -20.0
    np.testing.assert_allclose(found.coefficients, truth, atol=0.08)
    assert found.agreeing[~false].mean() > 0.95
    assert not false_share or found.agreeing[false].mean() < 0.05


def test_agreement_of_few_is_nearly_that_of_the_right_ones_alone():
    """Of 40 places two fifths are false, within 8 px: the bias is at most three times as uncertain as without them."""
    errors, least = [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        xy, offset, centre = rng.uniform(0, 3000, (40, 2)), rng.normal(0.0, 0.1, (40, 2)), np.full(2, 1500.0)
        false = rng.random(40) < 0.4
        design = np.column_stack([np.ones(40), (xy - centre) / centre])[~false]
        least.append(np.linalg.lstsq(design, offset[~false], rcond=None)[0][0])
        offset[false] = rng.uniform(-8.0, 8.0, (int(false.sum()), 2))
        found = find_agreement(xy, offset, centre, centre, 8.0, 1.5)
        errors.append(found.bias(centre[None])[0])
    assert np.sqrt(np.mean(np.square(errors))) < 3.0 * np.sqrt(np.mean(np.square(least)))


def test_agreement_of_chance_is_told():
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(20):
        xy, offset = rng.uniform(0, 3000, (200, 2)), rng.uniform(-8.0, 8.0, (200, 2))
        found = find_agreement(xy, offset, np.full(2, 1500.0), np.full(2, 1500.0), 8.0, 1.5)
        worst = min(worst, 0.0 if found is None else found.chance_log10)
    assert worst > -6.0


def test_cell_size(scene):
    terrain = scene.simulated.scene.terrain
    assert cell_size_m(scene.terrain, np.array([5.45, 43.53, 0.0])) == pytest.approx(terrain.post_m, rel=1e-3)


def test_bands_of_a_reference_are_averaged_but_alpha(tmp_path):
    bands = np.random.default_rng(5).integers(1, 200, (4, 20, 30)).astype(np.uint8)
    bands[3] = 255
    bands[3, :, :5] = 0
    path = write_raster(
        tmp_path / "rgba.tif", bands, (5.0, 1e-4, 0.0, 43.0, 0.0, -1e-4), "EPSG:4326",
        options=["PHOTOMETRIC=RGB", "ALPHA=YES"],
    )  # fmt: skip
    grey, valid = open_reference(path).raster.read(0, 0, 30, 20)
    assert not valid[:, :5].any() and valid[:, 5:].all()
    np.testing.assert_allclose(grey[:, 5:], bands[:3, :, 5:].mean(axis=0), rtol=1e-6)
    np.testing.assert_array_equal(open_reference(path, 2).raster.read(0, 0, 30, 20)[0][:, 5:], bands[1, :, 5:])

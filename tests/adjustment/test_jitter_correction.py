"""Jitter is estimated and removed: curves, accuracies and what stays as it is, against curves that the tests put in."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from scipy.interpolate import BSpline
from scipy.stats import norm, t

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.jitter.line_splines import LineSpline
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.block.jitter_curve import JitterCurve
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.surface.grid_surface import GridSurface

NOISE_PX = 0.15
PIXEL_RAD = lab.SENSORS["pleiades"].detector_angle_rad
PERIODS, AMPLITUDES = (400.0, 520.0), (0.8, 0.8)  # across and along the track


def shake(number: int, line: np.ndarray) -> np.ndarray:
    """Return the jitter of an image, ``(n, 2)``."""
    phase = 1.7 * number
    waves = [a * np.sin(2.0 * np.pi * line / p + phase) for a, p in zip(AMPLITUDES, PERIODS, strict=True)]
    return (1.0 - 0.2 * number) * np.column_stack(waves)


def make_block(count: int, shaken: bool = True, seed: int = 1) -> tuple[Block, np.ndarray]:
    """Return a block whose measurements shake, and its true positions."""
    block, truth, _ = blocks.block(8, 40, 1200, count=count, seed=seed, noise_px=NOISE_PX, bias_px=3.0, drift=3e-5)
    rows, xy = block.measurements, block.measurements.xy.copy()
    for number in range(len(block.images) if shaken else 0):
        here = rows.image == number
        xy[here] += shake(number, xy[here, 1])
    rows = replace(rows, xy=xy, sigma_px=np.full(len(rows), NOISE_PX))
    return replace(block, measurements=rows), truth


@pytest.fixture(scope="module")
def shaken():
    """Return the adjustments of three shaken images without and with a correction, and the true positions."""
    block, truth = make_block(3)
    return adjust(block), adjust(block, AdjustOptions(jitter="auto")), truth


def test_curves_are_those_of_the_simulation(shaken):
    _, result, _ = shaken
    for number, image in enumerate(result.block.images):
        curve = result.jitter.curves[image.id]
        line = np.arange(600.0, 3400.0)  # where there are points
        error = curve.evaluate(line) - shake(number, line)
        trend = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(line)), 1)  # of the corrections
        error -= trend @ np.linalg.lstsq(trend, error, rcond=None)[0]
        # Three views in different directions separate both axes: what is left is below a measurement's error
        assert (error.std(axis=0) < NOISE_PX).all(), (image.id, error.std(axis=0))


def test_residuals_fall_to_the_noise_and_check_points_to_their_prediction(shaken):
    without, result, truth = shaken
    tie = result.has_residual & (result.block.points.role[result.block.measurements.point] == Role.TIE)
    rms = [float(np.sqrt(np.mean(one.residual_px[tie] ** 2))) for one in (without, result)]
    assert rms[0] > 2.0 * NOISE_PX and rms[1] <= NOISE_PX
    check = np.flatnonzero(result.block.points.role == Role.CHECK)
    error = ground_difference_m(truth[check], result.ground[check])
    before = ground_difference_m(truth[check], without.ground[check])
    assert np.sqrt(np.mean(error**2)) < 0.5 * np.sqrt(np.mean(before**2))
    inside = np.abs(error) <= 1.645 * result.ground_sigma_m[check]
    assert 0.8 <= inside.mean() <= 1.0  # 90 % of 120 values that err together in part


def test_measurements_as_made_are_told_of(shaken):
    without, result, _ = shaken
    assert np.abs(result.measured_xy - without.block.measurements.xy).max() < 1e-4
    assert np.abs(result.block.measurements.xy - without.block.measurements.xy).max() > 0.5


@pytest.mark.thorough
def test_what_two_images_do_not_separate_is_told():
    block, truth = make_block(2)
    result = adjust(block, AdjustOptions(jitter="70"))
    check = np.flatnonzero(result.block.points.role == Role.CHECK)
    error = ground_difference_m(truth[check], result.ground[check])
    tie = result.has_residual & (result.block.points.role[result.block.measurements.point] == Role.TIE)
    assert np.sqrt(np.mean(result.residual_px[tie] ** 2)) <= NOISE_PX
    # Errors along the epipolar line are as large as before, and as predicted within the factor of one realisation
    ratio = np.sqrt(np.mean(error**2, axis=0) / np.mean(result.ground_sigma_m[check] ** 2, axis=0))
    assert (ratio > 0.3).all() and (ratio < 1.7).all(), ratio


@pytest.mark.parametrize("count", [2, 3])
def test_block_without_jitter_is_the_same_to_the_last_digit(count):
    block, _ = make_block(count, shaken=False)
    one, other = adjust(block, AdjustOptions(jitter="none")), adjust(block, AdjustOptions(jitter="auto"))
    assert other.jitter is None
    for name in ("values", "ground", "ground_sigma_m", "residual_px"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name


@pytest.mark.thorough
def test_weak_wave_beside_a_strong_one_is_removed_too():
    """A prior of the strong wave's period leaves nothing for one that is ten times as short."""
    block, _ = make_block(3, shaken=False)
    rows, xy = block.measurements, block.measurements.xy.copy()
    fine = 2.0 * np.pi / 150.0
    for number in range(3):
        here = rows.image == number
        strong = np.sin(2.0 * np.pi * xy[here, 1] / 1500.0 + 1.7 * number)
        xy[here, 0] += strong + 0.5 * np.sin(fine * xy[here, 1] + 0.9 * number)
    result = adjust(replace(block, measurements=replace(rows, xy=xy)), AdjustOptions(jitter="auto"))
    line = np.arange(600.0, 3400.0)
    for number, image in enumerate(result.block.images):
        across = result.jitter.curves[image.id].evaluate(line)[:, 0]
        sines = np.column_stack([np.sin(fine * line), np.cos(fine * line)])
        a, b = np.linalg.lstsq(sines, across, rcond=None)[0]
        assert np.hypot(a - 0.5 * np.cos(0.9 * number), b - 0.5 * np.sin(0.9 * number)) < 0.25 * 0.5, image.id


def test_waves_too_small_to_matter_change_nothing():
    block, _ = make_block(3, shaken=False)
    rows, xy = block.measurements, block.measurements.xy.copy()
    xy[:, 0] += 0.03 * np.sin(2.0 * np.pi * xy[:, 1] / 400.0 + rows.image)
    block = replace(block, measurements=replace(rows, xy=xy))
    assert adjust(block, AdjustOptions(jitter="auto")).jitter is None


def test_knots_can_be_named():
    block, _ = make_block(2, shaken=False)
    result = adjust(block, AdjustOptions(jitter="200"))
    rms = [np.sqrt(np.mean(curve.shift_px**2)) for curve in result.jitter.curves.values()]
    assert len(rms) == 2 and max(rms) < 0.5 * NOISE_PX  # there is nothing, whatever is asked for


@pytest.mark.parametrize("asked", ["much", "2", "nan", "1e6"])  # and more lines than images have
def test_other_words_are_errors(asked):
    block, _ = make_block(2, shaken=False)
    with pytest.raises(InputError, match="`jitter`"):
        adjust(block, AdjustOptions(jitter=asked))


@pytest.mark.parametrize("count", [2, 3])
def test_errors_of_curves_move_points_as_an_adjustment_with_them_does(count):
    block, _ = make_block(count)
    plain = AdjustOptions(model="affine", robust="none", test_sigmas=False, reject_sigma=0.0)
    result = adjust(block, replace(plain, jitter="70"))
    drawn = len(result.jitter.samples)
    predicted = result.shared_shifts_m[:, :, -drawn:]
    scale = t.ppf(0.95, drawn) / norm.ppf(0.95) / np.sqrt(drawn)  # of so many samples follows a limit of 90 %
    for number in (0, drawn - 1):
        rows, xy = result.block.measurements, result.block.measurements.xy.copy()
        for k, image in enumerate(result.block.images):
            here = rows.image == k
            xy[here] += scale * result.jitter.samples[number][image.id].evaluate(xy[here, 1])
        moved = adjust(replace(block, measurements=replace(rows, xy=xy)), plain)
        change = ground_difference_m(moved.ground, result.ground)
        known = np.isfinite(change).all(axis=1)
        assert np.abs(change[known]).max() > 0.02
        # Samples reach 0.3 px: the part that is not linear is that of lines moved by as much
        assert np.abs(change - predicted[:, :, number])[known].max() < 0.01 * np.abs(change[known]).max()


def test_splines_are_those_of_scipy():
    spline = LineSpline(100.0, 30.0, 12)
    knots = 100.0 + 30.0 * np.arange(-3, 16)
    line = np.linspace(100.5, 459.5, 57)
    x = np.random.default_rng(3).normal(size=spline.size)
    assert np.allclose(spline.make_matrix(line) @ x, BSpline(knots, x, 3)(line), atol=1e-12)


@pytest.mark.parametrize("damping", [1.0, 0.3, 0.05, 1e-6])
def test_prior_has_the_variance_and_the_correlation_of_its_process_up_to_the_ends(damping):
    spline, period = LineSpline(0.0, 5.0, 400), 100.0
    k = 2.0 * np.pi / period
    root = np.zeros((spline.size, spline.size))
    np.put_along_axis(root, spline.prior_columns, spline.make_prior(k, damping), axis=1)
    line = np.array([0.0, period / 2.0, 1000.0, 1000.0 + period / 2.0, 2000.0 - period / 2.0, 2000.0])
    shown = spline.make_matrix(line).toarray() @ np.linalg.inv(root)
    covariance = shown @ shown.T
    # White noise in a damped oscillator: its correlation is that of the free vibration (Wang and Uhlenbeck, 1945)
    decay, turn = np.sqrt(damping) * k, k * np.sqrt(max(1.0 - damping, 1e-12))
    half = period / 2.0
    expected = np.exp(-decay * half) * (np.cos(turn * half) + decay / turn * np.sin(turn * half))
    assert np.allclose(np.diag(covariance), 1.0, atol=0.025)  # kh = 0.3: the equation applies at the knots only
    assert np.allclose(covariance[[0, 2, 4], [1, 3, 5]], expected, atol=0.025)
    # The determinant that the likelihood uses is that of the whole matrix
    values = spline.make_prior(k, damping)
    expected_log = np.linalg.slogdet(values[:3])[1] + (spline.size - 3) * np.log(abs(values[3, 2]))
    assert np.linalg.slogdet(root)[1] == pytest.approx(expected_log, rel=1e-9)


def test_surface_takes_waves_of_heights_that_its_sigma_calls_wrong():
    """Of a wave of 3 m nearly all heights deviate from a DEM of 0.3 m by more than an outlier may."""
    views = [
        replace(view, jitter=lab.OrientationError(vibration=lab.Vibration(waves=((2000.0, 2.0 * PIXEL_RAD, phase),))))
        for view, phase in zip(
            lab.make_along_track_views(lab.SENSORS["pleiades"], 2, (2000, 8000)), (0.4, 3.0), strict=True
        )
    ]
    scene = lab.SceneSpec(10.0, 45.0, 300.0, relief_m=200.0, seed=3)
    simulated = lab.simulate_block(scene, views, lab.PointCounts(8, 20, 800), lab.Noise(0.2))
    place = {name: number for number, name in enumerate(simulated.truth.ids.tolist())}
    truth = simulated.truth.ground[[place[name] for name in simulated.block.points.ids.tolist()]]
    tie = np.flatnonzero(simulated.block.points.role == Role.TIE)
    low, high = truth[:, :2].min(axis=0) - 1e-3, truth[:, :2].max(axis=0) + 1e-3
    lon, lat = (np.arange(a, b + 1e-4, 1e-4) for a, b in zip(low, high, strict=True))
    nodes = np.stack([*np.meshgrid(lon, lat), np.zeros((len(lat), len(lon)))], axis=-1).reshape(-1, 3)
    heights = simulated.scene.terrain.height_at(nodes).reshape(len(lat), len(lon))
    dem = GridSurface.from_array(heights, (float(low[0]), float(low[1])), (1e-4, 1e-4))
    waves = []
    for jitter in ("none", "auto"):
        result = adjust(simulated.block, AdjustOptions(jitter=jitter, dem=dem, sigma_dem_m=0.3))
        error = ground_difference_m(result.ground, truth)[tie, 2]
        line = result.block.images[0].rpc.project(truth[tie])[:, 1]
        design = np.column_stack([np.ones_like(line), np.cos(np.pi * line / 1000.0), np.sin(np.pi * line / 1000.0)])
        known = np.isfinite(error)
        waves.append(np.hypot(*np.linalg.lstsq(design[known], error[known], rcond=None)[0][1:]))
    assert waves[0] > 2.0 and waves[1] < 0.15 * waves[0]


def test_curve_is_undone():
    line = np.arange(1000)
    curve = JitterCurve(0, np.column_stack([np.sin(line / 30.0), 3.0 * np.cos(line / 40.0)]), np.zeros((1000, 2)))
    ideal = np.column_stack([np.linspace(0.0, 500.0, 300), np.linspace(10.0, 990.0, 300)])
    assert np.abs(curve.remove_from(ideal + curve.evaluate(ideal[:, 1])) - ideal).max() < 1e-4

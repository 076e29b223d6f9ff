"""Predictions from the other images against intersections made without them, by another solver; wrong tracks; pairs."""

from dataclasses import replace

import numpy as np
import simulated_blocks as blocks
from scipy.optimize import least_squares

from hrsi.hrsi_engine.adjustment.evaluation import find_wrong_tracks, fit_pairs, fit_tracks
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.results.residuals import compute_given_residuals

EXACT_PX = 1e-3  # of a prediction over errors of ten pixels: what the linearisation may do
EXACT_M = 1e-3


def four_views(**options: float) -> tuple[Block, np.ndarray]:
    block, truth, _ = blocks.block(gcps=0, checks=4, ties=25, count=4, seed=5, **options)
    return block, truth


def ties_of(block: Block) -> np.ndarray:
    return (block.points.role == Role.TIE) & (block.rays_per_point() >= 2)


def intersected_without(block: Block, point: int, left_out: int) -> np.ndarray:
    """Return where the rays of a point meet, but for one image's: SciPy's least squares over metres."""
    rows = np.flatnonzero((block.measurements.point == point) & (block.measurements.image != left_out))
    start = np.array([[blocks.LON, blocks.LAT, blocks.HEIGHT]])

    def residual(step: np.ndarray) -> np.ndarray:
        ground = move_ground(start, step[None])
        return np.concatenate([
            (block.measurements.xy[row] - block.images[block.measurements.image[row]].rpc.project(ground)[0])
            / block.measurements.sigma_px[row]
            for row in rows
        ])  # fmt: skip

    return move_ground(start, least_squares(residual, np.zeros(3), xtol=1e-15, ftol=1e-15, x_scale=100.0).x[None])


def test_predictions_are_those_of_intersections_without_the_image():
    block, _ = four_views(bias_px=8.0)
    rng = np.random.default_rng(1)
    sigma = rng.uniform(0.2, 0.8, len(block.measurements))
    block = replace(block, measurements=replace(block.measurements, sigma_px=sigma))
    observations, fit = fit_tracks(block, ties_of(block))
    checked = 0
    for row in range(0, observations.count, 7):
        point, image = observations.points[observations.point[row]], int(observations.image[row])
        ground = intersected_without(block, point, image)
        expected = observations.xy[row] - block.images[image].rpc.project(ground)[0]
        if np.isfinite(fit.predicted_px[row]).all():
            np.testing.assert_allclose(fit.predicted_px[row], expected, atol=EXACT_PX)
            assert np.hypot(*expected) > np.hypot(*fit.fit_px[row])
            checked += 1
    assert checked > 10


def test_two_images_predict_nothing():
    block, _, _ = blocks.block(gcps=0, checks=0, ties=20, count=2)
    _, fit = fit_tracks(block, ties_of(block))
    assert np.isnan(fit.predicted_px).all() and np.isfinite(fit.fit_px).all()


def test_wrong_tracks_are_those_that_are_wrong_under_every_set():
    block, _, _ = blocks.block(gcps=0, checks=0, ties=80, count=3, bias_px=5.0, drift=1e-4, noise_px=0.1, seed=6)
    rows = block.measurements
    wrong_points = np.array([3, 17, 40])
    first_rows = np.array([np.flatnonzero(rows.point == point)[0] for point in wrong_points])
    block = blocks.move_measurements(block, first_rows, [4.0, -4.0])
    observations, fit = fit_tracks(block, ties_of(block))
    pairs = fit_pairs(observations, fit)
    wrong = find_wrong_tracks(observations, [pairs], 6.0)
    assert np.flatnonzero(wrong).tolist() == np.flatnonzero(np.isin(observations.points, wrong_points)).tolist()
    clean = [replace(pair, left_px=np.where(pair.points == 3, 0.0, pair.left_px)) for pair in pairs]
    spared = find_wrong_tracks(observations, [pairs, clean], 6.0)
    assert not spared[3] and spared.sum() == wrong.sum() - 1
    assert not find_wrong_tracks(observations, [pairs], 0.0).any()


def test_known_points_in_pixels_and_metres():
    """Right cameras leave a survey's own error, on two images and more as on one."""
    block, truth, _ = blocks.block(
        gcps=0, checks=8, ties=0, count=3, bias_px=0.0, drift=0.0, noise_px=1e-6, noise_m=1e-6
    )
    moved_m = np.array([1.5, -0.5, 2.0])
    survey = move_ground(truth, np.tile(moved_m, (len(truth), 1)))
    rows = block.measurements
    single = block.points.ids[0]
    keep = (block.points.ids[rows.point] != single) | (rows.image == 0)
    survey[0] = move_ground(truth[:1], np.array([[1.5, -0.5, 0.0]]))[0]  # in plan: one ray tells no height
    block = replace(block, points=replace(block.points, ground=survey)).with_measurements(keep)
    residual, difference = compute_given_residuals(block)
    np.testing.assert_allclose(difference[1:], np.tile(moved_m, (len(truth) - 1, 1)), atol=EXACT_M)
    np.testing.assert_allclose(difference[0], [1.5, -0.5, np.nan], atol=EXACT_M)
    image = block.images[0]
    row = int(np.flatnonzero(block.measurements.image == 0)[3])
    ground = block.points.ground[block.measurements.point[row]]
    np.testing.assert_allclose(residual[row], block.measurements.xy[row] - image.rpc.project(ground[None])[0])
    assert ground_difference_m(truth[:1], truth[:1]).max() == 0.0

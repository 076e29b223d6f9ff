"""Blocks without pixels: everything agrees with the cameras, and the errors are those asked for."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory import simulation as lab

SIZE = (1500, 1500)
NO_NOISE = lab.Noise(image_px=0.0, gcp_xy_m=0.0, gcp_h_m=0.0, vendor=0.0)
JITTER = lab.OrientationError(vibration=lab.Vibration(((400.0, 1e-6, 0.0),)))


def block(
    sensor: str = "pleiades", images: int = 3, spec: lab.SceneSpec | None = None, **noise: float
) -> lab.BlockSimulation:
    views = lab.make_along_track_views(lab.SENSORS[sensor], images, SIZE)
    return lab.simulate_block(spec or lab.SceneSpec(), views, lab.PointCounts(40, 160, 400), lab.Noise(**noise))


@pytest.mark.parametrize("sensor", lab.SENSORS)
def test_rpcs_fit_their_cameras_and_the_block_is_consistent(sensor: str):
    simulated = lab.simulate_block(
        lab.SceneSpec(), lab.make_along_track_views(lab.SENSORS[sensor], 2, SIZE), lab.PointCounts(5, 20, 100), NO_NOISE
    )
    truth, measured = simulated.truth, simulated.block.measurements
    stated = max(fit.max_px for fit in truth.vendor_rpcs)
    np.testing.assert_array_equal(simulated.block.points.ids, truth.ids)
    np.testing.assert_array_equal(measured.point, truth.image_points.point)
    for index, image in enumerate(simulated.block.images):
        seen = measured.image == index
        projected = image.rpc.project(truth.ground[measured.point[seen]])
        assert np.abs(projected - measured.xy[seen]).max() <= 1.5 * stated + 1e-8
    assert stated < 1e-6


def test_noise_is_as_asked():
    simulated = block(image_px=0.4, gcp_xy_m=0.5, gcp_h_m=0.8)
    truth, known = simulated.truth, simulated.block.known
    image = simulated.block.measurements.xy - truth.image_points.xy
    ground = ground_difference_m(simulated.block.points.ground[known], truth.ground[known])
    # Standard errors: 0.4 / sqrt(2 * 3600) = 0.005 px; 0.5 / sqrt(2 * 200) = 0.025 m.
    assert image.std() == pytest.approx(0.4, abs=0.02)
    np.testing.assert_allclose(ground.std(axis=0), [0.5, 0.5, 0.8], rtol=0.2)
    assert np.all(simulated.block.measurements.sigma_px == 0.4)


def test_blunders_and_wrong_heights_are_named():
    simulated = block(image_px=0.3, blunders=0.1, wrong_heights=0.25, wrong_height_m=20.0)
    truth = simulated.truth
    away = np.linalg.norm(simulated.block.measurements.xy - truth.image_points.xy, axis=1)
    assert np.all((away > 10.0) == truth.blunder)
    is_tie = truth.role[truth.image_points.point] == Role.TIE
    assert not truth.blunder[~is_tie].any()
    assert truth.blunder[is_tie].mean() == pytest.approx(0.1, abs=0.03)
    assert truth.wrong_height.sum() == 10
    assert np.all(truth.role[truth.wrong_height] == Role.GCP)
    height_error = np.abs(simulated.block.points.ground[:, 2] - truth.ground[:, 2])
    np.testing.assert_array_equal(height_error > 5.0, truth.wrong_height)


@pytest.mark.rendered
def test_the_same_arguments_give_the_same_block():
    first, second, other = block(), block(), block(spec=lab.SceneSpec(seed=2))
    ground = first.truth.ground
    np.testing.assert_array_equal(ground, second.truth.ground)
    # Threads of BLAS add in any order: an orbit's position of 7e6 m has 1e-9 m left; a fit is as good as it says.
    np.testing.assert_allclose(first.block.measurements.xy, second.block.measurements.xy, rtol=0.0, atol=1e-7)
    one, two = (simulated.block.images[0].rpc.project(ground) for simulated in (first, second))
    np.testing.assert_allclose(one, two, rtol=0.0, atol=1e-6)
    assert first.block.images[0].rpc != other.block.images[0].rpc


def test_vendor_error_moves_the_delivered_rpc_only():
    error = lab.OrientationError(attitude_rad=(10e-6, 0.0, 0.0))
    views = [replace(view, vendor_error=error) for view in lab.make_along_track_views(lab.SENSORS["ikonos"], 2, SIZE)]
    simulated = lab.simulate_block(lab.SceneSpec(), views, lab.PointCounts(5, 20, 50), NO_NOISE)
    truth, points = simulated.truth, simulated.truth.image_points
    first = points.image == 0
    ground, xy = truth.ground[points.point[first]], points.xy[first]
    moved = simulated.block.images[0].rpc.project(ground) - xy
    expected = 10e-6 / lab.SENSORS["ikonos"].detector_angle_rad
    np.testing.assert_allclose(np.abs(moved[:, 0]), expected, rtol=0.01)
    assert np.abs(truth.rpcs[0].rpc.project(ground) - xy).max() < 1e-6


def test_jitter_is_in_the_truth_and_not_in_the_rpc():
    views = [replace(view, jitter=JITTER) for view in lab.make_along_track_views(lab.SENSORS["pleiades"], 2, SIZE)]
    simulated = lab.simulate_block(lab.SceneSpec(), views, lab.PointCounts(5, 20, 300), NO_NOISE)
    assert simulated.truth.vendor_rpcs[0].max_px < 1e-6
    points, truth = simulated.truth.image_points, simulated.truth
    first = points.image == 0
    moved = simulated.block.images[0].rpc.project(truth.ground[points.point[first]]) - points.xy[first]
    amplitude = 1e-6 / lab.SENSORS["pleiades"].detector_angle_rad
    np.testing.assert_allclose(np.abs(moved).max(axis=0), amplitude, rtol=0.05)


def test_points_are_on_the_surface_and_gcps_spread():
    simulated = block()
    truth = simulated.truth
    assert np.abs(truth.ground[:, 2] - simulated.scene.terrain.height_at(truth.ground)).max() < 1e-6
    assert np.all(simulated.block.rays_per_point() >= 2)
    gcps = simulated.scene.chart.from_ground(truth.ground[truth.role == Role.GCP])
    assert np.ptp(gcps, axis=0).min() > 0.8 * SIZE[0] * 0.7


@pytest.mark.large
def test_strips_make_a_connected_block():
    views = lab.make_strip_views(lab.SENSORS["pleiades"], 2, 3, 2, SIZE)
    simulated = lab.simulate_block(lab.SceneSpec(), views, lab.PointCounts(6, 10, 600))
    rays = simulated.block.rays_per_point()
    assert len(simulated.block.images) == 12
    assert rays.max() >= 8  # where four places overlap
    assert len(np.unique(simulated.block.measurements.image)) == 12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda: lab.SceneSpec(lat_deg=95.0), "is not a place"),
        (lambda: lab.SceneSpec(relief_m=-1.0), "must not be negative"),
        (lambda: lab.Noise(image_px=-0.1), "image_px"),
        (lambda: lab.Noise(blunders=1.5), "blunders"),
        (lambda: lab.simulate_block(lab.SceneSpec(), []), "at least one view"),
        (lambda: block().index("nothing"), "no image 'nothing'"),
    ],
)
def test_bad_input_says_what_to_do(change, words: str):
    with pytest.raises(InputError, match=words):
        change()


def test_views_that_share_nothing_are_refused():
    one, two = lab.make_along_track_views(lab.SENSORS["ikonos"], 2, SIZE)
    with pytest.raises(InputError, match="see in common"):
        lab.simulate_block(lab.SceneSpec(), [one, replace(two, offset_m=(9000.0, 0.0))])

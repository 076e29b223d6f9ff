"""The physical camera: closes on itself, agrees with PROJ's geocentric axes, and obeys its errors."""

from dataclasses import replace

import numpy as np
import pyproj
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.ground.geodesy import from_ecef, ground_difference_m
from hrsi.hrsi_engine.laboratory.simulation import SENSORS, OrientationError, PushbroomCamera, Vibration, aim_camera

TARGET = np.array([147.3, -42.9, 100.0])
TO_ECEF = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
#: The refinement studies' disturbance: 0.1 rad and kilometres, with drifts and jitter.
LARGE = OrientationError(
    position_m=(3000.0, -2000.0, 1500.0), position_drift_m=(5.0, 5.0, -5.0), attitude_rad=(0.1, -0.1, 0.1),
    attitude_drift_rad=(2e-4, 2e-4, -2e-4), vibration=Vibration(((700.0, 1e-6, 0.0),)),
)  # fmt: skip
CASES = {
    "nadir": dict(),
    "oblique": dict(along_deg=20.0, across_deg=-25.0, heading_deg=12.0),
    "scan back": dict(along_deg=-10.0, scan_deg=10.0),
    "scan across": dict(across_deg=15.0, scan_deg=95.0),
}


def full_camera(name: str, **view: float) -> PushbroomCamera:
    sensor = SENSORS[name]
    return aim_camera(sensor, (sensor.samples, sensor.samples), TARGET, **view)


def image_points(camera: PushbroomCamera, count: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Return image points in and around an image, and heights."""
    rng = np.random.default_rng(3)
    return rng.uniform(-0.1, 1.1, (count, 2)) * camera.size, rng.uniform(-100.0, 3000.0, count)


@pytest.mark.parametrize("name", mark_beyond(4, "thorough", SENSORS))
@pytest.mark.parametrize("error", [OrientationError(), LARGE], ids=["exact", "disturbed"])
@pytest.mark.parametrize("case", CASES)
def test_directions_close_on_each_other(name: str, error: OrientationError, case: str):
    camera = full_camera(name, **CASES[case]).disturb(error)
    image, heights = image_points(camera)
    ground = camera.image_to_ground(image, heights)
    closure = np.abs(camera.ground_to_image(ground) - image).max()
    assert closure < 1e-7  # a thousandth of what any measurement could notice
    assert np.abs(ground[:, 2] - heights).max() < 1e-8


@pytest.mark.parametrize("case", CASES)
def test_ground_lies_on_the_ray_in_geocentric_axes_of_proj(case: str):
    camera = full_camera("worldview-2", **CASES[case])
    image, heights = image_points(camera)
    origin, direction = camera.rays(image)
    xyz = np.column_stack(TO_ECEF.transform(*camera.image_to_ground(image, heights).T))
    off_ray = np.linalg.norm(np.cross(xyz - origin, direction), axis=1).max()
    assert off_ray < 1e-7


@pytest.mark.parametrize("name", SENSORS)
def test_nominal_resolution_and_orbit(name: str):
    camera, sensor = full_camera(name), SENSORS[name]
    np.testing.assert_allclose(camera.gsd_m(), sensor.gsd_m, rtol=3e-4)  # the ground at 100 m is a little closer
    position, _ = camera.exterior(np.array([camera.middle[1]]))
    height = pyproj.Transformer.from_crs(4978, 4979, always_xy=True).transform(*position[0])[2]
    assert height == pytest.approx(sensor.altitude_m, abs=0.01)  # PROJ's own inverse is millimetres off up there


def test_off_nadir_angles_are_those_at_the_satellite():
    camera = full_camera("pleiades", along_deg=20.0, across_deg=-15.0, heading_deg=190.0)
    position, axes = camera.exterior(np.array([camera.middle[1]]))
    lon, lat, height = pyproj.Transformer.from_crs(4978, 4979, always_xy=True).transform(*position[0])
    # the flight's azimuth is that at the scene, carried up to the satellite
    target = from_ecef(camera.centre[None])[0]
    there = pyproj.Geod(ellps="WGS84").fwd(*target[:2], 190.0, 1000.0)[:2]
    heading = np.array(TO_ECEF.transform(*there, target[2])) - camera.centre
    up = position[0] - np.array(TO_ECEF.transform(lon, lat, height - 1000.0))
    right = np.cross(heading, up)
    ahead = np.cross(up, right)
    look = axes[0, :, 2]
    along, across, down = (look @ axis / np.linalg.norm(axis) for axis in (ahead, right, -up))
    seen = np.degrees(np.arctan2([along, across], down))
    np.testing.assert_allclose(seen, [20.0, -15.0], atol=0.005)  # a chord of 1 km dips by 1e-4 rad


def test_lines_run_in_the_scan_direction_and_images_are_not_mirrored():
    camera = full_camera("ikonos", scan_deg=180.0)
    sample, line = camera.middle
    image = np.array([[sample, line], [sample + 100, line], [sample, line + 100]])
    centre, right, below = camera.image_to_ground(image, 0.0)
    east, south = ground_difference_m(np.array([right, below]), np.array([centre, centre]))
    assert east[0] > 80.0
    assert abs(east[1]) < 1.0
    assert south[1] < -80.0
    assert abs(south[0]) < 1.0


def test_position_error_moves_the_ground_by_itself():
    camera = full_camera("spot5", across_deg=10.0, heading_deg=12.0)
    moved = camera.disturb(OrientationError(position_m=(30.0, -20.0, 0.0)))
    image = np.array([camera.middle])
    step = ground_difference_m(moved.image_to_ground(image, 100.0), camera.image_to_ground(image, 100.0))[0]
    np.testing.assert_allclose(step[:2], [30.0, -20.0], rtol=0.01)  # the Earth curves away under the ray


def test_drift_is_complete_over_the_image_and_zero_in_its_middle():
    camera = full_camera("spot5")
    drifting = camera.disturb(OrientationError(attitude_drift_rad=(1e-4, 0.0, 0.0)))
    sample, line = camera.middle
    image = np.array([[sample, line], [sample, line - 12000.0], [sample, line + 12000.0]])
    moved = drifting.ground_to_image(camera.image_to_ground(image, 100.0)) - image
    half = 5e-5 / SENSORS["spot5"].detector_angle_rad
    np.testing.assert_allclose(np.abs(moved[:, 0]), [0.0, half, half], atol=0.05)
    assert moved[1, 0] * moved[2, 0] < 0.0


def test_coarser_pixels_cover_the_same_ground():
    camera = replace(full_camera("pleiades", along_deg=15.0).disturb(LARGE), size=(29999, 29998))
    coarse = camera.coarsen(4)
    assert coarse.size == (7499, 7499)
    image = np.random.default_rng(4).uniform(0.0, 7000.0, (500, 2))
    same = camera.ground_to_image(coarse.image_to_ground(image, 50.0))
    np.testing.assert_allclose(same, 4.0 * image + 1.5, atol=1e-5)  # tangents of the pixel angle: no distortion


def test_points_behind_the_earth_are_nan():
    camera = full_camera("pleiades").disturb(OrientationError(attitude_rad=(1.4, 0.0, 0.0)))
    assert np.isnan(camera.image_to_ground(np.array([camera.middle]), 0.0)).all()


def test_curve_displaces_the_image_by_its_pixels():
    """Roll moves a point in sample, pitch in line; beyond its ends a curve is mirrored."""
    sensor = SENSORS["pleiades"]
    camera = aim_camera(sensor, (2000, 3000), np.array([10.0, 45.0, 100.0]))
    line = np.arange(-2000.0, 2001.0, 5.0)
    across, along = 0.8 * np.sin(line / 90.0), 0.4 * np.cos(line / 300.0)
    curve = tuple(zip(line, -across * sensor.detector_angle_rad, -along * sensor.detector_angle_rad, strict=True))
    shaken = camera.disturb(OrientationError(vibration=Vibration(curve=curve)))
    image = np.column_stack([np.linspace(100.0, 1900.0, 50), np.linspace(50.0, 2950.0, 50)])
    moved = image - camera.ground_to_image(shaken.image_to_ground(image, 100.0))
    step = image[:, 1] - camera.middle[1]
    expected = np.column_stack([0.8 * np.sin(step / 90.0), 0.4 * np.cos(step / 300.0)])
    assert moved == pytest.approx(expected, abs=2e-3)
    later = Vibration(curve=curve, start_line=3500.0)  # 1500 lines beyond the end: line 500 again
    assert later.compute_angles(np.array([0.0])) == pytest.approx(
        Vibration(curve=curve).compute_angles(np.array([500.0]))
    )


def test_larger_pixels_shake_alike():
    vibration = Vibration(waves=((500.0, 1e-6, 0.3),), start_line=40.0)
    camera = aim_camera(SENSORS["pleiades"], (2000, 3000), np.array([10.0, 45.0, 100.0]))
    coarse = camera.disturb(OrientationError(vibration=vibration)).coarsen(4).error.vibration
    assert coarse.compute_angles(np.array([25.0, -60.0])) == pytest.approx(
        vibration.compute_angles(np.array([100.0, -240.0]))
    )
    assert coarse.curvature_rad == pytest.approx(16.0 * 1e-6 * (2.0 * np.pi / 500.0) ** 2)

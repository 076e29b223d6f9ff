"""Geodesy against PROJ, and height datums against the published EGM96 grid."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground import crs_operations, geodesy, geoids, map_crs

METRE_TOLERANCE = 1e-6  # a micrometre; ECEF coordinates have a rounding step of 1e-9 m

lons = st.floats(-180, 180)
lats = st.floats(-89.999, 89.999)
heights_m = st.floats(-500, 9000)


def random_ground(count: int = 500) -> np.ndarray:
    return np.random.default_rng(31).uniform((-180, -89.9, -500), (180, 89.9, 9000), (count, 3))


def test_ecef_agrees_with_proj() -> None:
    ground = random_ground()
    proj = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    expected = np.column_stack(proj.transform(*ground.T))
    np.testing.assert_allclose(geodesy.to_ecef(ground), expected, atol=METRE_TOLERANCE, rtol=0)
    difference = np.abs(geodesy.from_ecef(expected) - ground).max(axis=0)
    assert (difference < [1e-9, 1e-11, METRE_TOLERANCE]).all()  # longitudes crowd at 89.9 degrees


@given(lon=lons, lat=lats, height=heights_m)
def test_ecef_returns(lon: float, lat: float, height: float) -> None:
    xyz = geodesy.to_ecef(np.array([[lon, lat, height]]))
    back = geodesy.to_ecef(geodesy.from_ecef(xyz))
    np.testing.assert_allclose(back, xyz, atol=1e-8, rtol=0)


def test_local_frame_agrees_with_projs_topocentric() -> None:
    frame = geodesy.LocalFrame(147.3, -42.9, 120.0)
    ground = np.random.default_rng(32).uniform((146.8, -43.3, -100), (147.8, -42.5, 2000), (50, 3))
    xyz = geodesy.to_ecef(ground)
    proj = pyproj.Transformer.from_pipeline("+proj=topocentric +ellps=WGS84 +lon_0=147.3 +lat_0=-42.9 +h_0=120")
    expected = np.column_stack(proj.transform(*xyz.T))
    local = frame.from_ground(ground)
    np.testing.assert_allclose(local, expected, atol=METRE_TOLERANCE, rtol=0)
    np.testing.assert_allclose(frame.from_ground(frame.to_ground(local)), local, atol=METRE_TOLERANCE, rtol=0)


def test_metres_per_degree_are_those_of_small_steps_at_any_height() -> None:
    ground = random_ground(50)
    ground[:, 1] *= 0.8
    factors = geodesy.metres_per_degree(ground)
    proj = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    step = 1e-4
    for axis in (0, 1):
        moved = ground.copy()
        moved[:, axis] += step
        here, there = (np.column_stack(proj.transform(*points.T)) for points in (ground, moved))
        np.testing.assert_allclose(factors[:, axis] * step, np.linalg.norm(there - here, axis=1), rtol=1e-5)


@given(lon=st.floats(-1000, 1000))
def test_wrapped_degrees_lie_in_one_turn(lon: float) -> None:
    wrapped = float(geodesy.wrap_degrees(np.array(lon)))
    assert -180.0 <= wrapped < 180.0
    assert np.cos(np.radians(wrapped)) == pytest.approx(np.cos(np.radians(lon)), abs=1e-9)


def test_differences_across_the_180_degree_meridian_are_short() -> None:
    east, west = np.array([[-179.999, 0.0, 5.0]]), np.array([[179.999, 0.0, 0.0]])
    np.testing.assert_allclose(geodesy.ground_difference_m(east, west), [[222.64, 0.0, 5.0]], atol=0.01)


@pytest.mark.parametrize(
    ("lon", "lat", "epsg"),
    [
        (147.3, -42.9, 32755), (-180.0, 1.0, 32601), (180.0, 1.0, 32601), (540.0, 1.0, 32601), (3.0, 45.0, 32631),
        # DMA TM 8358.2: 32V reaches west to 3 E between 56 and 64 N
        (2.99, 60.0, 32631), (3.0, 60.0, 32632), (5.3, 60.4, 32632), (5.3, 55.99, 32631), (5.3, 64.0, 32631),
        # Svalbard between 72 and 84 N
        (8.99, 78.0, 32631), (9.0, 78.0, 32633), (20.99, 78.0, 32633), (21.0, 78.0, 32635), (33.0, 78.0, 32637),
        (41.99, 78.0, 32637), (42.0, 78.0, 32638), (9.0, 71.99, 32632), (-0.01, 78.0, 32630),
        # beyond the grid: UPS, easting first
        (15.0, 83.99, 32633), (15.0, 84.0, 5041), (-120.0, 88.0, 5041), (15.0, -80.0, 32733), (15.0, -80.01, 5042),
    ],
)  # fmt: skip
def test_the_map_of_a_place_is_its_utm_zone_or_ups(lon: float, lat: float, epsg: int) -> None:
    assert map_crs.map_epsg(lon, lat) == epsg


@pytest.mark.parametrize(("lat", "epsg"), [(88.0, 5041), (-88.0, 5042)])
def test_ups_has_its_easting_first_and_grows_along_the_meridians_as_dma_says(lat: float, epsg: int) -> None:
    """On the meridian of 90 E the pole's false easting grows by the distance from the pole; true scale is 0.994."""
    both = np.array([[90.0, lat, 0.0], [90.0, lat * 1.0001, 0.0]])
    (easting, northing), (near, _) = map_crs.project_to_map(both, epsg)
    assert northing == pytest.approx(2e6, abs=1e-3)
    along = geodesy.ground_difference_m(np.array([[90.0, lat, 0.0]]), np.array([[90.0, lat * 1.0001, 0.0]]))[0, 1]
    assert easting > 2e6
    assert (easting - near) / abs(along) == pytest.approx(0.9943, abs=3e-4)


def test_the_middle_of_a_place_on_both_sides_of_180_lies_there() -> None:
    ground = np.array([[179.9, 1.0, 5.0], [-179.9, 2.0, 6.0], [-179.8, 3.0, 7.0], [np.nan, np.nan, np.nan]])
    assert map_crs.middle_position(ground) == pytest.approx((180.1, 2.0, 6.0))
    assert map_crs.map_epsg_of(ground) == 32601


@given(middle=st.floats(-180, 180), offsets=st.lists(st.floats(-40, 40), min_size=1), turns=st.sampled_from([-1, 0, 1]))
def test_longitudes_of_one_place_stay_together(middle: float, offsets: list[float], turns: int) -> None:
    lon = geodesy.wrap_degrees(middle + np.array(offsets)) + 360.0 * turns
    joined = geodesy.continuous_longitudes(np.append(lon, np.nan))[:-1]
    assert np.ptp(joined) == pytest.approx(np.ptp(offsets), abs=1e-9)
    np.testing.assert_allclose(geodesy.wrap_degrees(joined - lon + 90.0), 90.0, atol=1e-9)
    ends = np.array([lon.min(), lon.max(), np.nan])
    assert not geodesy.are_continuous(ends) or np.array_equal(joined, lon)  # what the ends say holds for all


def test_places_on_different_continents_are_not_brought_together() -> None:
    lon = np.array([140.0, -100.0])
    np.testing.assert_array_equal(geodesy.continuous_longitudes(lon), lon)


# ---- height datums ---------------------------------------------------------------------------------------------


def test_egm96_from_a_grid_file(real_data: Path) -> None:
    grid = real_data / "ventoux_phr_pair" / "dem" / "egm96_15.gtx"
    ground = np.array([[5.25, 44.25, 0.0], [179.9, 10.0, 0.0], [-179.9, 10.0, 0.0], [5.25 + 1e-9, 44.25, 0.0]])
    undulation = geoids.geoid_heights(ground, str(grid))
    # the file itself: header of 40 bytes (lat0, lon0, dlat, dlon as doubles, rows, columns as int), big-endian floats
    lat0, lon0, dlat, dlon = np.frombuffer(grid.read_bytes()[:32], ">f8")
    rows, columns = np.frombuffer(grid.read_bytes()[32:40], ">i4")
    cells = np.frombuffer(grid.read_bytes()[40:], ">f4").reshape(rows, columns)
    expected = cells[round((44.25 - lat0) / dlat), round((5.25 - lon0) / dlon)]
    assert undulation[0] == pytest.approx(expected, abs=1e-3)
    assert abs(undulation[1] - undulation[2]) < 1.0
    assert undulation[3] == pytest.approx(undulation[0], abs=1e-5)


def test_a_height_above_the_geoid_becomes_ellipsoidal(real_data: Path) -> None:
    grid = str(real_data / "ventoux_phr_pair" / "dem" / "egm96_15.gtx")
    ground = np.array([[5.2, 44.2, 476.0]])
    try:
        by_crs = crs_operations.operations_of("EPSG:4326+5773").to_wgs84(ground)
    except InputError:
        pytest.skip("PROJ has no EGM96 grid here")
    assert by_crs[0, 2] == pytest.approx(476.0 + geoids.geoid_heights(ground, grid)[0], abs=1e-3)
    offsets = crs_operations.operations_of("EPSG:4326+5773").height_offsets(ground[:, :2])
    assert offsets[0] == pytest.approx(by_crs[0, 2] - 476.0, abs=1e-6)


@pytest.mark.parametrize("datum", ["no_such_grid.gtx", "egm99", __file__])
def test_a_missing_grid_says_what_to_do(datum: str) -> None:
    with pytest.raises(InputError, match=r"check its name|projsync"):
        geoids.geoid_heights(np.zeros((1, 3)), datum)


def test_heights_are_never_left_as_they_are_for_want_of_a_grid() -> None:
    """DHHN92 needs a grid that is on no machine without proj-data; PROJ itself would keep the number."""
    point = np.array([[600000.0, 5300000.0, 100.0]])
    try:
        operations = crs_operations.operations_of("EPSG:25832+5783")
    except InputError as error:
        message = str(error)
        assert "DHHN92" in message
        assert "projsync" in message
        return
    ground, number = operations.convert(point)
    assert ground[0, 2] == pytest.approx(146.0, abs=5.0)  # the quasigeoid is 44 to 50 m in the south of Germany
    (use,) = operations.uses("gcps.csv", ground, number)
    assert not use.is_substituted or use.operation.sigma_m[1] == 1.0  # a model that stands in is told, with its error


def test_unknown_crs_is_named() -> None:
    with pytest.raises(InputError, match="EPSG:999999"):
        crs_operations.operations_of("EPSG:999999").to_wgs84(np.zeros((1, 3)))


def test_ellipsoidal_heights_stay() -> None:
    point = np.array([[5.0, 44.0, 321.0]])
    np.testing.assert_allclose(crs_operations.operations_of("EPSG:4979").to_wgs84(point), point)
    np.testing.assert_allclose(crs_operations.operations_of("EPSG:4326").height_offsets(point[:, :2]), [0.0])
    assert crs_operations.operations_of("EPSG:4979").has_heights
    assert not crs_operations.operations_of("EPSG:32631").has_heights


@pytest.mark.parametrize(("away_m", "found"), [(0.0, True), (20e3, True), (400e3, False)])
def test_coordinates_of_a_scene_and_its_surroundings_have_its_crs(away_m: float, found: bool) -> None:
    """A survey reaches beyond its scene, by less than a strip is wide; 400 km on lies another zone."""
    place = np.array([9.0, 48.0])
    xy = map_crs.project_to_map(np.array([[*place, 0.0]]), 32632)[0] + [away_m, 0.0]
    assert ("EPSG:32632" in map_crs.list_local_crs(place, xy)) == found
    assert (map_crs.list_local_crs(place, place + [0.0, away_m / 111e3]) == ["EPSG:4326"]) == found

"""Surfaces of rasters, lidar clouds and points: the same ground, whatever the file."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
from gdal_files import write_raster

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.surfaces import open_surface
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import point_session
from hrsi.processing_algorithms.files.opening import dem_surface
from hrsi.processing_algorithms.interface.option_groups import DemOptions

EAST, NORTH, SIDE_M = 500_000.0, 4_800_000.0, 300.0
TO_WGS84 = pyproj.Transformer.from_crs("EPSG:32631", "EPSG:4326", always_xy=True)
RNG = np.random.default_rng(4)


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the true ground: waves of 10 m, 250 m long."""
    return 200.0 + 10.0 * np.sin((x - EAST) / 40.0) * np.cos((y - NORTH) / 40.0)


def draw(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return easting, northing and true height of random points."""
    x, y = EAST + RNG.uniform(0.0, SIDE_M, count), NORTH + RNG.uniform(0.0, SIDE_M, count)
    return x, y, height(x, y)


def require_ground(surface, tolerance_m: float) -> None:
    """Check heights at places inside."""
    x, y, z = draw(500)
    inside = (np.abs(x - EAST - SIDE_M / 2) < 130.0) & (np.abs(y - NORTH - SIDE_M / 2) < 130.0)
    miss = surface_heights(surface, np.column_stack(TO_WGS84.transform(x, y)))[inside] - z[inside]
    assert np.isfinite(miss).mean() > 0.99
    assert np.nanpercentile(np.abs(miss), 95.0) < tolerance_m


def write_cloud(path: Path, crs: str | None, feet: bool = False) -> None:
    """Write a cloud: ground, trees as second class, noise 300 m up, and first and last returns."""
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    x, y, z = draw(60_000)
    kind, number = np.full(len(x), 2, dtype=np.uint8), np.ones(len(x), dtype=np.uint8)
    z[:300] += 300.0
    kind[:300] = 7  # noise
    z[300:20_000] -= 4.0
    number[300:20_000] = 2  # last returns below a canopy are not the surface
    kind[300:20_000] = 5
    header = laspy.LasHeader(point_format=6, version="1.4")
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    header.scales, header.offsets = [0.001] * 3, [EAST, NORTH, 0.0]
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z, cloud.classification, cloud.return_number = x, y, z, kind, number
    cloud.number_of_returns = np.full(len(x), 2, dtype=np.uint8)
    cloud.write(str(path))


@pytest.mark.parametrize("name", ["cloud.las", "cloud.laz"])
@pytest.mark.parametrize("kind", ["dsm", "dtm"])
def test_a_lidar_cloud(tmp_path: Path, name: str, kind: str) -> None:
    write_cloud(tmp_path / name, "EPSG:32631")
    # cells of 2.4 m, slopes up to 0.25: the mean of a cell is within 0.3 m, four points at random places in it
    require_ground(open_surface(str(tmp_path / name), "ellipsoidal", kind=kind), 0.5)
    if kind == "dtm":  # also where an algorithm takes a DEM
        dem = dem_surface(DemOptions(dem=str(tmp_path / name)), "ellipsoidal")
        assert dem is not None
        require_ground(dem, 0.5)
        lonlat = TO_WGS84.transform(EAST + 150.0, NORTH + 150.0)  # where the panel looks up a height
        found = point_session.dem_height(str(tmp_path / name), "ellipsoidal", lonlat)
        assert found == pytest.approx(height(EAST + 150.0, NORTH + 150.0), abs=0.5)


def test_heights_above_a_geoid(tmp_path: Path) -> None:
    write_cloud(tmp_path / "cloud.laz", "EPSG:32631+5773")
    x, y, z = EAST + 150.0, NORTH + 150.0, height(np.array([EAST + 150.0]), np.array([NORTH + 150.0]))[0]
    lon, lat = TO_WGS84.transform(x, y)
    expected = pyproj.Transformer.from_crs("EPSG:4326+5773", "EPSG:4979", always_xy=True).transform(lon, lat, z)[2]
    if abs(expected - z) < 1.0:
        pytest.skip("no EGM96 grid here")
    found = surface_heights(open_surface(str(tmp_path / "cloud.laz")), np.array([[lon, lat]]))[0]
    assert found == pytest.approx(expected, abs=0.5)


def test_a_cloud_must_say_where_it_is(tmp_path: Path) -> None:
    write_cloud(tmp_path / "cloud.laz", None)
    with pytest.raises(InputError, match="`ground_crs`"):
        open_surface(str(tmp_path / "cloud.laz"), "ellipsoidal")
    require_ground(open_surface(str(tmp_path / "cloud.laz"), "ellipsoidal", "EPSG:32631"), 0.5)


@pytest.mark.parametrize("cut", [100, 400, 5000])
def test_a_damaged_cloud_is_refused(tmp_path: Path, cut: int) -> None:
    write_cloud(tmp_path / "cloud.laz", "EPSG:32631")
    damaged = tmp_path / "damaged.laz"
    damaged.write_bytes((tmp_path / "cloud.laz").read_bytes()[:cut])
    with pytest.raises(InputError, match="damaged"):
        open_surface(str(damaged), "ellipsoidal")


def test_points_of_a_table(tmp_path: Path) -> None:
    x, y, z = draw(20_000)
    lon, lat = TO_WGS84.transform(x, y)
    rows = np.column_stack([lon, lat, z])
    np.savetxt(tmp_path / "points.csv", rows, "%.9f", ",", header="lon,lat,height", comments="")
    require_ground(open_surface(str(tmp_path / "points.csv"), "ellipsoidal"), 1.0)


def test_a_raster(tmp_path: Path) -> None:
    column, row = np.meshgrid(np.arange(150), np.arange(150))
    heights = height(EAST + 2.0 * column + 1.0, NORTH + SIDE_M - 2.0 * row - 1.0)
    dem = write_raster(tmp_path / "dem.tif", heights, (EAST, 2.0, 0.0, NORTH + SIDE_M, 0.0, -2.0), "EPSG:32631")
    require_ground(open_surface(dem, "ellipsoidal"), 0.1)


def test_what_is_no_surface_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.xyz").write_text("nothing")
    for name in ("notes.xyz", "missing.tif"):
        with pytest.raises(InputError, match=name):
            open_surface(str(tmp_path / name), "ellipsoidal")

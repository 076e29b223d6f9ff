"""DEM files as height surfaces: CRS, height datum, nodata, units; intersection against GDAL's own RPC_DEM."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyproj
import pytest
from gdal_files import write_raster
from osgeo import gdal, osr

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geoids import find_substitute
from hrsi.hrsi_engine.io.rasters.dems import RasterKind, find_raster_kind, open_dem
from hrsi.hrsi_engine.io.rasters.ortho_rasters import open_reference
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.hrsi_engine.surface.dem import Status, intersect_surface, surface_heights


def test_srtm_heights_above_egm96_become_ellipsoidal(real_data: Path) -> None:
    folder = real_data / "ventoux_phr_pair" / "dem"
    surface = open_dem(str(folder / "N44E005.hgt"), str(folder / "egm96_15.gtx"))
    rpc = read_rpc(str(folder.parent / "left_image.tif")).rpc
    ground, status = intersect_surface(rpc, np.array([[250.0, 250.0]]), surface)
    assert status[0] == Status.FOUND
    # data/real/README.md: SRTM about 476 m here, geoid about 51 m, tie points' median height 537 m
    assert ground[0, 2] == pytest.approx(527.0, abs=30.0)
    raw = gdal.Open(str(folder / "N44E005.hgt"))
    inverse = gdal.InvGeoTransform(raw.GetGeoTransform())
    column, row = gdal.ApplyGeoTransform(inverse, *ground[0, :2])
    near = raw.ReadAsArray(int(column) - 1, int(row) - 1, 3, 3)
    assert near.min() + 50.0 < ground[0, 2] < near.max() + 52.0


def test_intersection_agrees_with_gdal_on_smooth_terrain(real_data: Path, tmp_path: Path) -> None:
    """GDAL's RPC_DEM (bilinear, ellipsoidal heights given) on hills without occlusion."""
    path = str(real_data / "s2p_triplet_phr" / "img_03.tif")
    rpc = read_rpc(path).rpc
    lon, lat, _ = rpc.localize(np.array([[500.0, 500.0]]), 200.0).ground[0]
    cell, count = 0.0001, 300
    x, y = np.meshgrid(np.arange(count), np.arange(count))
    heights = 200.0 + 40.0 * np.sin(x / 20.0) * np.cos(y / 25.0)
    geotransform = (lon - cell * count / 2, cell, 0, lat + cell * count / 2, 0, -cell)
    dem = write_raster(tmp_path / "dem.tif", heights.astype(np.float32), geotransform, "EPSG:4326")
    image = np.random.default_rng(13).uniform(100, 900, (300, 2))
    ground, status = intersect_surface(rpc, image, open_dem(dem, "ellipsoidal"))
    assert (status == Status.FOUND).all()

    options = [
        "METHOD=RPC", f"RPC_DEM={dem}", "RPC_DEMINTERPOLATION=bilinear", "RPC_PIXEL_ERROR_THRESHOLD=1e-6",
        "RPC_MAX_ITERATIONS=200", "RPC_DEM_APPLY_VDATUM_SHIFT=FALSE",
    ]  # fmt: skip
    transformer = gdal.Transformer(gdal.Open(path), None, options)
    points, good = transformer.TransformPoints(False, np.column_stack([image + 0.5, np.zeros(len(image))]).tolist())
    by_gdal = np.array(points)[np.array(good) == 1]
    assert len(by_gdal) == len(image)
    # GDAL iterates to its pixel threshold on a surface stored as float32
    np.testing.assert_allclose(ground[:, :2], by_gdal[:, :2], rtol=0, atol=2e-8)


def test_the_crs_of_the_file_says_what_heights_are(tmp_path: Path) -> None:
    heights = np.full((20, 20), 100.0)
    geotransform = (600000.0, 30.0, 0.0, 4900600.0, 0.0, -30.0)
    ellipsoidal = open_dem(write_raster(tmp_path / "e.tif", heights, geotransform, "EPSG:32631"), "ellipsoidal")
    compound = open_dem(write_raster(tmp_path / "c.tif", heights, geotransform, "EPSG:32631+5773"))
    named = open_dem(write_raster(tmp_path / "n.tif", heights, geotransform, "EPSG:32631"), "egm96")
    lonlat = np.array([[4.2550, 44.2506]])
    assert ellipsoidal.covers(ellipsoidal.grid_coordinates(lonlat))[0]
    assert surface_heights(ellipsoidal, lonlat)[0] == pytest.approx(100.0)
    assert surface_heights(named, lonlat)[0] == pytest.approx(151.5, abs=1.0)  # EGM96 here: 51 to 52 m
    assert surface_heights(compound, lonlat)[0] == pytest.approx(surface_heights(named, lonlat)[0], abs=1e-3)


def test_pixels_of_a_reference_are_where_gdal_places_them(tmp_path: Path) -> None:
    """A turned orthoimage: centres of pixels by GDAL's geotransform and PROJ; one pixel aside is 30 m."""
    geotransform = (600000.0, 24.0, 18.0, 4900600.0, 18.0, -24.0)
    reference = open_reference(write_raster(tmp_path / "ortho.tif", np.ones((40, 30)), geotransform, "EPSG:32631"))
    pixels = np.array([[0.0, 0.0], [29.0, 0.0], [0.0, 39.0], [12.25, 20.5]])
    to_wgs84 = pyproj.Transformer.from_crs(32631, 4326, always_xy=True)
    lonlat = np.column_stack(to_wgs84.transform(*np.transpose(
        [gdal.ApplyGeoTransform(geotransform, column + 0.5, row + 0.5) for column, row in pixels]
    )))  # fmt: skip
    np.testing.assert_allclose(reference.to_lonlat(pixels), lonlat, rtol=0, atol=1e-10)
    np.testing.assert_allclose(reference.to_pixels(lonlat), pixels, atol=1e-5)
    assert reference.gsd_m == pytest.approx(30.0, rel=1e-3)


def test_a_geoid_is_added_where_the_cell_is(tmp_path: Path) -> None:
    """The grid rises by 1 m in 0.01° to the east, 3 m to the north: a cell of the DEM aside is 0.1 and 0.3 m."""
    lon, lat = 5.0 + 0.01 * np.arange(41), 44.0 + 0.01 * np.arange(41)
    geoid = (100.0 * (lon[None] - 5.0) + 300.0 * (lat[:, None] - 44.0)).astype(">f4")
    (tmp_path / "geoid.gtx").write_bytes(struct.pack(">4d2i", 44.0, 5.0, 0.01, 0.01, 41, 41) + geoid.tobytes())
    dem = write_raster(tmp_path / "dem.tif", np.full((40, 50), 7.0), (5.1, 1e-3, 0.0, 44.3, 0.0, -1e-3), "EPSG:4326")
    surface = open_dem(dem, str(tmp_path / "geoid.gtx"))
    cells = np.array([[0.0, 0.0], [49.0, 0.0], [3.0, 39.0], [20.0, 11.0]])
    centre = [5.1, 44.3] + (cells + 0.5) * [1e-3, -1e-3]
    expected = 7.0 + 100.0 * (centre[:, 0] - 5.0) + 300.0 * (centre[:, 1] - 44.0)
    np.testing.assert_allclose(surface.heights(cells), expected, atol=1e-4)  # float32 in the geoid grid


def test_rotated_grid_feet_and_nodata(tmp_path: Path) -> None:
    heights = np.full((30, 30), 1000.0)
    heights[:15] = -9999.0
    geotransform = (600000.0, 20.0, 20.0, 4900600.0, 20.0, -20.0)  # turned by 45 degrees
    path = write_raster(tmp_path / "r.tif", heights, geotransform, "EPSG:32631", -9999.0)
    dataset = gdal.Open(path, gdal.GA_Update)
    dataset.GetRasterBand(1).SetUnitType("ft")
    del dataset
    surface = open_dem(path, "ellipsoidal")
    reader_position = np.array([[29.0, 20.0], [3.0, 4.0]])
    np.testing.assert_allclose(surface.heights(reader_position), [304.8, np.nan])
    # the cell's centre by GDAL and PROJ
    x, y = gdal.ApplyGeoTransform(geotransform, 29.5, 20.5)
    utm, wgs84 = osr.SpatialReference(), osr.SpatialReference()
    utm.ImportFromEPSG(32631)
    wgs84.ImportFromEPSG(4326)
    lat, lon, _ = osr.CoordinateTransformation(utm, wgs84).TransformPoint(x, y)
    np.testing.assert_allclose(surface.grid_coordinates(np.array([[lon, lat]])), [[29.0, 20.0]], atol=1e-6)


@pytest.mark.parametrize(
    ("crs", "geotransform", "datum", "message"),
    [
        ("", (0.0, 1.0, 0.0, 0.0, 0.0, -1.0), "egm96", "no coordinate reference system"),
        ("EPSG:4326", (5.0, 0.01, 0.0, 45.0, 0.0, -0.01), "layer", "has no height datum"),
        ("EPSG:4326", (), "ellipsoidal", "no geotransform"),
        ("EPSG:4326", (5.0, 0.01, 0.0, 45.0, 0.0, -0.01), "my_geoid.gtx", "my_geoid.gtx"),
    ],
)
def test_what_is_missing_is_named(
    tmp_path: Path, crs: str, geotransform: tuple[float, ...], datum: str, message: str
) -> None:
    path = write_raster(tmp_path / "dem.tif", np.zeros((4, 4)), geotransform, crs)
    with pytest.raises(InputError, match=message):
        surface_heights(open_dem(path, datum), np.array([[5.02, 44.98]]))


@pytest.mark.parametrize(
    ("crs", "geotransform", "datum", "meant"),
    [
        ("EPSG:4326+3855", (5.0, 0.01, 0.0, 45.0, 0.0, -0.01), "layer", "EGM2008 height"),
        ("EPSG:25832+5783", (5e5, 10.0, 0.0, 5e6, 0.0, -10.0), "layer", "DHHN92 height"),
        ("EPSG:4326", (5.0, 0.01, 0.0, 45.0, 0.0, -0.01), "egm2008", "egm2008"),
    ],
)
def test_a_missing_geoid_is_replaced_and_told_or_named(
    tmp_path: Path, crs: str, geotransform: tuple[float, ...], datum: str, meant: str
) -> None:
    path = write_raster(tmp_path / "dem.tif", np.zeros((4, 4)), geotransform, crs)
    if find_substitute(meant) is None:  # no geoid grid at all
        with pytest.raises(InputError, match="projsync"):
            open_dem(path, datum)
        return
    surface = open_dem(path, datum)
    (use,) = surface.operations
    grid = np.array([[2.0, 1.0]])
    place = np.array([[5.025, 44.985]]) if crs.startswith("EPSG:4326") else np.array([[9.000255, 45.1532]])
    if use.is_substituted:
        assert (use.geoid.stands_for, use.operation.sigma_m[1]) == (meant, 1.0)
        expected = use.geoid.heights(place)
    else:
        expected = surface.heights(grid)
    np.testing.assert_allclose(surface.heights(grid), expected, atol=0.01)
    assert 30.0 < expected[0] < 60.0


def test_what_is_no_dem_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing\.tif"):
        open_dem(str(tmp_path / "missing.tif"))


@pytest.mark.parametrize(("values", "kind"), [([0, 1, 255], RasterKind.MASK), (range(256), RasterKind.PICTURE)])
def test_masks_are_told_from_pictures(tmp_path: Path, values: Sequence[int], kind: RasterKind) -> None:
    """Outside, cloud and clear are three values."""
    place = (5e5, 10.0, 0.0, 5e6, 0.0, -10.0)
    path = write_raster(tmp_path / "a.tif", np.resize(values, (64, 64)).astype(np.float32), place, "EPSG:32632")
    gdal.Translate(str(tmp_path / "b.tif"), path, outputType=gdal.GDT_Byte, noData="none")
    facts = find_raster_kind(str(tmp_path / "b.tif"))
    assert facts is not None and facts.kind is kind

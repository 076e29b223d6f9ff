"""The Arrow stream against reading feature by feature, on layers of every kind."""

import numpy as np
import pytest
from osgeo import gdal, ogr, osr

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import ogr_layer, read_points

has_stream = hasattr(ogr.Layer, "GetArrowStreamAsNumPy")
FORMATS = {"gpkg": "GPKG", "geojson": "GeoJSON", "shp": "ESRI Shapefile", "fgb": "FlatGeobuf"}


def make_layer(path, driver, *, with_z=True, gaps=True, count=300):
    """Write a layer with numbers, texts, NULLs, umlauts, numbers as text, and points some of which are missing."""
    rng = np.random.default_rng(3)
    reference = osr.SpatialReference()
    reference.ImportFromEPSG(4326)
    reference.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    source = ogr.GetDriverByName(driver).CreateDataSource(str(path))
    layer = source.CreateLayer("points", reference, ogr.wkbPoint25D if with_z else ogr.wkbPoint)
    for name, kind in (
        ("id", ogr.OFTInteger64), ("image", ogr.OFTString), ("sample", ogr.OFTReal), ("line", ogr.OFTInteger),
        ("height", ogr.OFTReal), ("sigma", ogr.OFTString), ("kind", ogr.OFTString), ("other", ogr.OFTDate),
    ):  # fmt: skip
        layer.CreateField(ogr.FieldDefn(name, kind))
    for number in range(count):
        feature = ogr.Feature(layer.GetLayerDefn())
        feature.SetField("id", number * 10**6)
        feature.SetField("image", "Bild Ä" if number % 2 else " left ")
        feature.SetField("sample", float(rng.uniform(0, 1e4)))
        feature.SetField("line", int(rng.integers(0, 10000)))
        feature.SetField("height", float(number))
        if not gaps or number % 3:
            feature.SetField("sigma", f"{0.1 + number % 7}")
            feature.SetField("kind", "corner")
        geometry = ogr.Geometry(ogr.wkbPoint25D if with_z else ogr.wkbPoint)
        east, north = rng.uniform(0, 10, 2)
        if with_z:
            geometry.SetPoint(0, east, north, number)
        else:
            geometry.SetPoint_2D(0, east, north)
        if not gaps or number % 5:
            feature.SetGeometry(geometry)
        layer.CreateFeature(feature)
    del layer, source
    return str(path)


def both_ways(path, monkeypatch):
    quick = ogr_layer.read(path)
    monkeypatch.setattr(ogr_layer, "_read_columns", lambda *_: None)
    return quick, ogr_layer.read(path)


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("with_z", [True, False])
@pytest.mark.parametrize("gaps", [True, False])
def test_equals_reading_features(tmp_path, monkeypatch, suffix, with_z, gaps):
    if ogr.GetDriverByName(FORMATS[suffix]) is None:
        pytest.skip(f"no driver for {suffix}")
    path = make_layer(tmp_path / f"points.{suffix}", FORMATS[suffix], with_z=with_z, gaps=gaps)
    quick, slow = both_ways(path, monkeypatch)
    assert quick.columns.keys() == slow.columns.keys()
    for name, column in slow.columns.items():
        np.testing.assert_array_equal(quick.columns[name], column, err_msg=name)
    np.testing.assert_array_equal(quick.geometry, slow.geometry)
    assert [quick.row_name(k) for k in (0, 7)] == [slow.row_name(k) for k in (0, 7)]
    assert quick.crs == slow.crs


@pytest.mark.skipif(not has_stream, reason=f"GDAL {gdal.__version__} has no Arrow stream")
def test_the_stream_is_used(tmp_path, monkeypatch):
    path = make_layer(tmp_path / "p.gpkg", "GPKG", gaps=False)
    monkeypatch.setattr(ogr_layer, "_read_position", lambda *_: pytest.fail("read feature by feature"))
    assert len(ogr_layer.read(path)) == 300


def test_other_geometries_are_still_refused_by_name(tmp_path):
    source = ogr.GetDriverByName("GPKG").CreateDataSource(str(tmp_path / "lines.gpkg"))
    layer = source.CreateLayer("lines", None, ogr.wkbLineString)
    layer.CreateField(ogr.FieldDefn("id", ogr.OFTString))
    feature = ogr.Feature(layer.GetLayerDefn())
    feature.SetField("id", "A")
    feature.SetGeometry(ogr.CreateGeometryFromWkt("LINESTRING (0 0, 1 1)"))
    layer.CreateFeature(feature)
    del layer, source
    with pytest.raises(InputError, match="feature 1: is a Linestring"):
        read_points(str(tmp_path / "lines.gpkg"))


def test_a_text_that_is_no_number_names_its_feature(tmp_path):
    path = make_layer(tmp_path / "p.gpkg", "GPKG", gaps=False)
    source = gdal.OpenEx(path, gdal.OF_VECTOR | gdal.OF_UPDATE)
    source.ExecuteSQL("UPDATE points SET sigma = 'much' WHERE fid = 12")
    del source
    with pytest.raises(InputError, match=r"feature 12, field 'sigma': 'much' is not a number"):
        read_points(path)

"""Layers of the project, files and CSV as input of the engine: what it opens holds what QGIS shows."""

from pathlib import Path

import pytest
from osgeo import gdal, ogr
from qgis.core import (
    QgsFeature,
    QgsGeometry,
    QgsPoint,
    QgsProcessingFeatureSourceDefinition,
    QgsProject,
    QgsRasterLayer,
    QgsVectorFileWriter,
    QgsVectorLayer,
)

FIELDS = "field=id:string&field=height:double&field=fid:string"
POINTS = (("H001", 147.3, -42.9, 12.5), ("H002", 147.4, -42.8, 13.25), ("H003", 147.5, -42.7, 14.0))


@pytest.fixture
def memory_layer(qgis_new_project) -> QgsVectorLayer:
    """Three points in memory, with a text field that has the name of a GeoPackage's feature id."""
    layer = QgsVectorLayer(f"PointZ?crs=EPSG:4326&{FIELDS}", "My GCPs", "memory")
    features = []
    for name, lon, lat, height in POINTS:
        feature = QgsFeature(layer.fields())
        feature.setAttributes([name, height, "same"])
        feature.setGeometry(QgsGeometry(QgsPoint(lon, lat, height)))
        features.append(feature)
    assert layer.dataProvider().addFeatures(features)[0]
    QgsProject.instance().addMapLayer(layer)
    return layer


@pytest.fixture
def file_layer(memory_layer: QgsVectorLayer, tmp_path: Path) -> QgsVectorLayer:
    """The three points in layer ``gcps`` of a GeoPackage, added to the project."""
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.layerName, options.layerOptions = "gcps", ["FID=number"]
    path = tmp_path / "points.gpkg"
    QgsVectorFileWriter.writeAsVectorFormatV3(
        memory_layer, str(path), QgsProject.instance().transformContext(), options
    )
    layer = QgsVectorLayer(f"{path}|layername=gcps", "GCPs in a file", "ogr")
    assert layer.isValid()
    QgsProject.instance().addMapLayer(layer)
    return layer


def rows(source: str) -> tuple[str, list[tuple[str, float, float, float, float]]]:
    """Read a ``FILE|layername=L`` source with OGR: EPSG code and (id, lon, lat, z, height field)."""
    path, _, name = source.partition("|layername=")
    data = ogr.Open(path)
    layer = data.GetLayerByName(name) if name else data.GetLayer(0)
    found = []
    for feature in layer:
        point = feature.GetGeometryRef()
        found.append((feature["id"], point.GetX(), point.GetY(), point.GetZ(), feature["height"]))
    return layer.GetSpatialRef().GetAuthorityCode(None), found


def expected(count: int = 3) -> list[tuple[str, float, float, float, float]]:
    return [(name, lon, lat, height, height) for name, lon, lat, height in POINTS[:count]]


def test_memory_layer_is_copied_with_fields_and_crs(run_tiny, memory_layer) -> None:
    assert rows(run_tiny(GCPS=memory_layer.id())["gcps"]) == ("4326", expected())
    assert rows(run_tiny(GCPS=memory_layer)["gcps"]) == ("4326", expected())


def test_file_layer_is_read_where_it_lies(run_tiny, file_layer, tmp_path: Path) -> None:
    assert run_tiny(GCPS=file_layer.id())["gcps"] == f"{tmp_path}/points.gpkg|layername=gcps"


def test_selected_features_only(run_tiny, file_layer) -> None:
    first = next(file_layer.getFeatures())
    file_layer.selectByIds([first.id()])
    definition = QgsProcessingFeatureSourceDefinition(file_layer.id(), True)
    assert rows(run_tiny(GCPS=definition)["gcps"])[1] == expected(1)


def test_filtered_layer_is_copied(run_tiny, file_layer) -> None:
    assert file_layer.setSubsetString("\"id\" <> 'H003'")
    assert rows(run_tiny(GCPS=file_layer.id())["gcps"])[1] == expected(2)


def test_edited_layer_is_copied_with_its_edits(run_tiny, file_layer) -> None:
    file_layer.startEditing()
    third = [feature.id() for feature in file_layer.getFeatures()][2]
    file_layer.deleteFeature(third)
    try:
        assert rows(run_tiny(GCPS=file_layer.id())["gcps"])[1] == expected(2)
    finally:
        file_layer.rollBack()


def test_crs_set_by_hand_is_kept(run_tiny, file_layer) -> None:
    crs = file_layer.crs()
    crs.createFromString("EPSG:4283")
    file_layer.setCrs(crs)
    assert rows(run_tiny(GCPS=file_layer.id())["gcps"])[0] == "4283"


@pytest.mark.parametrize("source", ["points.gpkg|layername=gcps", "gcps.csv", "gcps.points", "missing.gpkg"])
def test_paths_pass_as_they_are(run_tiny, source: str) -> None:
    assert run_tiny(GCPS=f"/data/{source}")["gcps"] == f"/data/{source}"


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    path = tmp_path / "gcps.csv"
    lines = [f"{name},{lon},{lat},{height}" for name, lon, lat, height in POINTS]
    path.write_text("\n".join(["id,lon,lat,height", *lines]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("uri", "provider"), [("{path}", "ogr"), ("file://{path}?type=csv&geomType=none", "delimitedtext")]
)
def test_csv_table_in_the_project(run_tiny, qgis_new_project, csv: Path, uri: str, provider: str) -> None:
    layer = QgsVectorLayer(uri.format(path=csv), "table", provider)
    assert layer.isValid()
    QgsProject.instance().addMapLayer(layer)
    assert run_tiny(GCPS=layer.id())["gcps"] == str(csv)


def test_csv_with_geometry_in_the_project(run_tiny, qgis_new_project, csv: Path) -> None:
    uri = f"file://{csv}?type=csv&xField=lon&yField=lat&zField=height&crs=EPSG:4326"
    layer = QgsVectorLayer(uri, "points", "delimitedtext")
    QgsProject.instance().addMapLayer(layer)
    assert rows(run_tiny(GCPS=layer.id())["gcps"]) == ("4326", expected())


def test_raster_layers_of_the_project(run_tiny, qgis_new_project, tmp_path: Path) -> None:
    path = str(tmp_path / "image.tif")
    gdal.GetDriverByName("GTiff").Create(path, 4, 4)
    layer = QgsRasterLayer(path, "an image")
    QgsProject.instance().addMapLayer(layer)
    options = run_tiny(IMAGES=[layer.id(), "other_RPC.TXT"], DEM=layer)
    assert options["images"] == [path, "other_RPC.TXT"]
    assert options["dem"] == path

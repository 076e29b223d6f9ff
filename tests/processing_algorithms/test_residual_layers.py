"""``block.gpkg`` field by field as the interface promises, read by OGR; on the Hobart block."""

from pathlib import Path

import pytest
from osgeo import ogr

TEXT, REAL = ogr.OFTString, ogr.OFTReal
RESIDUALS = {
    "id": TEXT, "role": TEXT, "image": TEXT, "level": TEXT, "residual_sample_px": REAL, "residual_line_px": REAL,
    "residual_east_m": REAL, "residual_north_m": REAL, "residual_height_m": REAL, "sigma_sample_px": REAL,
    "sigma_line_px": REAL, "sigma_east_m": REAL, "sigma_north_m": REAL, "sigma_height_m": REAL, "flag": TEXT,
}  # fmt: skip
FIELDS = {
    "images": {"id": TEXT, "path": TEXT},
    "ground_points": {"id": TEXT, "role": TEXT, "sigma_east_m": REAL, "sigma_north_m": REAL, "sigma_height_m": REAL},
    "image_points": {
        "id": TEXT, "image": TEXT, "sample": REAL, "line": REAL, "residual_sample_px": REAL, "residual_line_px": REAL,
        "weight": REAL, "flag": TEXT,
    },
    "residuals_wgs84": RESIDUALS,
    "residuals_utm": RESIDUALS,
}  # fmt: skip
CRS = dict.fromkeys(FIELDS, 4979) | {"images": 4326, "residuals_utm": 32755}  # Hobart: zone 55 south


@pytest.fixture
def result(hobart_result: Path) -> Path:
    return hobart_result


@pytest.mark.parametrize("name", FIELDS)
def test_fields_crs_and_geometry(result: Path, name: str) -> None:
    dataset = ogr.Open(str(result / "block.gpkg"))
    layer = dataset.GetLayerByName(name)
    definition = layer.GetLayerDefn()
    there = {
        definition.GetFieldDefn(index).GetName(): definition.GetFieldDefn(index).GetType()
        for index in range(definition.GetFieldCount())
    }
    assert FIELDS[name].items() <= there.items()
    assert int(layer.GetSpatialRef().GetAuthorityCode(None)) == CRS[name]
    wanted = ogr.wkbPolygon if name == "images" else ogr.wkbPoint
    assert ogr.GT_Flatten(layer.GetGeomType()) == wanted
    assert all(feature.GetGeometryRef() is not None for feature in layer)

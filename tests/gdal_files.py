"""Rasters and point layers that tests write with GDAL from arrays, in any CRS and format."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from osgeo import gdal, gdal_array, ogr, osr


def spatial_reference(crs: str) -> osr.SpatialReference:
    """Return a CRS by its code or WKT, with easting or longitude first."""
    reference = osr.SpatialReference()
    assert reference.SetFromUserInput(crs) == 0
    reference.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    return reference


def write_raster(
    path: Path | str, values: np.ndarray, geotransform: Sequence[float] = (), crs: str = "",
    nodata: float | None = None, driver: str = "GTiff", options: Sequence[str] = (),
) -> str:  # fmt: skip
    """Write ``(rows, columns)`` or ``(bands, rows, columns)`` in the type of the array; return the path."""
    dataset = gdal_array.OpenArray(np.ascontiguousarray(values))
    if crs:
        dataset.SetSpatialRef(spatial_reference(crs))
    if geotransform:
        dataset.SetGeoTransform(geotransform)
    if nodata is not None:
        dataset.GetRasterBand(1).SetNoDataValue(nodata)
    gdal.GetDriverByName(driver).CreateCopy(str(path), dataset, options=list(options))
    return str(path)


def write_layer(
    path: Path, driver: str, crs: str, xyz: np.ndarray, fields: dict[str, list], *, with_z: bool = True,
    layer: str = "points", options: Sequence[str] = (),
) -> Path:  # fmt: skip
    """Write a point layer with OGR; fields are texts or floats, None is NULL, a point of NaN is no geometry."""
    dataset = ogr.GetDriverByName(driver).CreateDataSource(str(path), list(options))
    given = ["COORDINATE_PRECISION=15", "RFC7946=NO"] if driver == "GeoJSON" else []
    geometry_type = ogr.wkbPoint25D if with_z else ogr.wkbPoint
    table = dataset.CreateLayer(layer, spatial_reference(crs) if crs else None, geometry_type, given)
    for name, values in fields.items():
        is_text = any(isinstance(value, str) for value in values)
        definition = ogr.FieldDefn(name, ogr.OFTString if is_text else ogr.OFTReal)
        if not is_text:
            definition.SetWidth(24)
            definition.SetPrecision(10)
        table.CreateField(definition)
    for row, point in enumerate(xyz):
        feature = ogr.Feature(table.GetLayerDefn())
        for name, values in fields.items():
            if values[row] is not None:
                feature.SetField(name, values[row])
        if np.isfinite(point[0]):
            geometry = ogr.Geometry(geometry_type)
            geometry.SetPoint(0, *point.tolist()) if with_z else geometry.SetPoint_2D(0, *point[:2].tolist())
            feature.SetGeometry(geometry)
        table.CreateFeature(feature)
    del table, dataset
    return path

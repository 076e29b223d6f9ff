"""Conversion of what a user chooses in QGIS to what the engine opens: a file name, or ``FILE|layername=L``.

A layer that differs from its file (in memory, edited, filtered, joined, from a database, with a CRS set by the user) is
copied to a temporary GeoPackage. This is done in the main thread, before the algorithm runs.
"""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from qgis.core import (
    NULL,
    QgsCoordinateReferenceSystem,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeatureSourceDefinition,
    QgsProcessingFeedback,
    QgsProcessingParameterDefinition,
    QgsProcessingParameters,
    QgsProcessingUtils,
    QgsProperty,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsRectangle,
    QgsVectorFileWriter,
    QgsVectorLayer,
)

from .background_task import in_main_thread

_NUMBERS = re.compile(r"[-+0-9.eE,\s]+")  #: a box without the name of a CRS


@in_main_thread
def raster_source(value: Any, context: QgsProcessingContext) -> str:
    """Return the source that GDAL opens, of a raster layer of the project, its id or name, or a path."""
    value = _static(value)
    layer = _project_layer(value, context)
    return str(layer.source()).partition("|option:")[0] if isinstance(layer, QgsRasterLayer) else str(value)


def raster_sources(values: Any, context: QgsProcessingContext) -> list[str]:
    """Return the sources of several rasters or RPC files."""
    return [raster_source(value, context) for value in list_sources(_static(values))]


def list_sources(values: Any) -> list[Any]:
    """Return one or several values as a list; a text may contain several, separated by semicolons."""
    if values is None or values == NULL:
        return []
    if isinstance(values, str):
        return [part for part in values.split(";") if part.strip()]
    return list(values) if isinstance(values, Iterable) else [values]


@in_main_thread
def point_source(value: Any, name: str, context: QgsProcessingContext, feedback: QgsProcessingFeedback) -> str:
    """Return ``FILE`` or ``FILE|layername=L`` for a vector layer of the project or a path.

    value : layer, layer id or name, feature source definition (also: selected features only) or path
    name : layer name of a copy, if one is needed; raises `QgsProcessingException` if it cannot be written
    """
    selected_only = isinstance(value, QgsProcessingFeatureSourceDefinition) and value.selectedFeaturesOnly
    value = _static(value)
    layer = _project_layer(value, context)
    if not isinstance(layer, QgsVectorLayer):
        return str(value)
    if not selected_only and (source := _file_source(layer)):
        return source
    # A copy of the layer with its fields and CRS in a temporary GeoPackage
    path = Path(QgsProcessingUtils.generateTempFilename(f"{name}.gpkg"))
    path.parent.mkdir(parents=True, exist_ok=True)
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.driverName, options.layerName = "GPKG", name
    options.onlySelectedFeatures, options.feedback = selected_only, feedback
    options.layerOptions = ["FID=_feature"]  # so that a field named fid is not the FID
    transforms = context.transformContext()
    error, message, *_ = QgsVectorFileWriter.writeAsVectorFormatV3(layer, str(path), transforms, options)
    if error != QgsVectorFileWriter.WriterError.NoError:
        raise QgsProcessingException(f"Layer {layer.name()} could not be copied to {path}: {message}")
    feedback.pushInfo(f"Layer {layer.name()} is read from a copy: {path}")
    return f"{path}|layername={name}"


def name_fields(source: str, chosen: Mapping[str, str]) -> str:
    """Return a source of points with the chosen fields, by HRSI's names; '' means not chosen."""
    columns = ",".join(f"{field}={name}" for field, name in chosen.items() if name)
    return f"{source}|columns={columns}" if source and columns else source


@in_main_thread
def read_box(
    definition: QgsProcessingParameterDefinition, value: Any, context: QgsProcessingContext
) -> tuple[QgsRectangle, QgsCoordinateReferenceSystem]:
    """Return a box in a format of QGIS (``xmin,xmax,ymin,ymax [CRS]``, rectangle, layer), and its CRS if it states one.

    The box is null if the value is no box.
    """
    box = QgsProcessingParameters.parameterAsExtent(definition, value, context)
    if type(value) is QgsRectangle or (isinstance(value, str) and _NUMBERS.fullmatch(value)):
        return box, QgsCoordinateReferenceSystem()  # QGIS would use that of the project
    return box, QgsProcessingParameters.parameterAsExtentCrs(definition, value, context)


def crs_text(crs: QgsCoordinateReferenceSystem) -> str:
    """Return a CRS as text for the engine: EPSG:code, or WKT 2 if it has none.

    QGIS's default, WKT 1, cannot represent heights above an ellipsoid: it is empty for EPSG:4979.
    """
    wkt = crs.toWkt(QgsCoordinateReferenceSystem.WktVariant.WKT_PREFERRED)
    return str(crs.authid() if crs.authid().startswith("EPSG:") else wkt)


def _static(value: Any) -> Any:
    """Return the plain value of feature source definitions and properties."""
    if isinstance(value, QgsProcessingFeatureSourceDefinition):
        value = value.source
    return value.staticValue() if isinstance(value, QgsProperty) else value


def _project_layer(value: Any, context: QgsProcessingContext) -> Any:
    """Return the open layer of a value, None if it is a path."""
    is_named = isinstance(value, str)
    return QgsProcessingUtils.mapLayerFromString(value, context, allowLoadingNewLayers=False) if is_named else value


def _file_source(layer: QgsVectorLayer) -> str | None:
    """Return the source of a layer that is identical to its file (features, fields and CRS), otherwise None."""
    provider, fields = layer.providerType(), layer.fields().count()
    is_changed = (
        layer.isModified()
        or layer.subsetString()
        or layer.vectorJoins()
        or fields != layer.dataProvider().fields().count()
        or (layer.isSpatial() and layer.crs() != layer.dataProvider().crs())
    )
    if is_changed or provider not in ("ogr", "delimitedtext"):
        return None
    parts = QgsProviderRegistry.instance().decodeUri(provider, layer.source())
    if provider == "delimitedtext":  # a geometry from columns is not in the file
        return None if layer.isSpatial() else str(parts["path"])
    if parts.get("openOptions") or parts.get("layerId") not in (None, "", 0, "0"):
        return None
    name = parts.get("layerName")
    return f"{parts['path']}|layername={name}" if name else str(parts["path"])

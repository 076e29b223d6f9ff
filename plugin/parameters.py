"""Parameters of Processing from declared options; and QGIS's enumerations, with their names before QGIS 3.36."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

from qgis.core import (
    NULL,
    Qgis,
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterField,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
    QgsProperty,
)

from ..processing_algorithms.interface.declare import READ_KINDS, Kind, Param, format_default, spell_arguments
from .background_task import in_main_thread
from .layer_sources import crs_text, name_fields, point_source, raster_source, raster_sources, read_box
from .translation import tr

if hasattr(Qgis, "ProcessingParameterFlag"):
    ADVANCED = Qgis.ProcessingParameterFlag.Advanced
    OPTIONAL = Qgis.ProcessingParameterFlag.Optional
    INTEGER = Qgis.ProcessingNumberParameterType.Integer
    DOUBLE = Qgis.ProcessingNumberParameterType.Double
    RASTER = Qgis.ProcessingSourceType.Raster
    VECTOR = Qgis.ProcessingSourceType.Vector
    NO_THREADING = Qgis.ProcessingAlgorithmFlag.NoThreading
else:
    ADVANCED = QgsProcessingParameterDefinition.Flag.FlagAdvanced
    OPTIONAL = QgsProcessingParameterDefinition.Flag.FlagOptional
    INTEGER = QgsProcessingParameterNumber.Type.Integer
    DOUBLE = QgsProcessingParameterNumber.Type.Double
    RASTER = QgsProcessing.SourceType.TypeRaster
    VECTOR = QgsProcessing.SourceType.TypeVector
    NO_THREADING = QgsProcessingAlgorithm.Flag.FlagNoThreading


SHORT_DIALOG = 12  # most fields of a dialog without groups
_ABBREVIATIONS = {
    "crs": "CRS", "dem": "DEM", "dir": "directory", "gcp": "GCP", "gcps": "GCPs", "gsd": "GSD", "h": "height",
    "rpc": "RPC", "rpcs": "RPCs", "stac": "STAC items", "utm": "UTM", "xy": "easting and northing",
}  # fmt: skip


class _AnyFile:
    """Accept every layer and every path; the engine reports invalid files."""

    def checkValueIsAcceptable(self, value: Any, context: QgsProcessingContext | None = None) -> bool:
        definition = cast(QgsProcessingParameterDefinition, self)
        given = definition.defaultValue() if value is None else value
        empty = given is None or (isinstance(given, (str, list, tuple)) and not given)
        return not empty or bool(definition.flags() & OPTIONAL)


class ImagesParameter(_AnyFile, QgsProcessingParameterMultipleLayers):
    """Raster layers of the project, image files and RPC files without pixels."""

    widget = f"{__package__}.dialog_fields.ImagesWidget"  #: imported by the dialogs only: qgis_process has no GUI

    def valueAsPythonString(self, value: Any, context: QgsProcessingContext) -> str:
        """Return the value for QGIS's history, which itself would omit RPC files, because they are no raster layers."""
        return repr(raster_sources(value, context))

    def createFileFilter(self) -> str:
        return "All files (*.*);;RPC files (*_RPC.TXT *_rpc.txt *.RPB *.XML *.xml *.geom)"


class RasterParameter(_AnyFile, QgsProcessingParameterRasterLayer):
    """One raster layer or file."""


class PointsParameter(_AnyFile, QgsProcessingParameterFeatureSource):
    """A vector layer, ``FILE|layername=L``, CSV or any other point file of the engine."""

    def createFileFilter(self) -> str:
        return "All files (*.*);;Point files (*.gpkg *.csv *.shp *.geojson *.points *.gcp)"


class ExtentParameter(_AnyFile, QgsProcessingParameterExtent):
    """A box on the map, or a word that the option accepts."""


class FileParameter(_AnyFile, QgsProcessingParameterFile):
    """A file name, with or without a dot in it, or a word that the option accepts."""


#: Fields of the dialog for a word or a file, and for a word or a box; imported by the dialogs only.
WORD_WIDGET = {"widget_wrapper": {"class": f"{__package__}.dialog_fields.WordWidget"}}
EXTENT_WIDGET = {"widget_wrapper": {"class": f"{__package__}.dialog_fields.ExtentWidget"}}


@dataclass(frozen=True)
class Reading:
    """Source of parameter values: the algorithm of a run, its parameters, context and feedback."""

    algorithm: QgsProcessingAlgorithm
    parameters: Mapping[str, Any]
    context: QgsProcessingContext
    feedback: QgsProcessingFeedback

    def call(self, method: str, param: Param) -> Any:
        """Evaluate a parameter with one of QGIS's ``parameterAs…`` methods."""
        return getattr(self.algorithm, method)(dict(self.parameters), qgis_name(param), self.context)

    def raw(self, param: Param) -> Any:
        """Return the value of a parameter as given."""
        return self.parameters[qgis_name(param)]


class Binding(NamedTuple):
    """How parameters of one kind are made and read; ``read`` is only called for values that were given.

    ``make`` may be a class of QGIS, and ``read`` the name of a ``parameterAs…`` method of QGIS.
    """

    make: Callable[..., QgsProcessingParameterDefinition]
    read: str | Callable[[Param, Reading], Any]


def qgis_name(param: Param) -> str:
    """Return the name of a parameter in QGIS: ``SIGMA_IMAGE``."""
    return param.key.upper()


def label_of(param: Param) -> str:
    """Return the label of a parameter in the dialog: ``Sigma image (px)``."""
    return tr(words_of(param)) + (f" ({param.unit})" if param.unit else "")


def words_of(param: Param) -> str:
    """Return the name of a parameter as English words: ``Sigma image``."""
    words = " ".join(_ABBREVIATIONS.get(word, word) for word in param.name.split("-"))
    return words[0].upper() + words[1:]


def definition(param: Param, params: Sequence[Param] = ()) -> QgsProcessingParameterDefinition:
    """Return the QGIS parameter of a declared option."""
    make = BINDINGS[param.kind].make
    made = make(**_common(param)) if isinstance(make, type) else make(param)
    made.setHelp(f"{spell_arguments(param.help, params, label_of)}.")
    # In a long dialog inputs, outputs and required parameters are above "Advanced": the others have defaults, and
    # thirty fields in a column would hide the three that are needed
    is_long = len(params) > SHORT_DIALOG and any(other.kind in READ_KINDS for other in params)
    first = (*READ_KINDS, Kind.EXTENT, Kind.FOLDERS, Kind.OUTPUT_DIR)
    is_first = param.required or "FILE" in param.metavar.split("|") or param.kind in first
    if param.advanced or (is_long and not is_first):
        made.setFlags(made.flags() | ADVANCED)
    return made


def label_gcp_fields() -> dict[str, str]:
    """Return the labels of the GCP fields that a user can choose, by HRSI's names."""
    return {
        "id": tr("GCP field: id"),
        "height": tr("GCP field: height"),
        "sigma_h": tr("GCP field: sigma height"),
        "sigma_east": tr("GCP field: sigma east"),
        "sigma_north": tr("GCP field: sigma north"),
    }


def name_field_choosers(param: Param) -> dict[str, str]:
    """Return the names of the parameters that choose fields in the layer of GCPs, by HRSI's names of the fields."""
    is_gcps = (param.key, param.kind) == ("gcps", Kind.POINTS)
    return {field: f"{qgis_name(param)}_{field.upper()}" for field in label_gcp_fields()} if is_gcps else {}


def field_choosers(param: Param) -> dict[str, QgsProcessingParameterDefinition]:
    """Return the parameters that choose fields in the layer of GCPs, by HRSI's names."""
    made, layer, labels = {}, qgis_name(param), label_gcp_fields()
    for field, name in name_field_choosers(param).items():
        made[field] = QgsProcessingParameterField(name, labels[field], parentLayerParameterName=layer, optional=True)
        made[field].setHelp(f"Field in the layer of GCPs, if its name is not {field}.")
        made[field].setFlags(made[field].flags() | ADVANCED)
    return made


def option_value(param: Param, reading: Reading) -> Any:
    """Return the value of a parameter for the engine; the declared default if none is given."""
    value = reading.parameters.get(qgis_name(param))
    if value is None or value == NULL or value == "":
        return param.default
    read = BINDINGS[param.kind].read
    return reading.call(read, param) if isinstance(read, str) else read(param, reading)


def _common(param: Param) -> dict[str, Any]:
    return {
        "name": qgis_name(param),
        "description": label_of(param),
        "defaultValue": format_default(param) if isinstance(param.default, tuple) else param.default,
        "optional": not (param.required or param.piped) and param.default in (None, ()),
    }


def _images(param: Param) -> QgsProcessingParameterDefinition:
    made = ImagesParameter(layerType=RASTER, **_common(param))
    made.setMetadata({"widget_wrapper": {"class": ImagesParameter.widget}})
    return made


def _points(param: Param) -> QgsProcessingParameterDefinition:
    optional = {"optional": not (param.required or param.piped)}  # empty in the dialog: the default
    return _with_words(PointsParameter(types=[VECTOR], **_common(param) | optional), param)


def _text(param: Param) -> QgsProcessingParameterDefinition:
    """Return a text parameter; with a button to browse if a file name is allowed (``auto|none|FILE``)."""
    made = FileParameter if "FILE" in param.metavar.split("|") else QgsProcessingParameterString
    return _with_words(made(**_common(param)), param)


def _with_words(made: QgsProcessingParameterDefinition, param: Param) -> QgsProcessingParameterDefinition:
    """Set the field that offers the words which a parameter accepts instead of a file, if there are any."""
    if param.words:
        made.setMetadata(WORD_WIDGET | {"words": list(param.words)})
    return made


def _extent(param: Param) -> QgsProcessingParameterDefinition:
    made = ExtentParameter(**_common(param))
    made.setMetadata(EXTENT_WIDGET | {"words": list(param.words)})
    return made


def _folder(param: Param) -> QgsProcessingParameterDefinition:
    return QgsProcessingParameterFile(behavior=QgsProcessingParameterFile.Behavior.Folder, **_common(param))


def _number(param: Param) -> QgsProcessingParameterDefinition:
    limits = {"minValue": param.minimum, "maxValue": param.maximum}
    given = {name: limit for name, limit in limits.items() if limit is not None}
    number_type = INTEGER if param.kind is Kind.INTEGER else DOUBLE
    return QgsProcessingParameterNumber(type=number_type, **given, **_common(param))


def _read_points(param: Param, reading: Reading) -> str:
    if reading.raw(param) in param.words:
        return str(reading.raw(param))
    source = point_source(reading.raw(param), param.key, reading.context, reading.feedback)
    chosen = {
        field: reading.algorithm.parameterAsString(dict(reading.parameters), name, reading.context)
        for field, name in name_field_choosers(param).items()
    }
    return name_fields(source, chosen)


@in_main_thread
def _read_crs(param: Param, reading: Reading) -> str:
    """Return EPSG:code, or WKT if the CRS has no code."""
    crs = reading.call("parameterAsCrs", param)
    return crs_text(crs) if crs.isValid() else str(reading.raw(param))  # the engine reports what is wrong


def _read_extent(param: Param, reading: Reading) -> str:
    """Return a word unchanged, a box as ``W,S,E,N [CRS]``."""
    value = raw.staticValue() if isinstance(raw := reading.raw(param), QgsProperty) else raw
    if value in param.words:
        return str(value)
    box, crs = read_box(reading.algorithm.parameterDefinition(qgis_name(param)), value, reading.context)
    if box.isNull():
        return str(value)  # the engine reports what is wrong
    sides = (box.xMinimum(), box.yMinimum(), box.xMaximum(), box.yMaximum())
    return ",".join(map(repr, sides)) + (f" [{crs_text(crs)}]" if crs.isValid() else "")


def _read_ids(param: Param, reading: Reading) -> list[str]:
    return [item.strip() for item in reading.call("parameterAsString", param).split(",") if item.strip()]


BINDINGS: dict[Kind, Binding] = {
    Kind.IMAGES: Binding(_images, lambda param, reading: raster_sources(reading.raw(param), reading.context)),
    Kind.RASTER: Binding(RasterParameter, lambda param, reading: raster_source(reading.raw(param), reading.context)),
    Kind.POINTS: Binding(_points, _read_points),
    Kind.FILE: Binding(FileParameter, "parameterAsFile"),
    Kind.PROJECT: Binding(FileParameter, "parameterAsFile"),
    Kind.CRS: Binding(QgsProcessingParameterCrs, _read_crs),
    Kind.EXTENT: Binding(_extent, _read_extent),
    Kind.TEXT: Binding(_text, "parameterAsString"),
    Kind.IDS: Binding(_text, _read_ids),
    Kind.GROUPS: Binding(_text, _read_ids),
    Kind.RANGE: Binding(_text, "parameterAsString"),
    Kind.CHOICE: Binding(
        lambda param: QgsProcessingParameterEnum(options=list(param.choices), usesStaticStrings=True, **_common(param)),
        "parameterAsEnumString",
    ),
    Kind.INTEGER: Binding(_number, "parameterAsInt"),
    Kind.NUMBER: Binding(_number, "parameterAsDouble"),
    Kind.FLAG: Binding(QgsProcessingParameterBoolean, "parameterAsBool"),
    Kind.RESULT: Binding(_folder, "parameterAsFile"),
    Kind.FOLDERS: Binding(_text, "parameterAsString"),
    Kind.OUTPUT_DIR: Binding(QgsProcessingParameterFolderDestination, "parameterAsFileOutput"),
}

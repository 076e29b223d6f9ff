"""Declared parameters as QGIS Processing parameters, and their values back as options of the engine.

`BINDINGS` has one entry for each `Kind`: how the QGIS parameter is made and how its value is read. QGIS's own
parameters for layers accept only what QGIS itself can load; an RPC file without pixels, a georeferencer's point list
or a file that is not there (which the engine names in its error) must pass, so these are subclassed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from qgis.core import (
    NULL,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
    QgsProperty,
)

from ..processing_algorithms.interface.declare import READ_KINDS, Kind, Param, format_default
from ..processing_algorithms.interface.naming import spell_arguments
from .enums import ADVANCED, DOUBLE, INTEGER, OPTIONAL, RASTER, VECTOR
from .layer_sources import crs_text, point_source, raster_source, raster_sources, read_box
from .translation import tr

SHORT_DIALOG = 12  # fields that a person sees at one glance
_ABBREVIATIONS = {
    "crs": "CRS", "dem": "DEM", "dir": "directory", "gcp": "GCP", "gcps": "GCPs", "gsd": "GSD", "h": "height",
    "rpc": "RPC", "rpcs": "RPCs", "stac": "STAC items", "utm": "UTM", "xy": "easting and northing",
}  # fmt: skip


class _AnyFile:
    """Accept every layer and every path; the engine says what is wrong with a file."""

    def checkValueIsAcceptable(self, value: Any, context: QgsProcessingContext | None = None) -> bool:
        definition = cast(QgsProcessingParameterDefinition, self)
        given = definition.defaultValue() if value is None else value
        empty = given is None or (isinstance(given, (str, list, tuple)) and not given)
        return not empty or bool(definition.flags() & OPTIONAL)


class ImagesParameter(_AnyFile, QgsProcessingParameterMultipleLayers):
    """Raster layers of the project, image files and RPC files without pixels."""

    widget = f"{__package__}.images_widget.ImagesWidget"  #: imported by the dialogs, there is no GUI in qgis_process

    def createFileFilter(self) -> str:
        return "All files (*.*);;RPC files (*_RPC.TXT *_rpc.txt *.RPB *.XML *.xml *.geom)"


class RasterParameter(_AnyFile, QgsProcessingParameterRasterLayer):
    """One raster layer or file."""


class PointsParameter(_AnyFile, QgsProcessingParameterFeatureSource):
    """A vector layer, ``FILE|layername=L``, CSV or any other point file of the engine."""

    def createFileFilter(self) -> str:
        return "All files (*.*);;Point files (*.gpkg *.csv *.shp *.geojson *.points *.gcp)"


class ExtentParameter(_AnyFile, QgsProcessingParameterExtent):
    """A box on the map, or a word that the engine knows."""


class FileParameter(_AnyFile, QgsProcessingParameterFile):
    """A file name, with or without a dot in it, or a word that the engine knows."""


#: The dialog's fields for parameters that take a word or a file, and a word or a box; imported by the dialogs only.
WORD_WIDGET = {"widget_wrapper": {"class": f"{__package__}.word_widget.WordWidget"}}
EXTENT_WIDGET = {"widget_wrapper": {"class": f"{__package__}.extent_widget.ExtentWidget"}}


@dataclass(frozen=True)
class Reading:
    """Where the value of a parameter is read from: a run's algorithm, its parameters, context and feedback."""

    algorithm: QgsProcessingAlgorithm
    parameters: Mapping[str, Any]
    context: QgsProcessingContext
    feedback: QgsProcessingFeedback

    def call(self, method: str, param: Param) -> Any:
        """Evaluate a parameter with one of QGIS's ``parameterAs…`` methods."""
        return getattr(self.algorithm, method)(dict(self.parameters), qgis_name(param), self.context)

    def raw(self, param: Param) -> Any:
        """Return a parameter as it was given."""
        return self.parameters[qgis_name(param)]


@dataclass(frozen=True)
class Binding:
    """How one kind of parameter is made and read; ``read`` is only called for values that were given."""

    make: Callable[[Param], QgsProcessingParameterDefinition]
    read: Callable[[Param, Reading], Any]


def qgis_name(param: Param) -> str:
    """Return the name of a parameter in QGIS: ``SIGMA_IMAGE``."""
    return param.key.upper()


def label_of(param: Param) -> str:
    """Return what the dialog writes beside a parameter: ``Sigma image (px)``."""
    unit = f" ({param.unit})" if param.unit else ""
    return tr(words_of(param)) + unit


def words_of(param: Param) -> str:
    """Return the name of a parameter in words, English: ``Sigma image``."""
    words = " ".join(_ABBREVIATIONS.get(word, word) for word in param.name.split("-"))
    return words[0].upper() + words[1:]


def definition(param: Param, params: Sequence[Param] = ()) -> QgsProcessingParameterDefinition:
    """Make the QGIS parameter of a declared one."""
    made = BINDINGS[param.kind].make(param)
    made.setHelp(f"{spell_arguments(param.help, params, label_of)}.")
    if param.advanced or not _is_asked_first(param, params):
        made.setFlags(made.flags() | ADVANCED)
    return made


def _is_asked_first(param: Param, params: Sequence[Param]) -> bool:
    """Return whether a field stands above "Advanced": in a long dialog inputs, outputs, and what must be given.

    How it is done has defaults, and thirty fields in a column hide the three that are needed.
    """
    if len(params) <= SHORT_DIALOG or not any(other.kind in READ_KINDS for other in params):
        return True
    takes_file = "FILE" in param.metavar.split("|")
    return param.required or takes_file or param.kind in (*READ_KINDS, Kind.EXTENT, Kind.FOLDERS, Kind.OUTPUT_DIR)


def option_value(param: Param, reading: Reading) -> Any:
    """Return the value of a parameter as the engine takes it; the declared default where none is given."""
    value = reading.parameters.get(qgis_name(param))
    if value is None or value == NULL or value == "":
        return param.default
    return BINDINGS[param.kind].read(param, reading)


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
    optional = {"optional": not (param.required or param.piped)}  # a blank choice in the dialog stands for the default
    return _with_words(PointsParameter(types=[VECTOR], **_common(param) | optional), param)


def _text(param: Param) -> QgsProcessingParameterDefinition:
    """Make a text field; with a browse button where a file name is among what it takes (``auto|none|FILE``)."""
    made = FileParameter if "FILE" in param.metavar.split("|") else QgsProcessingParameterString
    return _with_words(made(**_common(param)), param)


def _with_words(made: QgsProcessingParameterDefinition, param: Param) -> QgsProcessingParameterDefinition:
    """Give a parameter the field that offers the words which it takes besides a file, if there are such."""
    if param.words:
        made.setMetadata(WORD_WIDGET | {"words": list(param.words)})
    return made


def _extent(param: Param) -> QgsProcessingParameterDefinition:
    made = ExtentParameter(**_common(param))
    made.setMetadata(EXTENT_WIDGET | {"words": list(param.words)})
    return made


def _plain(made: Callable[..., QgsProcessingParameterDefinition]) -> Callable[[Param], Any]:
    """Return what makes a parameter of a class of QGIS that needs no more than every parameter has."""
    return lambda param: made(**_common(param))


def _choice(param: Param) -> QgsProcessingParameterDefinition:
    return QgsProcessingParameterEnum(options=list(param.choices), usesStaticStrings=True, **_common(param))


def _number(number_type: Any) -> Callable[[Param], QgsProcessingParameterDefinition]:
    def make(param: Param) -> QgsProcessingParameterDefinition:
        limits = {"minValue": param.minimum, "maxValue": param.maximum}
        given = {name: limit for name, limit in limits.items() if limit is not None}
        return QgsProcessingParameterNumber(type=number_type, **given, **_common(param))

    return make


def _read_points(param: Param, reading: Reading) -> str:
    if reading.raw(param) in param.words:
        return str(reading.raw(param))
    return point_source(reading.raw(param), param.key, reading.context, reading.feedback)


def _read_crs(param: Param, reading: Reading) -> str:
    """Return EPSG:code, or WKT where the CRS has none."""
    crs = reading.call("parameterAsCrs", param)
    if not crs.isValid():
        return str(reading.raw(param))  # the engine says what is wrong with it
    return crs_text(crs)


def _read_extent(param: Param, reading: Reading) -> str:
    """Return a word as it is, a box as ``W,S,E,N [CRS]``."""
    value = reading.raw(param)
    value = value.staticValue() if isinstance(value, QgsProperty) else value
    if value in param.words:
        return str(value)
    box, crs = read_box(reading.algorithm.parameterDefinition(qgis_name(param)), value, reading.context)
    if box.isNull():
        return str(value)  # the engine says what is wrong with it
    sides = (box.xMinimum(), box.yMinimum(), box.xMaximum(), box.yMaximum())
    return ",".join(map(repr, sides)) + (f" [{crs_text(crs)}]" if crs.isValid() else "")


def _read_ids(param: Param, reading: Reading) -> list[str]:
    return [item.strip() for item in reading.call("parameterAsString", param).split(",") if item.strip()]


def _reader(method: str) -> Callable[[Param, Reading], Any]:
    return lambda param, reading: reading.call(method, param)


BINDINGS: dict[Kind, Binding] = {
    Kind.IMAGES: Binding(_images, lambda param, reading: raster_sources(reading.raw(param), reading.context)),
    Kind.RASTER: Binding(
        _plain(RasterParameter), lambda param, reading: raster_source(reading.raw(param), reading.context)
    ),
    Kind.POINTS: Binding(_points, _read_points),
    Kind.FILE: Binding(_plain(FileParameter), _reader("parameterAsFile")),
    Kind.CRS: Binding(_plain(QgsProcessingParameterCrs), _read_crs),
    Kind.EXTENT: Binding(_extent, _read_extent),
    Kind.TEXT: Binding(_text, _reader("parameterAsString")),
    Kind.IDS: Binding(_text, _read_ids),
    Kind.GROUPS: Binding(_text, _read_ids),
    Kind.RANGE: Binding(_text, _reader("parameterAsString")),
    Kind.CHOICE: Binding(_choice, _reader("parameterAsEnumString")),
    Kind.INTEGER: Binding(_number(INTEGER), _reader("parameterAsInt")),
    Kind.NUMBER: Binding(_number(DOUBLE), _reader("parameterAsDouble")),
    Kind.FLAG: Binding(_plain(QgsProcessingParameterBoolean), _reader("parameterAsBool")),
    Kind.FOLDERS: Binding(_text, _reader("parameterAsString")),
    Kind.OUTPUT_DIR: Binding(_plain(QgsProcessingParameterFolderDestination), _reader("parameterAsFileOutput")),
}

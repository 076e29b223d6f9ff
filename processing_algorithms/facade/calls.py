"""The declared algorithms as functions: ``hrsi.triangulate(images, gcps="gcps.gpkg")``, and opening images.

Each function is made from its declaration: parameters, defaults and description are those of the command line. Values
may be objects in memory (`convert_options`), messages name the parameters, and without ``output_dir`` the results are
in a temporary folder that is deleted with the `Result`.
"""

import inspect
import logging
import os
import re
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import replace
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import ArrayRaster, Block, Image, ImagePoints
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import HrsiError, InputError
from ...hrsi_engine.foundation.progress import Progress, silent
from ...hrsi_engine.io.output_dir import find_image_outputs
from ...hrsi_engine.io.point_files import PointsInMemory
from ...hrsi_engine.io.rasters.images import ImageInMemory, open_image, path_of, placement_doubt
from ...hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from ...hrsi_engine.refinement.refine import require_axes_in_order
from ...hrsi_engine.surface.dem import HeightSurface, intersect_surface, surface_heights
from .. import REGISTRY
from ..files.opening import open_terrain
from ..interface.declare import (
    POSITIONAL_KINDS,
    Algorithm,
    Context,
    Kind,
    Param,
    fill_options,
    params_of,
    spell_arguments,
    value_facts,
)
from ..interface.option_groups import TerrainOptions
from ..interface.options import KINDS, OptionSpelling, check_options, suggestion
from .result import Result

_log = logging.getLogger("hrsi")


def open(source: Any, rpc: Any = None, id: str | None = None) -> Any:
    """Open an image with its RPC, or several.

    Parameters
    ----------
    source : path, rasterio dataset, xarray object, array, Image, or a sequence of them
        An image that GDAL opens, or an RPC file alone (``_RPC.TXT``, ``.RPB``, DIMAP or ISD XML, ``.geom``); an array
        ``(lines, samples)`` of grey values, which needs ``rpc``.
    rpc : RPC or path, optional
        A camera to be used instead of the image's own: an RPC, the result of `read_rpc`, or a file.
    id : str, optional
        Name in the block; by default the file's stem without a trailing ``_RPC``.

    Returns
    -------
    Image or list of Image
        With ``rpc``, ``size`` and access to the pixels; a list for a sequence.

    Raises
    ------
    InputError
        The file is missing, is neither an image nor an RPC file, or has no RPC.
    """
    if isinstance(source, (list, tuple)):
        if rpc is not None or id is not None:
            raise InputError("`rpc` and `id` belong to one image: open it by itself")
        return [open(one) for one in source]
    camera = _camera_of(rpc)
    if camera is None and isinstance(rpc, (str, os.PathLike)):
        camera = read_rpc(os.fspath(rpc)).rpc
    if camera is None and rpc is not None:
        raise InputError(f"`rpc` is a {type(rpc).__name__}: give an RPC, a file, or an image")
    if isinstance(source, np.ndarray):
        if camera is None or source.ndim != 2:
            raise InputError(f"an image given as an array {source.shape} needs `rpc`, and the shape (lines, samples)")
        return Image(id or "image", camera, (source.shape[1], source.shape[0]), raster=ArrayRaster(source))
    image = source if isinstance(source, Image) else open_image(source)
    if camera is None and (doubt := placement_doubt(image)):
        _log.warning(f"{image.id}: {doubt}")
    return replace(image, rpc=camera or image.rpc, id=id or image.id)


def _camera_of(given: Any) -> RPC | None:
    """Return a given RPC, or that of an object with an RPC: an image, or a result of `read_rpc`; else None."""
    if hasattr(given, "line_num_coeff") and hasattr(given, "samp_off"):  # rasterio's: ``dataset.rpcs``
        return RPC.from_rasterio(given)
    inner = given if isinstance(given, RPC) else getattr(given, "rpc", None)
    return inner if isinstance(inner, RPC) else None


def _image(given: Any) -> str:
    """Return the path of an image, also of one in memory: a path object with its name."""
    if (camera := _camera_of(given)) is None:
        return path_of(given)
    return ImageInMemory(given if isinstance(given, Image) else Image("image", camera, getattr(given, "size", None)))


#: Conversion of a value by the kind of its option; other kinds are unchanged. Images in memory keep their names.
TAKEN: dict[Kind, Callable[[Any], Any]] = {
    Kind.IMAGES: lambda given: [_image(one) for one in (given if isinstance(given, (list, tuple)) else [given])],
    Kind.RASTER: path_of,
    Kind.POINTS: lambda given: given if isinstance(given, (str, os.PathLike)) else PointsInMemory(given),
}


def convert_options(algorithm: Algorithm, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by keyword, converted to the types of their declaration.

    None in ``given`` means not given. A `Block` given as images adds its points.
    """
    kinds = {param.key: param.kind for param in algorithm.params}
    options = {key: _convert_results(value, kinds.get(key)) for key, value in given.items() if value is not None}
    if isinstance(block := options.get("images"), Block):
        # Its known points and all its measurements, as the options for them
        known, rows = block.points.select(block.known), block.measurements
        names = np.array([image.id for image in block.images])
        ids = block.points.ids[rows.point]
        measured = ImagePoints(ids, names[rows.image], rows.xy, rows.sigma_px, rows.kind, rows.quality)
        brought = {**({"gcps": known} if len(known) else {}), "image_points": measured}
        options = {key: brought[key] for key in brought if key in kinds} | options | {"images": block.images}
    return {
        key: TAKEN[kinds[key]](value) if key in kinds and kinds[key] in TAKEN else value
        for key, value in options.items()
    }


def _convert_results(given: Any, kind: Kind | None) -> Any:
    """Return a value with results replaced by their folders, or by the images that they wrote."""
    if isinstance(given, Mapping) and kind is Kind.FOLDERS:
        return {
            name: FolderOfRpcs(one) if isinstance(one, Mapping) else _convert_results(one, kind)
            for name, one in given.items()
        }
    if not isinstance(given, Result):
        return given
    if kind is Kind.PROJECT and "project" in given.report:
        return given.report["project"]
    if kind is Kind.IMAGES and given.is_project:
        given = given.step("triangulate")
    written = find_image_outputs(given.report, given.folder) if kind is Kind.IMAGES else {}
    return list(written.values()) or str(given.folder)


class FolderOfRpcs(str):
    """A temporary folder with an RPC file of each camera, by image id; it is deleted with this path object."""

    __slots__ = ("kept",)
    kept: TemporaryDirectory[str]

    def __new__(cls, rpcs: Mapping[str, RPC]) -> "FolderOfRpcs":
        """Write the files into a new folder."""
        kept = TemporaryDirectory(prefix="hrsi-")
        for name, rpc in rpcs.items():
            write_rpc_text(os.path.join(kept.name, f"{name}_RPC.TXT"), rpc)
        made = super().__new__(cls, kept.name)
        made.kept = kept
        return made


#: Algorithms whose results are files for later use: they need a folder of the caller.
MAKES_FILES = frozenset({"simulate", "crop", "strip"})
#: Options of a temporary result: virtual images with the refined RPCs, no copies of pixels, no report page.
BRIEF = {"write": "vrt", "report": False}
#: Options that give the height of the ground for points in arrays.
TERRAIN = tuple(param.key for param in params_of(TerrainOptions))
PYTHON = OptionSpelling(lambda param: param.key, "help(hrsi.{name})")
_OPTION = re.compile(r"--([a-z][a-z0-9-]*)")


def make_call(algorithm: Algorithm) -> Callable[..., Result]:
    """Return the function that runs a declared algorithm: its options are the parameters; it returns a `Result`."""
    signature = signature_of(algorithm)
    asked = {param.key: param.required for param in algorithm.params}
    needs_folder = asked.get("output_dir", False) and algorithm.name not in MAKES_FILES
    brief = {key: value for key, value in BRIEF.items() if key in asked}

    def call(*positional: Any, **named: Any) -> Result:
        try:
            given = signature.bind(*positional, **named).arguments
        except TypeError as error:
            unknown = [
                f"{key}{suggestion(key, signature.parameters)}" for key in named if key not in signature.parameters
            ]
            reason = f" has no parameter {unknown[0]}" if unknown else f": {error}"
            raise TypeError(f"hrsi.{call.__name__}{reason}") from None
        progress: Progress = given.pop("progress", None) or silent
        context = Context(progress, lambda text: _log.info(_spell_message(text, algorithm)))
        kept = None
        try:
            options = convert_options(algorithm, given)
            if needs_folder and "output_dir" not in options:
                kept = TemporaryDirectory(prefix="hrsi-")
                options = {**brief, **options, "output_dir": kept.name, "overwrite": True}
            report = algorithm.execute(check_options(algorithm, options, PYTHON), context)
        except HrsiError as error:  # with the names of the parameters
            raise type(error)(_spell_message(str(error), algorithm)) from error.__cause__
        tables = [value.points for value in options.values() if isinstance(value, PointsInMemory)]
        return Result(report, options.get("output_dir") or report.get("folder"), kept, tables)

    call.__name__ = call.__qualname__ = function_name(algorithm.name)
    call.__doc__ = describe_call(algorithm)
    call.__signature__ = signature  # type: ignore[attr-defined]
    call.__module__ = __name__
    return call


def _spell_message(text: str, algorithm: Algorithm) -> str:
    """Return a message with the options replaced by the names of the parameters."""
    keys = {param.name: param.key for param in algorithm.params}
    spelt = spell_arguments(text, algorithm.params, lambda param: param.key)
    return _OPTION.sub(lambda found: keys.get(found[1], found[0]), spelt)


# ---- points in arrays ------------------------------------------------------------------------------------------------


def project(images: Any, points: Any, **options: Any) -> Any:
    """Return the positions of ground points in an image; arrays give arrays.

    Parameters
    ----------
    images : image, or several with a table
        As for `open`, or its result.
    points : (n, 3) or (n, 2) array, table, or file
        Lon, lat in degrees and ellipsoidal height; without heights, ``height`` or ``dem`` gives that of the ground.
        Tables and files as for the command line.
    **options : Any
        ``height``, ``dem``, ``dem_datum``, ``height_datum``; with a table or a file every option of ``hrsi project``.

    Returns
    -------
    (n, 2) ndarray or Result
        Sample, line in pixels, (0, 0) is the centre of the first pixel; NaN if a point has no image position. For a
        table or a file a `Result`, whose `Result.points` has the columns id, image, sample, line.

    Raises
    ------
    HrsiError
        Points without height if the height of the ground is not given; longitude and latitude exchanged.
    """
    if not _is_array(points):
        return DECLARED["project"](images, points=points, **options)
    image, ground, surface = _read_array_call("project", images, points, options, "lon, lat and height")
    if ground.shape[1] == 2:
        ground = np.column_stack([ground, np.full(len(ground), np.nan)])
    without = np.isnan(ground[:, 2])
    if without.any() and surface is None:
        raise InputError("points have no heights: give (n, 3), or height or dem")
    if without.any() and surface is not None:
        ground = ground.copy()
        ground[without, 2] = surface_heights(surface, ground[without, :2])
    require_axes_in_order([image], ground)
    found = image.rpc.project(ground)
    return found[0] if np.ndim(points) == 1 else found


def localize(images: Any, points: Any, **options: Any) -> Any:
    """Return the intersections of the rays of image points with the ground; arrays give arrays.

    Parameters
    ----------
    images : image, or several with a table
        As for `open`, or its result.
    points : (n, 2) or (n, 3) array, table, or file
        Sample and line in pixels, (0, 0) is the centre of the first pixel; with an ellipsoidal height each, or
        ``height`` or ``dem``. Tables and files as for the command line.
    **options : Any
        ``height``, ``dem``, ``dem_datum``, ``height_datum``; with a table or a file every option of ``hrsi localize``.

    Returns
    -------
    (n, 3) ndarray or Result
        Lon, lat in degrees, ellipsoidal height in metres; NaN if a ray does not meet the ground. For a table or a file
        a `Result`, whose `Result.points` has the columns id, image, lon, lat, height, status.

    Raises
    ------
    HrsiError
        Points without height if the height of the ground is not given.
    """
    if not _is_array(points):
        return DECLARED["localize"](images, points=points, **options)
    image, places, surface = _read_array_call("localize", images, points, options, "sample, line and height")
    if places.shape[1] == 3:
        found = image.rpc.localize(places[:, :2], places[:, 2]).ground
    elif surface is None:
        raise InputError("points have no heights: give (n, 3), or height or dem")
    else:
        found = intersect_surface(image.rpc, places, surface).ground
    return found[0] if np.ndim(points) == 1 else found


def _is_array(points: Any) -> bool:
    """Return whether points are numbers without names: an array, or a list of numbers or of rows."""
    if isinstance(points, (list, tuple)):
        return bool(len(points)) and not isinstance(points[0], (str, os.PathLike))
    return isinstance(points, np.ndarray) and points.dtype.names is None


def _read_array_call(
    name: str, images: Any, points: Any, options: dict[str, Any], what: str
) -> tuple[Image, np.ndarray, HeightSurface | None]:
    """Return the image, the points ``(n, 2 or 3)``, described by ``what``, and the ground surface of the options."""
    one = images[0] if isinstance(images, (list, tuple)) and len(images) == 1 else images
    if isinstance(one, (list, tuple)):
        raise InputError("an array of points belongs to one image: give one, or a table with the column image")
    image = Image("image", one) if isinstance(one, RPC) else open(one)
    given = np.asarray(points, dtype=np.float64)
    rows = np.atleast_2d(given)
    if rows.ndim != 2 or rows.shape[1] not in (2, 3):
        raise InputError(f"points has the shape {given.shape}: give (n, 2 or 3), {what}")
    if unknown := [key for key in options if key not in TERRAIN]:
        raise InputError(f"{name} of arrays has no parameter {unknown[0]}: it has {', '.join(TERRAIN)}")
    algorithm = REGISTRY[name]
    checked = check_options(algorithm, convert_options(algorithm, {"images": "image", **options}), PYTHON)
    return image, rows, open_terrain(fill_options(TerrainOptions, checked))


#: Functions whose names differ from those of their algorithms.
RENAMED = {"refine-rpc": "refine"}
PROGRESS = "progress"


def function_name(algorithm: str) -> str:
    """Return the name of the function of an algorithm."""
    return RENAMED.get(algorithm, algorithm.replace("-", "_"))


def signature_of(algorithm: Algorithm) -> inspect.Signature:
    """Return the signature: required parameters may be positional, all others are keywords."""
    parameters = [
        inspect.Parameter(
            param.key,
            inspect.Parameter.POSITIONAL_OR_KEYWORD if _is_first(param) else inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if _is_needed(param) else param.default,
        )
        for param in sort_parameters(algorithm)
    ]
    return inspect.Signature([*parameters, inspect.Parameter(PROGRESS, inspect.Parameter.KEYWORD_ONLY, default=None)])


def sort_parameters(algorithm: Algorithm) -> list[Param]:
    """Return the options, with those first that may be positional, the required ones before the others."""
    return sorted(
        algorithm.params, key=lambda param: (not _is_first(param), not (_is_first(param) and _is_needed(param)))
    )


def _is_first(param: Param) -> bool:
    return _is_needed(param) or param.kind in POSITIONAL_KINDS


def _is_needed(param: Param) -> bool:
    return param.required and param.kind is not Kind.OUTPUT_DIR


def describe_call(algorithm: Algorithm) -> str:
    """Return the docstring of an algorithm's function, in NumPy's sections."""
    told = spell_arguments(algorithm.help, algorithm.params, lambda param: f"``{param.key}``")
    entries: list[str] = []
    for param in sort_parameters(algorithm):
        text = spell_arguments(param.help, algorithm.params, lambda other: f"``{other.key}``")
        facts = [fact for fact in value_facts(param) if fact != "required"]
        kind = " or ".join(KINDS[param.kind].described.split(" | "))
        entries.append(f"{param.key} : {kind}{'' if _is_needed(param) else ', optional'}")
        entries += _wrap_text(f"{text} ({'; '.join(facts)})." if facts else f"{text}.", "    ")
    given = any(param.key == "output_dir" for param in algorithm.params)
    folder_note = "Without ``output_dir`` they go when the result does." if given else ""
    wrapped, described = "\n".join(_wrap_text(told, "")), "\n".join(entries)
    return f"""{algorithm.summary}.

{wrapped}

Parameters
----------
{described}
{PROGRESS} : callable, optional
    Called with a fraction and a message; False cancels.

Returns
-------
Result
    The report, its tables and files. {folder_note}

Raises
------
HrsiError
    What is wrong with the input, and what to do about it.
"""


def _wrap_text(text: str, indent: str) -> list[str]:
    """Return the lines of paragraphs, with an empty line between them."""
    wrapped = [textwrap.fill(part, 100, initial_indent=indent, subsequent_indent=indent) for part in text.split("\n\n")]
    return "\n\n".join(wrapped).splitlines()


DECLARED = {function_name(name): make_call(algorithm) for name, algorithm in REGISTRY.items()}


def __getattr__(name: str) -> Any:
    """Return the function of an algorithm."""
    if name not in DECLARED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return DECLARED[name]

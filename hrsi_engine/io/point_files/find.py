"""Choice of the reader of a point file; reads it as points, or as positions in images, which need no ids."""

import glob
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...foundation.errors import InputError
from ...foundation.options import InMemory
from ...ground.operation_uses import OperationUse
from ..opening.budgets import require_heights
from ..opening.datasets import check_advice, require_plain_around
from . import csv_text, gcp_files, match_files, ogr_layer
from .in_memory import PointsInMemory
from .interpret import PointTables, image_names, interpret, require_field
from .kept_columns import read_columns, read_complete_table
from .positions import Reference, Surface, ground_positions, has_positions
from .table import FIELDS, PointReader, PointTable, match_fields

#: Formats of point files in the order in which they are tried; the last two need to open the file.
POINT_READERS: dict[str, PointReader] = {
    "micmac": match_files.MICMAC_TIE_POINTS,
    "micmac-homol": match_files.MICMAC_HOMOL,
    "asp-match-text": match_files.ASP_TEXT_MATCHES,
    "metashape": gcp_files.METASHAPE_REFERENCE,
    "orthoengine": gcp_files.ORTHOENGINE_TEXT,
    "qgis-points": gcp_files.QGIS_POINTS,
    "envi": gcp_files.ENVI_GCPS,
    "csv": csv_text.READER,
    "asp-gcp": gcp_files.ASP_GCPS,
    "asp-match": match_files.ASP_MATCHES,
    "colmap": match_files.COLMAP_DATABASE,
    "sat-bundleadjust": match_files.SAT_BUNDLEADJUST,
    "hloc": match_files.HLOC_MATCHES,
    "orthority": gcp_files.ORTHORITY_GCPS,
    "ogr": ogr_layer.READER,
    "image-gcps": gcp_files.IMAGE_GCPS,
}


def read_points(
    spec: str,
    *,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    image_ids: Sequence[str] = (),
    surface: Surface | None = None,
    adjusted: bool = False,
    epoch: float | None = None,
    surface_operations: tuple[OperationUse, ...] = (),
) -> PointTables:
    """Return the ground points and the image points of a file.

    Parameters
    ----------
    spec : str
        ``FILE``, ``FILE|layername=L`` or, as QGIS writes it, ``FILE|layerid=0``; ``FILE|columns=id=nr,sigma_h=sH``
        names fields of a layer or CSV to be used, ``FILE|image=ID`` the image of all measurements if the file does not
        state it, ``MATCHES.h5|features=FILE`` the file of the matched keypoints. Or `PointsInMemory`.
    ground_crs : str, optional
        CRS of positions in a file that states none, anything PROJ reads.
    height_datum : str
        ``layer`` (as the CRS states), ``ellipsoidal``, ``egm96``, ``egm2008`` or a geoid grid file.
    image_ids : sequence of str
        Ids of the block's images; an image given by file name or path gets the matching id.
    surface : callable, optional
        Ellipsoidal heights (n,) at lon, lat (n, 2), for points without a height.
    adjusted : bool
        Whether points of HRSI's own layers get their adjusted positions instead of the surveyed ones.
    epoch : float, optional
        Year at which coordinates in a plate-fixed CRS are transformed to WGS84.
    surface_operations : tuple of OperationUse
        Operations that transformed the surface to WGS84; points with heights from the surface share their error.

    Returns
    -------
    PointTables
        The ground points and the image points.

    Raises
    ------
    InputError
        With file, layer, row, field or id, and the remedy.
    """
    reference = Reference(ground_crs or "", height_datum, surface, adjusted, epoch, surface_operations)
    if isinstance(spec, PointsInMemory):
        return spec.tables(reference, image_ids)
    table = read_table(spec)
    image = _parse_options(spec).get("image")
    if image is not None:
        # All points of the table are measured in one image
        if "image" in {*match_fields(table.field_names), *choose_fields(spec)} or table.pairwise:
            raise InputError(f"{table.source}: has the image of each point in a field: remove |image=")
        if image not in image_ids:
            names = ", ".join(image_ids) or "none"
            raise InputError(f"{table.source}: |image={image} is not in the block (images: {names}): correct it")
        table = replace(table, columns=table.columns | {"image": np.full(len(table), image)})
        measured = [np.isfinite(table.columns[name]) for name in ("sample", "line") if name in table.columns]
        if len(measured) == 2 and not (rows := measured[0] | measured[1]).all():  # points that others of the files have
            table = table.select(rows)
    return interpret(table, reference, image_ids)


def read_image_points(spec: str, *, image_ids: Sequence[str] = (), **reference: Any) -> PointTables:
    """Return the image points of a file: as `read_points`, but from the column cache of a GeoPackage if it is valid.

    Ground points are returned only if they were read with them; ``reference`` are further options of `read_points`.
    """
    if not isinstance(spec, PointsInMemory) and not {"image", "chosen"} & _parse_options(spec).keys():
        stored = read_columns(*split_spec(spec), image_ids)
        if stored is not None:
            return stored
    return read_points(spec, image_ids=image_ids, **reference)


def several_specs(text: str) -> list[str]:
    """Return the files of a text ``FILE[|…][;FILE[|…]…]``, with wildcards replaced by the matching files.

    Raises `InputError` if there is none.
    """
    if isinstance(text, InMemory):
        return [text]
    text = str(text)
    path, _, remaining = text.partition("|")
    if os.path.exists(path) and ";" not in remaining:  # a file name may contain the separator
        return [text]
    specs = []
    for part in filter(None, map(str.strip, text.split(";"))):
        path, bar, remaining = part.partition("|")
        result = [path] if os.path.exists(path) or not glob.has_magic(path) else sorted(glob.glob(path))
        if not result:
            raise InputError(f"{path}: no file has such a name: check the path")
        specs += [f"{name}{bar}{remaining}" for name in result]
    return specs


def split_spec(spec: str) -> tuple[str, str]:
    """Return file and layer (its name, ``#number``, or empty) of a point file as the user names it.

    For matches with keypoints in another file, that file is returned instead of the layer.
    """
    options = _parse_options(spec)
    if "columns" in options:
        return str(spec).split("|")[0], csv_text.NAMED_COLUMNS + options["columns"]
    number = f"#{options['layerid']}" if "layerid" in options else ""
    return str(spec).split("|")[0], options.get("features", options.get("layername", number))


def _parse_options(spec: str) -> dict[str, str]:
    """Return the options after the file name, ``|layername=L|image=ID``; ``chosen`` are fields by HRSI's names."""
    options = dict[str, str]()
    for part in str(spec).split("|")[1:]:
        key, _, value = part.partition("=")
        option_names = ("layername", "layerid", "geometrytype", "image", "features", "columns")
        if key.lower() not in option_names or not value:
            raise InputError(
                f"{spec}: {part!r} is not understood: write FILE, FILE|layername=LAYER, FILE|image=ID, "
                "FILE|columns=NAME,NAME,…, FILE|columns=id=NAME,sigma_h=NAME,… or MATCHES.h5|features=FILE"
            )
        if key.lower() == "columns" and "=" in value:
            key, value = "chosen", ",".join(filter(None, [options.get("chosen"), value]))
        options[key.lower()] = value
    return options


def choose_fields(spec: str) -> dict[str, str]:
    """Return the file's names of the fields that ``|columns=id=nr,sigma_h=sH`` chooses, by HRSI's names.

    Raises `InputError` for a field that HRSI does not have.
    """
    fields_given = {}
    for part in filter(None, re.split(r",(?=\s*\w+\s*=)", _parse_options(spec).get("chosen", ""))):
        field, _, name = map(str.strip, part.partition("="))
        valid = next(iter(match_fields([field])), None)
        if valid is None or not name:
            raise InputError(
                f"{spec}: {part!r} behind |columns= chooses no field of points: write FIELD=NAME, with a field of "
                f"{', '.join(list(FIELDS)[:17])} … and its name in the file"
            )
        fields_given[valid] = name
    return fields_given


def read_table(spec: str) -> PointTable:
    """Return the rows of a point file as returned by its reader, unchecked."""
    path, layer = split_spec(spec)
    if (complete := read_complete_table(path, layer)) is not None:
        return complete
    # The reader of a file; raise `InputError` if there is no such file or no format matches
    require_plain_around(path)
    head = b""
    if not path or not (path.startswith("/vsi") or os.path.exists(path)):
        raise InputError(f"{path or 'point file'}: no such file: check the path")
    if os.path.isfile(path):
        try:
            with open(path, "rb") as file:
                head = file.read(65536)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}): check its permissions") from None
    name = os.path.basename(path).lower()
    columns, readers = layer.removeprefix(csv_text.NAMED_COLUMNS).split(","), POINT_READERS.values()
    names = (reader for reader in readers if reader.is_named_by(columns))
    reader = next(names, None) or next((reader for reader in readers if reader.recognises(path, name, head)), None)
    if reader is None:
        titles = ", ".join(reader.title for reader in readers)
        advice = check_advice(path, "convert it to GeoPackage or CSV")
        raise InputError(f"{path}: is no point file that is known ({titles}): {advice}")
    if not (fields_given := choose_fields(spec)):
        return reader.read(path, layer)
    if not reader.chooses_fields:
        raise InputError(f"{path}: the fields of the format {reader.title} have fixed names: remove |columns=")
    return reader.read(path, layer, fields_given)


class ImagePositions(NamedTuple):
    """Positions to localize: ids and image ids (n,) str, sample and line (n, 2), ellipsoidal height (n,) or NaN."""

    ids: np.ndarray
    image_ids: np.ndarray
    image: np.ndarray
    height_m: np.ndarray


class Correspondences(NamedTuple):
    """Ground points (n, 3) lon, lat, ellipsoidal height, their positions in one image (n, 2), and warnings.

    ``operations`` transformed the ground points to WGS84.
    """

    ground: np.ndarray
    image: np.ndarray
    warnings: tuple[str, ...]
    operations: tuple[OperationUse, ...] = ()


def read_image_positions(spec: str, image_ids: Sequence[str]) -> ImagePositions:
    """Return the rows of a file with the fields sample and line, and image and height if it has them.

    Rows without an id are numbered from 1. Raises `InputError` with file, row and field.
    """
    table, image = _read_sample_line(spec)
    ids = table.columns.get("id", np.arange(1, len(table) + 1).astype(str))
    height = table.columns.get("height", np.full(len(table), np.nan))
    return ImagePositions(ids, np.asarray(image_names(table, image_ids)), image, height)


def read_correspondences(spec: str, *, ground_crs: str | None = None, height_datum: str = "layer") -> Correspondences:
    """Return the correspondences of a file with positions (geometry, lon and lat, x and y), heights, sample and line.

    Raises `InputError` with file, row and field.
    """
    table, image = _read_sample_line(spec)
    if not has_positions(table):
        raise InputError(f"{table.source}: has no ground positions (point geometry, lon and lat, x and y): add them")
    placed = ground_positions(table, Reference(ground_crs or "", height_datum))
    table.refuse(np.isnan(placed.ground).any(axis=1), "has no ground position: fill it in, or remove the row")
    require_heights(placed.ground[:, 2], table.name_row)
    return Correspondences(placed.ground, image, (*table.notes, *placed.warnings), placed.operations)


def _read_sample_line(spec: str) -> tuple[PointTable, np.ndarray]:
    """Return the rows of a file and their sample and line ``(n, 2)``, which every row must have."""
    table = spec.table() if isinstance(spec, PointsInMemory) else read_table(spec)
    if not len(table):
        raise InputError(f"{table.source}: contains no points: add some, or name another layer")
    image = np.column_stack([require_field(table, "sample"), require_field(table, "line")])
    table.refuse(np.isnan(image).any(axis=1), "sample or line is empty: fill it in, or remove the row")
    return table, image

"""Which reader a point file takes; reading it as points, or as positions in images, for which ids are not needed."""

import glob
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...foundation.errors import InputError
from ...foundation.options import InMemory
from ...ground.operation_uses import OperationUse
from ..opening.budgets import require_heights
from ..opening.datasets import check_advice
from ..opening.plain_files import require_plain_around
from . import csv_text, gcp_files, gcp_texts, match_files, micmac_files, ogr_layer
from .in_memory import PointsInMemory
from .interpret import PointTables, image_names, interpret, require_field
from .kept_columns import read_columns
from .positions import Reference, Surface, ground_positions, has_positions
from .table import FIELDS, PointReader, PointTable, match_fields

#: Formats of point files in the order in which they are tried; the last two open the file to see.
POINT_READERS: dict[str, PointReader] = {
    "micmac": micmac_files.MICMAC_TIE_POINTS,
    "micmac-homol": micmac_files.MICMAC_HOMOL,
    "asp-match-text": match_files.ASP_TEXT_MATCHES,
    "metashape": gcp_texts.METASHAPE_REFERENCE,
    "orthoengine": gcp_texts.ORTHOENGINE_TEXT,
    "qgis-points": gcp_files.QGIS_POINTS,
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
    spec: str, *, ground_crs: str | None = None, height_datum: str = "layer", image_ids: Sequence[str] = (),
    surface: Surface | None = None, adjusted: bool = False, epoch: float | None = None,
    surface_operations: tuple[OperationUse, ...] = (),
) -> PointTables:  # fmt: skip
    """Return the ground points and the image points of a file.

    Parameters
    ----------
    spec : str
        ``FILE``, ``FILE|layername=L`` or, as QGIS writes it, ``FILE|layerid=0``; ``FILE|columns=id=nr,sigma_h=sH`` says
        which fields of a layer or CSV are meant, ``FILE|image=ID`` on which image the points were measured, where the
        file does not say it, ``MATCHES.h5|features=FILE`` which keypoints are matched. Or `PointsInMemory`.
    ground_crs : str, optional
        CRS of positions in a file that names none, anything PROJ reads.
    height_datum : str
        ``layer`` (what the CRS says), ``ellipsoidal``, ``egm96``, ``egm2008`` or a geoid grid file.
    image_ids : sequence of str
        Ids of the block's images; an image named by file name or path gets the id that fits.
    surface : callable, optional
        Ellipsoidal heights (n,) at lon, lat (n, 2), for points without a height.
    adjusted : bool
        Whether points of HRSI's own layers lie where the adjustment put them, not where they were surveyed.
    epoch : float, optional
        Year in which a CRS fixed to a plate is brought to WGS84.
    surface_operations : tuple of OperationUse
        How the surface came to WGS84; points that it gives heights share their error.

    Returns
    -------
    PointTables
        The ground points and the image points.

    Raises
    ------
    InputError
        Names file, layer, row, field or id, and what to do.
    """
    reference = Reference(ground_crs or "", height_datum, surface, adjusted, epoch, surface_operations)
    if isinstance(spec, PointsInMemory):
        return spec.tables(reference, image_ids)
    table = read_table(spec)
    image = _parse_options(spec).get("image")
    if image is not None:
        # The table with all points measured on one image
        if "image" in {*match_fields(table.field_names), *choose_fields(spec)} or table.pairwise:
            raise InputError(f"{table.source}: has the image of each point in a field: remove |image=")
        if image not in image_ids:
            listed = ", ".join(image_ids) or "none"
            raise InputError(f"{table.source}: |image={image} is not in the block (images: {listed}): correct it")
        table = replace(table, columns=table.columns | {"image": np.full(len(table), image)})
    return interpret(table, reference, image_ids)


def read_image_points(
    spec: str, *, ground_crs: str | None = None, height_datum: str = "layer", image_ids: Sequence[str] = (),
    surface: Surface | None = None, epoch: float | None = None,
) -> PointTables:  # fmt: skip
    """Return the image points of a file: as `read_points`, but from the column cache of a GeoPackage where it is valid.

    It has ground points only where they were read with them.
    """
    if not isinstance(spec, PointsInMemory) and not {"image", "chosen"} & _parse_options(spec).keys():
        kept = read_columns(*split_spec(spec), image_ids)
        if kept is not None:
            return kept
    return read_points(
        spec, ground_crs=ground_crs, height_datum=height_datum, image_ids=image_ids, surface=surface, epoch=epoch
    )


def several_specs(text: str) -> list[str]:
    """Return the files of a text ``FILE[|…][;FILE[|…]…]``, wildcards in names replaced by the files that fit.

    Raises `InputError` where none does.
    """
    if isinstance(text, InMemory):
        return [text]
    text = str(text)
    path, _, rest = text.partition("|")
    if os.path.exists(path) and ";" not in rest:  # a name may hold what else would be a separator
        return [text]
    specs = []
    for part in filter(None, map(str.strip, text.split(";"))):
        path, bar, rest = part.partition("|")
        found = [path] if os.path.exists(path) or not glob.has_magic(path) else sorted(glob.glob(path))
        if not found:
            raise InputError(f"{path}: no file has such a name: check the path")
        specs += [f"{name}{bar}{rest}" for name in found]
    return specs


def split_spec(spec: str) -> tuple[str, str]:
    """Return file and layer (its name, ``#number``, or empty) of a point file as the user names it.

    Of matches that point at keypoints of another file, that file is what has the place of the layer.
    """
    options = _parse_options(spec)
    if "columns" in options:
        return str(spec).split("|")[0], csv_text.NAMED_COLUMNS + options["columns"]
    number = f"#{options['layerid']}" if "layerid" in options else ""
    return str(spec).split("|")[0], options.get("features", options.get("layername", number))


def _parse_options(spec: str) -> dict[str, str]:
    """Return what stands behind the file name: ``|layername=L|image=ID``; ``chosen`` are columns with names of ours."""
    options = dict[str, str]()
    for part in str(spec).split("|")[1:]:
        key, _, value = part.partition("=")
        known = ("layername", "layerid", "geometrytype", "image", "features", "columns")
        if key.lower() not in known or not value:
            raise InputError(
                f"{spec}: {part!r} is not understood: write FILE, FILE|layername=LAYER, FILE|image=ID, "
                "FILE|columns=NAME,NAME,…, FILE|columns=id=NAME,sigma_h=NAME,… or MATCHES.h5|features=FILE"
            )
        if key.lower() == "columns" and "=" in value:
            key, value = "chosen", ",".join(filter(None, [options.get("chosen"), value]))
        options[key.lower()] = value
    return options


def choose_fields(spec: str) -> dict[str, str]:
    """Return the file's names of the fields that ``|columns=id=nr,sigma_h=sH`` chooses, by ours.

    Raises `InputError` for a field that is none of ours.
    """
    chosen = {}
    for part in filter(None, re.split(r",(?=\s*\w+\s*=)", _parse_options(spec).get("chosen", ""))):
        field, _, name = map(str.strip, part.partition("="))
        known = next(iter(match_fields([field])), None)
        if known is None or not name:
            raise InputError(
                f"{spec}: {part!r} behind |columns= chooses no field of points: write FIELD=NAME, with a field of "
                f"{', '.join(list(FIELDS)[:17])} … and its name in the file"
            )
        chosen[known] = name
    return chosen


def read_table(spec: str) -> PointTable:
    """Return the rows of a point file as its reader brings them, unchecked."""
    path, layer = split_spec(spec)
    # The reader of a file; raise `InputError` where there is no such file or no format fits
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
    named = (reader for reader in readers if reader.is_named_by(columns))
    reader = next(named, None) or next((reader for reader in readers if reader.recognises(path, name, head)), None)
    if reader is None:
        titles = ", ".join(reader.title for reader in readers)
        advice = check_advice(path, "convert it to GeoPackage or CSV")
        raise InputError(f"{path}: is no point file that is known ({titles}): {advice}")
    if not (chosen := choose_fields(spec)):
        return reader.read(path, layer)
    if not reader.chooses_fields:
        raise InputError(f"{path}: the fields of the format {reader.title} have fixed names: remove |columns=")
    return reader.read(path, layer, chosen)


class ImagePositions(NamedTuple):
    """Positions to localize: ids and image ids (n,) str, sample and line (n, 2), ellipsoidal height (n,) or NaN."""

    ids: np.ndarray
    image_ids: np.ndarray
    image: np.ndarray
    height_m: np.ndarray


class Correspondences(NamedTuple):
    """Ground points (n, 3) lon, lat, ellipsoidal height, where they are in one image (n, 2), and warnings.

    ``operations`` brought the ground points to WGS84.
    """

    ground: np.ndarray
    image: np.ndarray
    warnings: tuple[str, ...]
    operations: tuple[OperationUse, ...] = ()


def read_image_positions(spec: str, image_ids: Sequence[str]) -> ImagePositions:
    """Return the rows of a file with the fields sample and line, and image and height where it has them.

    Rows without an id are numbered from 1. Raises `InputError` naming file, row and field.
    """
    table, image = _read_sample_line(spec)
    rows = np.arange(len(table))
    ids = table.columns.get("id", (rows + 1).astype(str))
    height = table.columns.get("height", np.full(len(table), np.nan))
    return ImagePositions(ids, np.asarray(image_names(table, rows, image_ids)), image, height)


def read_correspondences(
    spec: str, *, ground_crs: str | None = None, height_datum: str = "layer", epoch: float | None = None
) -> Correspondences:
    """Return the correspondences of a file with positions (geometry, lon and lat, x and y), heights, sample and line.

    Raises `InputError` naming file, row and field.
    """
    table, image = _read_sample_line(spec)
    if not has_positions(table):
        raise InputError(f"{table.source}: has no ground positions (point geometry, lon and lat, x and y): add them")
    placed = ground_positions(table, Reference(ground_crs or "", height_datum, epoch=epoch))
    missing = np.flatnonzero(np.isnan(placed.ground).any(axis=1))
    if missing.size:
        raise InputError(f"{table.name_row(missing[0])}: has no ground position: fill it in, or remove the row")
    require_heights(placed.ground[:, 2], table.name_row)
    return Correspondences(placed.ground, image, (*table.notes, *placed.warnings), placed.operations)


def _read_sample_line(spec: str) -> tuple[PointTable, np.ndarray]:
    """Return the rows of a file and their sample and line ``(n, 2)``, which all of them must have."""
    table = spec.table() if isinstance(spec, PointsInMemory) else read_table(spec)
    if not len(table):
        raise InputError(f"{table.source}: contains no points: add some, or name another layer")
    image = np.column_stack([require_field(table, "sample"), require_field(table, "line")])
    missing = np.flatnonzero(np.isnan(image).any(axis=1))
    if missing.size:
        raise InputError(f"{table.name_row(missing[0])}: sample or line is empty: fill it in, or remove the row")
    return table, image

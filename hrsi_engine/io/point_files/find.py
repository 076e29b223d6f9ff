"""Which reader a point file takes, and reading it."""

from __future__ import annotations

import os
from collections.abc import Sequence

from ...errors import InputError
from . import asp_gcp, csv_text, image_gcps, ogr_layer, orthority, qgis_points
from .interpret import PointTables, interpret
from .positions import Reference, Surface
from .table import Reader

#: Formats of point files in the order in which they are tried; the last two open the file to see.
READERS: dict[str, Reader] = {
    "csv": csv_text.READER,
    "qgis-points": qgis_points.READER,
    "asp-gcp": asp_gcp.READER,
    "orthority": orthority.READER,
    "ogr": ogr_layer.READER,
    "image-gcps": image_gcps.READER,
}
_HEAD_BYTES = 65536


def read_points(
    spec: str,
    *,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    image_ids: Sequence[str] = (),
    surface: Surface | None = None,
) -> PointTables:
    """Return the ground points and the image points of a file.

    Parameters
    ----------
    spec : ``FILE``, ``FILE|layername=L`` or, as QGIS writes it, ``FILE|layerid=0``
    ground_crs : CRS of positions in a file that names none, anything PROJ reads
    height_datum : ``layer`` (what the CRS says), ``ellipsoidal``, ``egm96``, ``egm2008`` or a geoid grid file
    image_ids : ids of the block's images; an image named by file name or path gets the id that fits
    surface : ellipsoidal heights (n,) at lon, lat (n, 2), for points without a height

    Raises
    ------
    InputError
        Names file, layer, row, field or id, and what to do.
    """
    path, layer = split_spec(spec)
    table = reader_of(path).read(path, layer)
    return interpret(table, Reference(ground_crs or "", height_datum, surface), image_ids)


def split_spec(spec: str) -> tuple[str, str]:
    """Return file and layer (its name, ``#number``, or empty) of a point file as the user names it."""
    path, *parts = str(spec).split("|")
    layer = ""
    for part in parts:
        key, _, value = part.partition("=")
        if key.lower() not in ("layername", "layerid", "geometrytype") or not value:
            raise InputError(f"{spec}: {part!r} is not understood: write FILE or FILE|layername=LAYER")
        layer = {"layername": value, "layerid": f"#{value}"}.get(key.lower(), layer)
    return path, layer


def reader_of(path: str) -> Reader:
    """Return the reader of a file; raise `InputError` where there is no such file or no format fits."""
    head = b""
    if not path or not (path.startswith("/vsi") or os.path.exists(path)):
        raise InputError(f"{path or 'point file'}: no such file: check the path")
    if os.path.isfile(path):
        try:
            with open(path, "rb") as file:
                head = file.read(_HEAD_BYTES)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}): check its permissions") from None
    name = os.path.basename(path).lower()
    reader = next((reader for reader in READERS.values() if reader.recognises(path, name, head)), None)
    if reader is None:
        titles = ", ".join(reader.title for reader in READERS.values())
        raise InputError(f"{path}: is no point file that is known ({titles}): convert it to GeoPackage or CSV")
    return reader

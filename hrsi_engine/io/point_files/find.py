"""Which reader a point file takes, and reading it."""

import glob
import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...foundation.errors import InputError
from ...foundation.in_memory import InMemory
from ...ground.operation_uses import OperationUse
from ..opening.datasets import check_advice
from ..opening.plain_files import require_plain_around
from . import asp_gcp, asp_match, colmap, csv_text, hloc, image_gcps, micmac, ogr_layer, orthority, qgis_points
from .columns import match_fields
from .in_memory import PointsInMemory
from .interpret import PointTables, interpret
from .kept_columns import read_columns
from .positions import Reference, Surface
from .table import PointReader

#: Formats of point files in the order in which they are tried; the last two open the file to see.
POINT_READERS: dict[str, PointReader] = {
    "micmac": micmac.READER,
    "asp-match-text": asp_match.TEXT,
    "csv": csv_text.READER,
    "qgis-points": qgis_points.READER,
    "asp-gcp": asp_gcp.READER,
    "asp-match": asp_match.READER,
    "colmap": colmap.READER,
    "hloc": hloc.READER,
    "orthority": orthority.READER,
    "ogr": ogr_layer.READER,
    "image-gcps": image_gcps.READER,
}
_HEAD_BYTES = 65536
_SPEC_OPTIONS = ("layername", "layerid", "geometrytype", "image", "features")


def read_points(
    spec: str, *, ground_crs: str | None = None, height_datum: str = "layer", image_ids: Sequence[str] = (),
    surface: Surface | None = None, adjusted: bool = False, epoch: float | None = None,
    surface_operations: tuple[OperationUse, ...] = (),
) -> PointTables:  # fmt: skip
    """Return the ground points and the image points of a file.

    Parameters
    ----------
    spec : str
        ``FILE``, ``FILE|layername=L`` or, as QGIS writes it, ``FILE|layerid=0``; ``FILE|image=ID`` says on which image
        the points were measured, where the file does not say it, ``MATCHES.h5|features=FILE`` which keypoints are
        matched. Or `PointsInMemory`.
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
    path, layer = split_spec(spec)
    table = point_reader_of(path).read(path, layer)
    image = _parse_options(spec).get("image")
    if image is not None:
        # The table with all points measured on one image
        if "image" in match_fields(table.field_names) or table.pairwise:
            raise InputError(f"{table.source}: says itself on which image a point was measured: leave |image= out")
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
    if not isinstance(spec, PointsInMemory) and "image" not in _parse_options(spec):
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
    number = f"#{options['layerid']}" if "layerid" in options else ""
    return str(spec).split("|")[0], options.get("features", options.get("layername", number))


def _parse_options(spec: str) -> dict[str, str]:
    """Return what stands behind the file name: ``|layername=L|image=ID``."""
    options = {}
    for part in str(spec).split("|")[1:]:
        key, _, value = part.partition("=")
        if key.lower() not in _SPEC_OPTIONS or not value:
            raise InputError(
                f"{spec}: {part!r} is not understood: write FILE, FILE|layername=LAYER, FILE|image=ID or "
                "MATCHES.h5|features=FILE"
            )
        options[key.lower()] = value
    return options


def point_reader_of(path: str) -> PointReader:
    """Return the reader of a file; raise `InputError` where there is no such file or no format fits."""
    require_plain_around(path)
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
    reader = next((reader for reader in POINT_READERS.values() if reader.recognises(path, name, head)), None)
    if reader is None:
        titles = ", ".join(reader.title for reader in POINT_READERS.values())
        advice = check_advice(path, "convert it to GeoPackage or CSV")
        raise InputError(f"{path}: is no point file that is known ({titles}): {advice}")
    return reader

"""Text files of GCPs and tie points of other programs.

* Reference of Agisoft Metashape: ``# CoordinateSystem: WKT``, then the names of the columns behind another ``#``, the
  first of them Label: X/Easting (or X/Longitude, X), Y/Northing, Z/Altitude, accuracies in metres, and, of an export,
  errors and estimated positions, which are not used; rows end where nothing follows. Columns are separated by commas,
  semicolons, tabs or blanks. Pixels are not in it.
* OrthoEngine of PCI (CATALYST): a point a line, its fields separated by blanks, tabs or commas and quoted where they
  hold such, and their order told beside the file as in OrthoEngine's dialog: ``FILE|columns=ID,P,L,X,Y,Z`` (tie points:
  ``TP_ID,Image,P,L,E``). P and L (pixel and line) count from the corner of the first pixel, half a pixel is taken off.
  eP and eL are their errors in pixels; eX, eY and eZ have units that differ between versions, and are not used. S is G
  (GCP), C (check point) or I (inactive). Letters behind a number (N, W) mean nothing; a line that does not fit is
  refused, where OrthoEngine leaves it out. (CATALYST Professional help, "Understanding formats for text files".)
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...foundation.errors import InputError
from ..rpc_files.content import read_text
from .csv_text import NAMED_COLUMNS, read_plain_text
from .table import PointReader, PointTable

# ---- Agisoft Metashape ---------------------------------------------------------------------------------------------

_HEADER = re.compile(r"#\s*label\s*([,;\t ])", re.IGNORECASE)
_METASHAPE = {
    "label": "id", "x/easting": "x", "y/northing": "y", "x/longitude": "lon", "y/latitude": "lat",
    "z/altitude": "height", "z": "height", "accuracy_x/y_(m)": "sigma_xy", "accuracy_x_(m)": "sigma_east",
    "accuracy_y_(m)": "sigma_north", "accuracy_z_(m)": "sigma_h",
}  # fmt: skip


def read_metashape(path: str, _layer: str = "") -> PointTable:
    """Return the surveyed positions of a reference file; raise `InputError` naming the line where it is damaged."""
    lines = read_text(path).splitlines()
    start, header = next((number, found) for number, line in enumerate(lines) if (found := _HEADER.match(line)))
    separator, ends = None if header[1] == " " else header[1], f"{header[1]} "
    names = [name.strip().lower() for name in lines[start].lstrip("# ").rstrip(ends).split(separator)]
    body = [""] * (start + 1)  # so that lines keep their numbers
    for line in lines[start + 1 :]:
        full = line.rstrip(ends)
        body.append(full + f"{header[1]}nan" * (len(names) - len(full.split(separator))) if full else "")
    table = read_plain_text(path, body, [_METASHAPE.get(name, name) for name in names])
    told = next(
        (line.partition(":")[2].strip() for line in lines if line.lower().startswith("# coordinatesystem:")), ""
    )
    if not told or told.startswith("LOCAL_CS"):
        return table
    columns = dict(table.columns)
    empty = np.full(len(table), np.nan)
    position = [columns.pop(a, columns.pop(b, empty)) for a, b in (("x", "lon"), ("y", "lat"), ("height", ""))]
    return replace(table, columns=columns, geometry=np.column_stack(position), crs=told)


METASHAPE_REFERENCE = PointReader(
    "Metashape reference",
    lambda _path, name, head: (
        name.endswith((".csv", ".txt", ".tsv"))
        and any(_HEADER.match(line) for line in head.decode("utf-8-sig", "replace").splitlines())
    ),
    read_metashape,
)

# ---- OrthoEngine ---------------------------------------------------------------------------------------------------

_ORTHOENGINE = {
    "id": "id", "tp_id": "id", "image": "image", "p": "sample", "l": "line", "x": "x", "y": "y", "z": "height",
    "e": "height", "s": "role", "ep": "ep", "el": "el",
}  # fmt: skip
_ROLES = {"": "", "g": "gcp", "c": "check", "i": "off"}
_FIELD = re.compile(r'"[^"]*"|[^\s,]+')
_NUMBER_AND_LETTERS = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)[A-Za-z]+")


def is_orthoengine(names: Sequence[str]) -> bool:
    """Return whether names of columns are those of an OrthoEngine text: pixel and line by one letter."""
    return {"p", "l"} <= {name.strip().lower() for name in names}


def read_orthoengine(path: str, columns_option: str) -> PointTable:
    """Return the points of a text whose columns ``columns_option`` names; raise `InputError` where it is damaged."""
    names = columns_option.removeprefix(NAMED_COLUMNS).split(",")
    fields = [_ORTHOENGINE.get(name.strip().lower(), f"({name.strip()})") for name in names]
    lines = []
    for line in read_text(path).splitlines():
        texts = [text.strip('"') for text in _FIELD.findall(line)]
        for place, field in enumerate(fields[: len(texts)]):
            found = None if field in ("id", "image", "role") else _NUMBER_AND_LETTERS.fullmatch(texts[place])
            texts[place] = found[1] if found else texts[place]
        lines.append("\t".join(texts))
    known = [{"ep": "sigma", "el": "quality"}.get(field, field) for field in fields]  # both are numbers in pixels
    table = read_plain_text(path, lines, known)
    columns = table.columns | {axis: table.columns[axis] - 0.5 for axis in ("sample", "line")}
    if "role" in columns:
        told = np.char.lower(columns["role"])
        wrong = np.flatnonzero(~np.isin(told, list(_ROLES)))
        if len(wrong):
            raise InputError(f"{table.name_row(wrong[0])}: status {told[wrong[0]]!r} is not G, C or I: correct it")
        columns["role"] = np.array([_ROLES[status] for status in told.tolist()], dtype=str)
    across = columns.pop("quality", None)
    if across is not None and "sigma" in columns:
        columns["sigma"] = np.hypot(columns["sigma"], across) / np.sqrt(2.0)
    return replace(table, columns=columns)


#: Nothing in such a file tells the order of its fields: whoever names OrthoEngine's columns means this reader.
ORTHOENGINE_TEXT = PointReader("PCI OrthoEngine text", lambda _path, _name, _head: False, read_orthoengine)

"""Text files of GCPs and tie points of other programs.

* Reference of Agisoft Metashape: ``# CoordinateSystem: WKT``, then the column names after another ``#``, the first of
them Label. Errors and estimated positions are not used; rows may omit empty fields at their end.
* OrthoEngine of PCI (CATALYST): one point in each line, fields separated by blanks, tabs or commas, in an order that
the user gives as in OrthoEngine's dialog, ``FILE|columns=ID,P,L,X,Y,Z`` or ``TP_ID,Image,P,L,E``. P and L (pixel and
line) refer to the corner of the first pixel: 0.5 is subtracted. eP is used as the standard deviation of both; eX, eY
and eZ have no certain unit. S is G (GCP), C (check point) or I (inactive). (CATALYST Professional help.)
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..opening.files import read_text
from .csv_text import NAMED_COLUMNS, read_plain_text
from .table import PointReader, PointTable

_HEADER = re.compile(rb"^#\s*label\s*([,;\t ])", re.IGNORECASE | re.MULTILINE)
_METASHAPE = {
    "label": "id", "x/easting": "x", "y/northing": "y", "x/longitude": "lon", "y/latitude": "lat",
    "z/altitude": "height", "z": "height", "accuracy_x/y_(m)": "sigma_xy", "accuracy_x_(m)": "sigma_east",
    "accuracy_y_(m)": "sigma_north", "accuracy_z_(m)": "sigma_h",
}  # fmt: skip
_ORTHOENGINE = {"tp_id": "id", "p": "sample", "l": "line", "z": "height", "e": "height", "s": "role", "ep": "sigma"}
_ROLES = {"G": "gcp", "C": "check", "I": "off"}


def read_metashape(path: str, _layer: str = "") -> PointTable:
    """Return the surveyed positions of a reference file; raise `InputError` with the line if it is damaged."""
    lines = read_text(path, "points").splitlines()
    start, header = next(
        (current, result) for current, line in enumerate(lines, 1) if (result := _HEADER.match(line.encode()))
    )
    mark = header[1].decode()
    names = lines[start - 1].lstrip("# ").rstrip(f"{mark} ").split(mark.strip(" ") or None)
    texts = next(
        (line.partition(":")[2].strip() for line in lines if line.lower().startswith("# coordinatesystem:")), ""
    )
    rows = [line.rstrip(f"{mark} ") for line in lines[start:]]
    body = [row and row + f"{mark}nan" * (len(names) - len(row.split(mark.strip(" ") or None))) for row in rows]
    field_names = [_METASHAPE.get(name.strip().lower(), name) for name in names]
    table = read_plain_text(path, [""] * start + body, field_names)  # so that lines keep their numbers
    if not texts or texts.startswith("LOCAL_CS"):
        return table
    columns, empty = dict(table.columns), np.full(len(table), np.nan)
    position = [columns.pop(a, columns.pop(b, empty)) for a, b in (("x", "lon"), ("y", "lat"), ("height", ""))]
    return replace(table, columns=columns, geometry=np.column_stack(position), crs=texts)


METASHAPE_REFERENCE = PointReader(
    "Metashape reference",
    lambda _path, name, head: name.endswith((".csv", ".txt")) and bool(_HEADER.search(head)),
    read_metashape,
)


def is_orthoengine(names: Sequence[str]) -> bool:
    """Return whether names of columns are those of an OrthoEngine text: P and L for pixel and line."""
    return {"p", "l"} <= {name.strip().lower() for name in names}


def read_orthoengine(path: str, columns_option: str) -> PointTable:
    """Return the points of a text whose columns ``columns_option`` names; raise `InputError` if it is damaged."""
    names = columns_option.removeprefix(NAMED_COLUMNS).split(",")
    fields = [re.findall(r'"[^"]*"|[^\s,]+', line) for line in read_text(path, "points").splitlines()]
    field_names = [_ORTHOENGINE.get(name.strip().lower(), name) for name in names]
    table = read_plain_text(path, ["\t".join(row) for row in fields], field_names)
    columns = table.columns | {axis: table.columns[axis] - 0.5 for axis in ("sample", "line")}
    if "role" in columns:
        columns["role"] = np.array([_ROLES.get(status.upper(), status) for status in columns["role"].tolist()])
    return replace(table, columns=columns)


#: The file does not state the order of its fields: this reader is chosen if the user names OrthoEngine's columns.
ORTHOENGINE_TEXT = PointReader(
    "PCI OrthoEngine text", lambda _path, _name, _head: False, read_orthoengine, is_orthoengine
)

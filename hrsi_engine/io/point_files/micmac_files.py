"""Tie points of MicMac: one file for each image (MMVII), or a folder with one file for each pair (``Homol``).

* ``PMUL-IMAGE.csv`` with the fields Pt.x, Pt.y, Id. The same Id in other images is the same point.
* ``Homol…/PastisIMAGE1/IMAGE2.dat`` or ``.txt`` (Tapioca, ``ElPackHomologue``). Text: x and y in the first image, then
  in the second, and a weight, one match in each line. Binary: 2 and the number of matches (int32), then for each 2
  (int32), its weight and four coordinates (float64), in the byte order of the machine. Most pairs are written twice,
  once for each first image; matches are read once. The weights are 1 or those of a filter, and are not used.

Pixel coordinates refer to the corner of the first pixel, as everywhere in MicMac, and MMVII uses those of ``Homol``
unchanged: 0.5 is subtracted. (micmacIGN/micmac: ``ElPackHomologue``, ``cMMVII_Implem_V1ImportHom``.)
"""

import glob
import os
from dataclasses import replace

import numpy as np

from ...foundation.errors import InputError
from ..opening.files import read_bytes
from . import csv_text
from .match_files import tabulate_matches
from .table import PointReader, PointTable


def read_micmac(path: str, _layer: str = "") -> PointTable:
    """Return the tie points of one image, which is identified by the file's name."""
    table = csv_text.read(path, chosen={"sample": "Pt.x", "line": "Pt.y"})
    columns = table.columns | {axis: table.columns[axis] - 0.5 for axis in table.columns.keys() & {"sample", "line"}}
    name = os.path.basename(path)
    if name.lower().startswith("pmul-"):
        columns["image"] = np.full(len(table), name[len("pmul-") : -len(".csv")])
    return replace(table, columns=columns)


def _is_micmac(_path: str, name: str, head: bytes) -> bool:
    begin = head.lstrip(b"\xef\xbb\xbf").lower()
    return name.endswith(".csv") and begin.startswith((b"pt.x,pt.y", b"pt.x;pt.y"))


MICMAC_TIE_POINTS = PointReader("MicMac tie points", _is_micmac, read_micmac)

# ---- Homol ---------------------------------------------------------------------------------------------------------

_FOLDER = "Pastis"
_ORDERS = {(2).to_bytes(4, "little"): "<", (2).to_bytes(4, "big"): ">"}  # the first number of a binary file


def read_homol(path: str, _layer: str = "") -> PointTable:
    """Return two rows for each match of a folder or of one of its files; raise `InputError` if a file is damaged."""
    pairs: dict[tuple[str, str], dict[tuple[float, ...], None]] = {}
    for file in _list_homol(path) if os.path.isdir(path) else [path]:
        first, second = os.path.basename(os.path.dirname(os.path.abspath(file))), os.path.basename(file)[: -len(".dat")]
        first, rows = first[len(_FOLDER) :], _parse_homol(file)
        if second < first:
            first, second, rows = second, first, np.roll(rows, 2, axis=1)
        pairs.setdefault((first, second), {}).update(dict.fromkeys(map(tuple, rows.tolist())))
    result = [
        (*names, np.array([row[:2] for row in rows] + [row[2:] for row in rows]).reshape(-1, 2) - 0.5)
        for names, rows in pairs.items()
    ]
    return tabulate_matches(path, result, ("x", "y"))


def _list_homol(path: str) -> list[str]:
    """Return the files of a folder of matches; for a pair with both formats, the binary one."""
    files = {ending: glob.glob(f"{glob.escape(path)}/{_FOLDER}*/*{ending}") for ending in (".dat", ".txt")}
    return sorted({file[: -len(".dat")]: file for file in files[".txt"] + files[".dat"]}.values())


def _parse_homol(path: str) -> np.ndarray:
    """Return x and y in both images ``(k, 4)``, as the file has them."""
    content = read_bytes(path, "matches")
    order = _ORDERS.get(content[:4])
    try:
        if order is None:
            lines = [line.split() for line in content.decode("ascii").splitlines() if line.strip()]
            rows = np.array([[float(text) for text in line[:4]] for line in lines]).reshape(-1, 4)
        else:
            record = np.dtype([("dimension", f"{order}i4"), ("weight", f"{order}f8"), ("xy", f"{order}f8", 4)])
            records = np.frombuffer(content, record, offset=8)
            rows = records["xy"].astype(np.float64)
            if len(rows) != np.frombuffer(content, f"{order}i4", 1, 4)[0] or (records["dimension"] != 2).any():
                raise ValueError("the number of its matches is another one")
        if not np.isfinite(rows).all():
            raise ValueError("positions are no numbers")
    except ValueError as error:
        raise InputError(f"{path}: is no complete file of MicMac's matches ({error}): obtain it again") from None
    return rows


def _is_homol(path: str, name: str, head: bytes) -> bool:
    if os.path.isdir(path):
        return bool(_list_homol(path))
    if not os.path.basename(os.path.dirname(os.path.abspath(path))).startswith(_FOLDER):
        return False
    return (name.endswith(".dat") and head[:4] in _ORDERS) or name.endswith(".txt")


MICMAC_HOMOL = PointReader("MicMac Homol folder", _is_homol, read_homol)

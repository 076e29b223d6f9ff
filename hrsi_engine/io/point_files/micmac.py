"""Tie points of MicMac (MMVII): a file an image, ``PMUL-IMAGE.csv`` with the fields Pt.x, Pt.y, Id.

The same Id on other images is the same point. Pixels count from the corner of the first pixel, as everywhere in MicMac:
half a pixel is taken off.
"""

import os
from dataclasses import replace

import numpy as np

from . import csv_text
from .table import PointReader, PointTable

_FIELDS = {"pt.x": "sample", "pt.y": "line"}
_PREFIX, _SUFFIX = "pmul-", ".csv"


def read(path: str, _layer: str = "") -> PointTable:
    """Return the tie points of one image; the image is the one that the file's name says."""
    table = csv_text.read(path, renamed=_FIELDS)
    columns = table.columns
    for axis in ("sample", "line"):
        if axis in columns:
            columns[axis] = columns[axis] - 0.5
    name = os.path.basename(path)
    if name.lower().startswith(_PREFIX):
        image = name[len(_PREFIX) : len(name) - len(_SUFFIX)]
        columns = columns | {"image": np.full(len(table), image)}
    return replace(table, columns=columns)


def _recognises(_path: str, name: str, head: bytes) -> bool:
    return name.endswith(_SUFFIX) and head.lstrip(b"\xef\xbb\xbf").lower().startswith((b"pt.x,pt.y", b"pt.x;pt.y"))


READER = PointReader("MicMac tie points", _recognises, read)

"""Geoid grids in files that the user names, looked at before PROJ reads them."""

import os
import struct

import numpy as np

from ...foundation.errors import InputError
from ...ground.geoids import Geoid, find_geoid
from ..opening.datasets import call_quiet
from ..opening.plain_files import require_plain

#: Of a ``.gtx`` grid, big-endian: latitude and longitude of the first cell, their steps, rows, columns; then float32.
GTX_HEAD = struct.Struct(">4d2i")


def open_geoid(datum: str) -> Geoid:
    """Return the geoid model that `find_geoid` finds, quietly, and from files only that hold what they claim.

    PROJ makes room for all cells that the head of a ``.gtx`` grid tells of before it looks for them; other formats say
    themselves where they are damaged. ``datum`` is ``egm96``, ``egm2008`` or the path of a grid; the result tells by
    ``stands_for`` where another model has to stand in. Raises `InputError` where the grid is missing or damaged.
    """
    require_plain(datum)
    if datum.lower().endswith(".gtx") and os.path.isfile(datum):
        with open(datum, "rb") as file:
            head = file.read(GTX_HEAD.size)
        rows, columns = GTX_HEAD.unpack(head)[4:] if len(head) == GTX_HEAD.size else (0, 0)
        if min(rows, columns) < 2 or os.path.getsize(datum) < GTX_HEAD.size + 4 * rows * columns:
            raise InputError(
                f"{datum}: is no geoid grid: its head tells of {rows} x {columns} cells, the file does not hold them: "
                "get it again"
            )
    return call_quiet(find_geoid, datum)


def read_geoid_heights(ground: np.ndarray, geoid: Geoid) -> np.ndarray:
    """Return the undulations ``(n,)`` of a geoid as `Geoid.heights` does, quietly."""
    return call_quiet(geoid.heights, ground)

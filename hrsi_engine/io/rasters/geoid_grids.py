"""Geoid grids in files that the user names, looked at before PROJ reads them."""

from __future__ import annotations

import os
import struct

import numpy as np

from ...foundation.errors import InputError
from ...ground.geodesy import geoid_heights
from ..opening.datasets import quietly

#: Of a ``.gtx`` grid, big-endian: latitude and longitude of the first cell, their steps, rows, columns; then float32.
GTX_HEAD = struct.Struct(">4d2i")


def read_geoid_heights(ground: np.ndarray, datum: str) -> np.ndarray:
    """Return geoid undulations (m) as `geoid_heights` does, quietly, and from files only that hold what they claim.

    PROJ makes room for all cells that the head of a ``.gtx`` grid tells of before it looks for them; other formats say
    themselves where they are damaged.

    Parameters
    ----------
    ground : (n, 3) ndarray
        Lon, lat in degrees; a height is not used.
    datum : str
        ``egm96``, ``egm2008`` or the path of a grid.

    Returns
    -------
    (n,) ndarray
        Metres.

    Raises
    ------
    InputError
        The grid is missing or damaged, or does not cover a point.
    """
    if datum.lower().endswith(".gtx") and os.path.isfile(datum):
        with open(datum, "rb") as file:
            head = file.read(GTX_HEAD.size)
        rows, columns = GTX_HEAD.unpack(head)[4:] if len(head) == GTX_HEAD.size else (0, 0)
        if min(rows, columns) < 2 or os.path.getsize(datum) < GTX_HEAD.size + 4 * rows * columns:
            raise InputError(
                f"{datum}: is no geoid grid: its head tells of {rows} x {columns} cells, the file does not hold them: "
                "get it again"
            )
    return quietly(geoid_heights, ground, datum)

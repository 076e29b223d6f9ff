"""The database of COLMAP (SQLite): keypoints of images and matches of pairs.

Tables ``images`` (image_id, name), ``keypoints`` (image_id, rows, cols, data: float32, x and y first) and
``two_view_geometries``, the matches that COLMAP verified, or, where there are none, ``matches`` (pair_id, rows, cols,
data: uint32 pairs of keypoint numbers from 0). ``pair_id`` is 2147483647 times the smaller image_id plus the larger.
COLMAP counts pixels from the corner, the centre of the upper left one is (0.5, 0.5): half a pixel is taken off.
https://colmap.github.io/database.html
"""

import sqlite3

import numpy as np

from ...foundation.errors import InputError
from ..opening.budgets import require_size
from ..opening.sound_databases import require_sound, sound_database
from .matched_keypoints import KeypointMatches, table_of_matches
from .table import PointReader, PointTable

_PAIR_BASE = 2147483647
_CENTRE = 0.5  # of the first pixel, as COLMAP counts
_MAGIC = b"SQLite format 3\0"
_TABLES, _VERIFIED_TABLE = {"images", "keypoints", "matches"}, "two_view_geometries"
_MATCHED = "SELECT pair_id, rows, cols, data FROM matches WHERE rows > 0"
_VERIFIED = "SELECT pair_id, rows, cols, data FROM two_view_geometries WHERE rows > 0"


def read(path: str, _layer: str = "") -> PointTable:
    """Return two rows a match; raise `InputError` where the database is damaged or holds no matches."""
    require_size(path, "matches")
    require_sound(path)
    with sound_database(path) as database:
        missing = _TABLES - _list_tables(database)
        if missing:
            raise InputError(f"{path}: is no database of COLMAP, it has no table {min(missing)!r}: name another file")
        names = {int(number): str(name) for number, name in database.execute("SELECT image_id, name FROM images")}
        stored = database.execute("SELECT image_id, rows, cols, data FROM keypoints").fetchall()
        verified = database.execute(_VERIFIED).fetchall() if _VERIFIED_TABLE in _list_tables(database) else []
        pairs = verified or database.execute(_MATCHED).fetchall()
    if not pairs:
        raise InputError(f"{path}: holds no matches: run a matcher of COLMAP first")
    keypoints = {
        int(number): _parse_blob(path, "keypoints", data, rows, cols, "<f4")[:, :2].astype(np.float64) - _CENTRE
        for number, rows, cols, data in stored
    }
    found = []
    for pair_id, rows, cols, data in pairs:
        first, second = divmod(int(pair_id), _PAIR_BASE)
        for number in (first, second):
            if number not in names or number not in keypoints:
                raise InputError(f"{path}: has matches of image {number} and no keypoints of it: get the file again")
        index = _parse_blob(path, "matches", data, rows, cols, "<u4")[:, :2].astype(np.int64)
        found.append(KeypointMatches(names[first], names[second], keypoints[first], keypoints[second], index))
    return table_of_matches(path, found)


def _list_tables(database: sqlite3.Connection) -> set[str]:
    return {str(name) for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}


def _parse_blob(path: str, table: str, data: object, rows: object, cols: object, dtype: str) -> np.ndarray:
    """Return a blob as ``(rows, cols)``; raise `InputError` where it holds anything else."""
    content = data if isinstance(data, bytes) else b""
    whole = isinstance(rows, int) and isinstance(cols, int) and rows >= 0 and cols >= 2
    if not whole or len(content) != rows * cols * np.dtype(dtype).itemsize:  # type: ignore[operator]
        raise InputError(f"{path}: a row of {table!r} holds {len(content)} bytes for {rows} x {cols}: get it again")
    return np.frombuffer(content, dtype).reshape(rows, cols)  # type: ignore[call-overload]


def _recognises(_path: str, name: str, head: bytes) -> bool:
    return head.startswith(_MAGIC) and name.endswith(".db")


READER = PointReader("COLMAP database", _recognises, read)

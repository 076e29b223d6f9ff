"""``.match`` of the Ames Stereo Pipeline: matched interest points of two images, ``PREFIX-IMAGE1__IMAGE2.match``.

Little-endian: the numbers of interest points of both images (uint64), then their records, the first image first: x, y
(float32, from the centre of the first pixel), their integer parts (int32), orientation, scale, interest (float32),
polarity (1 byte), octave, level (uint32), length of the descriptor (uint64), descriptor (float32). The k-th records
of both images match.

As plain text, ``PREFIX-IMAGE1__IMAGE2.txt``, which external matchers write too: six numbers a match, x, y and
uncertainty in the first image, then in the second. The uncertainties are scales of the detector or 1, not standard
deviations, and are not used.
"""

import os
import re
import struct
from collections.abc import Callable

import numpy as np

from ...foundation.errors import InputError
from ..opening.budgets import require_size
from .table import PointReader, PointTable

_COUNTS, _RECORD = struct.Struct("<QQ"), struct.Struct("<ffiifffBIIQ")
_NAME = re.compile(r"(.+)__(.+?)(-clean)?\.(match|txt)$", re.IGNORECASE)
_NUMBERS = 6  # a line of a text file


def read(path: str, _layer: str = "") -> PointTable:
    """Return two rows a match; raise `InputError` where the file is damaged or its name says no images."""
    return _make_table(path, _interest_points)


def read_positions(path: str, _layer: str = "") -> PointTable:
    """Return two rows a match of a text file; raise `InputError` as `read` does."""
    return _make_table(path, _read_positions)


def _make_table(path: str, positions: Callable[[str, bytes], np.ndarray]) -> PointTable:
    """Return the matches with the names of the images, which only the file's name says."""
    named = _NAME.match(os.path.basename(path))
    if named is None:
        raise InputError(f"{path}: its name does not say its images: call it PREFIX-IMAGE1__IMAGE2.match")
    require_size(path, "matches" if path.lower().endswith(".match") else "points")
    try:
        with open(path, "rb") as file:
            content = file.read()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}): check the file") from None
    xy = positions(path, content)
    count = len(xy) // 2
    pair = f"{named[1]}__{named[2]}"
    columns = {
        "id": np.tile(np.char.add(f"{pair}:", np.arange(count).astype(str)), 2),
        "image": np.repeat([named[1], named[2]], count),
        "sample": xy[:, 0],
        "line": xy[:, 1],
    }
    return PointTable(path, columns, ("x", "y"), lambda row: f"match {row % max(count, 1) + 1}", pairwise=True)


def _read_positions(path: str, content: bytes) -> np.ndarray:
    """Return x and y ``(2 k, 2)`` of a text file, those in the first image first."""
    rows = [line.split() for line in content.decode("latin-1").splitlines() if line.strip() and line.lstrip()[0] != "#"]
    try:
        numbers = np.array([[float(text) for text in row] for row in rows]).reshape(-1, _NUMBERS)
    except ValueError:
        numbers = np.full((1, _NUMBERS), np.nan)
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: a match is six numbers a line, x, y and uncertainty in both images: get it again")
    return np.concatenate([numbers[:, 0:2], numbers[:, 3:5]])


def _interest_points(path: str, content: bytes) -> np.ndarray:
    """Return x and y of all records ``(2 k, 2)``."""
    try:
        first, second = _COUNTS.unpack_from(content)
        if first != second or _COUNTS.size + 2 * first * _RECORD.size > len(content):
            raise ValueError(f"it tells of {first} and {second} interest points")
        xy, offset = np.empty((2 * first, 2)), _COUNTS.size
        for row in range(2 * first):
            record = _RECORD.unpack_from(content, offset)
            xy[row] = record[:2]
            offset += _RECORD.size + 4 * record[-1]
        if offset != len(content):
            raise ValueError(f"{len(content)} bytes instead of {offset}")
    except (struct.error, ValueError, OverflowError) as error:
        raise InputError(f"{path}: is no complete match file ({error}): get it again") from None
    if not np.isfinite(xy).all():
        raise InputError(f"{path}: holds positions that are no numbers: get it again")
    return xy


READER = PointReader("Ames Stereo Pipeline matches", lambda _path, name, _head: name.endswith(".match"), read)


def _is_text(_path: str, name: str, head: bytes) -> bool:
    lines = [line for line in head.splitlines() if line.strip() and not line.lstrip().startswith(b"#")]
    if not (name.endswith(".txt") and _NAME.match(name) and lines):
        return False
    try:
        return len([float(text) for text in lines[0].split()]) == _NUMBERS
    except ValueError:
        return False


TEXT = PointReader("Ames Stereo Pipeline matches as text", _is_text, read_positions)

"""Matches that point at keypoints, as hloc and COLMAP keep them, as the rows of a point file."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...foundation.errors import InputError
from .table import PointTable


class KeypointMatches(NamedTuple):
    """Matches of two images: names, keypoints' positions ``(n, 2)`` and ``(m, 2)``, pairs of their rows ``(k, 2)``."""

    first: str
    second: str
    first_xy: np.ndarray
    second_xy: np.ndarray
    rows: np.ndarray


def table_of_matches(path: str, pairs: Sequence[KeypointMatches]) -> PointTable:
    """Return two rows a match; raise `InputError` where one points at a keypoint that is not there."""
    parts: dict[str, list[np.ndarray]] = {"id": [], "image": [], "sample": [], "line": []}
    for pair in pairs:
        name, count = f"{pair.first}__{pair.second}", len(pair.rows)
        keypoints = len(pair.first_xy), len(pair.second_xy)
        if count and ((pair.rows < 0) | (pair.rows >= keypoints)).any():
            raise InputError(
                f"{path}: matches of {pair.first} and {pair.second} point at keypoints that are not there "
                f"({keypoints[0]} and {keypoints[1]} are): name the keypoints that these matches were made of"
            )
        xy = np.concatenate([pair.first_xy[pair.rows[:, 0]], pair.second_xy[pair.rows[:, 1]]])
        if not np.isfinite(xy).all():
            raise InputError(f"{path}: keypoints of {pair.first} or {pair.second} are no numbers: get the file again")
        parts["id"].append(np.tile(np.char.add(f"{name}:", np.arange(count).astype(str)), 2))
        parts["image"].append(np.repeat([pair.first, pair.second], count))
        parts["sample"].append(xy[:, 0])
        parts["line"].append(xy[:, 1])
    columns = {field: np.concatenate(column) for field, column in parts.items() if column}
    return PointTable(path, columns, ("keypoints", "matches"), lambda row: f"match {row + 1}", pairwise=True)

"""Matching of features within bands along epipolar lines: mutual nearest neighbours that pass the ratio test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..tile_matching.features import compute_root_sift
from .overview import OVERVIEW


class EpipolarLines(NamedTuple):
    """Epipolar lines in the second image: a point, a unit direction, and the stretch that is searched, (n, …)."""

    origin: np.ndarray
    direction: np.ndarray
    reach: np.ndarray

    def select(self, rows: np.ndarray) -> EpipolarLines:
        """Return some of the lines."""
        return EpipolarLines(*(column[rows] for column in self))

    def bounds(self, margin_px: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the first and last sample and line of each line's band, ``(n, 2)``."""
        size = np.abs(self.direction)
        reach = self.reach[:, None] * size + margin_px * size.sum(axis=1, keepdims=True)
        return self.origin - reach, self.origin + reach


def match_in_bands(
    first: np.ndarray, second: np.ndarray, lines: EpipolarLines, second_xy: np.ndarray, margin_px: float
) -> np.ndarray:
    """Return index pairs ``(k, 2)`` of descriptors that are each other's nearest within a band along their lines.

    The ratio test compares with the next best in the same band, so that it is the stricter the less is known.
    """
    nothing = np.empty((0, 2), dtype=np.int64)
    if len(first) < 2 or len(second) < 2:
        return nothing
    roots = [compute_root_sift(part) for part in (first, second)]
    nearest, back = np.full(len(first), -1), np.full(len(second), -1)
    best, rival = np.full((2, len(first)), -1.0, dtype=np.float32)
    back_best, margin = np.full(len(second), -1.0, dtype=np.float32), np.float32(margin_px)
    for rows in _group_neighbours(lines):
        near = lines.select(rows)
        low, high = near.bounds(margin_px)
        columns = np.flatnonzero(((second_xy >= low.min(axis=0)) & (second_xy <= high.max(axis=0))).all(axis=1))
        if not len(columns):
            continue
        # Similarity of the features of these lines (rows) and of the points around (columns), -1 outside the bands
        similarity = roots[0][rows] @ roots[1][columns].T
        origin, direction, reach = (part.astype(np.float32) for part in near)
        x, y = (second_xy[columns, axis].astype(np.float32) - origin[:, axis, None] for axis in (0, 1))
        along, across = direction[:, :1] * x + direction[:, 1:] * y, direction[:, :1] * y - direction[:, 1:] * x
        similarity[(np.abs(across) > margin) | (np.abs(along) > reach[:, None] + margin)] = -1.0
        # Of each point the most similar line, unless one of an earlier group is more similar
        line = similarity.argmax(axis=0)
        value = similarity[line, np.arange(len(columns))]
        better = value > back_best[columns]
        back_best[columns[better]], back[columns[better]] = value[better], rows[line[better]]
        # Of each line the most similar point, and the similarity of the next
        place, row = similarity.argmax(axis=1), np.arange(len(rows))
        best[rows] = similarity[row, place]
        nearest[rows] = np.where(best[rows] > -1.0, columns[place], -1)
        similarity[row, place] = -1.0
        rival[rows] = similarity.max(axis=1)
    distinct = (1.0 - best) < OVERVIEW.ratio**2 * (1.0 - np.maximum(rival, 0.0))
    index = np.flatnonzero(distinct & (best > 0.0))
    index = index[back[nearest[index]] == index]
    return np.column_stack([index, nearest[index]])


def _group_neighbours(lines: EpipolarLines) -> Iterator[np.ndarray]:
    """Yield the rows of lines that are near one another; lines without finite positions are left out."""
    known = np.flatnonzero(np.isfinite(lines.origin).all(axis=1) & np.isfinite(lines.reach))
    strips = max(1, round(np.sqrt(len(known) / OVERVIEW.line_batch)))
    for strip in np.array_split(known[np.argsort(lines.origin[known, 0], kind="stable")], strips):
        for part in np.array_split(strip[np.argsort(lines.origin[strip, 1], kind="stable")], strips):
            if len(part):
                yield np.sort(part)

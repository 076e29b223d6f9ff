"""Matching of features within bands along epipolar lines: mutual nearest neighbours that pass the ratio test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ...foundation.compiled_code import is_wanted
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
    nearest = np.full(len(first), -1)
    best, rival = np.full((2, len(first)), -1.0, dtype=np.float32)
    back, back_best = np.full(len(second), -1), np.full(len(second), -1.0, dtype=np.float32)
    compare: Callable[..., None] = _compare_in_bands
    if is_wanted(len(first) * len(second) >= OVERVIEW.compiled_from):
        from .compiled_bands import compare_in_bands

        compare = compare_in_bands
    for rows in _group_neighbours(lines):
        near = lines.select(rows)
        low, high = near.bounds(margin_px)
        columns = np.flatnonzero(((second_xy >= low.min(axis=0)) & (second_xy <= high.max(axis=0))).all(axis=1))
        if not len(columns):
            continue
        likeness = roots[0][rows] @ roots[1][columns].T
        of_lines = best[rows], rival[rows], nearest[rows]
        of_points, line_of_point = back_best[columns], np.full(len(columns), -1)
        compare(
            likeness, *(part.astype(np.float32) for part in near), second_xy[columns].astype(np.float32),
            np.float32(margin_px), *of_lines, of_points, line_of_point,
        )  # fmt: skip
        best[rows], rival[rows] = of_lines[:2]
        nearest[rows] = np.where(of_lines[2] >= 0, columns[of_lines[2]], -1)
        better = line_of_point >= 0
        back_best[columns], back[columns[better]] = of_points, rows[line_of_point[better]]
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


def _compare_in_bands(
    similarity: np.ndarray, origin: np.ndarray, direction: np.ndarray, reach: np.ndarray, xy: np.ndarray,
    margin_px: float, best: np.ndarray, second: np.ndarray, nearest: np.ndarray, back_best: np.ndarray,
    back: np.ndarray,
) -> None:  # fmt: skip
    """As `compiled_bands.compare_in_bands`."""
    apart = xy - origin[:, None]
    along = np.einsum("ijk,ik->ij", apart, direction)
    across = direction[:, :1] * apart[..., 1] - direction[:, 1:] * apart[..., 0]
    similarity[~((np.abs(across) <= margin_px) & (np.abs(along) <= reach[:, None] + margin_px))] = -1.0
    rows, columns = np.arange(len(origin)), np.arange(len(xy))
    of_point = similarity.argmax(axis=0)
    better = similarity[of_point, columns] > back_best
    back_best[better], back[better] = similarity[of_point[better], columns[better]], of_point[better]
    at = similarity.argmax(axis=1)
    best[:] = similarity[rows, at]
    nearest[:] = np.where(best > -1.0, at, -1)
    similarity[rows, at] = -1.0
    second[:] = similarity.max(axis=1)

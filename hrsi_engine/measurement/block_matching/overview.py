"""Features of complete images at a low resolution, and their matches within bands along epipolar lines.

They determine the relative geometry of pairs. Matches are mutual nearest neighbours with a ratio test in their band.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...block.columns import rank_in_groups
from ...foundation.progress import Progress, stage
from ...foundation.thresholds import GRIDS, MEMORY, threshold, thresholds
from ...foundation.workers.scheduling import PartResult, ResultStore, Scheduler, WorkPart, run_parts
from ..tile_matching.features import compute_root_sift, detect_sift_features
from ..tile_matching.types import ImageTile
from .windows import TIE_WINDOWS, read_overview

_SPEED = "measured for speed, 2026-11-22"


@thresholds
class OVERVIEW:
    """Resolution and features of overviews, and their comparison along epipolar lines."""

    halved_px: int = threshold(768, "px", "longer side of unprobed images with overviews of half resolution")
    features: int = threshold(4000, "features", "largest number of features of an overview")
    ratio: float = threshold(0.85, "", "largest ratio of the nearest descriptors in a band", "Lowe 2004: 0.8 of all")
    line_batch: int = threshold(256, "lines", "compared together: neighbouring lines have common candidates", _SPEED)


@dataclass(frozen=True, eq=False)
class OverviewJob:
    """Read an image at a low resolution and detect its features."""

    image: Image
    step: int


def choose_overview_step(size: tuple[int, int], probed: bool = True) -> int:
    """Return the reduction factor of an image's overview: about 8, limited by its smallest and largest size.

    If all pairs are matched, without being probed for the best ones, features at half this resolution are sufficient
    and are found in a quarter of the time; a pair with too few matches is compared at a finer one (`coarse`).
    """
    longest = max(size)
    step = max(1, round(longest / min(max(longest / 8.0, MEMORY.part_px), TIE_WINDOWS.full_px)))
    return step if probed or longest < OVERVIEW.halved_px else 2 * step


def detect_overview_features(job: OverviewJob) -> PartResult:
    """Return positions ``xy (k, 2)`` in full-resolution pixels and SIFT descriptors ``(k, 128)``, uint8."""
    return detect_features(read_overview(job.image, job.step), OVERVIEW.features)


def hand_over(features: PartResult) -> PartResult:
    """Return features that were detected before: the function of a part whose result other parts need."""
    return features


class OverviewFeatures:
    """Features of the overviews of many images, detected once for probes and pairs by ``parts``, one for each image.

    The strongest ones of each image, for the probes, are kept in memory. The others are in the files of the keeper, or
    also in memory if there is none.
    """

    def __init__(self, parts: Sequence[WorkPart], scheduler: Scheduler, keeper: ResultStore | None) -> None:
        self._parts = [replace(part, keep=True) for part in parts]
        self._scheduler, self._keeper = scheduler, keeper
        self._held: dict[str, PartResult] = {}
        self.strongest: list[PartResult] = []

    def find(self, limit: int, progress: Progress) -> None:
        """Detect the features in batches of images; the ``limit`` strongest of each image are kept in memory."""
        for start in range(0, len(self._parts), MEMORY.images):
            batch = self._parts[start : start + MEMORY.images]
            ends = (min(start + offset, len(self._parts)) / len(self._parts) for offset in (0, MEMORY.images))
            keys = [part.key for part in batch]
            features = run_parts(batch, keys, self._scheduler, self._keeper, stage(progress, *ends))
            self.strongest += [{name: column[:limit].copy() for name, column in features[key].items()} for key in keys]
            if self._keeper is None:
                self._held |= features

    def part(self, index: int) -> WorkPart:
        """Return the part that returns an image's features, or detects them again if their file is missing."""
        part = self._parts[index]
        features = self._held.get(part.key) or (self._keeper.load(part.key) if self._keeper is not None else None)
        return part if features is None else WorkPart(part.key, hand_over, features, keep=False)


def detect_features(tile: ImageTile, limit: int) -> PartResult:
    """Return ``xy (k, 2)`` in full-resolution pixels and descriptors ``(k, 128)``, the strongest of each cell first."""
    detections, side, border = [], MEMORY.part_px, MEMORY.border_px
    for row, column in product(*(range(0, length, side) for length in tile.pixels.shape)):
        left, top = max(column - border, 0), max(row - border, 0)
        place = np.s_[top : row + side + border, left : column + side + border]
        part = detect_sift_features(tile.pixels[place], tile.valid[place], 2 * OVERVIEW.features)
        xy, begin = part.xy + (left, top), np.array([column, row]) - 0.5
        in_part = ((xy >= begin) & (xy < begin + side)).all(axis=1)
        detections.append((xy[in_part], part.strength[in_part], part.descriptors[in_part]))
    xy, response, descriptors = (np.concatenate(part) for part in zip(*detections, strict=True))
    # Limit the number: the strongest ones of every cell of the image are kept
    cell_px = (np.array(tile.pixels.shape[1::-1]) + 1.0) / GRIDS.cells
    cell = np.floor(xy / cell_px).astype(np.int64) @ (1, GRIDS.cells)
    order = np.lexsort((-response, cell))
    keep = order[np.argsort(rank_in_groups(cell[order]), kind="stable")[:limit]]
    return {"xy": tile.to_image(xy[keep]), "descriptors": descriptors[keep]}


class EpipolarLines(NamedTuple):
    """Epipolar lines in the second image: a point, a unit direction, and half the searched length, (n, …)."""

    origin: np.ndarray
    direction: np.ndarray
    reach: np.ndarray

    def select(self, rows: np.ndarray) -> EpipolarLines:
        """Return the selected lines."""
        return EpipolarLines(*(column[rows] for column in self))

    def bounds(self, margin_px: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the smallest and largest sample and line of the band of each line, ``(n, 2)``."""
        size = np.abs(self.direction)
        reach = self.reach[:, None] * size + margin_px * size.sum(axis=1, keepdims=True)
        return self.origin - reach, self.origin + reach


def match_in_bands(
    first: np.ndarray, second: np.ndarray, lines: EpipolarLines, second_xy: np.ndarray, margin_px: float
) -> np.ndarray:
    """Return index pairs ``(k, 2)`` of descriptors that are mutual nearest neighbours within bands along their lines.

    The ratio test uses the second best in the same band, so that it is stricter if the band is wide.
    """
    nothing = np.empty((0, 2), dtype=np.int64)
    if len(first) < 2 or len(second) < 2:
        return nothing
    roots = [compute_root_sift(part) for part in (first, second)]
    nearest, back_nearest = np.full(len(first), -1), np.full(len(second), -1)
    best, rival = np.full((2, len(first)), -1.0, dtype=np.float32)
    back_best, margin = np.full(len(second), -1.0, dtype=np.float32), np.float32(margin_px)
    for rows in _group_neighbours(lines):
        nearby_lines = lines.select(rows)
        low, high = nearby_lines.bounds(margin_px)
        columns = np.flatnonzero(((second_xy >= low.min(axis=0)) & (second_xy <= high.max(axis=0))).all(axis=1))
        if not len(columns):
            continue
        # Similarity of the features of these lines (rows) and of nearby points (columns), -1 outside the bands
        similarity = roots[0][rows] @ roots[1][columns].T
        origin, direction, reach = (part.astype(np.float32) for part in nearby_lines)
        x, y = (second_xy[columns, axis].astype(np.float32) - origin[:, axis, None] for axis in (0, 1))
        along, across = direction[:, :1] * x + direction[:, 1:] * y, direction[:, :1] * y - direction[:, 1:] * x
        similarity[(np.abs(across) > margin) | (np.abs(along) > reach[:, None] + margin)] = -1.0
        # The most similar line of each point, over all groups
        line = similarity.argmax(axis=0)
        value = similarity[line, np.arange(len(columns))]
        better = value > back_best[columns]
        back_best[columns[better]], back_nearest[columns[better]] = value[better], rows[line[better]]
        # The most similar point of each line, and the similarity of the next one
        place, row = similarity.argmax(axis=1), np.arange(len(rows))
        best[rows] = similarity[row, place]
        nearest[rows] = np.where(best[rows] > -1.0, columns[place], -1)
        similarity[row, place] = -1.0
        rival[rows] = similarity.max(axis=1)
    distinct = (1.0 - best) < OVERVIEW.ratio**2 * (1.0 - np.maximum(rival, 0.0))
    index = np.flatnonzero(distinct & (best > 0.0))
    index = index[back_nearest[nearest[index]] == index]
    return np.column_stack([index, nearest[index]])


def _group_neighbours(lines: EpipolarLines) -> Iterator[np.ndarray]:
    """Yield the row indices of groups of neighbouring lines; lines without finite positions are excluded."""
    usable = np.flatnonzero(np.isfinite(lines.origin).all(axis=1) & np.isfinite(lines.reach))
    strips = max(1, round(np.sqrt(len(usable) / OVERVIEW.line_batch)))
    for strip in np.array_split(usable[np.argsort(lines.origin[usable, 0], kind="stable")], strips):
        for part in np.array_split(strip[np.argsort(lines.origin[strip, 1], kind="stable")], strips):
            if len(part):
                yield np.sort(part)

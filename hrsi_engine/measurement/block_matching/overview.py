"""Features of whole images at a low resolution, from which the relative geometry of pairs is estimated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...block.block import Image
from ...foundation.progress import Progress, stage
from ...foundation.thresholds import threshold, thresholds
from ...foundation.workers.scheduling import Keeper, PartResult, Scheduler, WorkPart, run_parts
from ..tile_matching.features import detect_sift_features
from ..tile_matching.types import ImageTile
from .windows import read_overview

_SPEED = "measured for speed, 2026-11-22"


@thresholds
class OVERVIEW:
    """Resolution of overviews, the features that are kept of them, and their comparison within bands."""

    smallest_px: int = threshold(1024, "px", "least longer side of an overview, where the image has it")
    largest_px: int = threshold(2048, "px", "greatest longer side of an overview")
    tile_px: int = threshold(1024, "px", "side of the part that goes through SIFT at once")
    border_px: int = threshold(24, "px", "read around such a part")
    features: int = threshold(4000, "features", "of an overview")
    batch: int = threshold(64, "images", "whose features are in memory")
    cells: int = threshold(10, "cells", "along each side, over which features are kept evenly")
    ratio: float = threshold(0.85, "", "of distances to the nearest descriptors of a band", "Lowe 2004: 0.8 of all")
    line_batch: int = threshold(256, "lines", "compared at a time: neighbours have few points in question", _SPEED)


@dataclass(frozen=True, eq=False)
class OverviewJob:
    """Read an image at a lower resolution and find its features."""

    image: Image
    step: int


def choose_overview_step(size: tuple[int, int]) -> int:
    """Return the pixels per pixel of an image's overview: an eighth of the resolution, within sensible sizes."""
    longest = max(size)
    return max(1, round(longest / min(max(longest / 8.0, OVERVIEW.smallest_px), OVERVIEW.largest_px)))


def detect_overview_features(job: OverviewJob) -> PartResult:
    """Return positions ``xy (k, 2)`` in full-resolution pixels and SIFT descriptors ``(k, 128)`` of 8 bit."""
    return detect_features(read_overview(job.image, job.step), OVERVIEW.features)


def hand_over(features: PartResult) -> PartResult:
    """Return features that were found before: a part of the work whose result other parts need."""
    return features


class OverviewFeatures:
    """Features of the overviews of many images, found once for the probes and all pairs by ``parts``, one an image.

    Memory holds the strongest of each image, which probes compare; all of them where there is no keeper, else they are
    in its files.
    """

    def __init__(self, parts: Sequence[WorkPart], scheduler: Scheduler, keeper: Keeper | None) -> None:
        self._parts = [replace(part, keep=True) for part in parts]
        self._scheduler, self._keeper = scheduler, keeper
        self._held: dict[str, PartResult] = {}
        self.strongest: list[PartResult] = []

    def find(self, most: int, progress: Progress) -> None:
        """Find the features, so many images at a time; ``most`` of each are the strongest."""
        for start in range(0, len(self._parts), OVERVIEW.batch):
            chosen = self._parts[start : start + OVERVIEW.batch]
            ends = (min(start + done, len(self._parts)) / len(self._parts) for done in (0, OVERVIEW.batch))
            keys = [part.key for part in chosen]
            found = run_parts(chosen, keys, self._scheduler, self._keeper, stage(progress, *ends))
            self.strongest += [{name: column[:most].copy() for name, column in found[key].items()} for key in keys]
            if self._keeper is None:
                self._held |= found

    def part(self, index: int) -> WorkPart:
        """Return the part of the work that hands over an image's features, or finds them anew where files are gone."""
        part = self._parts[index]
        features = self._held.get(part.key) or (self._keeper.load(part.key) if self._keeper is not None else None)
        return part if features is None else WorkPart(part.key, hand_over, features, keep=False)


def detect_features(tile: ImageTile, most: int) -> PartResult:
    """Return ``xy (k, 2)`` in full-resolution pixels and descriptors ``(k, 128)``, the strongest everywhere first."""
    found = [
        _detect_in_part(tile, column, row)
        for row in range(0, tile.pixels.shape[0], OVERVIEW.tile_px)
        for column in range(0, tile.pixels.shape[1], OVERVIEW.tile_px)
    ]
    xy, response, descriptors = (np.concatenate(part) for part in zip(*found, strict=True))
    # Of at most so many features, the strongest of every part of the image come first
    cell_px = (np.array(tile.pixels.shape[1::-1]) + 1.0) / OVERVIEW.cells
    cell = np.floor(xy / cell_px).astype(np.int64) @ (1, OVERVIEW.cells)
    order = np.lexsort((-response, cell))
    _, first = np.unique(cell[order], return_index=True)
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.r_[first, len(order)]))
    keep = order[np.argsort(rank, kind="stable")[:most]]
    return {"xy": tile.to_image(xy[keep]), "descriptors": descriptors[keep]}


def _detect_in_part(tile: ImageTile, column: int, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return tile positions, strengths and descriptors of the features of one part of an overview."""
    side, border = OVERVIEW.tile_px, OVERVIEW.border_px
    left, top = max(column - border, 0), max(row - border, 0)
    place = np.s_[top : row + side + border, left : column + side + border]
    found = detect_sift_features(tile.pixels[place], tile.valid[place], 2 * OVERVIEW.features)
    xy = found.xy + (left, top)
    begin = np.array([column, row]) - 0.5
    own = ((xy >= begin) & (xy < begin + side)).all(axis=1)
    return xy[own], found.strength[own], found.descriptors[own]

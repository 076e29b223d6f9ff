"""Probes: how well two images will match, by their strongest features; hundreds of times cheaper than matching.

The strongest features of both overviews are compared within bands along the epipolar lines, as wide as the RPCs may be
off. Right matches share one offset across the lines, wrong ones lie anywhere in the band: the largest number of matches
whose offsets lie within 4 px of one another tells how many right ones there are. Sun, season, view angles and overlap
all act on that number, known or not.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...foundation.workers.scheduling import PartResult
from ..tile_matching.epipolar import compute_epipolar_miss
from .bands import match_in_bands
from .coarse import compute_epipolar_lines, reduce_rpc
from .overlaps import CHOICE, GroundRange


class Probe(NamedTuple):
    """Result of the probe of a pair.

    agreeing : features that agree with one offset; convergence_deg : angle between the lines of sight
    cells : parts of the first and of the second image with agreeing features, a bit for each
    """

    first: int
    second: int
    agreeing: int
    convergence_deg: float
    cells: tuple[int, int]


@dataclass(frozen=True, eq=False)
class ProbeJob:
    """An image and those it is compared with, with the steps of their overviews and their strongest features."""

    first: Image
    others: tuple[Image, ...]
    steps: tuple[int, ...]  #: of the first and the others
    heights: tuple[GroundRange, ...]
    margin_px: float
    features: tuple[PartResult, ...]  #: of the first and the others


def probe_pairs(job: ProbeJob) -> PartResult:
    """Return ``agreeing (k,)`` and ``cells (k, 2)`` of the first image with each of the others."""
    agreeing = np.zeros(len(job.others), dtype=np.int64)
    cells = np.zeros((len(job.others), 2), dtype=np.int64)
    first_rpc = reduce_rpc(job.first.rpc, job.steps[0])
    own = job.features[0]
    xy = (own["xy"] - (job.steps[0] - 1) / 2.0) / job.steps[0]
    for k, other in enumerate(job.others):
        step, theirs, heights = job.steps[k + 1], job.features[k + 1], job.heights[k]
        second_rpc = reduce_rpc(other.rpc, step)
        second_xy = (theirs["xy"] - (step - 1) / 2.0) / step
        lines = compute_epipolar_lines(first_rpc, second_rpc, xy, heights)
        usable = np.flatnonzero(np.isfinite(lines.origin).all(axis=1))
        pairs = match_in_bands(
            own["descriptors"][usable], theirs["descriptors"], lines.select(usable), second_xy, job.margin_px / step
        )  # fmt: skip
        if not len(pairs):
            continue
        places = xy[usable[pairs[:, 0]]], second_xy[pairs[:, 1]]
        across = compute_epipolar_miss(first_rpc, second_rpc, *places, 0.5 * (heights.low_m + heights.high_m)).across_px
        order = np.argsort(across)
        count = np.searchsorted(across[order], across[order] + CHOICE.agreeing_px, side="right") - np.arange(len(order))
        best = int(np.argmax(count))
        alike = order[best : best + int(count[best])]
        agreeing[k] = len(alike)
        sizes = np.array(job.first.known_size) / job.steps[0], np.array(other.known_size) / step
        for side, (place, size) in enumerate(zip(places, sizes, strict=True)):
            cell = np.clip(np.floor(CHOICE.cells * place[alike] / size), 0, CHOICE.cells - 1).astype(np.int64)
            cells[k, side] = int(np.bitwise_or.reduce(1 << (cell[:, 1] * CHOICE.cells + cell[:, 0])))
    return {"agreeing": agreeing, "cells": cells}

"""How well will two images match? A probe by their strongest features, hundreds of times cheaper than matching.

The strongest features of both overviews are compared within bands along the epipolar lines, as wide as the RPCs may be
off. Right matches share one offset across the lines, wrong ones lie anywhere in the band: the largest number of matches
whose offsets lie within 4 px of one another tells how many right ones there are. Sun, season, view angles and overlap
all act on that number, known or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...block.imaging_geometry import compute_view_directions
from ...foundation.thresholds import threshold, thresholds
from ...foundation.workers.scheduling import PartResult
from ...surface.dem import HeightSurface
from ..tile_matching.epipolar import compute_epipolar_miss
from .bands import match_in_bands
from .coarse import compute_epipolar_lines, reduce_rpc
from .overlaps import GroundRange, Overlap, estimate_overlaps, find_candidate_pairs, find_overlaps

_YEAR = "rank correlation with matches 0.96, simulated year, 2026-11-22"


@thresholds
class PairChoiceThresholds:
    """Which of many overlapping pairs are probed and matched."""

    features: int = threshold(600, "features", "of an image that are compared", _YEAR)
    agreeing_px: float = threshold(4.0, "px of the overview", "between offsets across the lines that are one")
    cells: int = threshold(3, "cells", "along each side of an image, for the ground that a pair covers")
    partners: int = threshold(40, "images", "with which an image is probed at most")
    measured_partners: int = threshold(60, "images", "whose overlap is measured; of more it is estimated")
    angle_scale_deg: float = threshold(20.0, "°", "between views, over which similarity falls to 1/e")
    chance: int = threshold(5, "features", "that agree by chance: a probe with no more says nothing", _YEAR)
    narrow_deg: float = threshold(1.5, "°", "angle between views below which a pair tells no heights")
    narrow_worth: float = threshold(0.6, "", "worth of such a pair over that of another")
    wanted_angle_deg: float = threshold(5.0, "°", "angle that one pair of each image should have")
    last_tries: int = threshold(3, "pairs", "tried of an image of which no probe is above chance")
    rounds: int = threshold(6, "rounds", "of new trees after failed pairs")
    found_worth: float = threshold(1e6, "features", "added to the worth of pairs that matched: they stay in new trees")


CHOICE = PairChoiceThresholds()


class Probe(NamedTuple):
    """What was found out of a pair.

    Parameters
    ----------
    first, second : int
        Numbers of the images.
    agreeing : int
        Features that agree with one offset.
    convergence_deg : float
        Angle between the lines of sight.
    cells : tuple of int
        Parts of the first and of the second image with agreeing features, a bit for each.
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
        seen = np.flatnonzero(np.isfinite(lines.origin).all(axis=1))
        pairs = match_in_bands(
            own["descriptors"][seen], theirs["descriptors"], lines.select(seen), second_xy, job.margin_px / step
        )  # fmt: skip
        if not len(pairs):
            continue
        places = xy[seen[pairs[:, 0]]], second_xy[pairs[:, 1]]
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


def compute_central_views(images: list[Image]) -> np.ndarray:
    """Return unit vectors ``(n, 3)`` east, north, up from the middle of each image's ground to its satellite."""
    found = []
    for image in images:
        ground = image.rpc.localize(image.centre_px[None], image.rpc.height_off).ground
        found.append(
            compute_view_directions(image.rpc, ground)[0] if np.isfinite(ground).all() else np.array([0.0, 0.0, 1.0])
        )
    return np.array(found)


def compute_convergence_deg(directions: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the angles between the lines of sight of pairs of images."""
    cosine = np.einsum("nk,nk->n", directions[first], directions[second])
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def choose_probes(overlaps: list[Overlap], angle_deg: np.ndarray, most: int = CHOICE.partners) -> np.ndarray:
    """Return the indices of the overlaps that are probed: of each image those that overlap most and look most alike.

    So the cost grows with the number of images, not with that of their pairs.
    """
    first, second = (
        np.array([getattr(pair, name) for pair in overlaps], dtype=np.int64) for name in ("first", "second")
    )
    prior = np.array([pair.share for pair in overlaps]) * np.exp(-angle_deg / CHOICE.angle_scale_deg)
    image, row = np.r_[first, second], np.tile(np.arange(len(overlaps)), 2)
    order = np.lexsort((-prior[row], image))
    _, start = np.unique(image[order], return_index=True)
    place = np.arange(len(order)) - np.repeat(start, np.diff(np.r_[start, len(order)]))
    return np.unique(row[order[place < most]])


def find_likely_overlaps(
    images: list[Image], ranges: Sequence[GroundRange], surface: HeightSurface | None, smallest: float
) -> list[Overlap]:
    """Return the pairs that share at least ``smallest``; of images that touch very many, those that may be probed."""
    candidates = find_candidate_pairs(images, ranges)
    if 2 * len(candidates) > CHOICE.measured_partners * len(images):
        rough = estimate_overlaps(images, ranges, candidates)
        first, second = np.array(candidates).T
        rows = choose_probes(
            rough, compute_convergence_deg(compute_central_views(images), first, second), CHOICE.measured_partners
        )
        candidates = [candidates[row] for row in rows.tolist()]
    return find_overlaps(images, ranges, surface, smallest, candidates)

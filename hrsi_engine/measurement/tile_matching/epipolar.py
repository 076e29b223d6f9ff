"""Epipolar lines by RPCs: the image of a point's ray in another image, which is nearly straight.

The line is computed by localizing the point at several heights and projecting it into the other image. A match is
tested by its distance across the line (for a correct match the relative bias of the RPCs) and by the height that
follows from its position along the line.

**Consistency.** The relative bias of a pair of RPCs is nearly constant within a window, so that correct matches are in
a narrow band across their epipolar lines. Its unknown position is the mode of the distances of all matches across the
lines, around which a trend is then fitted. Along the lines the parallax is arbitrary, but similar for neighbours: a
match is wrong if its parallax differs from the median of its neighbours by more than buildings can cause.
"""

from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial import cKDTree

from ...camera.rpc import Localization
from ...foundation.robust_scale import ROBUST, robust_sigma
from ...foundation.thresholds import GROUND, SAMPLES, threshold, thresholds


@thresholds
class EPIPOLAR:
    """Computation of epipolar lines from RPCs, and limits for matches relative to them."""

    least_stretch: float = threshold(1e-3, "px/m", "smallest parallax per height from which heights are computed")
    ratio: float = threshold(0.8, "", "largest ratio of the distances to the two nearest descriptors", "Lowe 2004")
    batch: int = threshold(2048, "descriptors", "number of descriptors compared together (memory)")
    mode_px: float = threshold(3.0, "px", "range of the offsets of correct matches before their trend is known")
    jump_px: float = threshold(8.0, "px", "largest deviation from that median: buildings, trees")


class LocalizingCamera(Protocol):
    """What epipolar lines need of a camera: an RPC, or a polynomial in its place."""

    @property
    def height_range(self) -> tuple[float, float]:
        """Lowest and highest ellipsoidal height (m) for which the camera is valid."""

    def localize(self, image: np.ndarray, height_m: np.ndarray | float) -> Localization:
        """As `RPC.localize`."""

    def project(self, ground: np.ndarray) -> np.ndarray:
        """As `RPC.project`."""


class EpipolarDeviation(NamedTuple):
    """For each match: signed distance across the epipolar line (px), height (m), parallax along the line (px per metre
    of height), and distance along the line (px) from the position at the initial height.

    If two images have the same view there is no line; its direction is then that of the samples.
    """

    across_px: np.ndarray
    height_m: np.ndarray
    stretch: np.ndarray
    along_px: np.ndarray


def transfer(
    source: LocalizingCamera, target: LocalizingCamera, xy: np.ndarray, height_m: np.ndarray | float
) -> np.ndarray:
    """Return the positions in the other image of points at given heights, ``(n, 2)``; NaN if there is none."""
    return target.project(source.localize(xy, height_m).ground)


def compute_epipolar_deviation(
    first: LocalizingCamera,
    second: LocalizingCamera,
    first_xy: np.ndarray,
    second_xy: np.ndarray,
    height_m: np.ndarray | float,
    iterations: int = 3,
) -> EpipolarDeviation:
    """Return the distances of matches from their epipolar lines, and the heights at which the rays come nearest.

    The line is that of two heights near the present one, which is iterated along it.

    first_xy, second_xy : (n, 2) px; height_m : initial height, of all or of each match
    """
    lowest, highest = first.height_range
    reach = 2.0 * (highest - lowest)
    height = np.full(len(first_xy), height_m, dtype=np.float64)
    for _ in range(iterations):
        at_low = transfer(first, second, first_xy, height - GROUND.margin_m)
        above = transfer(first, second, first_xy, height + GROUND.margin_m)
        slope = (above - at_low) / (2.0 * GROUND.margin_m)
        stretch = np.linalg.norm(slope, axis=1)
        distinct = stretch > EPIPOLAR.least_stretch
        direction = np.where(distinct[:, None], slope / np.maximum(stretch, EPIPOLAR.least_stretch)[:, None], (1, 0))
        miss = second_xy - 0.5 * (above + at_low)
        along = np.einsum("ni,ni->n", miss, direction)
        across = direction[:, 0] * miss[:, 1] - direction[:, 1] * miss[:, 0]
        step = np.where(distinct, along / np.maximum(stretch, EPIPOLAR.least_stretch), 0.0)
        height = np.clip(height + step, lowest - reach, highest + reach)
    return EpipolarDeviation(across, height, stretch, np.where(distinct, (height - height_m) * stretch, along))


def match_descriptors(
    first: np.ndarray, second: np.ndarray, ratio: float = EPIPOLAR.ratio
) -> tuple[np.ndarray, np.ndarray]:
    """Return index pairs of descriptors that are mutual nearest neighbours and pass the ratio test (Lowe 2004).

    first, second : (n, d) and (m, d) of unit length
    Result: indices ``(k,)`` into both.
    """
    if len(first) < 2 or len(second) < 2:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    nearest = np.empty(len(first), np.int64)
    distinct = np.empty(len(first), bool)
    back_best = np.full(len(second), -np.inf, np.float32)
    back_nearest = np.zeros(len(second), np.int64)
    for start in range(0, len(first), EPIPOLAR.batch):
        part = slice(start, min(start + EPIPOLAR.batch, len(first)))
        similarity = first[part] @ second.T
        column_best = similarity.argmax(axis=0)
        column_value = similarity[column_best, np.arange(len(second))]
        better = column_value > back_best
        back_nearest[better], back_best[better] = start + column_best[better], column_value[better]
        rows = np.arange(part.stop - part.start)
        best = similarity.argmax(axis=1)
        best_value = similarity[rows, best].copy()
        similarity[rows, best] = -np.inf
        second_value = similarity.max(axis=1)
        nearest[part] = best
        # distance² of unit vectors is 2 - 2 * similarity
        distinct[part] = (1.0 - best_value) < ratio**2 * (1.0 - second_value)
    index = np.flatnonzero(distinct & (back_nearest[nearest] == np.arange(len(first))))
    return index, nearest[index]


class Consistency(NamedTuple):
    """For matches: mask of those consistent with the geometry, deviation across the epipolar line from the trend (px,
    or NaN), its robust standard deviation, and the epipolar distances themselves."""

    good: np.ndarray
    deviation_px: np.ndarray
    sigma_px: float
    miss: EpipolarDeviation


def check_rpc_consistency(
    first: LocalizingCamera,
    second: LocalizingCamera,
    first_xy: np.ndarray,
    second_xy: np.ndarray,
    height_m: np.ndarray | float,
    floor_px: float = 0.5,
    unit_px: float = 1.0,
) -> Consistency:
    """Test matches for consistency with the RPC geometry, for any relative bias of the RPCs.

    Across the epipolar lines all correct matches have one common offset, the relative bias, with a small trend over the
    image. It is the mode of the distances, refined by a robust plane. Matches beyond `ROBUST.outlier` sigmas are
    rejected; if the mode is due to chance the sigma is too large, and all are rejected. Along the lines a match must
    not differ from its neighbours by more than terrain does.

    first_xy, second_xy : (n, 2) px; height_m : approximate height, of all or of each match
    floor_px : smallest limit across the lines
    unit_px : size of a matched pixel in pixels of the image (pyramids); thresholds are in units of it
    """
    miss = compute_epipolar_deviation(first, second, first_xy, second_xy, height_m)
    across, along = miss.across_px / unit_px, miss.along_px / unit_px
    finite = np.isfinite(across) & np.isfinite(miss.height_m)
    nothing = Consistency(np.zeros(len(first_xy), bool), np.full(len(first_xy), np.nan), np.nan, miss)
    if finite.sum() < SAMPLES.redundant:
        return nothing
    across = np.where(finite, across, np.inf)
    # Median of the densest interval of half the mode's width
    ordered = np.sort(across[finite])
    count = np.searchsorted(ordered, ordered + EPIPOLAR.mode_px / 2.0, side="right") - np.arange(len(ordered))
    densest = int(count.argmax())
    mode = float(np.median(ordered[densest : densest + count[densest]]))
    consistent = finite & (np.abs(across - mode) < EPIPOLAR.mode_px)
    design = np.column_stack([np.ones(len(first_xy)), (first_xy - first_xy.mean(axis=0)) / (np.ptp(first_xy) + 1.0)])
    for _ in range(5):
        if consistent.sum() < SAMPLES.redundant:
            return nothing
        terms = 3 if consistent.sum() >= SAMPLES.trend else 1
        deviation = (
            across - design[:, :terms] @ np.linalg.lstsq(design[consistent, :terms], across[consistent], rcond=None)[0]
        )
        sigma = float(robust_sigma(deviation[consistent]))
        if sigma > EPIPOLAR.mode_px:
            return nothing
        consistent = np.abs(deviation) < max(ROBUST.outlier * sigma, floor_px)
    index = np.flatnonzero(consistent)
    if len(index) > SAMPLES.fewest:
        # The parallax (px) must agree with the median of the good neighbours
        _, neighbours = cKDTree(first_xy[index]).query(first_xy[index], k=SAMPLES.fewest + 1)
        neighbour_parallax = along[index][neighbours[:, 1:]]
        middle = np.median(neighbour_parallax, axis=1)
        spread = robust_sigma(neighbour_parallax - middle[:, None], axis=1)
        consistent[index] = np.abs(along[index] - middle) < np.maximum(5.0 * spread, EPIPOLAR.jump_px)
    return Consistency(consistent, np.where(finite, deviation, np.nan) * unit_px, sigma * unit_px, miss)

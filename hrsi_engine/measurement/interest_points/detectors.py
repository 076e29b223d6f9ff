"""Detectors by name, and running one over an image of any size.

A detector is prepared once for an image (thresholds from the image's own statistics) and then called for window after
window; only the points it returns stay in memory. To add one, write its `Detector` and enter it in `DETECTORS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from ...block.block import Raster
from ...foundation.errors import InputError
from ...foundation.progress import Progress, advance, silent
from ...foundation.workers.streams import open_calls
from ...foundation.workers.threads import thread_count
from .blobs import Blobs, find_blobs
from .corners import Peaks, Strength, corner_peaks, foerstner_strength, harris_strength
from .corners import corner_halo_px as corner_halo_px
from .gravity_centres import Centre, gravity_centres
from .gravity_centres import centre_halo_px as centre_halo_px
from .options import STRONG_QUALITY, CentreOptions, CornerOptions, DetectionOptions
from .points import CORNER, SUPER, InterestPoints, join_points, no_points, spread_over_grid
from .statistics import ImageStatistics, image_statistics, normalise, sample_areas
from .windows import Area, DetectionWindow, cores, read_window

BLOB = "blob"
CHANCE_OF_SHAPE = 2.0 / 3.0  # to be found again, of a shape of the best quality: on real pairs, beside blobs
COVERED_SHARE, LIKE_SIZE = (
    0.15,
    1.4,
)  # share of a shape's diameter, and factor of size, by which a blob is the same object
SMALLEST_IMAGE_PX = 32
SMALL_IMAGE_PX = 2**22  # thresholds are set from all of it


class Detector(Protocol):
    """Finds points in a window's core; the image's statistics come first."""

    def halo_px(self, options: DetectionOptions) -> int:
        """Return how far windows must reach beyond their cores."""

    def prepare(
        self, raster: Raster, region: Area, statistics: ImageStatistics, options: DetectionOptions
    ) -> Callable[[DetectionWindow], InterestPoints]:
        """Return the function that finds the points of a window."""


@dataclass(frozen=True)
class CornerDetector:
    """Corners by a strength of the structure tensor; super points are those above TA."""

    strength: Strength

    def halo_px(self, options: DetectionOptions) -> int:
        return corner_halo_px(options.corners)

    def prepare(
        self, raster: Raster, region: Area, statistics: ImageStatistics, options: DetectionOptions
    ) -> Callable[[DetectionWindow], InterestPoints]:
        known: dict[tuple[int, int, int, int], Peaks] = {}
        thresholds = self._thresholds(raster, region, statistics, options.corners, known)
        return partial(self._find, statistics=statistics, options=thresholds, known=known)

    def _thresholds(
        self, raster: Raster, region: Area, statistics: ImageStatistics, options: CornerOptions,
        known: dict[tuple[int, int, int, int], Peaks],
    ) -> CornerOptions:  # fmt: skip
        """Return the options with TA and TB set from the strengths of the local maxima in sample windows.

        The peaks of small images are kept in ``known``, to be found only once.
        """
        if options.interest_threshold is not None and options.super_threshold is not None:
            return options
        small = (region.right - region.left) * (region.bottom - region.top) <= SMALL_IMAGE_PX
        strengths = []
        for area in cores(region) if small else sample_areas(region):
            window = read_window(raster, area, corner_halo_px(options), statistics.saturation)
            peaks = corner_peaks(window, statistics, options, self.strength)
            strengths.append(peaks.strength)
            if small:
                known[area.bounds] = peaks
        every = np.concatenate(strengths)
        if not len(every):
            return replace(options, interest_threshold=0.0, super_threshold=0.0)
        low, high = np.quantile(every, [1.0 - options.interest_share, 1.0 - options.super_share])
        return replace(
            options,
            interest_threshold=low if options.interest_threshold is None else options.interest_threshold,
            super_threshold=high if options.super_threshold is None else options.super_threshold,
        )

    def _find(
        self, window: DetectionWindow, statistics: ImageStatistics, options: CornerOptions,
        known: dict[tuple[int, int, int, int], Peaks],
    ) -> InterestPoints:  # fmt: skip
        peaks = known.pop(window.core.bounds, None) or corner_peaks(window, statistics, options, self.strength)
        strong = peaks.strength > (options.interest_threshold or 0.0)
        return _corner_table(Peaks(*(column[strong] for column in peaks)), options.super_threshold or 0.0)


def _corner_table(peaks: Peaks, super_threshold: float) -> InterestPoints:
    count = len(peaks.xy)
    unknown = np.full(count, np.nan)
    quality = peaks.strength / (peaks.strength + max(super_threshold, 1e-30))  # 0.5 at TA
    return InterestPoints(
        peaks.xy, np.where(peaks.strength > super_threshold, SUPER, CORNER).astype("U9"),
        peaks.sigma_px[:, None, None] ** 2 * np.eye(2), peaks.strength.astype(np.float64), quality.astype(np.float64),
        np.full((count, 2), np.nan), unknown, unknown, unknown,
    )  # fmt: skip


@dataclass(frozen=True)
class CentreDetector:
    """Gravity centres of closed regions with a shape, and of blobs where there is none."""

    def halo_px(self, options: DetectionOptions) -> int:
        return centre_halo_px(options.centres)

    def prepare(
        self, raster: Raster, region: Area, statistics: ImageStatistics, options: DetectionOptions
    ) -> Callable[[DetectionWindow], InterestPoints]:
        return partial(self._find, statistics=statistics, options=options.centres)

    def _find(self, window: DetectionWindow, statistics: ImageStatistics, options: CentreOptions) -> InterestPoints:
        of_shape = replace(options, quality=min(options.quality / CHANCE_OF_SHAPE, 1.0))
        shapes = _centre_table(gravity_centres(window, statistics, of_shape))
        found = find_blobs(normalise(window, statistics), window.usable, options)
        blobs = _blob_table(found.select(found.chance >= options.quality), window)
        return join_points([shapes, blobs.select(window.core.contains(blobs.xy) & ~_covered(blobs, shapes))])


def _centre_table(centres: list[Centre]) -> InterestPoints:
    if not centres:
        return no_points()
    return InterestPoints(
        np.array([c.xy for c in centres]), np.array([c.kind for c in centres], dtype="U9"),
        np.array([c.covariance_px2 for c in centres]), np.array([abs(c.contrast) for c in centres]),
        CHANCE_OF_SHAPE * np.array([c.quality for c in centres]), np.array([c.size_px for c in centres]),
        np.array([c.azimuth_rad for c in centres]), np.array([c.contrast for c in centres]),
        np.array([c.rmse_px for c in centres]),
    )  # fmt: skip


def _blob_table(blobs: Blobs, window: DetectionWindow) -> InterestPoints:
    if not len(blobs.xy):
        return no_points()
    size, azimuth, uneven = blobs.ellipse()
    contrast = blobs.grey_contrast(window.grey)
    return InterestPoints(
        blobs.xy + window.origin, np.full(len(blobs.xy), BLOB, dtype="U9"),
        blobs.sigma_px[:, None, None] ** 2 * np.eye(2), np.abs(contrast), blobs.chance, size, azimuth, contrast, uneven,
    )  # fmt: skip


def _covered(blobs: InterestPoints, shapes: InterestPoints) -> np.ndarray:
    """Return the mask of blobs that lie in a strong shape of like size: the same object, measured better."""
    shapes = shapes.select(shapes.quality >= STRONG_QUALITY)
    if not len(shapes) or not len(blobs):
        return np.zeros(len(blobs), dtype=bool)
    diameter, of_blob = (np.sqrt(np.prod(points.size_px, axis=1)) for points in (shapes, blobs))
    near = cKDTree(shapes.xy).query_ball_point(blobs.xy, COVERED_SHARE * float(diameter.max()))
    covered = np.zeros(len(blobs), dtype=bool)
    for row, others in enumerate(near):
        away = np.hypot(*(shapes.xy[others] - blobs.xy[row]).T)
        alike = np.abs(np.log(diameter[others] / of_blob[row])) < np.log(LIKE_SIZE)
        covered[row] = bool((alike & (away < COVERED_SHARE * diameter[others])).any())
    return covered


#: Detectors by the name that `interest-points` and matching know them by.
DETECTORS: dict[str, Detector] = {
    "harris": CornerDetector(harris_strength),
    "foerstner": CornerDetector(foerstner_strength),
    "centres": CentreDetector(),
}


def detect_interest_points(
    raster: Raster,
    detector: str = "harris",
    options: DetectionOptions | None = None,
    region: Area | None = None,
    progress: Progress = silent,
) -> InterestPoints:
    """Return the interest points of an image, or of a region of it, in a fixed order.

    The result does not depend on the windows the image is read in; memory is that of ``threads`` windows of 2048 x 2048
    pixels and of the points.

    Parameters
    ----------
    raster : Raster
        The image's pixels.
    detector : str
        One of `DETECTORS`.
    options : DetectionOptions, optional
        What to look for.
    region : Area, optional
        The part of the image; by default all.
    progress : Progress
        Callback; False cancels.

    Returns
    -------
    InterestPoints
        The points.

    Raises
    ------
    InputError
        An unknown detector, or a region without pixels.
    Cancelled
        When ``progress`` asks to stop.
    """
    options = options or DetectionOptions()
    if detector not in DETECTORS:
        raise InputError(f"no interest point detector {detector!r}: choose one of {', '.join(DETECTORS)}")
    region = inside(region, raster)
    statistics = image_statistics(raster, region, options.mask_saturated)
    find = DETECTORS[detector].prepare(raster, region, statistics, options)
    halo = DETECTORS[detector].halo_px(options)

    def of_core(core: Area) -> InterestPoints:
        return find(read_window(raster, core, halo, statistics.saturation))

    parts, areas = [], cores(region)
    with open_calls(threads=thread_count(options.threads)) as calls:
        for number, found in enumerate(calls.answers(of_core, areas)):
            parts.append(found)
            advance(progress, (number + 1) / len(areas), f"{detector}: {sum(map(len, parts))} points")
    points = join_points(parts)
    if options.per_cell:
        points = points.select(spread_over_grid(points, options.cell_px, options.per_cell))
    return points


def inside(region: Area | None, raster: Raster) -> Area:
    """Return the part of a region that lies inside the image, all of it for None; `InputError` where it is nothing."""
    width, height = raster.size
    wanted = region or Area(0, 0, width, height)
    cut = Area(max(wanted.left, 0), max(wanted.top, 0), min(wanted.right, width), min(wanted.bottom, height))
    if cut.right - cut.left < SMALLEST_IMAGE_PX or cut.bottom - cut.top < SMALLEST_IMAGE_PX:
        raise InputError(
            f"the window {wanted.left},{wanted.top} to {wanted.right},{wanted.bottom} has less than "
            f"{SMALLEST_IMAGE_PX} x {SMALLEST_IMAGE_PX} pixels in the image of {width} x {height}: choose a larger one"
        )
    return cut

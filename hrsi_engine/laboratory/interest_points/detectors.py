"""Detectors by name, and running one over an image of any size.

A detector is prepared once for an image (thresholds from the image's own statistics) and then called for window after
window; only the points it returns stay in memory. To add one, write its `Detector` and enter it in `DETECTORS`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from ...block.block import Raster
from ...foundation.errors import InputError
from ...foundation.progress import Progress, advance, silent
from ...foundation.thresholds import threshold, thresholds
from ...foundation.workers.scheduling import open_calls
from ...measurement.interest_points.gravity_centres import GravityCentre, compute_centre_halo_px, find_gravity_centres
from ...measurement.interest_points.options import STRONG_QUALITY, CentreOptions
from ...measurement.interest_points.windows import (
    Area,
    DetectionWindow,
    ImageStatistics,
    choose_sample_areas,
    estimate_image_statistics,
    normalise,
    read_window,
    tile_region,
)
from .blobs import BLOB_PAIRS, Blobs, find_blobs
from .corners import (
    CornerPeaks,
    Strength,
    compute_corner_halo_px,
    compute_foerstner_strength,
    compute_harris_strength,
    find_corner_peaks,
)
from .options import CornerOptions, DetectionOptions
from .points import CORNER, SUPER, InterestPoints, join_points, make_empty_points, select_best_per_cell

BLOB = "blob"


@thresholds
class DETECTION:
    """Limits for the size of images, and for two centres of one object."""

    shape_chance: float = threshold(
        2.0 / 3.0, "", "factor of the quality of shapes: probability to be detected again", BLOB_PAIRS
    )
    same_centre: float = threshold(0.15, "", "largest distance of a blob and a shape of one object over its diameter")
    same_size: float = threshold(1.4, "", "largest ratio of the diameters of a blob and a shape of one object")
    smallest_side_px: int = threshold(32, "px", "smallest side of an image or window")
    small_image_px: int = threshold(2**22, "px", "area up to which thresholds are set from the whole image")


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
        return compute_corner_halo_px(options.corners)

    def prepare(
        self, raster: Raster, region: Area, statistics: ImageStatistics, options: DetectionOptions
    ) -> Callable[[DetectionWindow], InterestPoints]:
        cache: dict[tuple[int, int, int, int], CornerPeaks] = {}
        thresholds = self._thresholds(raster, region, statistics, options.corners, cache)
        return partial(self._find, statistics=statistics, options=thresholds, cache=cache)

    def _thresholds(
        self,
        raster: Raster,
        region: Area,
        statistics: ImageStatistics,
        options: CornerOptions,
        cache: dict[tuple[int, int, int, int], CornerPeaks],
    ) -> CornerOptions:
        """Return the options with TA and TB set from the strengths of the local maxima in sample windows.

        The peaks of small images are kept in ``cache``, to be found only once.
        """
        if options.interest_threshold is not None and options.super_threshold is not None:
            return options
        small = (region.right - region.left) * (region.bottom - region.top) <= DETECTION.small_image_px
        strengths = []
        for area in tile_region(region) if small else choose_sample_areas(region):
            window = read_window(raster, area, compute_corner_halo_px(options), statistics.saturation)
            peaks = find_corner_peaks(window, statistics, options, self.strength)
            strengths.append(peaks.strength)
            if small:
                cache[area.bounds] = peaks
        all_strengths = np.concatenate(strengths)
        if not len(all_strengths):
            return replace(options, interest_threshold=0.0, super_threshold=0.0)
        low, high = np.quantile(all_strengths, [1.0 - options.interest_share, 1.0 - options.super_share])
        return replace(
            options,
            interest_threshold=low if options.interest_threshold is None else options.interest_threshold,
            super_threshold=high if options.super_threshold is None else options.super_threshold,
        )

    def _find(
        self,
        window: DetectionWindow,
        statistics: ImageStatistics,
        options: CornerOptions,
        cache: dict[tuple[int, int, int, int], CornerPeaks],
    ) -> InterestPoints:
        peaks = cache.pop(window.core.bounds, None) or find_corner_peaks(window, statistics, options, self.strength)
        strong = peaks.strength > (options.interest_threshold or 0.0)
        xy, strength, sigma_px = (column[strong] for column in peaks)
        threshold, unknown = options.super_threshold or 0.0, np.full(len(xy), np.nan)
        quality = strength / (strength + max(threshold, 1e-30))  # 0.5 at TA
        return InterestPoints(
            xy=xy,
            kind=np.where(strength > threshold, SUPER, CORNER).astype("U9"),
            covariance_px2=sigma_px[:, None, None] ** 2 * np.eye(2),
            strength=strength.astype(np.float64),
            quality=quality.astype(np.float64),
            size_px=np.full((len(xy), 2), np.nan),
            azimuth_rad=unknown,
            contrast=unknown,
            rmse_px=unknown,
        )


@dataclass(frozen=True)
class CentreDetector:
    """Gravity centres of closed regions with a shape, and of blobs where there is none."""

    def halo_px(self, options: DetectionOptions) -> int:
        return compute_centre_halo_px(options.centres)

    def prepare(
        self, raster: Raster, region: Area, statistics: ImageStatistics, options: DetectionOptions
    ) -> Callable[[DetectionWindow], InterestPoints]:
        return partial(self._find, statistics=statistics, options=options.centres)

    def _find(self, window: DetectionWindow, statistics: ImageStatistics, options: CentreOptions) -> InterestPoints:
        of_shape = replace(options, quality=min(options.quality / DETECTION.shape_chance, 1.0))
        shapes = _tabulate_centres(find_gravity_centres(window, statistics, of_shape))
        candidates = find_blobs(normalise(window, statistics), window.usable, options)
        blobs = _tabulate_blobs(candidates.select(candidates.chance >= options.quality), window)
        return join_points([shapes, blobs.select(window.core.contains(blobs.xy) & ~_is_same_object(blobs, shapes))])


def _tabulate_centres(centres: list[GravityCentre]) -> InterestPoints:
    """Return gravity centres as interest points; their quality is the chance to be found again."""
    if not centres:
        return make_empty_points()
    return InterestPoints(
        xy=np.array([c.xy for c in centres]),
        kind=np.array([c.kind for c in centres], dtype="U9"),
        covariance_px2=np.array([c.covariance_px2 for c in centres]),
        strength=np.array([abs(c.contrast) for c in centres]),
        quality=DETECTION.shape_chance * np.array([c.quality for c in centres]),
        size_px=np.array([c.size_px for c in centres]),
        azimuth_rad=np.array([c.azimuth_rad for c in centres]),
        contrast=np.array([c.contrast for c in centres]),
        rmse_px=np.array([c.rmse_px for c in centres]),
    )


def _tabulate_blobs(blobs: Blobs, window: DetectionWindow) -> InterestPoints:
    """Return blobs as interest points of the image, in the window's pixels so far."""
    if not len(blobs.xy):
        return make_empty_points()
    size, azimuth, uneven = blobs.ellipse()
    contrast = blobs.grey_contrast(window.grey)
    return InterestPoints(
        xy=blobs.xy + window.origin,
        kind=np.full(len(blobs.xy), BLOB, dtype="U9"),
        covariance_px2=blobs.sigma_px[:, None, None] ** 2 * np.eye(2),
        strength=np.abs(contrast),
        quality=blobs.chance,
        size_px=size,
        azimuth_rad=azimuth,
        contrast=contrast,
        rmse_px=uneven,
    )


def _is_same_object(blobs: InterestPoints, shapes: InterestPoints) -> np.ndarray:
    """Return the mask of blobs that lie in a strong shape of like size: the same object, measured better."""
    shapes = shapes.select(shapes.quality >= STRONG_QUALITY)
    if not len(shapes) or not len(blobs):
        return np.zeros(len(blobs), dtype=bool)
    diameter, of_blob = (np.sqrt(np.prod(points.size_px, axis=1)) for points in (shapes, blobs))
    neighbours = cKDTree(shapes.xy).query_ball_point(blobs.xy, DETECTION.same_centre * float(diameter.max()))
    covered = np.zeros(len(blobs), dtype=bool)
    for row, rows in enumerate(neighbours):
        distance_px = np.hypot(*(shapes.xy[rows] - blobs.xy[row]).T)
        has_same_size = np.abs(np.log(diameter[rows] / of_blob[row])) < np.log(DETECTION.same_size)
        covered[row] = bool((has_same_size & (distance_px < DETECTION.same_centre * diameter[rows])).any())
    return covered


#: Detectors by the name that `interest-points` and matching know them by.
DETECTORS: dict[str, Detector] = {
    "harris": CornerDetector(compute_harris_strength),
    "foerstner": CornerDetector(compute_foerstner_strength),
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
    region = clip_to_image(region, raster)
    statistics = estimate_image_statistics(raster, region, options.mask_saturated)
    find = DETECTORS[detector].prepare(raster, region, statistics, options)
    halo = DETECTORS[detector].halo_px(options)

    def of_core(core: Area) -> InterestPoints:
        return find(read_window(raster, core, halo, statistics.saturation))

    parts, areas = [], tile_region(region)
    with open_calls(threads=options.threads) as calls:
        for number, found in enumerate(calls.answers(of_core, areas)):
            parts.append(found)
            advance(progress, (number + 1) / len(areas), f"{detector}: {sum(map(len, parts))} points")
    points = join_points(parts)
    if options.per_cell:
        points = points.select(select_best_per_cell(points, options.cell_px, options.per_cell))
    return points


def clip_to_image(region: Area | None, raster: Raster) -> Area:
    """Return the part of a region that lies inside the image, all of it for None; `InputError` where it is nothing."""
    width, height = raster.size
    requested = region or Area(0, 0, width, height)
    cut = Area(
        max(requested.left, 0), max(requested.top, 0), min(requested.right, width), min(requested.bottom, height)
    )
    smallest_px = DETECTION.smallest_side_px
    if cut.right - cut.left < smallest_px or cut.bottom - cut.top < smallest_px:
        raise InputError(
            f"the window {requested.left},{requested.top} to {requested.right},{requested.bottom} has less than "
            f"{smallest_px} x {smallest_px} pixels in the image of {width} x {height}: choose a larger one"
        )
    return cut

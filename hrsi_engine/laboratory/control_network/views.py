"""The two windows to be matched: grey values, usable pixels and interest points, in the windows' own coordinates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...block.block import ArrayRaster, Raster
from ...foundation.pixel_filters import blur, erode, interpolate
from ...foundation.progress import Progress, silent, stage
from ...foundation.thresholds import threshold, thresholds
from ...measurement.interest_points.windows import Area
from ...measurement.window_matching.windows import MatchImage
from ..interest_points.detectors import detect_interest_points
from ..interest_points.options import DetectionOptions
from ..interest_points.points import InterestPoints, join_points
from .leaves import NETWORK


@dataclass(frozen=True, eq=False)
class NetworkWindow:
    """One window: ``grey`` float32 and ``usable`` bool (lines, samples); points have (0, 0) at its first pixel.

    origin : sample and line of the window's first pixel in the image; reduction : pixels of the image for one of the
    window, 1 or more
    """

    grey: np.ndarray
    usable: np.ndarray
    points: InterestPoints
    origin: np.ndarray
    reduction: float = 1.0

    @property
    def xy(self) -> np.ndarray:
        """Positions of the interest points, ``(n, 2)``."""
        return self.points.xy

    @property
    def size(self) -> np.ndarray:
        """Samples and lines, ``(2,)``."""
        return np.array(self.grey.shape[::-1])

    @cached_property
    def match_image(self) -> MatchImage:
        """The window prepared for least-squares matching."""
        return MatchImage(self.grey, self.usable, NETWORK.smoothing_px)

    def to_image(self, xy: np.ndarray) -> np.ndarray:
        """Return positions ``(n, 2)`` of the window as sample and line of the image."""
        return (xy + 0.5) * self.reduction - 0.5 + self.origin


def read_network_window(
    raster: Raster,
    area: Area,
    detectors: Sequence[str],
    options: DetectionOptions,
    reduction: float = 1.0,
    progress: Progress = silent,
) -> NetworkWindow:
    """Return a window of an image with its interest points; the window must lie within the image.

    reduction : by how much the pixels are enlarged first, averaged over their area
    """
    grey, usable = raster.read(area.left, area.top, area.right - area.left, area.bottom - area.top)
    grey = np.where(usable, grey, 0).astype(np.float32)
    if reduction != 1.0:
        y, x = np.mgrid[tuple(slice(int(length / reduction)) for length in grey.shape)].astype(np.float32)
        places = (x + 0.5) * reduction - 0.5, (y + 0.5) * reduction - 0.5
        smooth = blur(grey, 0.5 * np.sqrt(reduction**2 - 1.0))  # of a pixel to that of a larger one
        # A larger pixel is usable where all that it is made of are
        clear = erode(usable, 2 * int(np.ceil(reduction)) + 1)
        usable = interpolate(clear.view(np.uint8), *places, order=0, outside=0) > 0
        grey = interpolate(smooth, *places, order=1)
    pixels = ArrayRaster(grey, usable)
    ends = np.linspace(0.0, 1.0, len(detectors) + 1).tolist()
    parts = [
        detect_interest_points(pixels, name, options, progress=stage(progress, *ends[k : k + 2]))
        for k, name in enumerate(detectors)
    ]
    origin = np.array([area.left, area.top], dtype=float)
    return NetworkWindow(grey, usable, join_points(parts), origin, reduction)


@thresholds
class PATCHES:
    """Limits for correlated patches."""

    half_px: int = threshold(8, "px", "half side of a patch (17 x 17 px)")
    least_usable: float = threshold(0.75, "", "smallest share of pixels that are valid in both")
    batch: int = threshold(1800, "patches", "number of patches in memory together")


def correlate_patches(
    first: NetworkWindow, second: NetworkWindow, first_xy: np.ndarray, second_xy: np.ndarray, A: np.ndarray
) -> np.ndarray:
    """Return the correlation coefficient ``(n,)`` of each patch with its image under ``A`` (n, 2, 2).

    ``first_xy`` and ``second_xy`` are the patches' middles ``(n, 2)`` in the windows.
    0 where too few pixels of the patch are usable.
    """
    result = np.empty(len(first_xy))
    y, x = np.mgrid[-PATCHES.half_px : PATCHES.half_px + 1, -PATCHES.half_px : PATCHES.half_px + 1]
    offsets = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    for start in range(0, len(first_xy), PATCHES.batch):
        part = slice(start, start + PATCHES.batch)
        # A patch is spread over as many pixels of the image with the larger scale, so that neither is undersampled.
        ours, our_usable = _sample_patches(first, first_xy[part][:, None, :] + offsets)
        transformed = np.einsum("nij,kj->nki", A[part], offsets)
        theirs, their_usable = _sample_patches(second, second_xy[part][:, None, :] + transformed)
        weight = (our_usable & their_usable).astype(np.float32)
        count = np.maximum(weight.sum(axis=1), 1.0)
        a, b = ((grey - ((grey * weight).sum(axis=1) / count)[:, None]) * weight for grey in (ours, theirs))
        product = (a * b).sum(axis=1) / np.sqrt(np.maximum((a * a).sum(axis=1) * (b * b).sum(axis=1), 1e-12))
        result[part] = np.where(weight.mean(axis=1) >= PATCHES.least_usable, product, 0.0)
    return result


def _sample_patches(view: NetworkWindow, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return grey values and usability of positions ``(n, k, 2)``, bilinear."""
    places = xy.astype(np.float32)
    grey = interpolate(view.grey, places[..., 0], places[..., 1], order=1)
    usable = interpolate(view.usable.view(np.uint8), places[..., 0], places[..., 1], order=0, outside=0)
    return grey, usable.astype(bool)

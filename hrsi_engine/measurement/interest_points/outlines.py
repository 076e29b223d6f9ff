"""Sub-pixel outlines: edge points at the maxima of the gradient near the outline of a region's pixels.

The pixel outline is smoothed and divided into points of equal distance; along the normal of each the gradient of the
grey values (Gaussian derivative) is sampled, and the edge is the peak of a parabola through the largest value. All
regions of a window are measured together, large ones first in the reduced image in which they were found.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from ...block.columns import Columns
from ...foundation import pixel_filters as filters
from ...foundation.pixel_filters import BLUR
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import EQUALITY, threshold, thresholds
from .corners import make_gaussian_kernels
from .level_regions import HOMOGENEOUS, LevelRegions


@thresholds
class OUTLINE_SAMPLING:
    """Sampling of a region's outline and detection of its edge points."""

    step_px: float = threshold(0.5, "px", "spacing of samples along a normal")
    smoothing_points: float = threshold(1.5, "points", "standard deviation of the outline's smoothing")
    opened_pixels: int = threshold(60, "px", "area above which thin connections are removed by opening")
    fewest_points: int = threshold(16, "points", "fewest points of an outline")
    most_points: int = threshold(96, "points", "most points of an outline")


@dataclass(frozen=True, eq=False)
class GradientImage:
    """Grey values of a window, reduced by ``scale``, their gradient and its noise; unusable pixels have gradient 0."""

    grey: np.ndarray
    usable: np.ndarray
    noise: float
    scale: int = 1

    @cached_property
    def gradient(self) -> np.ndarray:
        """Derivative by column + 1j * derivative by row, complex64."""
        smooth, slope = make_gaussian_kernels(BLUR.sigma_px)
        derivatives = np.empty((*self.grey.shape, 2), dtype=np.float32)
        derivatives[..., 0], derivatives[..., 1] = filters.slopes(self.grey, smooth, slope, "reflect")
        if not self.usable.all():
            derivatives[filters.dilate(~self.usable, 5)] = 0.0
        return derivatives.view(np.complex64)[..., 0]

    @property
    def threshold(self) -> float:
        """Smallest gradient of a clear edge."""
        return ROBUST.rejected * self.noise * compute_slope_noise()

    def reduce(self, scale: int) -> GradientImage:
        """Return the `GradientImage` of the image reduced by averaging ``scale`` x ``scale`` pixels."""
        if scale == 1:
            return self
        size = self.grey.shape[1] // scale, self.grey.shape[0] // scale
        grey, usable = filters.reduce_by_area(self.grey, size), filters.reduce_mask(self.usable, size)
        return GradientImage(grey, usable, self.noise / scale, scale)


@dataclass(frozen=True, eq=False)
class Outlines(Columns):
    """Edge points of n regions, in order around each, padded to m points.

    xy : (n, m, 2) in the window; normal : (n, m, 2) unit vectors outwards; slope : (n, m) gradient in grey values per
    px, positive for the expected sign; found : (n, m) mask of clear edges; count : (n,) number of points before padding
    """

    xy: np.ndarray
    normal: np.ndarray
    slope: np.ndarray
    found: np.ndarray
    count: np.ndarray


def compute_slope_noise() -> float:
    """Return the standard deviation of the gradient for image noise of 1 grey value."""
    smooth, slope = make_gaussian_kernels(BLUR.sigma_px)
    return float(np.sqrt(np.sum(smooth**2) * np.sum(slope**2)))


def measure_outlines(slopes: GradientImage, regions: LevelRegions) -> Outlines:
    """Return the edge points of all regions."""
    points, normals, counts = _trace_pixel_outlines(regions)
    region = np.repeat(np.arange(len(regions)), counts)
    sign = -regions.sign[region].astype(np.float64)  # of the gradient in outward direction
    scale = regions.scale[region]
    slope, is_edge = np.zeros(len(points)), np.zeros(len(points), dtype=bool)
    for factor in np.unique(scale).tolist():
        rows = scale == factor
        level = slopes.reduce(factor)
        along = normals[rows], sign[rows]
        edge_xy, steep, clear = find_edges_along(level, points[rows], *along, BLUR.end_px)
        edge_xy = (edge_xy + 0.5) * factor - 0.5
        if factor > 1:
            edge_xy, steep, fine = find_edges_along(slopes, edge_xy, *along, 0.5 * factor)  # a pixel there
            clear &= fine
        points[rows], slope[rows], is_edge[rows] = edge_xy, steep, clear
    place = region, np.arange(len(points)) - np.repeat(np.r_[0, np.cumsum(counts)[:-1]], counts)
    padded = []
    for values in (points, normals, slope, is_edge):
        table = np.zeros((len(regions), OUTLINE_SAMPLING.most_points, *values.shape[1:]), dtype=values.dtype)
        table[place] = values
        padded.append(table)
    xy, normal, steepness, clear = padded
    return Outlines(xy, normal, steepness, clear, counts)


def find_edges_along(
    slopes: GradientImage, points: np.ndarray, normals: np.ndarray, sign: np.ndarray, reach_px: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the edge along each normal ``(n, 2)``, its gradient ``(n,)`` and whether it is clear ``(n,)``.

    The edge is the largest gradient of the given ``sign``; if that is 0, the first local maximum from inside that is
    nearly as large as the largest, of any sign. It must be inside the search range. Positions are pixels of ``slopes``.
    """
    steps = np.arange(-reach_px, reach_px + OUTLINE_SAMPLING.step_px / 2.0, OUTLINE_SAMPLING.step_px)
    x = points[:, :1] + steps * normals[:, :1]
    y = points[:, 1:] + steps * normals[:, 1:]
    gradient = interpolate_bilinear(slopes.gradient, x, y)
    along = normals[:, :1] * gradient.real + normals[:, 1:] * gradient.imag
    along = np.where(sign[:, None] == 0.0, np.abs(along), sign[:, None] * along)
    row, last = np.arange(len(points)), len(steps) - 1
    peak = along.copy()
    unsigned = sign == 0.0
    # Without a sign: 1 at the first local maximum above `first_peak_share` of the largest, else 0
    either, first_peak = along[unsigned], np.zeros((int(unsigned.sum()), len(steps)), dtype=np.float32)
    inner = either[:, 1:-1]
    large = inner >= EQUALITY.majority * either.max(axis=1, initial=0.0)[:, None]
    first_peak[:, 1:-1] = (inner >= either[:, :-2]) & (inner >= either[:, 2:]) & large
    peak[unsigned] = first_peak
    best = np.argmax(peak, axis=1)
    middle = np.clip(best, 1, last - 1)
    previous_value, peak_value, next_value = along[row, middle - 1], along[row, middle], along[row, middle + 1]
    bend = previous_value - 2.0 * peak_value + next_value
    shift = np.where(bend < 0.0, 0.5 * (previous_value - next_value) / np.where(bend < 0.0, bend, 1.0), 0.0)
    offset = OUTLINE_SAMPLING.step_px * (middle - last / 2.0 + np.clip(shift, -0.5, 0.5))
    clear = (best > 0) & (best < last) & (peak_value > slopes.threshold)
    return points + offset[:, None] * normals, peak_value, clear


# ---- pixel outlines --------------------------------------------------------------------------------------------


def _trace_pixel_outlines(regions: LevelRegions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points around the regions and outward normals ``(k, 2)``, in pixels of their scale; counts ``(n,)``."""
    # Centres of each region's outermost pixels, in order
    starts = regions.bounds[:-1]
    low = np.minimum.reduceat(regions.pixels, starts) - 1
    width, height = (np.maximum.reduceat(regions.pixels, starts) - low + 2).T
    region = np.repeat(np.arange(len(starts)), np.diff(regions.bounds))
    column, row = (regions.pixels - low[region]).T
    place = row * width[region] + column
    contours = []
    for number, (first, last, lines, samples) in enumerate(zip(starts, regions.bounds[1:], height, width, strict=True)):
        mask = np.zeros(lines * samples, dtype=bool)
        mask[place[first:last]] = True
        mask = mask.reshape(lines, samples)
        if last - first >= OUTLINE_SAMPLING.opened_pixels and (core := filters.apply_opening(mask, 3)).any():
            # The largest part after an opening, which removes thin connections to the surroundings
            parts, count = ndimage.label(core, np.ones((3, 3)))
            mask = core if count == 1 else parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])
        contours.append(trace_contour(mask) + low[number])
    # Points about 1 px apart along the closed contours; their numbers are multiples of 4
    lengths = np.array([len(contour) for contour in contours])
    starts = np.r_[0, np.cumsum(lengths)[:-1]]
    vertices = np.concatenate(contours).astype(np.float64)
    following = np.arange(len(vertices)) + 1
    following[starts + lengths - 1] = starts
    step = vertices[following] - vertices
    way = np.r_[0.0, np.cumsum(np.hypot(step[:, 0], step[:, 1]))]  # cumulated length of all contours
    perimeter = way[starts + lengths] - way[starts]
    counts = (
        4 * np.clip(np.rint(perimeter / 4.0), OUTLINE_SAMPLING.fewest_points / 4, OUTLINE_SAMPLING.most_points / 4)
    ).astype(np.int64)
    region = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(region)) - np.repeat(np.r_[0, np.cumsum(counts)[:-1]], counts)
    arc_length = way[starts][region] + perimeter[region] * number / counts[region]
    segment = np.searchsorted(way, arc_length, side="right") - 1
    share = (arc_length - way[segment]) / np.maximum(way[segment + 1] - way[segment], 1e-9)
    points = vertices[segment] + share[:, None] * step[segment]
    starts = np.r_[0, np.cumsum(counts)[:-1]]
    for count in np.unique(counts).tolist():  # Gaussian smoothing in the frequency domain
        rows = starts[counts == count][:, None] + np.arange(count)
        gain = np.exp(-2.0 * (np.pi * OUTLINE_SAMPLING.smoothing_points * np.fft.fftfreq(count)) ** 2)
        smooth = np.fft.ifft(np.fft.fft(points[rows, 0] + 1j * points[rows, 1]) * gain)
        points[rows, 0], points[rows, 1] = smooth.real, smooth.imag
    next_row, previous_row = np.arange(len(points)) + 1, np.arange(len(points)) - 1
    next_row[starts + counts - 1], previous_row[starts] = starts, starts + counts - 1
    tangent = points[next_row] - points[previous_row]
    length = np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / length[:, None]
    region = np.repeat(np.arange(len(counts)), counts)
    middle = np.add.reduceat(points, starts) / counts[:, None]
    outwards = np.add.reduceat(np.sum((points - middle[region]) * normal, axis=1), starts)
    normal *= np.where(outwards < 0.0, -1.0, 1.0)[region, None]
    # the contour connects pixel centres; the edge is half a pixel outside, for even regions farther
    outside = np.where(regions.sign == HOMOGENEOUS, BLUR.edge_px, 0.5)[region]
    return points + outside[:, None] * normal, normal, counts


def trace_contour(mask: np.ndarray) -> np.ndarray:
    """Return column and row ``(k, 2)`` of the outermost pixels of a connected mask, clockwise as displayed.

    The first one is the leftmost pixel of the first row.
    """
    cv2 = filters.load_opencv()
    (contour,), _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.roll(contour[::-1, 0], 1, axis=0)


def interpolate_bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return an image interpolated bilinearly at columns x, rows y; outside it the values at the border."""
    x = np.clip(x, 0.0, image.shape[1] - 1.001)
    y = np.clip(y, 0.0, image.shape[0] - 1.001)
    column, row = x.astype(np.int64), y.astype(np.int64)
    x, y = (x - column).astype(np.float32), (y - row).astype(np.float32)
    flat, first = image.ravel(), row * image.shape[1] + column
    upper = flat.take(first)
    upper += x * (flat.take(first + 1) - upper)
    first += image.shape[1]
    lower = flat.take(first)
    lower += x * (flat.take(first + 1) - lower)
    return upper + y * (lower - upper)

"""Sub-pixel outlines: from the pixels of a region to edge points where the grey values change fastest.

The pixel outline is smoothed and cut into points of equal distance; along the normal of each the slope of the grey
values (Gaussian derivative) is sampled, and the edge is the peak of the parabola through the largest slope. All regions
of a window are measured in one go.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .corners import gaussian_kernels
from .level_regions import Region

SLOPE_PX = 1.0  # standard deviation of the Gaussian
STEP_PX = 0.25  # between samples along a normal
REACH_PX = 2.5  # along a normal to each side, in pixels of the region's scale
SMOOTHED_POINTS = 1.5  # standard deviation of the outline's smoothing, in points
OPENED_PIXELS = 60
FEWEST_POINTS, MOST_POINTS = 16, 96


@dataclass(frozen=True, eq=False)
class Outlines:
    """Edge points of many regions, in order around each.

    xy : (n, 2) in the window; normal : (n, 2) unit vectors outwards; slope : (n,) grey values per px, the right sign
    positive; found : (n,) mask of clear edges; region : (n,) index of the region, sorted
    """

    xy: np.ndarray
    normal: np.ndarray
    slope: np.ndarray
    found: np.ndarray
    region: np.ndarray


def measure_outlines(grey: np.ndarray, regions: list[Region], noise: float) -> Outlines:
    """Return the edge points of all regions in a window's grey values (float32)."""
    starts = [_outline_points(region) for region in regions]
    counts = [len(points) for points, _ in starts]
    index = np.repeat(np.arange(len(regions)), counts)
    if not len(index):
        return Outlines(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty(0, bool), index)
    points = np.concatenate([points for points, _ in starts])
    normals = np.concatenate([normals for _, normals in starts])
    scale = np.array([region.scale for region in regions], dtype=np.float64)[index]
    sign = np.where([region.bright for region in regions], -1.0, 1.0)[index]  # of the slope outwards
    offset, slope, inside = _steepest(grey, points, normals, sign, scale)
    found = inside & (slope > SLOPE_TO_NOISE * noise * slope_noise())
    return Outlines(points + offset[:, None] * normals, normals, slope, found, index)


SLOPE_TO_NOISE = 4.0


def slope_noise() -> float:
    """Return the standard deviation of the slope for noise of 1 grey value."""
    smooth, slope = gaussian_kernels(SLOPE_PX)
    return float(np.sqrt(np.sum(smooth**2) * np.sum(slope**2)))


def _outline_points(region: Region) -> tuple[np.ndarray, np.ndarray]:
    """Return points around a region and their outward normals, both ``(n, 2)``, in full-resolution pixels."""
    low = region.pixels.min(axis=0)
    size = region.pixels.max(axis=0) - low + 3
    mask = np.zeros((size[1], size[0]), dtype=np.uint8)
    mask[region.pixels[:, 1] - low[1] + 1, region.pixels[:, 0] - low[0] + 1] = 1
    if len(region.pixels) >= OPENED_PIXELS:  # cut off threads by which a region leaks into its surroundings
        opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        mask = opened if opened.any() else mask
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=len)[:, 0].astype(np.float64) + low - 1
    points = _evenly_spaced(contour, region.scale)
    points = _smoothed(points)
    tangent = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    length = np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / length[:, None]
    if np.sum((points - points.mean(axis=0)) * normal) < 0.0:
        normal = -normal
    outer = points + 0.5 * normal  # the contour runs through pixel middles, the edge lies half a pixel outside
    return (outer + 0.5) * region.scale - 0.5, normal


def _evenly_spaced(contour: np.ndarray, scale: int) -> np.ndarray:
    """Return points about 1 px apart along a closed contour, `FEWEST_POINTS` … `MOST_POINTS`."""
    closed = np.vstack([contour, contour[:1]])
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(closed, axis=0).T))]
    count = int(np.clip(round(along[-1]), FEWEST_POINTS, MOST_POINTS))
    at = along[-1] * np.arange(count) / count
    return np.column_stack([np.interp(at, along, closed[:, axis]) for axis in (0, 1)])


def _smoothed(points: np.ndarray) -> np.ndarray:
    """Return a closed outline smoothed by a Gaussian, in the frequency domain."""
    frequency = np.fft.fftfreq(len(points))
    gain = np.exp(-2.0 * (np.pi * SMOOTHED_POINTS * frequency) ** 2)
    spectrum = np.fft.fft(points[:, 0] + 1j * points[:, 1]) * gain
    smooth = np.fft.ifft(spectrum)
    return np.column_stack([smooth.real, smooth.imag])


def _steepest(
    grey: np.ndarray, points: np.ndarray, normals: np.ndarray, sign: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where along each normal the signed slope is largest, that slope, and whether it peaks inside the reach."""
    smooth, derivative = gaussian_kernels(SLOPE_PX)
    by_x = cv2.sepFilter2D(grey, cv2.CV_32F, derivative, smooth, borderType=cv2.BORDER_REFLECT)
    by_y = cv2.sepFilter2D(grey, cv2.CV_32F, smooth, derivative, borderType=cv2.BORDER_REFLECT)
    steps = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2.0, STEP_PX)
    offsets = scale[:, None] * steps
    x = points[:, :1] + offsets * normals[:, :1]
    y = points[:, 1:] + offsets * normals[:, 1:]
    along = sign[:, None] * (normals[:, :1] * bilinear(by_x, x, y) + normals[:, 1:] * bilinear(by_y, x, y))
    best = np.argmax(along, axis=1)
    inside = (best > 0) & (best < len(steps) - 1)
    middle = np.clip(best, 1, len(steps) - 2)
    row = np.arange(len(points))
    before, at, after = along[row, middle - 1], along[row, middle], along[row, middle + 1]
    bend = before - 2.0 * at + after
    shift = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)
    offset = scale * STEP_PX * (middle - (len(steps) - 1) / 2.0 + np.clip(shift, -0.5, 0.5))
    return offset, along[row, best], inside


def bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return an image at positions inside it (columns x, rows y); outside its border values go on."""
    x = np.clip(x, 0.0, image.shape[1] - 1.001)
    y = np.clip(y, 0.0, image.shape[0] - 1.001)
    column, row = x.astype(np.int64), y.astype(np.int64)
    x, y = x - column, y - row
    flat, first = image.ravel(), row * image.shape[1] + column
    upper = flat[first] * (1.0 - x) + flat[first + 1] * x
    lower = flat[first + image.shape[1]] * (1.0 - x) + flat[first + image.shape[1] + 1] * x
    return upper * (1.0 - y) + lower * y

"""Correlation of a window with every position of a larger one by FFT, of grey values or of gradient directions.

Directions change less between seasons and sensors than grey values. The gradient ``g = gx + i gy`` of each pixel
becomes ``(g / |g|)² |g| / (|g| + m)``, with the median length m: doubling the angle makes opposite contrasts equal, and
the factor suppresses noise without letting strong edges dominate (orientation correlation: Fitch, Kadyrov, Christmas
and Kittler 2002).
"""

from typing import NamedTuple

import numpy as np
from scipy import fft

from ...foundation.pixel_filters import SCHARR, blur, erode, slopes
from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import EQUALITY
from .windows import MATCHING


def correlate_template(template: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the correlation coefficient, -1 to 1, float64, at every shift with the template inside the area.

    The sums of products come from Fourier transforms, those of the windows' means and squares from summed-area tables
    (Lewis 1995).

    template, area : (t, u) and (a, b) grey values
    Result: ``(a - t + 1, b - u + 1)``, the first for the template at the first pixels; -1 for places without contrast.
    """
    template_values = template.astype(np.float64)
    template_values -= template_values.mean()
    area_values = area.astype(np.float64)
    area_values -= area_values.mean()
    size = [fft.next_fast_len(length, real=True) for length in area.shape]
    product = fft.rfft2(area_values, size) * np.conj(fft.rfft2(template_values, size))
    lines, samples = (a - t + 1 for a, t in zip(area.shape, template.shape, strict=True))
    sums = fft.irfft2(product, size)[:lines, :samples]
    shape = template.shape[0], template.shape[1]
    squares = sum_windows(area_values**2, shape) - sum_windows(area_values, shape) ** 2 / template.size
    has_contrast = squares > EQUALITY.rounding * template.size * np.mean(area_values**2)
    norm = np.sqrt(np.sum(template_values**2) * np.where(has_contrast, squares, 1.0))
    return np.where(has_contrast & (norm > 0.0), sums / np.maximum(norm, 1e-300), -1.0)


def sum_windows(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the sums over a window of ``shape`` (lines, samples) at every position inside, by a summed-area table."""
    total = np.pad(np.cumsum(np.cumsum(values, axis=0, dtype=np.float64), axis=1), ((1, 0), (1, 0)))
    lines, samples = shape
    return total[lines:, samples:] - total[:-lines, samples:] - total[lines:, :-samples] + total[:-lines, :-samples]


class CorrelationPeak(NamedTuple):
    """The best shift ``(2,)`` in samples and lines, its score, and measures of its reliability.

    ``contrast`` is the distance from the median of the surface in units of its robust standard deviation; ``rival`` is
    the second best score at another place, as a share of the best one.
    """

    shift: np.ndarray
    score: float
    contrast: float
    rival: float


def compute_orientation_field(grey: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return the field of doubled gradient directions, complex64; 0 close to invalid pixels.

    With the gradient g as a complex number it is g² / (|g| (|g| + median |g|)): equal for edges of either sign, and
    nearly independent of the contrast.

    grey, valid : (rows, columns) grey values and mask
    """
    by_column, by_row = slopes(blur(np.asarray(grey, dtype=np.float32), MATCHING.gradient_smoothing_px), *SCHARR)
    gradient = by_column + 1j * by_row
    inside = erode(valid, MATCHING.gradient_side_px)
    length = np.abs(gradient)
    typical = float(np.median(length[inside])) if inside.any() else 0.0
    if typical <= 0.0:
        typical = float(length.max()) or 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        field = gradient**2 / (length * (length + typical))
    return np.where(inside & (length > 0.0), field, 0.0).astype(np.complex64)


def correlate_fields(template: np.ndarray, search: np.ndarray) -> np.ndarray:
    """Return the real part of the correlation at every shift with the template inside the search field."""
    shape = [fft.next_fast_len(size) for size in search.shape]
    product = fft.fft2(search, shape) * np.conj(fft.fft2(template, shape))
    lines, samples = (s - t + 1 for s, t in zip(search.shape, template.shape, strict=True))
    return np.ascontiguousarray(fft.ifft2(product)[:lines, :samples].real)


def correlate_orientations(template: np.ndarray, search: np.ndarray) -> np.ndarray:
    """Return the normalised correlation, -1 to 1, of orientation fields at every shift; 0 without any."""
    template_energy = float(np.square(np.abs(template)).sum())
    window_energy = sum_windows(np.square(np.abs(search)), (template.shape[0], template.shape[1]))
    energy = np.maximum(
        window_energy, 0.25 * template_energy
    )  # lower limit, so that half empty windows are not preferred
    return correlate_fields(template, search) / np.sqrt(max(template_energy, 1e-12) * np.maximum(energy, 1e-12))


def find_correlation_peak(surface: np.ndarray, separation: int = 3) -> CorrelationPeak:
    """Return the peak of a correlation surface; ``shift`` is counted from its first element.

    Rivals are peaks more than ``separation`` elements away.
    """
    row, column = np.unravel_index(int(np.argmax(surface)), surface.shape)
    best = float(surface[row, column])
    middle = float(np.median(surface))
    spread = float(robust_sigma(surface - middle))
    outside = surface.copy()
    outside[
        max(row - separation, 0) : row + separation + 1, max(column - separation, 0) : column + separation + 1
    ] = -np.inf
    second = float(outside.max())
    shift = np.array([column, row], dtype=np.float64) + locate_vertex(surface, int(row), int(column))
    return CorrelationPeak(
        shift, best, (best - middle) / max(spread, 1e-12), second / best if best > 0.0 and np.isfinite(second) else 0.0
    )


def locate_vertex(surface: np.ndarray, row: int, column: int) -> np.ndarray:
    """Return the vertex ``(2,)`` of the parabolas through the peak and its neighbours, column and row from the peak."""
    result = np.zeros(2)
    for axis, (place, line) in enumerate(((column, surface[row]), (row, surface[:, column]))):
        if 0 < place < len(line) - 1:
            previous, centre, above = line[place - 1 : place + 2]
            curvature = previous - 2.0 * centre + above
            if curvature < 0.0:
                result[axis] = 0.5 * (previous - above) / curvature
    return np.clip(result, -0.5, 0.5)

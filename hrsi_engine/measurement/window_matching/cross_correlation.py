"""Normalised cross-correlation of a window with every place of a larger one, by FFT."""

import numpy as np
from scipy import fft

from .windows import MATCHING


def correlate_template(template: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the correlation coefficient, -1 to 1, at every shift at which the template lies inside the area.

    Its first element is that of the area's first pixels; -1 where the area shows nothing. float64
    """
    own = template.astype(np.float64)
    own -= own.mean()
    other = area.astype(np.float64)
    other -= other.mean()
    size = [fft.next_fast_len(length, real=True) for length in area.shape]
    product = fft.rfft2(other, size) * np.conj(fft.rfft2(own, size))
    lines, samples = (a - t + 1 for a, t in zip(area.shape, template.shape, strict=True))
    sums = fft.irfft2(product, size)[:lines, :samples]
    shape = template.shape[0], template.shape[1]
    squares = sum_windows(other**2, shape) - sum_windows(other, shape) ** 2 / template.size
    known = squares > MATCHING.least_contrast * template.size * np.mean(other**2)
    norm = np.sqrt(np.sum(own**2) * np.where(known, squares, 1.0))
    return np.where(known & (norm > 0.0), sums / np.maximum(norm, 1e-300), -1.0)


def sum_windows(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the sums over a window of ``shape`` (lines, samples) at every place inside, from a summed-area table."""
    total = np.pad(np.cumsum(np.cumsum(values, axis=0, dtype=np.float64), axis=1), ((1, 0), (1, 0)))
    lines, samples = shape
    return total[lines:, samples:] - total[:-lines, samples:] - total[lines:, :-samples] + total[:-lines, :-samples]

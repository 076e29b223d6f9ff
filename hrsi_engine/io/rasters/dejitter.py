"""Resamples an image without jitter: each line once, at the position that its jitter curve states.

The pixel at sample s and line l is that of the source at ``s + c_s(l)`` and ``l + c_l(l)``, by the cubic convolution of
Keys (1981, IEEE Trans. ASSP 29, 1153-1160) along lines and samples. Beyond the border its pixels are repeated.
"""

import numpy as np
from osgeo import gdal

from ...block.jitter_curve import JitterCurve
from ...foundation.errors import OutputError
from ...foundation.progress import Progress, advance, silent
from ..opening.files import open_raster

LINES_AT_ONCE = 256


def rewrite_without_jitter(source_path: str, path: str, curve: JitterCurve, progress: Progress = silent) -> None:
    """Replace the pixels of an image's copy at ``path`` by those without jitter, and build its overviews again."""
    source = open_raster(source_path)
    target = gdal.OpenEx(path, gdal.OF_RASTER | gdal.OF_UPDATE, open_options=["IGNORE_COG_LAYOUT_BREAK=YES"])
    if target is None:
        raise OutputError(f"{path} cannot be opened for writing: check its permissions")
    samples, lines = source.RasterXSize, source.RasterYSize
    for first in range(0, lines, LINES_AT_ONCE):
        advance(progress, first / lines, "resampling lines")
        line = np.arange(first, min(first + LINES_AT_ONCE, lines))
        shift = curve.evaluate(line)
        source_line = line + shift[:, 1]
        line_above = np.floor(source_line).astype(np.int64)
        share = source_line - line_above
        low, high = int(line_above.min()) - 1, int(line_above.max()) + 3
        top, bottom = max(low, 0), min(max(high, 1), lines)
        top = min(top, bottom - 1)
        for number in range(1, source.RasterCount + 1):
            band = source.GetRasterBand(number)
            grey = band.ReadAsArray(0, top, samples, bottom - top)
            row = np.clip(line_above[:, None] + np.arange(-1, 3), top, bottom - 1) - top
            values = _resample(grey.astype(np.float64), row, share, shift[:, 0])
            if np.issubdtype(grey.dtype, np.integer):
                limits = np.iinfo(grey.dtype)
                values = np.clip(np.rint(values), limits.min, limits.max)
            nodata = band.GetNoDataValue()
            if nodata is not None and (empty := grey == nodata).any():
                values[_resample(empty.astype(np.float64), row, share, shift[:, 0], True) > 0.0] = nodata
            target.GetRasterBand(number).WriteArray(values.astype(grey.dtype), 0, first)
    overviews = target.GetRasterBand(1)
    sizes = [overviews.GetOverview(k).XSize for k in range(overviews.GetOverviewCount())]
    target.FlushCache()
    if sizes:
        target.BuildOverviews("AVERAGE", [round(samples / size) for size in sizes])


def _resample(
    grey: np.ndarray, row: np.ndarray, share: np.ndarray, shift: np.ndarray, touch: bool = False
) -> np.ndarray:
    """Return lines of an image, interpolated in its rows ``row (n, 4)`` at ``share`` and shifted along the samples.

    touch : return the sum of absolute weights instead: above zero if a pixel of ``grey`` is used
    """
    down, across = _weigh(share), _weigh(shift - np.floor(shift))
    if touch:
        down, across = np.abs(down), np.abs(across)
    lines = sum(down[:, k, None] * grey[row[:, k]] for k in range(4))
    column = np.arange(grey.shape[1]) + np.floor(shift).astype(np.int64)[:, None]
    resampled = np.zeros_like(lines)
    for k in range(4):
        source_column = np.clip(column + k - 1, 0, grey.shape[1] - 1)
        resampled += across[:, k, None] * np.take_along_axis(lines, source_column, axis=1)
    return resampled


def _weigh(t: np.ndarray) -> np.ndarray:
    """Return the weights ``(n, 4)`` of four neighbours at the position t, 0 to 1, between the middle two."""
    columns = -t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, -(t**2) + t**3
    return np.stack(columns, axis=-1) / 2.0

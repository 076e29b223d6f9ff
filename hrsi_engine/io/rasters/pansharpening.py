"""Chunks of pan-sharpened orthoimages: a multispectral and a panchromatic image of one exposure, by GDAL.

Both images are warped to the pixels of the map, each by its own RPC, and GDAL's pansharpening combines them (weighted
Brovey): each band is multiplied by the ratio of the panchromatic grey value and the weighted sum of the bands. The
weights follow from the images by non-negative least squares, so that the bands keep their level.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from osgeo import gdal, gdal_array

from ...foundation.errors import OutputError
from ...foundation.pixel_filters import blur, load_opencv
from ...foundation.thresholds import EQUALITY
from ..opening.datasets import gdal_messages
from .ortho_warp import OrthoSource, Pixels, Warp, mark_invalid, warp_chunk
from .orthoimages import MapChunk, OrthoChunk

SHIFT_REACH_PX, SHIFT_BLUR_PX = 16, 2.0  # largest displacement that is found; multispectral pixels are 4 as large
PANSHARPENED_VRT = """\
<VRTDataset subClass="VRTPansharpenedDataset"><PansharpeningOptions>
<AlgorithmOptions><Weights>{weights}</Weights></AlgorithmOptions><Resampling>Nearest</Resampling>
<NumThreads>1</NumThreads><SpatialExtentAdjustment>None</SpatialExtentAdjustment><PanchroBand/>{bands}
</PansharpeningOptions></VRTDataset>"""


@dataclass(frozen=True, eq=False)
class ExposurePart:
    """The panchromatic or the multispectral image of an exposure.

    map_chunk : returns the `ortho.ChunkMapping` of a window; warp : with a mask, without a nodata value
    """

    source: OrthoSource
    map_chunk: MapChunk
    warp: Warp


@dataclass(frozen=True, eq=False)
class Pansharpening:
    """Both images of an exposure on the pixels of a map, and the weights of the bands; several threads may use it.

    nodata : value of pixels that not both images show; None if the orthoimage has a mask
    """

    pan: ExposurePart
    colour: ExposurePart
    nodata: float | None
    weights: tuple[float, ...] = ()

    def make_chunk(self, window: Any) -> OrthoChunk:
        """Return a window of the pan-sharpened orthoimage."""
        mapping = self.pan.map_chunk(window)
        if mapping is None:
            return OrthoChunk(window, None, np.empty(0), 0)
        pan = warp_chunk(self.pan.source, mapping, window.columns, window.rows, self.pan.warp)
        colour = self._warp_colour(window) if pan is not None else None
        pixels = None if pan is None or colour is None else self._sharpen(pan, colour)
        return OrthoChunk(window, pixels, mapping.errors_px, mapping.unknown, mapping.hidden)

    def _warp_colour(self, window: Any) -> Pixels | None:
        mapping = self.colour.map_chunk(window)
        if mapping is None:
            return None
        return warp_chunk(self.colour.source, mapping, window.columns, window.rows, self.colour.warp)

    def _sharpen(self, pan: Pixels, colour: Pixels) -> Pixels:
        """Return the pan-sharpened pixels of a chunk."""
        files = [gdal_array.OpenArray(pan.values), gdal_array.OpenArray(colour.values)]
        bands = "".join(f'<SpectralBand dstBand="{number}"/>' for number in range(1, len(colour.values) + 1))
        text = PANSHARPENED_VRT.format(weights=",".join(map(repr, self.weights)), bands=bands)
        with gdal_messages() as messages:
            spectral = [files[1].GetRasterBand(number) for number in range(1, len(colour.values) + 1)]
            combined = gdal.CreatePansharpenedVRT(text, files[0].GetRasterBand(1), spectral)
            values = None if combined is None else combined.ReadAsArray()
        if values is None:
            raise OutputError(f"{self.colour.source.path}: GDAL cannot pan-sharpen it ({messages.reason})")
        values = values.reshape(colour.values.shape).astype(colour.values.dtype)
        return mark_invalid(values, _find_common(pan, colour), self.nodata)

    def sample(self, windows: Sequence[Any]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return panchromatic and multispectral values ``(bands, rows, columns)`` of those windows that both show."""
        samples = []
        for window in windows:
            mapping = self.pan.map_chunk(window)
            colour = self._warp_colour(window)
            if mapping is None or colour is None:
                continue
            pan = warp_chunk(self.pan.source, mapping, window.columns, window.rows, self.pan.warp)
            if pan is not None and np.mean(valid := _find_common(pan, colour)) > EQUALITY.majority:
                samples.append((np.where(valid, pan.values, 0.0), np.where(valid, colour.values, 0.0)))
        return samples


def fit_weights(samples: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, ...]:
    """Return the weights of the bands whose sum is the panchromatic grey value; none is negative."""
    from scipy.optimize import nnls  # takes a tenth of a second, which other orthoimages do not need

    grey, bands = (
        np.concatenate([one[part].reshape(len(one[part]), -1) for one in samples], axis=1) for part in (0, 1)
    )
    weights = nnls(bands.T, grey[0])[0]
    return tuple(weights.tolist()) if weights.any() else (1.0 / len(bands),) * len(bands)


def measure_shift(samples: Sequence[tuple[np.ndarray, np.ndarray]], weights: Sequence[float]) -> float:
    """Return the distance of multispectral from panchromatic windows (whole px, median), by their correlation."""
    cv2, reach = load_opencv(), SHIFT_REACH_PX
    shifts = []
    for (grey,), bands in samples:
        coarse = np.tensordot(weights, bands, 1)[reach:-reach, reach:-reach].astype(np.float32)
        if min(coarse.shape, default=0) > 2 * reach:
            score = cv2.matchTemplate(blur(grey.astype(np.float32), SHIFT_BLUR_PX), coarse, cv2.TM_CCOEFF_NORMED)
            shifts.append(np.array(np.unravel_index(np.argmax(score), score.shape)) - reach)
    return float(np.hypot(*np.median(shifts, axis=0))) if shifts else 0.0


def _find_common(one: Pixels, second: Pixels) -> np.ndarray:
    """Return a mask of the pixels that both chunks show; both have masks."""
    masks = [part.valid for part in (one, second) if part.valid is not None]
    return np.asarray(np.logical_and.reduce(masks))

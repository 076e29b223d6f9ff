"""Images that were resampled after their RPC was made, or whose RPC was scaled without half a pixel.

An image resampled by r has pixel x where the original has (x + 0.5) / r - 0.5, so OFF of its RPC is r (OFF + 0.5)
- 0.5. GDAL (to 3.13) scales OFF itself, which is 0.5 (1 - r) px too much; other programs leave the RPC unchanged. Four
signs indicate that, the most certain first:

* a VRT states the pixels of its source that it shows: the source's RPC determines its own;
* a product's file states another size than the image has, the same in samples and lines but for a factor;
* the RPC is centred on an image that begins at (0, 0) and is larger or smaller by one factor;
* vendors centre RPCs at W / 2 - c / 2 with an integer c. If GDAL scaled it, W - 2 OFF is c r, which is no integer.
"""

import os
from typing import NamedTuple

import numpy as np
from osgeo import gdal

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import metadata_of
from .content import Element, finite_number, read_xml
from .crop import CropPlace, crop_rpc
from .find import difference_px, read_rpc

_Size = tuple[int, int]
#: Metadata of images whose RPC was composed here: image size for which it is valid.
SIZE_ITEM, SIZE_TEXT = "HRSI_CROP_SIZE", "{},{}"


@thresholds
class IGNORED_RESAMPLING:
    """Limits for the detection of a resampling of the image that its RPC ignores."""

    same_px: float = threshold(1e-3, "px", "largest difference from the RPC expected")
    factor: float = threshold(1.05, "", "smallest factor of a resampling that is detected from the range of an RPC")
    same_factor: float = threshold(
        0.003, "", "largest difference of the factors along samples and lines", "centres of vendors' RPCs"
    )
    begin_share: float = threshold(0.1, "", "largest offset of an RPC's range from the first pixel, in half images")
    gross_px: float = threshold(
        1.0, "px", "smallest error with which an adjustment is unreliable", "a shift is corrected by every model"
    )
    whole: float = threshold(1e-4, "px", "largest difference from a whole number of pixels", "15 digits of GDAL")


class IgnoredResampling(NamedTuple):
    """A resampling that an RPC ignores: its largest error in the image (px), and the sign that indicates it."""

    offset_px: float
    reason: str

    @property
    def is_gross(self) -> bool:
        """Whether the error is more than a shift, which every model corrects."""
        return self.offset_px > IGNORED_RESAMPLING.gross_px

    def __str__(self) -> str:
        return (
            f"{self.reason}: the error is up to {self.offset_px:.3g} px. Make the image again from the original "
            "with 'crop'"
        )


def find_ignored_resampling(
    path: str, dataset: gdal.Dataset, rpc: RPC, stated_size: _Size | None
) -> IgnoredResampling | None:
    """Return the resampling that an image's RPC ignores, None if nothing indicates one.

    ``stated_size`` is the size of the image for which the RPC was delivered, if its file states it.
    """
    size = dataset.RasterXSize, dataset.RasterYSize
    if metadata_of(dataset).get(SIZE_ITEM) == SIZE_TEXT.format(*size):
        return None
    if dataset.GetDriver().ShortName == "VRT" and os.path.isfile(path):
        return _compare_with_source(path, rpc, size)
    return _find_other_size(size, rpc, stated_size) or _find_scaled_centre(size, rpc)


def _compare_with_source(path: str, rpc: RPC, size: _Size) -> IgnoredResampling | None:
    """Return the difference of a VRT's RPC from that of the one image whose pixels it shows, if the RPC ignores it."""
    sources = [source for band in read_xml(path).findall("VRTRasterBand") for source in band if "Source" in source.tag]
    places = {(source.findtext("SourceFilename") or "", _read_rectangles(source)) for source in sources}
    if len(places) != 1:
        return None
    name, numbers = places.pop()
    first, extent, target_first, target_extent = np.reshape(numbers, (4, 2))
    if not (name and (extent > 0.0).all() and (target_extent > 0.0).all()) or (extent == target_extent).all():
        return None
    relative = next(sources[0].iter("SourceFilename")).get("relativeToVRT") == "1"
    try:
        before = read_rpc(os.path.join(os.path.dirname(path), name) if relative else name).rpc
    except InputError:
        return None
    step = extent / target_extent
    half = 0.5 * (1.0 - 1.0 / step)
    right = crop_rpc(before, CropPlace.from_corner(np.diag(step), first - step * target_first), size)
    offset, same_px = difference_px(right, rpc, size), IGNORED_RESAMPLING.same_px
    if offset < same_px:
        return None
    told = f"its pixels are {step[0]:.4g} x {step[1]:.4g} of those of {name}, and its RPC ignores"
    if difference_px(rpc, right.shift(*half), size) < same_px:
        return IgnoredResampling(float(np.abs(half).max()), f"{told} half a pixel")
    left_alone = min(difference_px(rpc, wrong, size) for wrong in (before, before.shift(*-first))) < same_px
    return IgnoredResampling(offset, f"{told} that") if left_alone else None


def _read_rectangles(source: Element) -> tuple[float, ...]:
    """Return offset and size of the rectangles in the source and in the VRT; NaN if they are not stated."""
    told = [place.get(name) for tag in ("SrcRect", "DstRect") for place in [source.find(tag)] if place is not None
            for name in ("xOff", "yOff", "xSize", "ySize")]  # fmt: skip
    numbers = [finite_number(text) for text in told]
    return tuple(float("nan") if number is None else number for number in numbers) if len(told) == 8 else (np.nan,) * 8


def _find_other_size(size: _Size, rpc: RPC, stated: _Size | None) -> IgnoredResampling | None:
    """Return the error if the RPC is that of a larger or smaller image, by the stated size or by the RPC's centre."""
    off, scale = np.array([rpc.samp_off, rpc.line_off]), np.array([rpc.samp_scale, rpc.line_scale])
    begins_at_zero = (np.abs(scale - off) < IGNORED_RESAMPLING.begin_share * np.abs(off)).all()
    factors = (2.0 * off + 1.0 if stated is None else np.array(stated)) / size
    factor, same = float(factors.mean()), max(IGNORED_RESAMPLING.same_factor, 1.0 / min(size))
    if (stated is None and not begins_at_zero) or not factor > 0.0 or not np.ptp(factors) <= same * factor:
        return None
    if max(factor, 1.0 / factor) < IGNORED_RESAMPLING.factor:
        return None
    told = f"its RPC is that of an image {factor:.4g} times as long and wide; if the pixels were resampled, it is"
    return IgnoredResampling(float((np.abs(factors - 1.0) * (np.array(size) - 1.0)).max()), told)


def _find_scaled_centre(size: _Size, rpc: RPC) -> IgnoredResampling | None:
    """Return the error if OFF of an RPC was scaled without half a pixel."""
    off, scale = np.array([rpc.samp_off, rpc.line_off]), np.array([rpc.samp_scale, rpc.line_scale])
    beyond, whole = np.array(size) - 2.0 * off, IGNORED_RESAMPLING.whole
    if not (beyond > 0.0).all() or (np.abs(beyond - np.round(beyond)) < whole).any():
        return None  # as vendors make them
    doubled = (np.abs(2.0 * (scale - off) - beyond) < whole * beyond).all()  # SPOT, WorldView: OFF + 1 is SCALE
    factors = beyond / (2.0 if doubled else 1.0)
    originals = size / factors
    if not np.ptp(factors) <= 1.0 / min(size) or not (np.abs(originals - np.round(originals)) <= whole).all():
        return None
    told = f"its RPC was scaled with an image resampled by {factors.mean():.4g} without half a pixel (gdal_translate)"
    return IgnoredResampling(float(np.abs(0.5 * (1.0 - factors)).max()), told)

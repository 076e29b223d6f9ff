"""Images that were resampled after their RPC was made, or with an RPC that was scaled without half a pixel.

An image resampled by r has pixel x where the original has (x + 0.5) / r - 0.5, so its RPC has r (OFF + 0.5) - 0.5 for
OFF. GDAL (to 3.13) scales OFF itself, which is 0.5 (1 - r) px too much; other programs leave the RPC as it was. Four
signs, the surest first, tell of that:

* a VRT says which pixels of its source it shows: the source's RPC says what its own should be;
* a product's file states another size than the image has, the same in samples and lines but for a factor;
* the RPC is centred on an image that begins at (0, 0) and is larger or smaller by one factor;
* vendors centre RPCs at W / 2 - c / 2 with a whole c. Scaled by GDAL, W - 2 OFF is c r, no whole number any more.
"""

import os
from typing import NamedTuple

import numpy as np
from osgeo import gdal

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import metadata_of
from .compare import difference_px
from .content import Element, read_xml
from .crop import CropPlace, crop_rpc
from .find import read_rpc

_Size = tuple[int, int]
#: Metadata of images whose RPC was composed here: the size that it is for.
SIZE_ITEM = "HRSI_CROP_SIZE"


@thresholds
class IGNORED_RESAMPLING:
    """When the size of an image and its RPC show a resampling that the RPC ignores."""

    same_px: float = threshold(1e-3, "px", "largest difference of an RPC from the one that is looked for")
    factor: float = threshold(1.05, "", "smallest factor of a resampling that is told from an RPC's range")
    same_factor: float = threshold(
        0.003, "", "largest difference of the factors along samples and lines", "centres of vendors' RPCs"
    )
    begin_share: float = threshold(0.1, "", "share of half an image by which an RPC of all of it may begin elsewhere")
    gross_px: float = threshold(
        1.0, "px", "offset beyond which an adjustment is doubtful", "less is a shift, which every model takes up"
    )
    whole: float = threshold(1e-4, "px", "largest difference from a whole number of pixels", "15 digits of GDAL")


class IgnoredResampling(NamedTuple):
    """A resampling that an RPC ignores: by how much it is off at the worst place (px), and what shows it."""

    offset_px: float
    reason: str

    @property
    def is_gross(self) -> bool:
        """Whether it is more than a shift that every model takes up."""
        return self.offset_px > IGNORED_RESAMPLING.gross_px

    def __str__(self) -> str:
        return f"{self.reason}: up to {self.offset_px:.3g} px off. Make it again from the original with 'crop'"


def format_size(size: _Size) -> str:
    """Return samples and lines as `SIZE_ITEM` has them."""
    return f"{size[0]},{size[1]}"


def find_ignored_resampling(
    path: str, dataset: gdal.Dataset, rpc: RPC, stated_size: _Size | None
) -> IgnoredResampling | None:
    """Return the resampling that an image's RPC ignores, None where nothing shows one.

    ``stated_size`` is that of the image which the RPC was delivered for, where its file says so.
    """
    size = dataset.RasterXSize, dataset.RasterYSize
    if metadata_of(dataset).get(SIZE_ITEM) == format_size(size):
        return None
    if dataset.GetDriver().ShortName == "VRT" and os.path.isfile(path):
        return _compare_with_source(path, rpc, size)
    if stated_size is not None:
        return _compare_sizes(size, stated_size)
    return _find_other_centre(size, rpc) or _find_scaled_centre(size, rpc)


def _compare_with_source(path: str, rpc: RPC, size: _Size) -> IgnoredResampling | None:
    """Compare a VRT's RPC with that of the one image whose pixels it shows."""
    sources = [source for band in read_xml(path).findall("VRTRasterBand") for source in band if "Source" in source.tag]
    places = {(source.findtext("SourceFilename") or "", _read_rectangles(source)) for source in sources}
    if len(places) != 1:
        return None
    name, numbers = places.pop()
    source, target = np.array(numbers[:4]), np.array(numbers[4:])
    if not name or not np.isfinite(numbers).all() or not (target[2:] > 0.0).all() or (source == target)[2:].all():
        return None
    relative = next(sources[0].iter("SourceFilename")).get("relativeToVRT") == "1"
    try:
        before = read_rpc(os.path.join(os.path.dirname(path), name) if relative else name).rpc
    except InputError:
        return None
    step = source[2:] / target[2:]
    place = CropPlace.from_corner(np.diag(step), source[:2] - step * target[:2])
    right = crop_rpc(before, place, size)
    half = 0.5 * (1.0 - 1.0 / step)
    offset, told = difference_px(right, rpc, size), f"its pixels are {step[0]:.4g} x {step[1]:.4g} of those of {name}"
    if offset < IGNORED_RESAMPLING.same_px:
        return None
    if difference_px(rpc, right.shift(*half), size) < IGNORED_RESAMPLING.same_px:
        return IgnoredResampling(float(np.abs(half).max()), f"{told}, and its RPC ignores half a pixel")
    if any(
        difference_px(rpc, wrong, size) < IGNORED_RESAMPLING.same_px for wrong in (before, before.shift(*-source[:2]))
    ):
        return IgnoredResampling(offset, f"{told}, which its RPC ignores")
    return None


def _read_rectangles(source: Element) -> tuple[float, ...]:
    """Return offset and size of the rectangle in the source and of that in the VRT; NaN where they are not told."""
    names = ("xOff", "yOff", "xSize", "ySize")
    found = [source.find(tag) for tag in ("SrcRect", "DstRect")]
    return tuple(float("nan" if place is None else place.get(name, "nan")) for place in found for name in names)


def _compare_sizes(size: _Size, stated: _Size) -> IgnoredResampling | None:
    """Compare an image's size with that of the image which its RPC belongs to."""
    factor = stated[0] / size[0]
    if max(factor, 1.0 / factor) < IGNORED_RESAMPLING.factor or abs(stated[1] / factor - size[1]) > 1.0:
        return None
    told = (
        f"its RPC was delivered for {stated[0]} x {stated[1]} px, {factor:.4g} times as long and wide; if the pixels "
        "were resampled, it is"
    )
    return IgnoredResampling(abs(factor - 1.0) * (max(size) - 1.0), told)


def _find_other_centre(size: _Size, rpc: RPC) -> IgnoredResampling | None:
    """Find an RPC whose middle is that of an image larger or smaller by one factor."""
    off, scale = np.array([rpc.samp_off, rpc.line_off]), np.array([rpc.samp_scale, rpc.line_scale])
    factors = (2.0 * off + 1.0) / size
    begins_at_zero = (np.abs(scale - off) < IGNORED_RESAMPLING.begin_share * np.abs(off)).all()
    factor = float(factors.mean())
    if not begins_at_zero or np.ptp(factors) > IGNORED_RESAMPLING.same_factor * factor:
        return None
    if max(factor, 1.0 / factor) < IGNORED_RESAMPLING.factor:
        return None
    told = f"its RPC is that of an image {factor:.4g} times as long and wide; if the pixels were resampled, it is"
    return IgnoredResampling(abs(factor - 1.0) * (max(size) - 1.0), told)


def _find_scaled_centre(size: _Size, rpc: RPC) -> IgnoredResampling | None:
    """Find an RPC whose OFF was scaled without half a pixel."""
    off, scale = np.array([rpc.samp_off, rpc.line_off]), np.array([rpc.samp_scale, rpc.line_scale])
    beyond, begin = np.array(size) - 2.0 * off, scale - off
    if (beyond <= 0.0).any() or (np.abs(beyond - np.round(beyond)) < IGNORED_RESAMPLING.whole).any():
        return None  # as vendors make them
    doubled = (
        np.abs(2.0 * begin - beyond) < IGNORED_RESAMPLING.whole * beyond
    ).all()  # SPOT, WorldView: OFF + 1 is SCALE
    factors = beyond / (2.0 if doubled else 1.0)
    originals = size / factors
    if np.ptp(factors) > 1.0 / min(size) or (np.abs(originals - np.round(originals)) > IGNORED_RESAMPLING.whole).any():
        return None
    told = f"its RPC was scaled with an image resampled by {factors.mean():.4g} without half a pixel (gdal_translate)"
    return IgnoredResampling(float(np.abs(0.5 * (1.0 - factors)).max()), told)

"""Images of which the pixels are needed; an RPC is welcome but not required."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...hrsi_engine.block.block import Raster
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.rasters.images import GdalRaster, image_id
from ...hrsi_engine.io.rpc_files.find import read_rpc_or_none
from ...hrsi_engine.measurement.interest_points.windows import Area
from ...hrsi_engine.surface.dem import HeightSurface, intersect_surface


class ImagePixels(NamedTuple):
    """An image opened for its pixels; ``rpc`` is None where it has none."""

    id: str
    path: str
    raster: Raster
    rpc: RPC | None


def open_pixels(path: str, band: int = 1) -> ImagePixels:
    """Open an image; raises `InputError` where it has no pixels, or an RPC that is damaged."""
    raster = GdalRaster(path, band)
    found = read_rpc_or_none(path)
    return ImagePixels(image_id(path), path, raster, None if found is None else found.rpc)


def ground_of(image: ImagePixels, xy: np.ndarray, surface: HeightSurface | None) -> np.ndarray:
    """Return lon, lat, height ``(n, 3)`` of image points on a surface, else at the RPC's mean height.

    NaN without RPC.
    """
    if image.rpc is None or not len(xy):
        return np.full((len(xy), 3), np.nan)
    if surface is None:
        return image.rpc.localize(xy, image.rpc.height_off).ground
    return intersect_surface(image.rpc, xy, surface)[0]


def window_area(text: str | None, argument: str) -> Area | None:
    """Return the window of ``sample,line,samples,lines``; `InputError` naming the argument for another text."""
    if text is None:
        return None
    try:
        sample, line, samples, lines = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"`{argument}` {text!r} is not SAMPLE,LINE,SAMPLES,LINES: give four whole numbers") from None
    return Area(sample, line, sample + samples, line + lines)


def ground_warnings(images: Sequence[ImagePixels], grounds: Sequence[np.ndarray]) -> list[str]:
    """Return a word on each image with an RPC whose points ``(n, 3)`` have no ground position, all or some."""
    lost = {image.id: int(np.isnan(ground).any(axis=1).sum()) for image, ground in zip(images, grounds, strict=True)
            if image.rpc is not None}  # fmt: skip
    return [f"{name}: {count} points have no position on the terrain" for name, count in lost.items() if count]

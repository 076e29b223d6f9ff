"""An image as GIS software shows it without any warping: map x is the sample, map y minus the line."""

import hashlib

import numpy as np
from osgeo import gdal

from ...block.block import Raster
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import gdal_messages
from ..opening.raster_datasets import open_raster


@thresholds
class GREY_STRETCH:
    """How grey values are stretched for a view."""

    percentiles: tuple[float, float] = threshold((1.0, 99.0), "%", "of the grey values that become black and white")


def pixel_view(path: str) -> str:
    """Return a virtual image, without RPC, whose map coordinates are (sample, -line).

    It lives in memory, for this process. Raises `InputError` where the image cannot be opened.
    """
    name = f"/vsimem/hrsi/{hashlib.sha256(path.encode('utf-8')).hexdigest()}.vrt"
    source = open_raster(path)
    view = None
    with gdal_messages() as messages:
        view = gdal.Translate(name, source, options=gdal.TranslateOptions(format="VRT", nogcp=True))
        if view is not None:
            view.SetProjection("")
            view.SetGeoTransform((-0.5, 1.0, 0.0, 0.5, 0.0, -1.0))
            view.SetMetadata({}, "RPC")
    if view is None:
        raise InputError(f"{path}: cannot be shown ({messages[-1] if messages else 'unknown reason'}): check the file")
    del view
    return name


def grey_range(raster: Raster, middle: tuple[float, float], half_px: int) -> tuple[float, float]:
    """Return the grey values between which the surroundings of a place are well seen."""
    sample, line = (round(value) - half_px for value in middle)
    grey, valid = raster.read(sample, line, 2 * half_px, 2 * half_px)
    if not valid.any():
        return 0.0, 1.0
    low, high = np.percentile(grey[valid], GREY_STRETCH.percentiles)
    return float(low), max(float(high), float(low) + 1e-6)

"""Small pictures of images, as texts that a page holds in itself."""

import base64

import numpy as np
from osgeo import gdal

from ...drawing.target_chips import encode_grey_png, stretch_grey
from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import gdal_messages


@thresholds
class PICTURES:
    """How pictures on pages are compressed and filled."""

    jpeg_quality: int = threshold(70, "", "quality of JPEG")
    fill_grey: int = threshold(236, "grey value", "grey of pixels without a value", "near the page's white")


def picture_uri(grey: np.ndarray, valid: np.ndarray) -> str:
    """Return grey values of any type, where valid, as a ``data:`` URI: JPEG, and PNG where this GDAL has no JPEG."""
    content = _encode_jpeg(np.where(valid, stretch_grey(grey, valid), np.uint8(PICTURES.fill_grey)))
    if content is None:
        return f"data:image/png;base64,{encode_grey_png(grey, valid)}"
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode('ascii')}"


def _encode_jpeg(grey: np.ndarray) -> bytes | None:
    driver = gdal.GetDriverByName("JPEG")
    if driver is None:
        return None
    name = "/vsimem/hrsi/picture.jpg"
    lines, samples = grey.shape
    with gdal_messages():
        memory = gdal.GetDriverByName("MEM").Create("", samples, lines, 1, gdal.GDT_Byte)
        memory.GetRasterBand(1).WriteArray(grey)
        made = driver.CreateCopy(name, memory, options=[f"QUALITY={PICTURES.jpeg_quality}"])
        del made
        status = gdal.VSIStatL(name)
        file = gdal.VSIFOpenL(name, "rb") if status is not None else None
        content = None if file is None else bytes(gdal.VSIFReadL(1, status.size, file))
        if file is not None:
            gdal.VSIFCloseL(file)
        gdal.Unlink(name)
        gdal.Unlink(f"{name}.aux.xml")
    return content

"""Quick-looks: small images on a map, warped by an RPC at one height, to look at a result within seconds."""

import numpy as np
from osgeo import gdal

from ...block.block import Image
from ...camera.rpc import RPC
from ...foundation.errors import OutputError
from ..opening.datasets import gdal_messages
from ..opening.files import open_raster
from ..rpc_files.fields import gdal_metadata

SIDE_PX = 1200  # longer side before warping
STRETCH_PERCENT = (2.0, 98.0)  # of the grey values: black and white


def write_quick_look(image: Image, rpc: RPC, height_m: float, path: str) -> None:
    """Write the first band of an image, warped by an RPC at an ellipsoidal height, as a GeoTIFF of bytes in WGS84.

    GDAL reads an overview of the image if it has one; the value 0 is outside. Raises `OutputError` if GDAL fails.
    """
    source = open_raster(image.path)
    size = np.array([source.RasterXSize, source.RasterYSize])
    step = max(size.max() / SIDE_PX, 1.0)
    columns, rows = np.maximum(np.round(size / step), 1).astype(int).tolist()
    with gdal_messages() as messages:
        small = gdal.Translate("", source, format="MEM", width=columns, height=rows, bandList=[1])
        grey = small.ReadAsArray().astype(np.float64)
        nodata = small.GetRasterBand(1).GetNoDataValue()
        valid_values = grey[np.isfinite(grey) & (grey != (0.0 if nodata is None else nodata))]
        black, white = np.percentile(valid_values, STRETCH_PERCENT) if valid_values.size else (0.0, 1.0)
        stretched = np.clip(np.nan_to_num((grey - black) / max(white - black, 1e-9)), 0.0, 1.0)
        bytes_ = gdal.GetDriverByName("MEM").Create("", columns, rows, 1, gdal.GDT_Byte)
        bytes_.GetRasterBand(1).WriteArray((1.0 + 254.0 * stretched).astype(np.uint8))
        factor = size[0] / columns, size[1] / rows
        resampled = rpc.resample(factor, ((factor[0] - 1.0) / 2.0, (factor[1] - 1.0) / 2.0))
        bytes_.SetMetadata(gdal_metadata(resampled), "RPC")
        warped = gdal.Warp(
            path, bytes_, dstSRS="EPSG:4326", rpc=True, transformerOptions=[f"RPC_HEIGHT={height_m}"],
            resampleAlg="bilinear", dstNodata=0, creationOptions=["COMPRESS=DEFLATE", "TILED=YES"],
        )  # fmt: skip
    if warped is None:
        raise OutputError(f"{path}: GDAL cannot warp {image.path} ({messages.reason})")

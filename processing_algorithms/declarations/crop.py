"""`crop`: a window of an image, an overview or a resampled image, with the RPC of its pixels."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    Common,
    ResultFolder,
    TerrainOptions,
    compression_option,
    images_option,
    window_option,
)

#: GDAL's kernels that leave a feature where it is: average takes whole pixels and is up to 0.4 of them off, mode
#: prefers the upper left of equals.
KERNELS = ("cubic", "near", "bilinear", "cubicspline", "lanczos")

#: Formats, and how the names of their files end.
FORMAT_ENDINGS = {"gtiff": ".tif", "cog": ".tif", "vrt": ".vrt"}


@options(kw_only=True)
class CropOptions:
    """What `crop` takes."""

    images: tuple[str, ...] = images_option()
    window: str | None = window_option("The window to cut, from 0, 0, the first pixel")
    extent: str | None = option(
        None,
        "A box on the ground, in degrees or in the CRS that stands in brackets behind it: the window that shows all of "
        "it is cut, as far as the image reaches", kind=Kind.EXTENT, metavar="W,S,E,N [CRS]",
    )  # fmt: skip
    factor: float | None = option(
        None,
        "Size of the result to that of the window, or of the whole image: 0.5 halves the number of samples and lines. "
        "Both are rounded to whole pixels, and the RPC follows what comes out", minimum=1e-3, maximum=64.0,
    )  # fmt: skip
    resampling: str = option("cubic", "GDAL's resampling kernel; only with `factor`", choices=KERNELS)
    terrain: TerrainOptions = nest_options(TerrainOptions)
    format: str = option(
        "gtiff",
        "A tiled GeoTIFF, a cloud-optimised one with overviews, or a virtual image that reads the original",
        choices=tuple(FORMAT_ENDINGS),
    )
    compression: str = compression_option()
    folder: ResultFolder = nest_options(ResultFolder)
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="crop", title="Crop or resample", group="RPC",
    summary="A window, overview or resampling of images with the exact RPC of its pixels",
    help=(
        "Cuts a window out of an image, or brings the image or window to another pixel size, and gives it the RPC of "
        "its pixels: the same camera, exactly, at any factor (gdal_translate is off by half of what a pixel has grown)."
        " The RPC is the one that counts, wherever it is kept; what is told of a refinement stays in the file, and its "
        "original RPC, which `restore` of write-rpc brings back. With `extent` the window follows from the ground: "
        "give `dem` or `height` with it. Bands, data type, masks, nodata and metadata are kept. The files are called "
        "ID_crop; an RPC file alone becomes a _RPC.TXT."
    ),
    options=CropOptions,
    images_made="Cropped images",
    examples=(
        "hrsi crop block/image_1.tif --window 40,60,100,80 --output-dir cropped",
        "hrsi crop block/image_1.tif block/image_2.tif --factor 0.5 --format cog --output-dir halves",
    ),
)  # fmt: skip

"""Orthoimages: the algorithms that make and compare them."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.ortho.options import MisregistrationOptions
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    POINTS,
    Common,
    ResultFolder,
    TerrainOptions,
    WorkerOptions,
    compression_option,
    ground_crs_option,
    images_option,
    report_option,
)

#: GDAL's kernels (`io.rasters.ortho_warp.RESAMPLING`).
RESAMPLING_NAMES = (
    "near", "bilinear", "cubic", "cubicspline", "lanczos", "average", "rms", "mode", "max", "min", "med", "q1", "q3",
)  # fmt: skip
#: Formats (`io.rasters.orthoimages`).
FORMAT_NAMES = ("cog", "gtiff")


@options(kw_only=True)
class OrthorectifyOptions:
    """What `orthorectify` takes."""

    images: tuple[str, ...] = images_option("Images with RPC")
    terrain: TerrainOptions = nest_options(TerrainOptions)
    terrain_points: str | None = option(
        None, "Points whose heights make the terrain, instead of a DEM: the layer ground_points of a triangulation",
        kind=Kind.POINTS, metavar=POINTS,
    )  # fmt: skip
    ground_crs: str | None = ground_crs_option()
    fill_gaps: int = option(
        0, "Interpolate gaps of the DEM up to so many of its cells wide; 0 leaves them nodata", minimum=0, maximum=1000,
        unit="cells", advanced=True, metavar="N",
    )  # fmt: skip
    crs: str | None = option(
        None,
        "CRS of the orthoimages; by default the UTM zone of the block's middle, or UPS beyond 84 degrees north and 80 "
        "south", kind=Kind.CRS, metavar="CRS",
    )  # fmt: skip
    resolution: float | None = option(
        None,
        "Pixel size, in units of the CRS (degrees for EPSG:4326); by default the finest pixel of the block on the "
        "ground, rounded", minimum=1e-9, metavar="R",
    )  # fmt: skip
    extent: str = option(
        "each",
        "each: what the image shows; union or overlap: of all images; or a box in the CRS of the orthoimages, or in "
        "the one that stands in brackets behind it. Widened to whole pixels",
        kind=Kind.EXTENT,
        metavar="each|union|overlap|W,S,E,N [CRS]",
    )
    resampling: str = option("cubic", "GDAL's resampling kernel", choices=RESAMPLING_NAMES)
    error_px: float = option(
        0.05, "Largest error of a pixel's position in the image; 0 computes every pixel exactly", minimum=0.0,
        maximum=10.0, unit="px", metavar="PX",
    )  # fmt: skip
    nodata: str | None = option(
        None,
        "Value of pixels that the image does not show, or mask for a mask band; by default the image's own, else a "
        "mask where the image has one, else 0 (NaN for floating point)",
        metavar="VALUE|mask",
    )
    format: str = option(
        "cog", "Cloud-optimised GeoTIFF with overviews, or a plain tiled GeoTIFF", choices=FORMAT_NAMES
    )
    compression: str = compression_option()
    workers: WorkerOptions = nest_options(WorkerOptions)
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option()
    common: Common = nest_options(Common)


ORTHORECTIFY = Algorithm(
    name="orthorectify", title="Orthorectify block", group="Orthoimages",
    summary="Orthoimages from (refined) RPCs and a DEM, all on one map grid",
    help=(
        "Makes an orthoimage of every image with GDAL's warper: all bands, data type and nodata kept, as "
        "cloud-optimised GeoTIFF. All pixels lie on one lattice, so that the orthoimages of a block register pixel to "
        "pixel. Heights of the DEM are brought to the ellipsoid. Positions are right to `error_px`; the report states "
        "what was found at random pixels. Orthoimages that were made before from the same files with the same options "
        "are kept, so a stopped run goes on where it was. With `scheduler` the tiles are warped by the workers "
        "of a Dask scheduler and written here, the same bytes. Ground hidden from the sensor shows what hides it."
    ),
    options=OrthorectifyOptions,
    main=("dem", "dem-datum", "terrain-points", "crs", "resolution", "extent", "resampling", "format"),
    images_made="Orthoimages",
    are_maps=True,
    examples=(
        "hrsi orthorectify adjusted/image_*.tif --dem block/dem.tif --height-datum ellipsoidal "
        "--extent overlap --output-dir ortho",
    ),
)  # fmt: skip


SHIFTS_FILE, SHIFTS_LAYERS = "misregistration.gpkg", ("misregistration_utm", "misregistration_wgs84")


@options(kw_only=True)
class OrthoCheckOptions:
    """What `ortho-check` takes."""

    images: tuple[str, ...] = option(help="Orthoimages", kind=Kind.IMAGES, metavar="ORTHO")
    reference: str | None = option(
        None, "Compare with this orthoimage instead of with one another", kind=Kind.RASTER, metavar="FILE"
    )
    before: str | None = option(None, "Folder with orthoimages of the same names, made before", metavar="DIR")
    matching: MisregistrationOptions = nest_options(MisregistrationOptions)
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option()
    common: Common = nest_options(Common)


ORTHO_CHECK = Algorithm(
    name="ortho-check", title="Check orthoimages", group="Orthoimages",
    summary="Misregistration between overlapping orthoimages, as numbers and arrows",
    help=(
        "Compares orthoimages of one map grid, each with each that overlaps it, or all with a reference. In windows "
        "spread over the common ground the shift is measured to a few hundredths of a pixel by correlation and least "
        "squares, around the shift that the pair has in common (up to 256 px). Reports medians, robust spreads and "
        "90th percentiles, and writes a layer of arrows. `before` names the folder of the orthoimages made with the "
        "original RPCs: both are then compared in the same windows."
    ),
    options=OrthoCheckOptions,
    examples=(
        "hrsi ortho-check ortho/image_*_ortho.tif --output-dir check",
    ),
    layers=(f"{SHIFTS_FILE}|layername={SHIFTS_LAYERS[0]}",),
)  # fmt: skip

ALGORITHMS = (ORTHORECTIFY, ORTHO_CHECK)

"""Declarations of the algorithms that make and compare orthoimages.

Declaration of the surface model of an adjusted block.
"""

from __future__ import annotations

from ...hrsi_engine.dense.options import SurfaceOptions
from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.ortho.options import MisregistrationOptions
from ..interface import option_groups as groups
from ..interface.declare import Algorithm, Kind

#: GDAL's resampling methods (`io.rasters.ortho_warp.RESAMPLING`).
RESAMPLING_NAMES = (
    "near", "bilinear", "cubic", "cubicspline", "lanczos", "average", "rms", "mode", "max", "min", "med", "q1", "q3",
)  # fmt: skip
#: Formats (`io.rasters.orthoimages`).
FORMAT_NAMES = ("cog", "gtiff")
#: The mosaic and its seamlines in the output directory.
MOSAIC_FILE, SEAMLINES_FILE, SEAMLINES_LAYER = "mosaic.tif", "seamlines.gpkg", "seamlines"


@options(kw_only=True)
class OrthorectifyOptions:
    """Options of `orthorectify`."""

    images: tuple[str, ...] = groups.images_option("Images with RPC")
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    terrain_points: str | None = option(
        None,
        "Points between which the terrain is interpolated where there is no DEM, or where it has gaps: the layer "
        "ground_points of a triangulation",
        kind=Kind.POINTS,
        metavar=groups.POINTS,
    )
    ground_crs: str | None = groups.ground_crs_option()
    fill_gaps: int = option(
        0,
        "Largest width of gaps of the DEM that are interpolated; 0 leaves them nodata",
        minimum=0,
        maximum=1000,
        unit="cells",
        advanced=True,
        metavar="N",
    )
    visibility: bool = option(
        False,
        "Ground that the DEM hides from the sensor becomes nodata (true orthoimages); the DEM is a surface model with "
        "buildings and trees",
        advanced=True,
    )
    mosaic: bool = option(
        False,
        f"Also one mosaic of all orthoimages ({MOSAIC_FILE}) and its seamlines ({SEAMLINES_FILE}); ground that an "
        "image does not show is taken from the others",
        advanced=True,
    )
    pansharpen: str | None = option(
        None,
        "Multispectral image of the exposure of the panchromatic image, or a folder with those of all: each pair "
        "becomes one pan-sharpened orthoimage; several files are separated by semicolons",
        kind=Kind.FILE,
        metavar="FILE|DIR",
        advanced=True,
    )
    crs: str | None = option(
        None,
        "CRS of the orthoimages; by default the UTM zone at the centre of the block, or UPS beyond 84 degrees north "
        "and 80 south",
        kind=Kind.CRS,
    )
    resolution: float | None = option(
        None,
        "Pixel size, in units of the CRS (degrees for EPSG:4326); by default the finest pixel of the block on the "
        "ground, rounded",
        minimum=1e-9,
        metavar="R",
    )
    extent: str = option(
        "each",
        "each: the area of each image; union or overlap: of all images; or a box in the CRS of the orthoimages, or in "
        "the CRS in brackets after it. It is enlarged to whole pixels",
        kind=Kind.EXTENT,
        metavar="each|union|overlap|W,S,E,N [CRS]",
    )
    resampling: str = option("cubic", "GDAL's resampling kernel", choices=RESAMPLING_NAMES)
    error_px: float = option(
        0.05,
        "Largest error of a pixel's position in the image; 0 computes every pixel exactly",
        minimum=0.0,
        maximum=10.0,
        unit="px",
        metavar="PX",
    )
    nodata: str | None = option(
        None,
        "Value of pixels outside the image, or mask for a mask band; by default that of the image, else a mask if the "
        "image has one, else 0 (NaN for floating point)",
        metavar="VALUE|mask",
    )
    format: str = option(
        "cog", "Cloud-optimised GeoTIFF with overviews, or a plain tiled GeoTIFF", choices=FORMAT_NAMES
    )
    compression: str = groups.compression_option()
    workers: groups.WorkerOptions = nest_options(groups.WorkerOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)
    report: bool = groups.report_option()


ORTHORECTIFY = Algorithm(
    name="orthorectify",
    title="Orthorectify block",
    group="Orthoimages",
    summary="Orthoimages from (refined) RPCs and a DEM, all on one map grid",
    help=(
        "Makes an orthoimage of every image with the GDAL warper, as cloud-optimised GeoTIFF; all bands, data type "
        "and nodata are kept. All orthoimages of a block have one pixel grid. Heights of the DEM are converted to "
        "ellipsoidal heights. Orthoimages of parts of an area have the pixels of that of the complete area. The report "
        "gives the errors of positions at random pixels. Orthoimages that were made from the same files with the same "
        "options are kept, so that a stopped run can be continued. With `scheduler` the tiles are warped by workers of "
        "a Dask scheduler, with the same result. Hidden ground shows the object in front of it, "
        "unless `visibility` masks it. `pansharpen` combines panchromatic and multispectral images. `mosaic` makes one "
        "image of all, with the areas of the images as a layer."
    ),
    options=OrthorectifyOptions,
    main=("dem", "dem-datum", "terrain-points", "crs", "resolution", "extent", "resampling", "format"),
    layers=(f"{SEAMLINES_FILE}|layername={SEAMLINES_LAYER}",),
    images_made="Orthoimages",
    are_maps=True,
    examples=(
        "hrsi orthorectify adjusted/image_*.tif --dem block/dem.tif --height-datum ellipsoidal "
        "--extent overlap --output-dir ortho",
    ),
)


SHIFTS_FILE, SHIFTS_LAYERS = "misregistration.gpkg", ("misregistration_utm", "misregistration_wgs84")


@options(kw_only=True)
class OrthoCheckOptions:
    """Options of `ortho-check`."""

    images: tuple[str, ...] = option(help="Orthoimages", kind=Kind.IMAGES, metavar="ORTHO")
    reference: str | None = option(
        None, "Compare all with this orthoimage instead of with each other", kind=Kind.RASTER
    )
    before: str | None = option(
        None, "Folder with orthoimages of the same names, from the original RPCs", metavar="DIR"
    )
    matching: MisregistrationOptions = nest_options(MisregistrationOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)
    report: bool = groups.report_option()


ORTHO_CHECK = Algorithm(
    name="ortho-check",
    title="Check orthoimages",
    group="Orthoimages",
    summary="Misregistration between overlapping orthoimages, as numbers and arrows",
    help=(
        "Compares all overlapping orthoimages of one map grid with each other, or all with a reference. The shift is "
        "measured in windows spread over the overlap, to a few hundredths of a pixel, by correlation and least "
        "squares. It is searched near the common shift of the pair (up to 256 px). The report has medians, robust "
        "standard deviations and 90th percentiles; the layer shows arrows. `before` names the folder of the "
        "orthoimages made with the original RPCs, which are then measured in the same windows."
    ),
    options=OrthoCheckOptions,
    examples=("hrsi ortho-check ortho/image_*_ortho.tif --output-dir check",),
    layers=(f"{SHIFTS_FILE}|layername={SHIFTS_LAYERS[0]}",),
)

SURFACE_FILE, DIFFERENCE_FILE = "surface.tif", "difference.tif"


@options(kw_only=True)
class SurfaceModelOptions:
    """Options of `surface-model`."""

    result: str = option(help="Output directory of an adjustment", kind=Kind.RESULT, metavar="RESULT")
    resolution: float | None = option(
        None,
        "Cell size, in units of the CRS; by default the finest pixel of the block on the ground, rounded",
        minimum=1e-9,
        metavar="R",
    )
    crs: str | None = option(
        None, "CRS of the map, projected; by default the UTM zone (or UPS) at the centre of the block", kind=Kind.CRS
    )
    vertical: str = option(
        "ellipsoidal",
        "Reference of the heights: ellipsoidal, egm96, egm2008, or a vertical CRS",
        metavar="ellipsoidal|egm96|egm2008|EPSG:CODE",
    )
    extent: str | None = option(
        None,
        "A box in the CRS of the map, or in the CRS in brackets after it; by default the ground that the chosen pairs "
        "show",
        kind=Kind.EXTENT,
        metavar="W,S,E,N [CRS]",
    )
    reference: str | None = option(
        None,
        "DEM with which the surface is compared: bias, NMAD, LE90, and a raster of the differences",
        kind=Kind.RASTER,
    )
    reference_datum: str = option("layer", "Height datum of the reference", advanced=True, metavar=groups.DATUMS)
    dense: SurfaceOptions = nest_options(SurfaceOptions)
    dem: groups.DemOptions = nest_options(groups.DemOptions)
    height_datum: str = groups.height_datum_option()
    compression: str = groups.compression_option()
    workers: groups.WorkerOptions = nest_options(groups.WorkerOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)
    report: bool = groups.report_option()


SURFACE_MODEL = Algorithm(
    name="surface-model",
    title="Surface model",
    group="Orthoimages",
    summary="Digital surface model (DSM) of an adjusted block by dense matching",
    help=(
        "Matches the best pairs of an adjusted block at every pixel and intersects the rays of their refined RPCs. "
        "Pairs are chosen by convergence angle (10 to 25 degrees are best), overlap, sun, season and common tie "
        "points. The surface model is a cloud-optimised GeoTIFF with three bands: height, its standard deviation, and "
        "the number of pairs that agree. Where no pair supports a height (water, clouds, occlusions, changes between "
        "dates) it is nodata. The search starts at the heights of the tie points, or of `dem`. Finished tiles are kept "
        "when a run is stopped, and the same command continues."
    ),
    options=SurfaceModelOptions,
    main=("resolution", "crs", "vertical", "extent", "reference"),
    images_made="Surface model",
    are_maps=True,
    examples=("hrsi surface-model adjusted --output-dir surface",),
)

ALGORITHMS = (SURFACE_MODEL, ORTHORECTIFY, ORTHO_CHECK)

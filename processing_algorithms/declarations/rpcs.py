"""RPCs: the algorithms that judge, write, cut, join, use or fit them."""

from __future__ import annotations

from ...hrsi_engine.adjustment.options import surface_kind_option, surface_search_option
from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    POINTS,
    Common,
    DemOptions,
    OptionalFolder,
    PointFiles,
    ResultFolder,
    SearchOptions,
    SurfaceFile,
    TerrainOptions,
    compression_option,
    ground_crs_option,
    height_datum_option,
    images_option,
    report_option,
    strict_datum_option,
    window_option,
)

AUTOMATIC_TRACKS, NO_TRACKS = "auto", "none"
OWN = "own"  #: name of the set of the images' own RPCs
EVALUATION_FILE = "evaluation.gpkg"


@options(kw_only=True)
class EvaluateOptions:
    """What `evaluate` takes."""

    images: tuple[str, ...] = images_option()
    rpcs: tuple[str, ...] = option(
        (),
        f"A further set of RPCs: its name, and the directory that holds an RPC or an image with RPC for each image, "
        f"under the image's name; given again for each set. The images' own RPCs are the set {OWN!r}",
        kind=Kind.FOLDERS,
        metavar="NAME=DIR",
    )
    tracks: str = option(
        AUTOMATIC_TRACKS,
        f"Points on two images or more: {AUTOMATIC_TRACKS} finds them in the images, {NO_TRACKS} does without, FILE "
        "reads them", kind=Kind.POINTS, metavar=f"{AUTOMATIC_TRACKS}|{NO_TRACKS}|FILE",
    )  # fmt: skip
    used_points: str | None = option(
        None, "Image points that an adjustment of these RPCs used (block.gpkg): tracks near one of them take no part",
        kind=Kind.POINTS, metavar="FILE",
    )  # fmt: skip
    apart_px: float = option(
        10.0, "How far from `used_points` a track must be, on each of its images", name="apart", minimum=0.0, unit="px",
        advanced=True, metavar="PX",
    )  # fmt: skip
    reject: float = option(
        6.0, "Leave out tracks with a residual of so many sigmas under every set of RPCs: wrong matches; 0 keeps all",
        minimum=0.0, unit="sigma", advanced=True, metavar="SIGMAS",
    )  # fmt: skip
    points: PointFiles = nest_options(PointFiles)
    dem: DemOptions = nest_options(DemOptions)
    surface: SurfaceFile = nest_options(SurfaceFile)
    surface_search_m: float = surface_search_option()
    surface_kind: str = surface_kind_option()
    search: SearchOptions = nest_options(SearchOptions)
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option()


EVALUATE = Algorithm(
    name="evaluate", title="Evaluate RPCs", group="RPC",
    summary="How well RPCs fit: tracks, ground points, a DEM; several sets side by side",
    help=(
        "Answers whether RPCs are better than others: those of the images as they are, refined ones, another tool's "
        "(`rpcs` NAME=DIR, once for each set). All sets are judged by the same points. Nothing is adjusted.\n\n"
        "Each track is predicted on each of its images from a ground point that the other images alone intersect "
        "(strict leave-one-out; three images or more), fitted by all its rays, and taken pair by pair across the "
        "epipolar lines. Wrong matches are left out only where they fit under no set of RPCs. Known ground points, "
        "control and check apart, are compared in pixels and metres, heights of the tracks with a DEM; with `surface` "
        "the tracks are matched with its relief, which tells by how much each set is displaced in plan and height.\n\n"
        "The RPCs should not have seen the tracks: give points that took no part in the adjustment, or name those that "
        "did by `used_points`."
    ),
    options=EvaluateOptions,
    examples=(
        "hrsi evaluate block/image_*.tif --rpcs refined=adjusted --tracks block/image_points.csv "
        "--height-datum ellipsoidal --output-dir evaluation",
    ),
    main=("rpcs", "tracks", "gcps", "image-points", "check-ids", "height-datum", "dem", "dem-datum"),
    layers=(f"{EVALUATION_FILE}|layername=images",),
)  # fmt: skip


#: What the output of an image is called, by way of writing; None is the image itself.
OUTPUT_ENDINGS: dict[str, str | None] = {
    "copy": ".tif", "in-place": None, "vrt": ".vrt", "sidecar": "_RPC.TXT", "rpb": ".RPB", "xml": ".xml",
    "geom": ".geom", "json": ".json",
}  # fmt: skip


@options(kw_only=True)
class WriteRpcOptions:
    """What `write-rpc` takes."""

    images: tuple[str, ...] = images_option("Images, or RPC files alone (then `write` cannot be copy or vrt)")
    rpc: str | None = option(
        None,
        "File with the RPC to write, or a folder of RPC files named like the images; default: the image's own RPC",
        kind=Kind.FILE,
        metavar="FILE|DIR",
    )
    write: str = option("copy", "Where the RPC goes", choices=tuple(OUTPUT_ENDINGS))
    restore: bool = option(False, "Bring back the RPC from before the first writing in place")
    output_dir: str | None = option(
        None, "Directory for copies, VRTs and sidecars; created where missing", kind=Kind.OUTPUT_DIR, metavar="DIR"
    )
    overwrite: bool = option(False, "Replace files of an earlier run")
    common: Common = nest_options(Common)


WRITE_RPC = Algorithm(
    name="write-rpc", title="Write RPC", group="RPC",
    summary="Put an RPC into a GeoTIFF, a sidecar or a VRT; `restore` brings the original back",
    help=(
        "Writes the RPC of any file that HRSI reads (or the image's own, wherever it is kept) for one or more images. "
        "copy writes a GeoTIFF with the pixels, compression and overviews of the image; in-place changes the image "
        "itself and keeps its original RPC in it, so that `restore` brings it back bit by bit; vrt writes a virtual "
        "image; sidecar, rpb, xml, geom and json write a _RPC.TXT, .RPB, ISD XML (ASP), .geom (Orfeo ToolBox) or rpcm "
        "JSON file, beside the image unless an output directory is given (docs/bridges.md says who reads what). "
        "Everything is read again and compared; a file that exists is replaced in one step."
    ),
    options=WriteRpcOptions,
    images_made="Images with their RPCs",
    examples=(
        "hrsi write-rpc block/image_1.tif --rpc adjusted/image_1.tif --write sidecar --output-dir rpcs",
        "hrsi write-rpc block/image_1.tif --rpc adjusted/image_1.tif --write vrt --output-dir virtual",
    ),
)  # fmt: skip


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


CROP = Algorithm(
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


@options(kw_only=True)
class StripOptions:
    """What `strip` takes."""

    images: tuple[str, ...] = images_option(
        "Parts of one strip, or tiles of one scene; RPC files alone give the RPC only"
    )
    id: str | None = option(
        None, "Id of the strip, which names the files; by default that of the first part and _strip", metavar="ID"
    )
    format: str = option(
        "vrt",
        "A virtual image that reads the parts, a tiled GeoTIFF, or a cloud-optimised one with overviews",
        choices=tuple(FORMAT_ENDINGS),
    )
    compression: str = compression_option()
    folder: ResultFolder = nest_options(ResultFolder)
    common: Common = nest_options(Common)


JOIN_STRIP = Algorithm(
    name="strip",
    title="Join strip",
    group="RPC",
    summary="Parts or tiles of one strip as one image with one RPC",
    help=(
        "Joins the parts in which a strip was delivered (WorldView's P001, P002 …) or the tiles of a scene (R1C1 …) to "
        "one image, a virtual one unless pixels of its own are asked for, and gives it one RPC. Where the parts lie "
        "follows from the product or from their RPCs; where they overlap the later one is on top. Tiles with one RPC "
        "have it exactly; other RPCs are fitted together, and the report states how far the fit is from each part. "
        "Where that is more than 0.1 px a warning says so, and the grid that the RPC was fitted to is written as a "
        "table. Refined parts give a refined strip. RPC files alone whose size is known (ISD, DIMAP) give the strip's "
        "_RPC.TXT."
    ),
    options=StripOptions,
    images_made="Strips",
    examples=("hrsi strip delivery/*_P001.TIF delivery/*_P002.TIF --output-dir strip",),
)  # fmt: skip


RPC_INFO_FILE = "rpc_info.gpkg"


@options(kw_only=True)
class RpcInfoOptions:
    """What `rpc-info` takes."""

    images: tuple[str, ...] = images_option()
    terrain: TerrainOptions = nest_options(TerrainOptions)
    crs: str | None = option(
        None,
        "List the coordinate operations between this CRS and WGS84 at the images' place: which one is taken, and which "
        "lack their grid (EPSG:code or WKT)", kind=Kind.CRS, metavar="CRS",
    )  # fmt: skip
    folder: OptionalFolder = nest_options(OptionalFolder)
    common: Common = nest_options(Common)


RPC_INFO = Algorithm(
    name="rpc-info", title="RPC information", group="RPC",
    summary="Footprint, GSD, incidence and azimuth, pair convergence and B/H, overlaps, RPC sanity",
    help=(
        "Says for each image where it lies, the ground size of a pixel along line and sample, the incidence angle (at "
        "the ground, between the ray to the satellite and the vertical) and the azimuth (from the target to the "
        "satellite, clockwise from north); and for each pair the convergence angle, B/H (distance of the two rays at "
        "unit height above the ground) and which share of each image the other one sees on the terrain. Overlap "
        "depends on the terrain's height: give a DEM or a height. Warns of RPCs that are damaged, swapped, used "
        "beyond their heights, or of another image."
    ),
    options=RpcInfoOptions,
    examples=(
        "hrsi rpc-info block/image_*.tif --dem block/dem.tif --height-datum ellipsoidal",
        "hrsi rpc-info block/image_*.tif --crs EPSG:23030",
    ),
    layers=(f"{RPC_INFO_FILE}|layername=images",),
)  # fmt: skip


POINTS_FILE = "points.gpkg"


@options(kw_only=True)
class ProjectOptions:
    """What `project` takes."""

    images: tuple[str, ...] = images_option("Images with RPC, or RPC files alone")
    points: str | None = option(
        None, "Ground points: a vector layer or CSV; by default lines on standard input", kind=Kind.POINTS, piped=True,
        metavar=POINTS,
    )  # fmt: skip
    ground_crs: str | None = ground_crs_option()
    terrain: TerrainOptions = nest_options(TerrainOptions)
    folder: OptionalFolder = nest_options(OptionalFolder)
    common: Common = nest_options(Common)


PROJECT = Algorithm(
    name="project", title="Project ground points", group="RPC",
    summary="Ground points to image coordinates, for a point file or as a filter",
    help=(
        "Computes where ground points lie in one or more images. Points come from a vector layer or CSV, or as lines "
        "'lon lat height' (WGS84 degrees, ellipsoidal metres) on standard input; then lines 'sample line' are printed, "
        "with what follows the coordinates. Sample 0, line 0 is the CENTRE of the first pixel (GDAL's pixel and line "
        "are 0.5 larger). Points without a height take it from the DEM or from `height`."
    ),
    options=ProjectOptions,
    examples=(
        "hrsi project block/image_1.tif --points block/ground_points.csv --height-datum ellipsoidal",
        "echo 2.35 48.85 60 | hrsi project block/image_1.tif",
    ),
    layers=(f"{POINTS_FILE}|layername=image_points",),
)  # fmt: skip


@options(kw_only=True)
class LocalizeOptions:
    """What `localize` takes."""

    images: tuple[str, ...] = images_option("Images with RPC, or RPC files alone")
    points: str | None = option(
        None, "Image points: a vector layer or CSV; by default lines on standard input", kind=Kind.POINTS, piped=True,
        metavar=POINTS,
    )  # fmt: skip
    terrain: TerrainOptions = nest_options(TerrainOptions)
    folder: OptionalFolder = nest_options(OptionalFolder)
    common: Common = nest_options(Common)


LOCALIZE = Algorithm(
    name="localize", title="Localize image points", group="RPC",
    summary="Image points to the ground, at a height or on a DEM, for a point file or as a filter",
    help=(
        "Follows the rays of image points to the ground. Points come from a vector layer or CSV with the fields sample "
        "and line (and image, where several are given), or as lines 'sample line [height]' on standard input; then "
        "lines 'lon lat height' (WGS84 degrees, ellipsoidal metres) are printed, with what follows the coordinates, "
        "and 'nan' where there is no ground position. A point's own ellipsoidal height counts before the DEM and "
        "`height`. On a DEM the first hit of the ray from above counts. Sample 0, line 0 is the CENTRE of the first "
        "pixel (GDAL's pixel and line are 0.5 larger)."
    ),
    options=LocalizeOptions,
    examples=(
        "echo 40 60 | hrsi localize block/image_1.tif --dem block/dem.tif --height-datum ellipsoidal",
    ),
    layers=(f"{POINTS_FILE}|layername=ground_points",),
)  # fmt: skip


@options(kw_only=True)
class FitRpcOptions:
    """What `fit-rpc` takes."""

    points: str = option(help="Table of correspondences: a CSV or vector layer", kind=Kind.POINTS, metavar=POINTS)
    ground_crs: str | None = ground_crs_option()
    height_datum: str = height_datum_option()
    strict_datum: bool = strict_datum_option()
    id: str | None = option(
        None, "Id of the image, which names the file; by default the stem of the table", metavar="ID"
    )
    common_denominator: bool = option(
        False, "One denominator for sample and line (less exact, simpler to correct later)"
    )
    min_height: float | None = option(
        None, "Lowest height where the RPC will be used; warns where it extrapolates", unit="m", metavar="M"
    )
    max_height: float | None = option(
        None, "Highest height where the RPC will be used; warns where it extrapolates", unit="m", metavar="M"
    )
    folder: ResultFolder = nest_options(ResultFolder)
    common: Common = nest_options(Common)


FIT_RPC = Algorithm(
    name="fit-rpc", title="Fit RPC", group="RPC",
    summary="An RPC from a grid or table of correspondences",
    help=(
        "Fits an RPC to points with known ground position and image coordinates, as a sensor model or another program "
        "computes them on a grid, and writes it as _RPC.TXT. The table has lon, lat, height (or x, y, z with "
        "`ground_crs`, or point geometry), sample and line; sample 0, line 0 is the CENTRE of the first pixel. One "
        "point in five is left out once, and the differences there are reported. A full RPC takes 45 points or more, "
        "spread over the image and at several heights; with fewer points only its lower terms are estimated."
    ),
    options=FitRpcOptions,
    examples=(
        "hrsi fit-rpc --points grid.csv --height-datum ellipsoidal --output-dir fitted",
    ),
)  # fmt: skip

# ---- hand-over ------------------------------------------------------------------------------------------------------

NEXT_PROGRAMS = ("cars", "s2p", "asp", "micmac", "colmap", "nerf", "points")


@options(kw_only=True)
class HandOverOptions:
    """What `hand-over` takes."""

    result: str = option(help="Output directory of an adjustment", kind=Kind.RESULT, metavar="RESULT")
    to: str = option(
        "cars", "The next program; colmap gets perspective cameras, nerf is for radiance fields with RPCs, points for "
        "point clouds and GCPs",
        choices=NEXT_PROGRAMS,
    )  # fmt: skip
    extent: str | None = option(
        None, "Region of interest: a box on the ground, in degrees or in the CRS that stands in brackets behind it; by "
        "default all that the chosen pairs have in common", kind=Kind.EXTENT, metavar="W,S,E,N [CRS]",
    )  # fmt: skip
    dem: DemOptions = nest_options(DemOptions)
    height_datum: str = height_datum_option()
    most_pairs: int = option(8, "Most stereo pairs, the best first", minimum=1)
    factor: float = option(
        1.0, "Size of the crops for colmap and nerf to that of the images", minimum=1e-3, maximum=64.0, advanced=True
    )
    link: bool = option(False, "Refer to the images by VRTs instead of copying them")
    folder: ResultFolder = nest_options(ResultFolder)
    common: Common = nest_options(Common)


HAND_OVER = Algorithm(
    name="hand-over", title="Hand over to another program", group="RPC",
    summary="A project for the next program from an adjusted block, ready to run",
    help=(
        "Writes a folder in which the next program runs with one printed command: the images with their refined RPCs, "
        "the stereo pairs worth matching, an initial DEM of ellipsoidal heights, the program's configuration, and the "
        "accuracy to expect. Pairs are chosen by convergence, sun, season and the share of common tie points; the "
        "initial DEM is `dem`, or a surface through the adjusted points."
    ),
    options=HandOverOptions,
    images_made="Images with refined RPCs",
    examples=("hrsi hand-over adjusted --to cars --output-dir project",),
)  # fmt: skip


ALGORITHMS = (EVALUATE, WRITE_RPC, CROP, JOIN_STRIP, HAND_OVER, RPC_INFO, PROJECT, LOCALIZE, FIT_RPC)

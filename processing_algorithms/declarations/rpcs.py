"""Declarations of the algorithms that evaluate, write, crop, join, apply or fit RPCs."""

from __future__ import annotations

from ...hrsi_engine.adjustment.options import surface_kind_option, surface_search_option
from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface import option_groups as groups
from ..interface.declare import Algorithm, Kind

AUTOMATIC_TRACKS, NO_TRACKS = "auto", "none"
OWN = "own"  #: name of the set of the images' own RPCs
EVALUATION_FILE = "evaluation.gpkg"


@options(kw_only=True)
class EvaluateOptions:
    """Options of `evaluate`."""

    images: tuple[str, ...] = groups.images_option()
    rpcs: tuple[str, ...] = option(
        (),
        "A further set of RPCs: its name, and the directory with an RPC or an image with RPC for each image, under "
        f"the name of the image; repeat for each set. The RPCs of the images themselves are the set {OWN!r}",
        kind=Kind.FOLDERS,
        metavar="NAME=DIR",
    )
    tracks: str = option(
        AUTOMATIC_TRACKS,
        f"Points measured in two or more images: {AUTOMATIC_TRACKS} finds them in the images, {NO_TRACKS} uses none, "
        "FILE reads them",
        kind=Kind.POINTS,
        metavar=f"{AUTOMATIC_TRACKS}|{NO_TRACKS}|FILE",
    )
    used_points: str | None = option(
        None,
        "Image points that the adjustment of these RPCs used (block.gpkg): tracks near one of them are not evaluated",
        kind=Kind.POINTS,
        metavar="FILE",
    )
    apart_px: float = option(
        10.0,
        "Smallest distance of a track from `used_points`, on each of its images",
        name="apart",
        minimum=0.0,
        unit="px",
        advanced=True,
        metavar="PX",
    )
    reject: float = option(
        6.0,
        "Reject tracks whose residual exceeds this multiple of sigma for every set of RPCs, as wrong matches; 0 "
        "rejects none",
        minimum=0.0,
        unit="sigma",
        advanced=True,
        metavar="SIGMAS",
    )
    points: groups.PointFiles = nest_options(groups.PointFiles)
    dem: groups.DemOptions = nest_options(groups.DemOptions)
    surface: groups.SurfaceFile = nest_options(groups.SurfaceFile)
    surface_search_m: float = surface_search_option()
    surface_kind: str = surface_kind_option()
    search: groups.SearchOptions = nest_options(groups.SearchOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)
    report: bool = groups.report_option()


EVALUATE = Algorithm(
    name="evaluate",
    title="Evaluate RPCs",
    group="RPC",
    summary="Accuracy of one or more sets of RPCs with tracks, ground points and a DEM",
    help=(
        "Compares sets of RPCs with the same points: those of the images, refined ones, those of another program "
        "(`rpcs` NAME=DIR, once for each set). Nothing is adjusted.\n\nEach track is predicted in each of its images "
        "from the intersection of the other images (strict leave-one-out, from three images on). It is also "
        "intersected from all images, and compared pair by pair across the epipolar lines. A match is rejected only "
        "if it is an outlier for all sets. Ground points with known position are compared in pixels and metres, "
        "separately for GCPs and check points, and heights of the tracks with a DEM. With `surface` the tracks are "
        "matched with its relief, which gives the displacement of each set in plan and height.\n\nThe tracks should "
        "be independent of the RPCs: give points that the adjustment did not use, or name the used ones with "
        "`used_points`."
    ),
    options=EvaluateOptions,
    examples=(
        "hrsi evaluate block/image_*.tif --rpcs refined=adjusted --tracks block/image_points.csv "
        "--height-datum ellipsoidal --output-dir evaluation",
    ),
    main=("rpcs", "tracks", "gcps", "image-points", "check-ids", "height-datum", "dem", "dem-datum"),
    layers=(f"{EVALUATION_FILE}|layername=images",),
)


#: Ending of the output of an image, by way of writing; None is the image itself.
OUTPUT_ENDINGS: dict[str, str | None] = {
    "copy": ".tif",
    "in-place": None,
    "vrt": ".vrt",
    "sidecar": "_RPC.TXT",
    "rpb": ".RPB",
    "xml": ".xml",
    "geom": ".geom",
    "json": ".json",
}


@options(kw_only=True)
class WriteRpcOptions:
    """Options of `write-rpc`."""

    images: tuple[str, ...] = groups.images_option("Images, or RPC files alone (then `write` cannot be copy or vrt)")
    rpc: str | None = option(
        None,
        "File with the RPC to write, or a folder of RPC files with the names of the images; default: the RPC of the "
        "image",
        kind=Kind.FILE,
        metavar="FILE|DIR",
    )
    write: str = option("copy", "Target of the RPC", choices=tuple(OUTPUT_ENDINGS))
    restore: bool = option(False, "Restore the original RPC that was replaced in place")
    output_dir: str | None = option(
        None, "Directory for copies, VRTs and sidecars; created if missing", kind=Kind.OUTPUT_DIR
    )
    overwrite: bool = option(False, "Replace files of an earlier run")


WRITE_RPC = Algorithm(
    name="write-rpc",
    title="Write RPC",
    group="RPC",
    summary="Write an RPC into a GeoTIFF, a sidecar or a VRT; `restore` restores the original",
    help=(
        "Writes the RPC of any file that HRSI reads (or that of the image) for one or more images. copy writes a "
        "GeoTIFF with the pixels, compression and overviews of the image; in-place changes the image itself and keeps "
        "its original RPC in it, so that `restore` restores it exactly; vrt writes a virtual image; sidecar, rpb, "
        "xml, geom and json write a _RPC.TXT, .RPB, ISD XML (ASP), .geom (Orfeo ToolBox) or rpcm JSON file. Such a "
        "file is written into the folder of the image, or into the output directory. docs/how-to/bridges.md lists the "
        "formats that other programs read. Everything is read again and compared; an existing file is replaced in one "
        "step."
    ),
    options=WriteRpcOptions,
    images_made="Images with their RPCs",
    examples=(
        "hrsi write-rpc block/image_1.tif --rpc adjusted/image_1.tif --write sidecar --output-dir rpcs",
        "hrsi write-rpc block/image_1.tif --rpc adjusted/image_1.tif --write vrt --output-dir virtual",
    ),
)


#: GDAL's kernels that do not displace features: average uses complete pixels and displaces by up to 0.4 of them, mode
#: prefers the upper left of equal values.
KERNELS = ("cubic", "near", "bilinear", "cubicspline", "lanczos")

#: Formats, and the endings of their file names.
FORMAT_ENDINGS = {"gtiff": ".tif", "cog": ".tif", "vrt": ".vrt"}


@options(kw_only=True)
class CropOptions:
    """Options of `crop`."""

    images: tuple[str, ...] = groups.images_option()
    window: str | None = groups.window_option("Window to cut; the first pixel is 0, 0")
    extent: str | None = groups.ground_box_option(": the smallest window that contains it is cut, within the image")
    factor: float | None = option(
        None,
        "Size of the result relative to the window or image: 0.5 halves the number of samples and lines. Both are "
        "rounded to whole pixels, and the RPC is scaled accordingly",
        minimum=1e-3,
        maximum=64.0,
    )
    resampling: str = option("cubic", "GDAL's resampling kernel; only with `factor`", choices=KERNELS)
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    format: str = option(
        "gtiff",
        "A tiled GeoTIFF, a cloud-optimised one with overviews, or a virtual image that reads the original",
        choices=tuple(FORMAT_ENDINGS),
    )
    compression: str = groups.compression_option()
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


CROP = Algorithm(
    name="crop",
    title="Crop or resample",
    group="RPC",
    summary="Window, overview or resampled copy of images, with the exact RPC",
    help=(
        "Cuts a window out of an image, or resamples the image or window to another pixel size, and writes the RPC of "
        "the new pixels. It is the same camera, exactly, at any factor; the RPC of gdal_translate has an error of "
        "half the increase of the pixel size. The metadata of a refinement and the original RPC are kept, so that "
        "`restore` of write-rpc works. `extent` gives the window as a box on the ground, with `dem` or `height`. "
        "Bands, data type, masks, nodata and metadata are kept. The files are named ID_crop; for an RPC file alone a "
        "_RPC.TXT is written."
    ),
    options=CropOptions,
    images_made="Cropped images",
    examples=(
        "hrsi crop block/image_1.tif --window 40,60,100,80 --output-dir cropped",
        "hrsi crop block/image_1.tif block/image_2.tif --factor 0.5 --format cog --output-dir halves",
    ),
)


@options(kw_only=True)
class StripOptions:
    """Options of `strip`."""

    images: tuple[str, ...] = groups.images_option(
        "Parts of one strip, or tiles of one scene; RPC files alone give the RPC only"
    )
    id: str | None = option(
        None, "Id of the strip, used as file name; by default that of the first part with _strip", metavar="ID"
    )
    format: str = option(
        "vrt",
        "A virtual image that reads the parts, a tiled GeoTIFF, or a cloud-optimised one with overviews",
        choices=tuple(FORMAT_ENDINGS),
    )
    compression: str = groups.compression_option()
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


JOIN_STRIP = Algorithm(
    name="strip",
    title="Join strip",
    group="RPC",
    summary="One image with one RPC from the parts or tiles of a strip",
    help=(
        "Joins the parts of a strip as delivered (P001, P002 … of WorldView) or the tiles of a scene (R1C1 …) to one "
        "image with one RPC. The image is a virtual one by default. The positions of the parts follow from the "
        "product or from their RPCs; in an overlap the later part is on top. Tiles with a common RPC keep it exactly. "
        "Otherwise one RPC is fitted to all, and the report gives the difference from each part. If it exceeds 0.1 "
        "px, a warning is given and the grid of the fit is written as a table. Refined parts give a refined strip. "
        "RPC files of known image size (ISD, DIMAP) give a _RPC.TXT of the strip."
    ),
    options=StripOptions,
    images_made="Strips",
    examples=("hrsi strip delivery/*_P001.TIF delivery/*_P002.TIF --output-dir strip",),
)


RPC_INFO_FILE = "rpc_info.gpkg"


@options(kw_only=True)
class RpcInfoOptions:
    """Options of `rpc-info`."""

    images: tuple[str, ...] = groups.images_option()
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    crs: str | None = option(
        None,
        "List the coordinate operations between this CRS and WGS84 in the area of the images: the one that is used, "
        "and those whose grid is missing (EPSG:code or WKT)",
        kind=Kind.CRS,
    )
    folder: groups.OptionalFolder = nest_options(groups.OptionalFolder)


RPC_INFO = Algorithm(
    name="rpc-info",
    title="RPC information",
    group="RPC",
    summary="Footprint, GSD, incidence and azimuth, convergence and B/H of pairs, overlaps, check of the RPCs",
    help=(
        "Reports footprint, GSD along line and sample, incidence angle and azimuth of each image. The incidence angle "
        "is measured at the ground, from the vertical to the ray to the satellite; the azimuth from the target to the "
        "satellite, clockwise from north. For each pair it reports the convergence angle, B/H (distance of the two "
        "rays at unit height above the ground) and the overlap on the terrain. The overlap depends on the height of "
        "the terrain: give a DEM or a height. Warnings are given for RPCs that are damaged, exchanged, used outside "
        "their height range, or of another image."
    ),
    options=RpcInfoOptions,
    examples=(
        "hrsi rpc-info block/image_*.tif --dem block/dem.tif --height-datum ellipsoidal",
        "hrsi rpc-info block/image_*.tif --crs EPSG:23030",
    ),
    layers=(f"{RPC_INFO_FILE}|layername=images",),
)


POINTS_FILE = "points.gpkg"


@options(kw_only=True)
class ProjectOptions:
    """Options of `project`."""

    images: tuple[str, ...] = groups.images_option("Images with RPC, or RPC files alone")
    points: str | None = groups.input_points_option("Ground")
    ground_crs: str | None = groups.ground_crs_option()
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    folder: groups.OptionalFolder = nest_options(groups.OptionalFolder)


PROJECT = Algorithm(
    name="project",
    title="Project ground points",
    group="RPC",
    summary="Ground points to image coordinates, for a point file or as a filter",
    help=(
        "Computes the positions of ground points in one or more images. Points are read from a vector layer or CSV, "
        "or as lines 'lon lat height' from standard input. They are WGS84 degrees and ellipsoidal metres, or x, y and "
        "height of `ground_crs` and `height_datum`. In this case lines 'sample line' are printed, with the rest of "
        "the input line. Sample 0, line 0 is the CENTRE of the first pixel (pixel and line of GDAL are 0.5 larger). "
        "For points without a height, the DEM or `height` is used."
    ),
    options=ProjectOptions,
    examples=(
        "hrsi project block/image_1.tif --points block/ground_points.csv --height-datum ellipsoidal",
        "echo 2.35 48.85 60 | hrsi project block/image_1.tif",
    ),
    layers=(f"{POINTS_FILE}|layername=image_points",),
)


@options(kw_only=True)
class LocalizeOptions:
    """Options of `localize`."""

    images: tuple[str, ...] = groups.images_option("Images with RPC, or RPC files alone")
    points: str | None = groups.input_points_option("Image")
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    folder: groups.OptionalFolder = nest_options(groups.OptionalFolder)


LOCALIZE = Algorithm(
    name="localize",
    title="Localize image points",
    group="RPC",
    summary="Image points to the ground, at a height or on a DEM, for a point file or as a filter",
    help=(
        "Intersects the rays of image points with the ground. Points are read from a vector layer or CSV with the "
        "fields sample and line (and image, if there are several), or as lines 'sample line [height]' from standard "
        "input. In this case lines 'lon lat height' (WGS84 degrees, ellipsoidal metres) are printed, with the rest of "
        "the input line, and 'nan' for points without a ground position. The ellipsoidal height of a point takes "
        "precedence over the DEM and `height`. On a DEM the first intersection of the ray from above is used. Sample "
        "0, line 0 is the CENTRE of the first pixel (pixel and line of GDAL are 0.5 larger)."
    ),
    options=LocalizeOptions,
    examples=("echo 40 60 | hrsi localize block/image_1.tif --dem block/dem.tif --height-datum ellipsoidal",),
    layers=(f"{POINTS_FILE}|layername=ground_points",),
)


@options(kw_only=True)
class FitRpcOptions:
    """Options of `fit-rpc`."""

    points: str = option(
        help="Table of correspondences, a CSV or vector layer; or an exact camera: ISD XML with ephemeris and "
        "attitude, DIMAP V1 of SPOT 5, a CSM state of a line scanner; or RUN.adjust|camera=IMAGE of ASP",
        kind=Kind.POINTS,
        metavar=groups.POINTS,
    )
    ground_crs: str | None = groups.ground_crs_option()
    height_datum: str = groups.height_datum_option()
    strict_datum: bool = groups.strict_datum_option()
    id: str | None = option(None, "Id of the image, used as file name; by default the name of the table", metavar="ID")
    common_denominator: bool = option(
        False, "One denominator for sample and line (less accurate, easier to correct later)"
    )
    min_height: float | None = option(
        None, "Lowest height at which the RPC will be used; exact cameras are sampled from there", unit="m", metavar="M"
    )
    max_height: float | None = option(
        None,
        "Highest height at which the RPC will be used; a warning is given for extrapolation",
        unit="m",
        metavar="M",
    )
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


FIT_RPC = Algorithm(
    name="fit-rpc",
    title="Fit RPC",
    group="RPC",
    summary="An RPC from a grid or table of correspondences",
    help=(
        "Fits an RPC to points with known ground position and image coordinates, for example from a grid of a sensor "
        "model, and writes it as _RPC.TXT. The table has lon, lat, height (or x, y, z with `ground_crs`, or point "
        "geometry), sample and line; sample 0, line 0 is the CENTRE of the first pixel. For a check, the fit is "
        "repeated without every fifth point, and the differences there are reported. A full RPC needs at least 45 "
        "points, spread over the image and at several heights; with fewer points only its lower terms are estimated. "
        "`points` may also be a file with ephemeris, attitude and detectors: the RPC is then fitted to its exact "
        "camera, between `min_height` and `max_height`, which may be missing for an ISD file that has an RPC. An "
        ".adjust file of bundle_adjust (ASP 3) moves the RPC of the image that is named behind it; the "
        "result is its adjusted RPC."
    ),
    options=FitRpcOptions,
    examples=("hrsi fit-rpc --points grid.csv --height-datum ellipsoidal --output-dir fitted",),
)

# ---- hand-over ------------------------------------------------------------------------------------------------------

NEXT_PROGRAMS = ("cars", "s2p", "asp", "micmac", "colmap", "nerf", "points")


@options(kw_only=True)
class HandOverOptions:
    """Options of `hand-over`."""

    result: str = option(help="Output directory of an adjustment", kind=Kind.RESULT, metavar="RESULT")
    to: str = option(
        "cars",
        "Target program; colmap has perspective cameras, nerf radiance fields with RPCs, points is for "
        "point clouds and GCPs",
        choices=NEXT_PROGRAMS,
    )
    extent: str | None = groups.ground_box_option("; by default the common area of the chosen pairs")
    dem: groups.DemOptions = nest_options(groups.DemOptions)
    height_datum: str = groups.height_datum_option()
    most_pairs: int = option(8, "Largest number of stereo pairs; the best ones are chosen", minimum=1)
    factor: float = option(
        1.0, "Size of the crops for colmap and nerf relative to the images", minimum=1e-3, maximum=64.0, advanced=True
    )
    link: bool = option(False, "Write VRTs that refer to the images instead of copies")
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


HAND_OVER = Algorithm(
    name="hand-over",
    title="Hand over to another program",
    group="RPC",
    summary="A project folder for another program from an adjusted block, ready to run",
    help=(
        "Writes a folder in which the target program runs with one printed command. It contains the images with their "
        "refined RPCs, the chosen stereo pairs, an initial DEM of ellipsoidal heights, the configuration of the "
        "program, and the expected accuracy. Pairs are chosen by convergence angle, sun, season and the share of "
        "common tie points. The initial DEM (not for CARS) is `dem`, or a surface through the adjusted "
        "points."
    ),
    options=HandOverOptions,
    images_made="Images with refined RPCs",
    examples=("hrsi hand-over adjusted --to cars --output-dir project",),
)


ALGORITHMS = (EVALUATE, WRITE_RPC, CROP, JOIN_STRIP, HAND_OVER, RPC_INFO, PROJECT, LOCALIZE, FIT_RPC)

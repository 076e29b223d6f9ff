"""Groups of options that several algorithms share, as dataclasses that are nested in their options."""

from __future__ import annotations

from typing import Any

from ...hrsi_engine.adjustment.options import HOLD_OUT
from ...hrsi_engine.block.default_sigmas import DefaultSigmas
from ...hrsi_engine.foundation.options import nest_options, option, options, threads_option
from ...hrsi_engine.foundation.workers.certificates import Certificates
from ...hrsi_engine.measurement.reference.options import ReferenceOptions
from ...hrsi_engine.measurement.tie_options import TieOptions
from .declare import Kind, params_of

DATUMS = "layer|ellipsoidal|egm96|egm2008|FILE"
EARLIEST_EPOCH = 1957.0  # year of the first satellite
POINTS = "FILE[|layername=L]"
#: Values instead of a file of tie points: search by matching, and none.
AUTOMATIC_TIES, NO_TIES = "auto", "none"
#: Use of the cameras of an earlier block when images join it.
FREE, OBSERVED = "free", "observed"
COMPRESSION_NAMES = ("deflate", "lzw", "zstd", "none")
WINDOW = "SAMPLE,LINE,SAMPLES,LINES"


def images_option(
    help: str = "Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json)",
) -> Any:
    """Return the option of the images, the positional arguments."""
    return option(help=help, kind=Kind.IMAGES)


def report_option(help: str = "Write report.html") -> Any:
    """Return the option of the report page."""
    return option(True, help)


def hold_out_option() -> Any:
    """Return the option of the share of tie tracks that are held out."""
    return option(
        0.1,
        "Share of the tie points that the adjustment does not use and that check its result, in blocks with more than "
        f"{HOLD_OUT.fewest_tracks}; 0 uses all",
        minimum=0.0,
        maximum=0.5,
        advanced=True,
        metavar="SHARE",
    )


def band_option(help: str = "Band of the image") -> Any:
    """Return the option of a band."""
    return option(1, help, minimum=1)


def compression_option() -> Any:
    """Return the option of the compression of images (`io.rasters.orthoimages.COMPRESSION`)."""
    return option("deflate", "Compression, all of them lossless", choices=COMPRESSION_NAMES, advanced=True)


def input_points_option(what: str) -> Any:
    """Return the option of points, which are read from standard input if no file is given."""
    help = f"{what} points: a vector layer or CSV; by default lines on standard input"
    return option(None, help, kind=Kind.POINTS, piped=True, metavar=POINTS)


def ground_box_option(purpose: str) -> Any:
    """Return the option of a box on the ground."""
    help = f"Box on the ground, in degrees or in the CRS in brackets after it{purpose}"
    return option(None, help, kind=Kind.EXTENT, metavar="W,S,E,N [CRS]")


def window_option(help: str) -> Any:
    """Return the option of a window of an image."""
    return option(None, help, metavar=WINDOW)


# ---- results --------------------------------------------------------------------------------------------------------


@options
class LineOptions:
    """Options of the command line only."""

    dry_run: bool = option(False, "Read and check all inputs, write nothing, and print what a run would do")
    log: str | None = option(
        None, "Text file to which progress, warnings and errors are appended, with their times", kind=Kind.FILE
    )
    quiet: bool = option(False, "No progress and no messages, only errors")
    json: bool = option(False, "Print the report as one JSON document")


@options(kw_only=True)
class ResultFolder:
    """Output directory."""

    output_dir: str = option(help="Directory for the results; created where missing", kind=Kind.OUTPUT_DIR)
    overwrite: bool = option(False, "Replace the results of an earlier run in the output directory")


OUTPUT_PARAMS = params_of(ResultFolder)
LINE_PARAMS = params_of(LineOptions)  #: options of the command line itself


@options
class OptionalFolder:
    """Output directory, optional."""

    output_dir: str | None = option(
        None, "Directory for report and layers; by default the result is only printed", kind=Kind.OUTPUT_DIR
    )
    overwrite: bool = option(False, "Replace the results of an earlier run in the output directory")


@options
class DocumentOptions:
    """Texts on the cover of the report."""

    title: str | None = option(None, "Title of the project, for the cover of report.html", advanced=True)
    client: str | None = option(None, "Client or recipient, for the cover of report.html", advanced=True)
    place: str | None = option(None, "Name of the place, for the cover of report.html", advanced=True)


@options(kw_only=True)
class BlockOutput:
    """Output of an adjusted block."""

    folder: ResultFolder = nest_options(ResultFolder)
    write: str = option(
        "copy",
        "Target of the refined RPCs: copies of the images, copies resampled without jitter, the images themselves "
        "(write-rpc with `restore` restores the original), virtual images, _RPC.TXT files, or none; for an RPC file "
        "without image a new _RPC.TXT is written",
        choices=("copy", "resampled", "in-place", "vrt", "sidecar", "none"),
    )
    force_write: bool = option(False, "Write the refined RPCs even if the verdict is unusable", advanced=True)
    residual_crs: str = option("both", "Coordinate systems of the residual layers", choices=("both", "wgs84", "utm"))
    report: bool = report_option()
    document: DocumentOptions = nest_options(DocumentOptions)
    stac: bool = option(
        False, "Also write a STAC item of each refined image (ID_stac.json), and one file of all items (stac.json)"
    )


# ---- heights ---------------------------------------------------------------------------------------------------------


def ground_crs_option() -> Any:
    """Return the option of the CRS of ground points."""
    return option(None, "CRS of ground points whose file does not name one (EPSG:code or WKT)", kind=Kind.CRS)


def height_datum_option() -> Any:
    """Return the option of the height datum."""
    return option(
        "layer",
        "Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or the file of a "
        "geoid grid",
        metavar=DATUMS,
    )


def strict_datum_option() -> Any:
    """Return the option of whether a missing grid is an error."""
    return option(
        False,
        "Stop if the geoid or the grid of a better coordinate operation is not installed, instead of using the next "
        "best one",
        advanced=True,
    )


@options
class DemOptions:
    """A DEM of the ground."""

    dem: str | None = option(None, "DEM of the ground, in any CRS", kind=Kind.RASTER)
    dem_datum: str | None = option(
        None, "Height datum of the DEM, if it differs from `height_datum`", advanced=True, metavar=DATUMS
    )


@options
class LaserFile:
    """File of laser points and its height datum."""

    laser: str | None = option(
        None,
        "Laser points whose heights constrain the block; image points are not needed: a granule of ICESat-2 (ATL06, "
        "ATL08) or GEDI L2A, GeoParquet or CSV of SlideRule, or a point layer with height and sigma_h",
        kind=Kind.POINTS,
        metavar=POINTS,
    )
    laser_datum: str = option(
        "ellipsoidal",
        "Height datum of laser points in a layer; heights of granules are ellipsoidal",
        advanced=True,
        metavar=DATUMS,
    )


@options
class SurfaceFile:
    """A surface that constrains a block in plan and height, its datum and accuracy."""

    surface: str | None = option(
        None,
        "Surface that constrains the block in plan and height by its relief, instead of `dem` with `sigma_dem_m`: a "
        "raster, a lidar point cloud (LAS, LAZ), a layer of points with heights, a granule of ICESat-2 or GEDI",
        kind=Kind.POINTS,
        metavar=POINTS,
    )
    surface_datum: str | None = option(
        None, "Height datum of the surface, if it differs from `height_datum`", advanced=True, metavar=DATUMS
    )
    sigma_surface: float | None = option(
        None,
        "Standard deviation of the heights of the surface, four fifths of it common to all heights; by default a "
        "value for its cell size",
        minimum=1e-6,
        unit="m",
        advanced=True,
        metavar="M",
    )


@options(kw_only=True)
class MandatoryDem(DemOptions):
    """A required DEM."""

    dem: str = option(help="DEM of the ground, in any CRS", kind=Kind.RASTER)


@options
class TerrainOptions:
    """Height of the ground: a DEM or one height."""

    dem: DemOptions = nest_options(DemOptions)
    height: float | None = option(None, "Ellipsoidal height of the ground, instead of a DEM", unit="m", metavar="M")
    height_datum: str = height_datum_option()
    strict_datum: bool = strict_datum_option()


# ---- points ----------------------------------------------------------------------------------------------------------


@options
class PointFiles:
    """Files of ground and image points, and which points are control."""

    gcps: str | None = option(
        None,
        "Ground points with known position: a vector layer or CSV; FILE|columns=id=NAME,… if its fields have other "
        "names",
        kind=Kind.POINTS,
        metavar=POINTS,
    )
    image_points: str | None = option(
        None,
        "Image measurements of the points; ground positions in this file are not used",
        kind=Kind.POINTS,
        metavar="FILE",
    )
    gcp_ids: tuple[str, ...] | None = option(
        None, "Ids of the GCPs; all other points with known position are check points", metavar="A,B,…"
    )
    check_ids: tuple[str, ...] | None = option(
        None,
        "Ids of the check points; with `gcp_ids` too, all other points with known position are not used",
        metavar="A,B,…",
    )
    ground_crs: str | None = ground_crs_option()
    height_datum: str = height_datum_option()
    gcp_epoch: float | None = option(
        None,
        "Year of the images (2015.4), for the plate motion between WGS84 and the datum of points and DEM (ETRS89, "
        "GDA2020, NAD83); by default the two are treated as equal, and the error is included in the accuracy",
        minimum=EARLIEST_EPOCH,
        advanced=True,
        metavar="YEAR",
    )
    strict_datum: bool = strict_datum_option()
    sigmas: DefaultSigmas = nest_options(DefaultSigmas)


@options
class BlockGrowthOptions:
    """A block adjusted before, which the images join."""

    add_to: str | None = option(
        None, "Output directory of an earlier adjustment; the images are added to its block", metavar="DIR"
    )
    earlier_cameras: str = option(
        FREE,
        "Cameras of the earlier block: free (adjusted again from all measurements) or observed (with the values and "
        "covariances of the earlier adjustment; its points are not used again)",
        choices=(FREE, OBSERVED),
    )


@options
class WorkerOptions:
    """Threads or workers for tie points and orthoimages: threads of this machine, or workers of a Dask scheduler."""

    scheduler: str | None = option(
        None,
        "Address of a Dask scheduler whose workers find tie points or make orthoimages (they need the files under the "
        "same paths); by default threads of this machine are used. The block adjustment itself always runs in this "
        "process",
        advanced=True,
        metavar="tcp://HOST:PORT",
    )
    scheduler_ca: str | None = option(
        None,
        "Certificates (PEM) of the authority of a scheduler at tls://HOST:PORT; this and the next two default to the "
        "Dask configuration (distributed.comm.tls)",
        kind=Kind.FILE,
        advanced=True,
    )
    scheduler_certificate: str | None = option(
        None, "Client certificate (PEM) for a scheduler at tls://HOST:PORT", kind=Kind.FILE, advanced=True
    )
    scheduler_key: str | None = option(
        None,
        "Private key (PEM) of the client certificate, if it is not in the same file",
        kind=Kind.FILE,
        advanced=True,
    )

    @property
    def certificates(self) -> Certificates:
        """TLS certificates for the connection to a scheduler."""
        return Certificates(self.scheduler_ca, self.scheduler_certificate, self.scheduler_key)


@options
class SearchOptions:
    """Search for tie points: method, scheduler and folder of finished parts."""

    search: TieOptions = nest_options(TieOptions)
    matches: str | None = option(
        None,
        "Matches of another program instead of a search: .h5 of hloc, a COLMAP database, matches as text; each is "
        "measured again by least-squares matching and tested like matches of HRSI",
        kind=Kind.POINTS,
        advanced=True,
        metavar="FILE",
    )
    workers: WorkerOptions = nest_options(WorkerOptions)
    work_dir: str | None = option(
        None,
        "Directory for finished parts, which later runs use again; by default a folder in the output directory, which "
        "is removed at the end of a run",
        advanced=True,
        metavar="DIR",
    )
    threads: int = threads_option()


@options
class ReferenceImage:
    """A reference orthoimage: reading, weights and matching."""

    reference: str | None = option(None, "Orthoimage in which GCPs are found by matching, in any CRS", kind=Kind.RASTER)
    reference_sigma: float | None = option(
        None,
        "Standard deviation of each horizontal coordinate of the reference; by default twice its pixel size, at "
        "most 5 m or half a pixel",
        minimum=1e-6,
        unit="m",
        metavar="M",
    )
    reference_band: int | None = option(
        None, "Band of the reference; by default the mean of all", minimum=1, advanced=True, metavar="N"
    )
    matching: ReferenceOptions = nest_options(ReferenceOptions)


@options(kw_only=True)
class MandatoryReference(ReferenceImage):
    """A required reference orthoimage."""

    reference: str = option(help="Orthoimage in which GCPs are found by matching, in any CRS", kind=Kind.RASTER)

"""Options that several algorithms share, as dataclasses that theirs are made of."""

from __future__ import annotations

from typing import Any

from ...hrsi_engine.adjustment.options import HOLD_OUT
from ...hrsi_engine.block.default_sigmas import DefaultSigmas
from ...hrsi_engine.foundation.options import nest_options, option, options, threads_option
from ...hrsi_engine.foundation.workers.certificates import Certificates
from ...hrsi_engine.measurement.reference.options import ReferenceOptions
from ...hrsi_engine.measurement.tie_options import TieOptions
from .declare import Kind

DATUMS = "layer|ellipsoidal|egm96|egm2008|FILE"
EARLIEST_EPOCH = 1957.0  # no image from space is older
POINTS = "FILE[|layername=L]"
#: Words instead of a file of tie points: those that matching finds, and none.
AUTOMATIC_TIES, NO_TIES = "auto", "none"
#: What cameras of an earlier block are when others join them.
FREE, OBSERVED = "free", "observed"
COMPRESSION_NAMES = ("deflate", "lzw", "zstd", "none")
WINDOW = "SAMPLE,LINE,SAMPLES,LINES"


def images_option(
    help: str = "Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json)",
) -> Any:
    """Return the field of the images, the positional arguments."""
    return option(help=help, kind=Kind.IMAGES, metavar="IMAGE")


def report_option(help: str = "Write report.html") -> Any:
    """Return the field that asks for a page."""
    return option(True, help)


def hold_out_option() -> Any:
    """Return the field of the share of tie tracks that is held out."""
    return option(
        0.1,
        f"Share of the tie tracks that take no part in the adjustment and judge its result, of blocks with more than "
        f"{HOLD_OUT.fewest_tracks}; 0 lets all take part", minimum=0.0, maximum=0.5, advanced=True, metavar="SHARE",
    )  # fmt: skip


def band_option(help: str = "Band of the image") -> Any:
    """Return the field of a band."""
    return option(1, help, minimum=1)


def compression_option() -> Any:
    """Return the field of the compression of images (`io.rasters.orthoimages.COMPRESSION`)."""
    return option("deflate", "Compression, all of them lossless", choices=COMPRESSION_NAMES, advanced=True)


def window_option(help: str) -> Any:
    """Return the field of a window of an image."""
    return option(None, help, metavar=WINDOW)


# ---- where results go ------------------------------------------------------------------------------------------------


@options
class Common:
    """What every algorithm takes."""

    threads: int = threads_option()


@options
class LineOptions:
    """What the command line has for every algorithm, and QGIS and Python do without."""

    dry_run: bool = option(False, "Read and check everything, write nothing, and say what would be done")
    log: str | None = option(
        None, "Text file to which the run adds its progress, warnings and errors, with their times", kind=Kind.FILE,
        metavar="FILE",
    )  # fmt: skip
    quiet: bool = option(False, "No progress and no messages, only errors")
    json: bool = option(False, "Print the report as one JSON document")


@options(kw_only=True)
class ResultFolder:
    """Where results go."""

    output_dir: str = option(
        help="Directory for the results; created where missing", kind=Kind.OUTPUT_DIR, metavar="DIR"
    )
    overwrite: bool = option(False, "Replace the results of an earlier run in the output directory")


@options
class OptionalFolder:
    """Where results go, if anywhere."""

    output_dir: str | None = option(
        None, "Directory for report and layers; without it the result is only printed", kind=Kind.OUTPUT_DIR,
        metavar="DIR",
    )  # fmt: skip
    overwrite: bool = option(False, "Replace the results of an earlier run in the output directory")


@options
class DocumentOptions:
    """What the cover of a report says besides its figures."""

    title: str | None = option(None, "Title of the project, for the cover of report.html", advanced=True)
    client: str | None = option(None, "Client or recipient, for the cover of report.html", advanced=True)
    place: str | None = option(None, "Name of the place, for the cover of report.html", advanced=True)


@options(kw_only=True)
class BlockOutput:
    """What is written of an adjusted block, and where."""

    folder: ResultFolder = nest_options(ResultFolder)
    write: str = option(
        "copy",
        "Where refined RPCs go: into copies of the images, into the images themselves (write-rpc with `restore` brings "
        "the original back), into virtual images, into _RPC.TXT files, or nowhere; an RPC file without image gets a "
        "new _RPC.TXT",
        choices=("copy", "in-place", "vrt", "sidecar", "none"),
    )
    force_write: bool = option(
        False, "Write the refined RPCs although the verdict on the result is unusable", advanced=True
    )
    residual_crs: str = option("both", "Coordinate systems of the residual layers", choices=("both", "wgs84", "utm"))
    report: bool = report_option()
    document: DocumentOptions = nest_options(DocumentOptions)
    stac: bool = option(
        False, "Write a STAC item of each refined image too (ID_stac.json), and all of them in one file (stac.json)"
    )
    common: Common = nest_options(Common)


# ---- heights ---------------------------------------------------------------------------------------------------------


def ground_crs_option() -> Any:
    """Return the field of the CRS of ground points."""
    return option(
        None, "CRS of ground points whose file does not name one (EPSG:code or WKT)", kind=Kind.CRS, metavar="CRS"
    )


def height_datum_option() -> Any:
    """Return the option of the height datum."""
    return option(
        "layer",
        "What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96, egm2008 or a "
        "geoid grid file",
        metavar=DATUMS,
    )


def strict_datum_option() -> Any:
    """Return the field of whether a missing grid is an error."""
    return option(
        False,
        "Stop where the geoid that is meant or the grid of a better coordinate operation is not installed, instead of "
        "going on with the next best one",
        advanced=True,
    )


@options
class DemOptions:
    """A DEM of the ground."""

    dem: str | None = option(None, "DEM of the ground, in any CRS", kind=Kind.RASTER, metavar="FILE")
    dem_datum: str | None = option(
        None, "What the heights of the DEM refer to, where it is not what `height_datum` says", advanced=True,
        metavar=DATUMS,
    )  # fmt: skip


@options
class LaserFile:
    """File of laser points and its height datum."""

    laser: str | None = option(
        None,
        "Laser points whose heights hold the block, without image points: a granule of ICESat-2 (ATL06, ATL08) or GEDI "
        "L2A, SlideRule's GeoParquet or CSV, or a point layer with height and sigma_h",
        kind=Kind.POINTS,
        metavar=POINTS,
    )
    laser_datum: str = option(
        "ellipsoidal", "What the heights of laser points in a layer refer to; those of granules are ellipsoidal",
        advanced=True, metavar=DATUMS,
    )  # fmt: skip


@options
class SurfaceFile:
    """A surface that holds a block in plan and height, its datum and accuracy."""

    surface: str | None = option(
        None,
        "Surface whose relief and heights hold the block in plan and height, instead of `dem` with `sigma_dem_m`: a "
        "raster, a lidar cloud (LAS, LAZ), a layer of points with heights, a granule of ICESat-2 or GEDI",
        kind=Kind.POINTS,
        metavar=POINTS,
    )
    surface_datum: str | None = option(
        None, "What the heights of the surface refer to, where it is not what `height_datum` says", advanced=True,
        metavar=DATUMS,
    )  # fmt: skip
    sigma_surface: float | None = option(
        None, "Standard deviation of the heights of the surface, four fifths of it common to all; by default what "
        "its cell size is known for", minimum=1e-6, unit="m", advanced=True, metavar="M",
    )  # fmt: skip


@options(kw_only=True)
class MandatoryDem(DemOptions):
    """A DEM that has to be named."""

    dem: str = option(help="DEM of the ground, in any CRS", kind=Kind.RASTER, metavar="FILE")


@options
class TerrainOptions:
    """How high the ground is: a DEM or one height."""

    dem: DemOptions = nest_options(DemOptions)
    height: float | None = option(None, "Ellipsoidal height of the ground, instead of a DEM", unit="m", metavar="M")
    height_datum: str = height_datum_option()
    strict_datum: bool = strict_datum_option()


# ---- points ----------------------------------------------------------------------------------------------------------


@options
class PointFiles:
    """Files of ground and image points, and which points are control."""

    gcps: str | None = option(
        None, "Ground points with known position: a vector layer or CSV", kind=Kind.POINTS, metavar=POINTS
    )
    image_points: str | None = option(
        None, "Where points were measured on the images; ground positions in it are not used", kind=Kind.POINTS,
        metavar="FILE",
    )  # fmt: skip
    gcp_ids: tuple[str, ...] | None = option(
        None, "These points are control, all other known points are check points", metavar="A,B,…"
    )
    check_ids: tuple[str, ...] | None = option(
        None, "These points are check points; with `gcp_ids` too, all other known points take no part", metavar="A,B,…"
    )
    ground_crs: str | None = ground_crs_option()
    height_datum: str = height_datum_option()
    gcp_epoch: float | None = option(
        None,
        "Year (2015.4) in which points and DEM are brought to WGS84 where their datum moves with a plate (ETRS89, "
        "GDA2020, NAD83): that of the images; by default such a datum is taken for WGS84, with the accuracy of that",
        minimum=EARLIEST_EPOCH, advanced=True, metavar="YEAR",
    )  # fmt: skip
    strict_datum: bool = strict_datum_option()
    sigmas: DefaultSigmas = nest_options(DefaultSigmas)


@options
class BlockGrowthOptions:
    """The block that was adjusted before and that the images join."""

    add_to: str | None = option(
        None, "Output directory of an earlier adjustment, whose block the images join", metavar="DIR"
    )
    earlier_cameras: str = option(
        FREE,
        "What the cameras of the earlier block are: free, adjusted again from all measurements, or observed, as the "
        "earlier adjustment left them, with all that it says of them together; then its points are not used again",
        choices=(FREE, OBSERVED),
    )


@options
class WorkerOptions:
    """Who finds tie points or makes orthoimages: threads of this machine, or workers of a Dask scheduler."""

    scheduler: str | None = option(
        None,
        "Address of a Dask scheduler whose workers find tie points or make orthoimages (they must see the files under "
        "the same paths); by default threads of this machine do. A block is always adjusted by this process",
        advanced=True,
        metavar="tcp://HOST:PORT",
    )
    scheduler_ca: str | None = option(
        None,
        "Certificates (PEM) of the authority that signed those of a scheduler at tls://HOST:PORT; this and the next "
        "two are by default as Dask's configuration (distributed.comm.tls) says", kind=Kind.FILE, advanced=True,
        metavar="FILE",
    )  # fmt: skip
    scheduler_certificate: str | None = option(
        None, "Certificate (PEM) to show to a scheduler at tls://HOST:PORT", kind=Kind.FILE, advanced=True,
        metavar="FILE",
    )  # fmt: skip
    scheduler_key: str | None = option(
        None, "Private key (PEM) of that certificate, where it is not in the same file", kind=Kind.FILE, advanced=True,
        metavar="FILE",
    )  # fmt: skip

    @property
    def certificates(self) -> Certificates:
        """What is shown to a scheduler that encrypts."""
        return Certificates(self.scheduler_ca, self.scheduler_certificate, self.scheduler_key)


@options
class SearchOptions:
    """Search for tie points: method, scheduler and folder of finished parts."""

    search: TieOptions = nest_options(TieOptions)
    matches: str | None = option(
        None, "Matches of another program instead of a search: hloc's .h5, a COLMAP database, matches as text; each is "
        "measured anew by least-squares matching and judged as those found here", kind=Kind.POINTS, advanced=True,
        metavar="FILE",
    )  # fmt: skip
    workers: WorkerOptions = nest_options(WorkerOptions)
    work_dir: str | None = option(
        None, "Directory that keeps what is finished, for later runs too; by default a folder in the output directory, "
        "which a run that was stopped leaves behind, and a finished run removes", advanced=True, metavar="DIR",
    )  # fmt: skip
    threads: int = threads_option()


@options
class ReferenceImage:
    """A reference orthoimage, and how it is read, trusted and matched."""

    reference: str | None = option(
        None, "Orthoimage in which GCPs are found by matching, in any CRS", kind=Kind.RASTER, metavar="FILE"
    )
    reference_sigma: float | None = option(
        None, "Standard deviation of each horizontal coordinate of the reference; by default twice its pixel size, at "
        "most 5 m or half a pixel", minimum=1e-6, unit="m", metavar="M",
    )  # fmt: skip
    reference_band: int | None = option(
        None, "Band of the reference; by default the mean of all", minimum=1, advanced=True, metavar="N"
    )
    matching: ReferenceOptions = nest_options(ReferenceOptions)


@options(kw_only=True)
class MandatoryReference(ReferenceImage):
    """A reference orthoimage that has to be named."""

    reference: str = option(
        help="Orthoimage in which GCPs are found by matching, in any CRS", kind=Kind.RASTER, metavar="FILE"
    )

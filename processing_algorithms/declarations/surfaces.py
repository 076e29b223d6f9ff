"""Declaration of the surface model of an adjusted block."""

from __future__ import annotations

from ...hrsi_engine.dense.options import SurfaceOptions
from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface import option_groups as groups
from ..interface.declare import Algorithm, Kind

SURFACE_FILE, DIFFERENCE_FILE = "surface.tif", "difference.tif"


@options(kw_only=True)
class SurfaceModelOptions:
    """Options of `surface-model`."""

    result: str = option(help="Output directory of an adjustment", kind=Kind.RESULT, metavar="RESULT")
    resolution: float | None = option(
        None, "Cell size, in units of the CRS; by default the finest pixel of the block on the ground, rounded",
        minimum=1e-9, metavar="R",
    )  # fmt: skip
    crs: str | None = option(
        None, "CRS of the map, projected; by default the UTM zone (or UPS) at the centre of the block", kind=Kind.CRS,
        metavar="CRS",
    )  # fmt: skip
    vertical: str = option(
        "ellipsoidal",
        "Reference of the heights: ellipsoidal, egm96, egm2008, or a vertical CRS",
        metavar="ellipsoidal|egm96|egm2008|EPSG:CODE",
    )
    extent: str | None = option(
        None,
        "A box in the CRS of the map, or in the CRS in brackets after it; by default the ground that the chosen pairs "
        "show", kind=Kind.EXTENT, metavar="W,S,E,N [CRS]",
    )  # fmt: skip
    reference: str | None = option(
        None, "DEM with which the surface is compared: bias, NMAD, LE90, and a raster of the differences",
        kind=Kind.RASTER, metavar="FILE",
    )  # fmt: skip
    reference_datum: str = option("layer", "Height datum of the reference", advanced=True, metavar=groups.DATUMS)
    dense: SurfaceOptions = nest_options(SurfaceOptions)
    dem: groups.DemOptions = nest_options(groups.DemOptions)
    height_datum: str = groups.height_datum_option()
    compression: str = groups.compression_option()
    workers: groups.WorkerOptions = nest_options(groups.WorkerOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)
    report: bool = groups.report_option()
    common: groups.Common = nest_options(groups.Common)


SURFACE_MODEL = Algorithm(
    name="surface-model", title="Surface model", group="Orthoimages",
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
)  # fmt: skip

ALGORITHMS = (SURFACE_MODEL,)

"""`fit-rpc`: an RPC from a table or grid of correspondences between ground and image."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    POINTS,
    Common,
    ResultFolder,
    ground_crs_option,
    height_datum_option,
    strict_datum_option,
)


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


ALGORITHM = Algorithm(
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

"""`fit-rpc`: an RPC from a table or grid of correspondences between ground and image."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .files.result_folder import check_folder, tell
from .files.terrain import GROUND_CRS, HEIGHT_DATUM
from .interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Algorithm, Context, Kind, Param, Report

if TYPE_CHECKING:
    import numpy as np

    from ..hrsi_engine.camera.rpc_fit import RpcFit

CHECK_SHARE = 5  # one point in five is kept for the check
FEWEST_FOR_CHECK = 15
SEED = 1  # of the choice of check points: the same ones every time


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Fit without some of the points, check on them, then fit to all and write."""
    from ..hrsi_engine.foundation.progress import advance
    from ..hrsi_engine.io.output_dir import require_plain_name, stage_folder
    from ..hrsi_engine.io.position_tables import read_correspondences
    from ..hrsi_engine.io.report import write_report_json
    from ..hrsi_engine.io.rpc_files import read_back_px, write_rpc_text

    check_folder(options)
    table = read_correspondences(
        options["points"], ground_crs=options["ground_crs"], height_datum=options["height_datum"]
    )
    advance(context.progress, 0.2, "fitting")
    fit, check = fitted(table.ground, table.image, options["common_denominator"])
    require_plain_name(options["id"] or "rpc", "the id")
    name = f"{options['id'] or Path(options['points'].partition('|')[0]).stem}_RPC.TXT"
    low, high = float(table.ground[:, 2].min()), float(table.ground[:, 2].max())
    report: Report = {
        "schema": 1, "algorithm": "fit-rpc", "output": str(Path(options["output_dir"]) / name),
        "points": len(table.ground), "max_px": fit.max_px, "rms_px": fit.rms_px,
        "check": None if check is None else {"points": check[0], "max_px": check[1].max_px, "rms_px": check[1].rms_px},
        "height_min_m": low, "height_max_m": high,
        "warnings": [*table.warnings, *fit.warnings, *_height_warnings(options, low, high, check is None)],
    }  # fmt: skip
    with stage_folder(options["output_dir"], context.inputs, options["overwrite"]) as folder:
        write_rpc_text(str(folder / name), fit.rpc)
        report["read_back_px"] = read_back_px(str(folder / name), fit.rpc)
        write_report_json(str(folder / "report.json"), report)
    tell(report["warnings"], context)
    advance(context.progress, 1.0, "done")
    return report


def fitted(ground: np.ndarray, image: np.ndarray, common_denominator: bool) -> tuple[RpcFit, tuple[int, RpcFit] | None]:
    """Return the RPC of all points, and how one fitted without the check points agrees with them.

    The check points also decide how much the fit is damped. Too few points leave no check.
    """
    import numpy as np

    from ..hrsi_engine.camera.rpc_fit import best_fit, fit_rpc

    if len(ground) < FEWEST_FOR_CHECK:
        return fit_rpc(ground, image, common_denominator=common_denominator), None
    kept_out = np.zeros(len(ground), dtype=bool)
    kept_out[np.random.default_rng(SEED).permutation(len(ground))[: len(ground) // CHECK_SHARE]] = True
    checked = best_fit(
        (ground[~kept_out], image[~kept_out]), (ground[kept_out], image[kept_out]), common_denominator
    )  # fmt: skip
    whole = fit_rpc(ground, image, ridge=checked.ridge, common_denominator=common_denominator)
    return whole, (int(kept_out.sum()), checked)


def _height_warnings(options: Mapping[str, Any], low: float, high: float, unchecked: bool) -> list[str]:
    from ..hrsi_engine.camera.rpc_fit import extrapolation_warnings

    wanted = (
        low if options["min_height"] is None else options["min_height"],
        high if options["max_height"] is None else options["max_height"],
    )
    few = [f"too few points to keep some for a check: give at least {FEWEST_FOR_CHECK}"] if unchecked else []
    return [*few, *extrapolation_warnings(wanted, (low, high))]


def summarise(report: Report) -> str:
    """Return where the RPC is and how good it is."""
    check = report["check"]
    lines = [
        report["output"],
        f"{report['points']} points: RMS {report['rms_px']:.3g} px, largest {report['max_px']:.3g} px",
    ]
    if check is not None:
        lines.append(
            f"fitted without {check['points']} of them, there: "
            f"RMS {check['rms_px']:.3g} px, largest {check['max_px']:.3g} px"
        )
    return "\n".join(lines)


ALGORITHM = Algorithm(
    name="fit-rpc",
    title="Fit RPC",
    group="RPC",
    summary="An RPC from a grid or table of correspondences",
    help=(
        "Fits an RPC to points with known ground position and image coordinates, as a sensor model or another program "
        "computes them on a grid, and writes it as _RPC.TXT. The table has lon, lat, height (or x, y, z with "
        "--ground-crs, or point geometry), sample and line; sample 0, line 0 is the CENTRE of the first pixel. One "
        "point in five is left out once, and the differences there are reported. A full RPC takes 45 points or more, "
        "spread over the image and at several heights; with fewer points only its lower terms are estimated."
    ),
    declared=(
        Param(
            "points", Kind.POINTS, "Table of correspondences: a CSV or vector layer", required=True,
            metavar="FILE[|layername=L]",
        ),
        GROUND_CRS,
        HEIGHT_DATUM,
        Param("id", Kind.TEXT, "Id of the image, which names the file; by default the stem of the table", metavar="ID"),
        Param(
            "common-denominator", Kind.FLAG,
            "One denominator for sample and line (less exact, simpler to correct later)", default=False,
        ),
        Param(
            "min-height", Kind.NUMBER, "Lowest height where the RPC will be used; warns where it extrapolates",
            unit="m", metavar="M",
        ),
        Param(
            "max-height", Kind.NUMBER, "Highest height where the RPC will be used; warns where it extrapolates",
            unit="m", metavar="M",
        ),
        *OUTPUT_PARAMS,
        *COMMON_PARAMS,
    ),
    run=run,
    summarise=summarise,
)  # fmt: skip

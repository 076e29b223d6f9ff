"""`fit-rpc`: an RPC from a table or grid of correspondences between ground and image."""

from functools import partial
from pathlib import Path

import numpy as np

from ..hrsi_engine.block.placement import FRAME
from ..hrsi_engine.camera.linescan import AdjustedRpc, SampledCamera
from ..hrsi_engine.camera.rpc_fit import RpcFit, best_fit, extrapolation_warnings, fit_rpc
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.options import InMemory
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.foundation.thresholds import SAMPLES, threshold, thresholds
from ..hrsi_engine.ground.operation_uses import list_operation_warnings, require_strict_datums
from ..hrsi_engine.io.exact_cameras import read_adjusted_camera, read_exact_camera
from ..hrsi_engine.io.output_dir import require_plain_name
from ..hrsi_engine.io.point_files.find import Correspondences, read_correspondences
from ..hrsi_engine.io.rpc_files import read_back_px, write_rpc_text
from .declarations.rpcs import FitRpcOptions
from .files.result_folder import check_folder, plan_folder, stage_results
from .interface.declare import Context, Report


@thresholds
class FIT_CHECK:
    """Limits for the check of a fitted RPC."""

    check_every: int = threshold(5, "points", "one of so many points is kept for the check of a fit")


SEED = 1  # of the choice of check points, so that it is repeatable


def run(options: FitRpcOptions, context: Context) -> Report:
    """Fit without some of the points and check the fit there, then fit to all points and write the RPC."""
    check_folder(options.folder, context)
    path = "" if isinstance(options.points, InMemory) else options.points
    camera = (read_adjusted_camera(path) or read_exact_camera(path)) if path else None
    table = (
        _sample_camera(camera, options)
        if camera is not None
        else read_correspondences(options.points, ground_crs=options.ground_crs, height_datum=options.height_datum)
    )
    require_strict_datums(table.operations, options.strict_datum)
    require_plain_name(options.id or "rpc")
    stem = "rpc" if isinstance(options.points, InMemory) else Path(options.points.partition("|")[0]).stem
    name = f"{options.id or stem}_RPC.TXT"
    if context.dry_run:
        return plan_folder(options.folder, name, {"correspondences": len(table.ground)}, table.warnings, context)
    advance(context.progress, 0.2, "fitting")
    ground, image, count = table.ground, table.image, len(table.ground)
    common, kept_out = options.common_denominator, np.zeros(count, dtype=bool)
    check: RpcFit | None = None
    if count >= (SAMPLES.plane * FIT_CHECK.check_every):
        # A fit without some of the points, checked there, also determines the damping of the fit to all
        kept_out[np.random.default_rng(SEED).permutation(count)[: count // FIT_CHECK.check_every]] = True
        check = best_fit((ground[~kept_out], image[~kept_out]), (ground[kept_out], image[kept_out]), common)
    fit_all = partial(fit_rpc, ground, image, common_denominator=common)
    fit = fit_all() if check is None else fit_all(ridge=check.ridge)
    low, high = float(ground[:, 2].min()), float(ground[:, 2].max())
    wanted = (
        low if options.min_height is None else options.min_height,
        high if options.max_height is None else options.max_height,
    )
    warnings = [*table.warnings, *list_operation_warnings(table.operations), *fit.warnings]
    if check is None:
        warnings.append(
            f"too few points to keep some for a check: give at least {(SAMPLES.plane * FIT_CHECK.check_every)}"
        )
    if fit.max_px > FRAME.gross_px:
        cause = "check them for mistakes and points given twice" if camera is None else "fit parts of the image"
        warnings.append(f"the RPC fits its points to {fit.max_px:.3g} px only: {cause}")
    warnings += extrapolation_warnings(wanted, (low, high))
    report: Report = {
        **context.record,
        "output": str(Path(options.folder.output_dir) / name),
        "points": len(table.ground),
        "max_px": fit.max_px,
        "rms_px": fit.rms_px,
        "check": check and {"points": int(kept_out.sum()), "max_px": check.max_px, "rms_px": check.rms_px},
        "height_min_m": low,
        "height_max_m": high,
        "warnings": warnings,
        "crs_operations": [use.entry() for use in table.operations],
    }
    with stage_results(options.folder, report, context) as folder:
        write_rpc_text(str(folder / name), fit.rpc)
        report["read_back_px"] = read_back_px(str(folder / name), fit.rpc)
    return report


def _sample_camera(camera: SampledCamera, options: FitRpcOptions) -> Correspondences:
    """Return correspondences of an exact camera between the heights of the options, or between those that it states."""
    low, high = camera.heights_m or (None, None)
    low = low if options.min_height is None else options.min_height
    high = high if options.max_height is None else options.max_height
    if low is None or high is None or high <= low:
        raise InputError(
            f"{options.points}: its camera needs heights to fit between: give `min_height` and `max_height`"
        )
    ground, image = camera.sample_correspondences(low, high)
    if not np.isfinite(ground).all():
        raise InputError(f"{options.points}: rays of its camera miss the Earth: the file is damaged, get it again")
    return Correspondences(ground, image, (camera.notice,) if isinstance(camera, AdjustedRpc) and camera.notice else ())


def summarise(report: Report) -> str:
    """Return the path of the RPC and the residuals of its fit."""
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

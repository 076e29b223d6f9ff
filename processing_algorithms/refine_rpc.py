"""`refine-rpc`: RPCs of one image or several, each refined separately, from ground control points only."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..hrsi_engine.adjustment.options import AdjustOptions
from ..hrsi_engine.block.block import Block, Role
from ..hrsi_engine.foundation.errors import InputError, SolveError
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.refinement.model import RefinementModel
from ..hrsi_engine.refinement.refine import Refinement, refine_image, solve_refinement
from ..hrsi_engine.refinement.selection import select_control
from ..hrsi_engine.results.figures import control_and_check
from ..hrsi_engine.results.residuals import compute_residuals
from ..hrsi_engine.results.separate_images import separate_result
from .block_steps.block_run import BlockRun
from .block_steps.plausibility import explain_failures
from .block_steps.summary import COLUMN_WIDTHS, choice_entries, format_digits
from .block_steps.summary import summarise as summarise_block
from .declarations.triangulation import RefineAlgorithmOptions
from .interface.declare import Context, Report
from .laboratory.direct_methods import select_models

#: Sigmas of shift (px) and drift if the control may have any distance from the RPC: generic models are for orientation
#: errors of any size, 0.1 rad and more.
ANY_ORIENTATION = (1e5, 0.1)


def run(options: RefineAlgorithmOptions, context: Context) -> Report:
    """Refine every image from its GCPs and write the results; compare the models if requested."""
    models = select_models(options.refinement.model, options.coefficient_covariance)
    block_run = BlockRun(context, options.output, options.points)
    block_run.open_images(options.images)
    block_run.open_dem(options.dem)
    block_run.read()
    shift_px, drift = ANY_ORIENTATION if options.refinement.model.startswith("generic") else (None, None)
    block_run.check(AdjustOptions(sigma_shift_px=shift_px, sigma_drift=drift))
    if context.dry_run:
        return block_run.plan(together=False)
    block, refinements = block_run.block, list[Refinement]()
    with explain_failures(block_run.reasons):
        for index, image in enumerate(block.images):
            advance(context.stage(0.1, 0.3).progress, index / len(block.images), f"refining {image.id}")
            refinements.append(refine_image(image, select_control(block, index, Role.GCP), options.refinement, models))
    block_run.take_result(separate_result(block, refinements), "refine")
    # Entries of the report in addition to those of a block: model of each image, its choice, excluded GCPs
    block_run.entries |= {
        "iterations": max(found.estimate.iterations for found in refinements),
        "image_models": {
            found.image.id: {
                "model": found.model.name,
                "sigma0": found.estimate.sigma0,
                "choice": choice_entries(options.refinement.model, found.choice).get("model_choice"),
                "left_out": [suspect.id for suspect in found.left_out],
                "parameters": dict(zip(found.model.parameters, found.estimate.values.tolist(), strict=True)),
            }
            for found in refinements
        },
    }
    if options.compare:
        block_run.entries["models"] = _compare_models(block, refinements, models, context.stage(0.3, 0.6))
        block_run.clock.lap("compare")
    return block_run.write()


def _compare_models(
    block: Block, refinements: Sequence[Refinement], models: Mapping[str, RefinementModel], context: Context
) -> dict[str, Any]:
    """Return the figures of every model with the same control and check points."""
    table: dict[str, Any] = {}
    for done, (name, model) in enumerate(models.items()):
        advance(context.progress, done / len(models), f"model {name}")
        try:
            others = [
                Refinement(one.image, model, solve_refinement(model, one.image, one.control), one.control)
                for one in refinements
            ]
        except (InputError, SolveError) as error:
            table[name] = {"control": {}, "check": {}, "prediction_rmse_px": None, "note": str(error)}
            continue
        result = separate_result(block, others)
        # Error of predicting each GCP from the others
        left_out = np.concatenate([found.estimate.left_out_px for found in others])
        table[name] = {
            **control_and_check(result, compute_residuals(result)),
            "prediction_rmse_px": float(np.sqrt(np.mean(np.sum(left_out**2, axis=1)))),
            "note": "" if result.converged else "not converged",
        }
    return table


def summarise(report: Report) -> str:
    """Return a block's summary with the model of each image and the table of models.

    The table has check points if there are any, otherwise control points; its last column is the 2D error of each GCP
    predicted from the others.
    """
    lines = [
        f"{name}: {entry['model']}" + (f" ({entry['choice']['reason']})" if entry["choice"] else "")
        for name, entry in report["image_models"].items()
    ]
    lines.append("")
    if models := report.get("models"):
        role = "check" if any(entry["check"].get("points") for entry in models.values()) else "control"
        axes = "".join(f"{axis.replace('_', ' '):>{width}}" for axis, width in COLUMN_WIDTHS.items())
        lines.append(f"{f'model ({role} RMSE)':<24}{'points':>7}{axes}{'left out px':>13}")
        for name, entry in models.items():
            figures, predicted = entry[role], f"{format_digits(entry['prediction_rmse_px']):>13}"
            numbers = "".join(
                f"{format_digits(figures.get(f'rmse_{axis}')):>{width}}" for axis, width in COLUMN_WIDTHS.items()
            )
            lines.append(f"{name:<24}{figures.get('points', '-'):>7}{numbers}{predicted}  {entry['note']}".rstrip())
        lines.append("")
    return "\n".join([*lines, summarise_block(report)])

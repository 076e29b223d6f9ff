"""Adjusting what was measured so far: a snapshot in, cameras, residuals and suspicions out. Thread-safe."""

from __future__ import annotations

from collections.abc import Sequence

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.adjustment.solver import adjust
from ...hrsi_engine.block.block import Block, assemble
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.progress import Progress, silent, stage
from ...hrsi_engine.foundation.reasons import Reason
from ...hrsi_engine.plausibility import check_block
from ...hrsi_engine.results.figures import block_report
from ...hrsi_engine.results.outliers import is_outlier, measurement_statistic
from ...hrsi_engine.results.residuals import Residuals, residuals
from ...hrsi_engine.results.verdict import Evidence, Verdict, describe_reached, find_reasons
from ..block_steps.model_choice import choice_warnings
from ..block_steps.plausibility import explained_by
from .adjusted import Adjusted
from .session import PointSession
from .tables import ground_points, image_points


def block_of(session: PointSession) -> Block:
    """Return the session as a block; later edits do not change it. Raises `InputError` where nothing is measured."""
    measured = image_points(session)
    if not len(measured) and session.ties is None:
        raise InputError("no point is measured on any image: measure one first")
    tables = [measured] if session.ties is None else [measured, session.ties]
    return assemble(list(session.images.values()), [ground_points(session)], tables)


def adjust_block(block: Block, model: str, progress: Progress = silent) -> Adjusted:
    """Adjust a block with a model's name or a rule that chooses one; raises `SolveError`, `InputError`, `Cancelled`."""
    reasons = check_block(block)
    with explained_by(reasons):
        result = adjust(block, AdjustOptions(model=model), stage(progress, 0.1, 0.9))
    return shown(result, residuals(result), tuple(choice_warnings(result.choice)), reasons)


def shown(
    result: Adjustment,
    left: Residuals,
    warnings: tuple[str, ...] = (),
    reasons: Sequence[Reason] = (),
) -> Adjusted:
    """Return an adjustment in the form that the panel shows; ``reasons`` are what was found before it."""
    images = result.block.images
    refined = [result.model.refined_rpc(image, values) for image, values in zip(images, result.values, strict=True)]
    figures = block_report(result, left, refined)
    verdict = Verdict.of(describe_reached(figures), find_reasons(Evidence(result, left, refined), reasons))
    return Adjusted(
        model=result.model,
        corrections={image.id: result.values[index] for index, image in enumerate(result.block.images)},
        residual_px=_image_residuals(result, left),
        residual_m=_ground_residuals(result, left),
        image_suspicions=_suspicious_measurements(result, left),
        point_suspicions=_suspicious_points(result),
        verdict=verdict,
        check=figures["check"],
        warnings=(*warnings, *result.warnings),
        result=result,
        left=left,
    )


def _image_residuals(result: Adjustment, left: Residuals) -> dict[tuple[str, str], tuple[float, float]]:
    rows = result.block.measurements
    known = result.block.known[rows.point].nonzero()[0]
    return {_key(result, row): (float(left.measured_px[row, 0]), float(left.measured_px[row, 1])) for row in known}


def _ground_residuals(result: Adjustment, left: Residuals) -> dict[str, tuple[float, float, float]]:
    points = result.block.known.nonzero()[0]
    found = {}
    for index in points:
        east, north, up = left.ground_m[index].tolist()
        found[str(result.block.points.ids[index])] = (east, north, up)
    return found


def _suspicious_measurements(result: Adjustment, left: Residuals) -> dict[tuple[str, str], str]:
    """Return the measurements of known points that stand out, by the test that the report uses."""
    statistic = measurement_statistic(left)
    known = result.block.known[result.block.measurements.point]
    return {
        _key(result, row): f"{_key(result, row)[1]}: {statistic[row]:.1f} sigma off"
        for row in (known & is_outlier(statistic)).nonzero()[0]
    }


def _suspicious_points(result: Adjustment) -> dict[str, str]:
    """Return the GCPs that disagree with the others, by data snooping and by the choice of the model."""
    found = {name: finding.message for finding in result.findings for name in finding.concerned}
    for suspect in result.choice.suspects if result.choice else ():
        found.setdefault(suspect.id, f"{suspect.image}: {suspect.deviation_px:.1f} px from where the others put it")
    return found


def _key(result: Adjustment, row: int) -> tuple[str, str]:
    rows = result.block.measurements
    return str(result.block.points.ids[rows.point[row]]), result.block.images[rows.image[row]].id

"""Adjusting what was measured so far: a snapshot in, cameras, residuals and suspicions out. Thread-safe.

`adjust_block` does it from the beginning, with every test; `follow` goes on from there with what was edited since.
"""

from collections.abc import Collection, Sequence

import numpy as np

from ...hrsi_engine.adjustment.following import Follower
from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.adjustment.result import Adjustment, Decision
from ...hrsi_engine.block.assembly import assemble
from ...hrsi_engine.block.block import Block
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.progress import Progress, silent, stage
from ...hrsi_engine.foundation.reasons import Reason
from ...hrsi_engine.foundation.workers.threads import one_thread_calls
from ...hrsi_engine.plausibility import check_block
from ...hrsi_engine.results.figures import block_report
from ...hrsi_engine.results.outliers import is_outlier, measurement_statistic
from ...hrsi_engine.results.residuals import Residuals, compute_residuals
from ...hrsi_engine.results.verdict import Evidence, Verdict, find_reasons, summarise_accuracy
from ..block_steps.model_choice import choice_warnings
from ..block_steps.plausibility import explain_failures
from .adjusted import AdjustmentView, suspicion
from .followed import CurrentView, update_view
from .history import Key
from .session import PointSession
from .tables import ground_points, image_points


def follow(session: PointSession) -> CurrentView:
    """Return the block with the measurements of a session as they are now, at once; it must have been adjusted.

    Raises `SolveError` where what was edited leaves cameras undetermined.
    """
    if session.adjusted is None:
        raise InputError("the block is not adjusted yet: adjust it first")
    edited = session.list_edits()
    now = assemble(list(session.images.values()), [ground_points(session, edited)], [image_points(session, edited)])
    with one_thread_calls():  # a camera system is small: threads of BLAS would wait for one another three times as long
        return update_view(session.adjusted, edited, now)


def block_of(session: PointSession) -> Block:
    """Return the session as a block; later edits do not change it. Raises `InputError` where nothing is measured."""
    measured = image_points(session)
    if not len(measured) and session.ties is None:
        raise InputError("no point is measured on any image: measure one first")
    tables = [measured] if session.ties is None else [measured, session.ties]
    return assemble(list(session.images.values()), [ground_points(session)], tables)


def adjust_block(
    block: Block, model: str, progress: Progress = silent, listed: Collection[str] = frozenset()
) -> AdjustmentView:
    """Adjust a block with a model's name or a rule that chooses one; residuals are of known and of ``listed`` points.

    Raises `SolveError`, `InputError`, `Cancelled`.
    """
    reasons = check_block(block)
    with explain_failures(reasons):
        follower = Follower(block, AdjustOptions(model=model), stage(progress, 0.1, 0.9), listed)
    result = follower.result
    return show_adjustment(follower, compute_residuals(result), listed, tuple(choice_warnings(result.choice)), reasons)


def show_adjustment(
    follower: Follower, left: Residuals, listed: Collection[str] = frozenset(), warnings: tuple[str, ...] = (),
    reasons: Sequence[Reason] = (),
) -> AdjustmentView:  # fmt: skip
    """Return an adjustment in the form that the panel shows; ``reasons`` are what was found before it."""
    result, images = follower.result, follower.result.block.images
    names = result.block.points.ids
    rows = (result.block.known | np.isin(names, list(listed)))[result.block.measurements.point].nonzero()[0]
    refined = [
        result.model.compute_refined_rpc(image, values) for image, values in zip(images, result.values, strict=True)
    ]
    # GCPs that disagree with the others, by data snooping and by the choice of the model
    suspects = {name: finding.message for finding in result.findings for name in finding.concerned}
    for gcp in result.choice.suspects if result.choice else ():
        suspects.setdefault(gcp.id, f"{gcp.image}: {gcp.deviation_px:.1f} px from where the others put it")
    # Measurements that stand out, by the test that the report uses, and ties that were left out
    found = measurement_statistic(left)
    left_out = np.isnan(found) & (result.decision != int(Decision.KEPT))
    found = np.where(left_out, result.statistic, found)
    outlying = is_outlier(found[rows]) | left_out[rows]
    figures = block_report(result, left, refined)
    verdict = Verdict.create(summarise_accuracy(figures), find_reasons(Evidence(result, left, refined), reasons))
    key_of = {row: _key(result, row) for row in rows.tolist()}
    return AdjustmentView(
        model=result.model, corrections={image.id: result.values[index] for index, image in enumerate(images)},
        residual_px={key: (float(left.measured_px[row, 0]), float(left.measured_px[row, 1]))
                     for row, key in key_of.items()},
        residual_m={str(names[row]): tuple(left.ground_m[row].tolist()) for row in result.block.known.nonzero()[0]},
        image_suspicions={key_of[row]: suspicion(key_of[row][1], found[row]) for row in rows[outlying].tolist()},
        point_suspicions=suspects, verdict=verdict, check=figures["check"], warnings=(*warnings, *result.warnings),
        result=result, left=left, follower=follower, listed=listed,
    )  # fmt: skip


def _key(result: Adjustment, row: int) -> Key:
    rows = result.block.measurements
    return str(result.block.points.ids[rows.point[row]]), result.block.images[rows.image[row]].id

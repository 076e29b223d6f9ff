"""Adjustment of the present measurements: a block in, cameras, residuals and suspicions out. Thread-safe.

`adjust_block` adjusts from the beginning, with all tests; `follow` continues from its result with the points edited
since: between two adjustments, the panel shows residuals with cameras that follow every edit.
"""

from collections.abc import Collection, Iterator
from itertools import compress
from typing import Any

import numpy as np

from ...hrsi_engine.adjustment.following import BlockUpdater
from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.block.assembly import assemble
from ...hrsi_engine.block.block import Block
from ...hrsi_engine.block.points import Role
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.progress import Progress, silent, stage
from ...hrsi_engine.foundation.workers.threads import one_thread_calls
from ...hrsi_engine.refinement.model import RefinementModel
from ...hrsi_engine.results.outliers import find_outliers, is_outlier
from ...hrsi_engine.results.residuals import compute_statistic, ground_residuals_m, residuals_at_px
from ..block_steps.block_run import BlockRun
from ..block_steps.plausibility import explain_failures
from ..interface.declare import Context
from .adjusted import AdjustmentView, CurrentResiduals, CurrentView, describe_outlier, list_keys
from .files import ground_points, image_points
from .session import PointSession


def block_of(session: PointSession) -> Block:
    """Return the session as a block, independent of later edits. Raises `InputError` if nothing is measured."""
    tables = [image_points(session), *([] if session.ties is None else [session.ties])]
    if not len(tables[0]) and session.ties is None:
        raise InputError("no point is measured on any image: measure one first")
    return assemble(list(session.images.values()), [ground_points(session)], tables)


def adjust_block(
    block: Block, model: str, progress: Progress = silent, listed: Collection[str] = frozenset()
) -> AdjustmentView:
    """Adjust a block with a model, or a rule that chooses one; return residuals of known and of ``listed`` points.

    Raises `SolveError`, `InputError`, `Cancelled`.
    """
    block_run = BlockRun.of_block(block, Context(progress, lambda text: None))
    block_run.check(AdjustOptions(model=model))
    with explain_failures(block_run.reasons):
        follower = BlockUpdater(block_run.block, block_run.options, stage(progress, 0.1, 0.9), listed)
    block_run.take_result(follower.result)
    judged = block_run.judge()
    result, residuals = judged.adjustment, judged.residuals
    block, names = result.block, result.block.points.ids
    rows = (block.known | np.isin(names, list(listed)))[block.measurements.point].nonzero()[0]
    # GCPs that contradict the others, by data snooping and by the choice of the model
    suspects = {name: finding.message for finding in result.findings for name in finding.concerned}
    for gcp in result.choice.suspects if result.choice else ():
        suspects.setdefault(gcp.id, f"{gcp.image}: {gcp.deviation_px:.1f} px from where the others put it")
    statistics, outlying = find_outliers(result, residuals)
    keys = list_keys(block)
    return AdjustmentView(
        model=result.model,
        corrections={image.id: result.values[index] for index, image in enumerate(block.images)},
        residual_px={
            keys[row]: (float(residuals.measured_px[row, 0]), float(residuals.measured_px[row, 1]))
            for row in rows.tolist()
        },
        residual_m={str(names[row]): tuple(residuals.ground_m[row].tolist()) for row in block.known.nonzero()[0]},
        statistics={keys[row]: float(statistics[row]) for row in rows.tolist()},
        image_suspicions={
            keys[row]: describe_outlier(keys[row][1], statistics[row]) for row in rows[outlying[rows]].tolist()
        },
        point_suspicions=suspects,
        verdict=judged.verdict,
        check=judged.figures["check"],
        warnings=judged.warnings,
        unchecked_gcps=count_unchecked_gcps(result),
        result=result,
        left=residuals,
        follower=follower,
        listed=listed,
    )


def count_unchecked_gcps(result: Adjustment) -> int | None:
    """Return the number of GCPs if no residual can show an error of one, otherwise None.

    None can without a measured check point if there is one GCP, or if the measurements of all GCPs together have less
    than one redundant observation.
    """
    role, point = result.block.points.role, result.block.measurements.point
    rows = role[point] == Role.GCP
    gcps = len(np.unique(point[rows]))
    has_redundancy = gcps > 1 and np.nansum(result.redundancy_numbers[rows]) >= 1.0
    return None if has_redundancy or (role[point] == Role.CHECK).any() else gcps


def follow(session: PointSession) -> CurrentView:
    """Return the state with the present measurements of a session, which must have been adjusted.

    Raises `SolveError` if the edited measurements do not determine the cameras.
    """
    adjusted = session.adjusted
    if adjusted is None:
        raise InputError("the block is not adjusted yet: adjust it first")
    edited = session.list_edits()
    now = assemble(list(session.images.values()), [ground_points(session, edited)], [image_points(session, edited)])
    with one_thread_calls():  # a camera system is small: three times as fast without BLAS threads
        new = adjusted.follower.follow(edited, now)
        watched, model = adjusted.watched, adjusted.model
        own = adjusted.result.unit_sigma * now.measurements.sigma_px
        sigma_now = np.maximum(own[:, None], watched.typical_px[now.measurements.image])
        left, left_now = (
            residuals_at_px(block, model, new.values, np.where(block.known[:, None], block.points.ground, ground))
            for block, ground in ((watched.block, new.ground), (now, new.edited_ground))
        )
        keys_now = list_keys(now)
        others = ~np.isin(watched.block.points.ids, list(edited))[watched.block.measurements.point]
        lengths = compute_statistic(np.where(others[:, None], left, np.nan), watched.sigma_px)
        statistics = dict(zip(watched.keys, lengths.tolist(), strict=True))
        statistics |= dict(zip(keys_now, compute_statistic(left_now, sigma_now).tolist(), strict=True))
        outlying = compress(statistics, is_outlier(np.array(list(statistics.values()))))
        suspicions = {key: describe_outlier(key[1], statistics[key]) for key in outlying}
        residual_m = dict(_ground_residuals(watched.block, model, new.values, new.ground))
        residual_m |= dict(_ground_residuals(now, model, new.values, new.edited_ground))
    return CurrentView(
        model,
        {image.id: new.values[index] for index, image in enumerate(adjusted.result.block.images)},
        CurrentResiduals(watched, left, edited, dict(zip(keys_now, map(tuple, left_now.tolist()), strict=True))),
        residual_m,
        statistics,
        suspicions,
    )


def _ground_residuals(
    block: Block, model: RefinementModel, values: np.ndarray, ground: np.ndarray
) -> Iterator[tuple[str, Any]]:
    """Yield the id and the residual east, north, up (m) of each known point with a measurement."""
    left_m = ground_residuals_m(block, model, values, ground)
    shown = np.flatnonzero(block.known & (np.bincount(block.measurements.point, minlength=len(block.points)) > 0))
    yield from zip(block.points.ids[shown].tolist(), map(tuple, left_m[shown].tolist()), strict=True)

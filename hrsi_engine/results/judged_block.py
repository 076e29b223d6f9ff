"""An adjusted block with the judgement on it: residuals, refined RPCs, figures, warnings and verdict, each once."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass
from typing import Any

from ..adjustment.result import Adjustment
from ..foundation.reasons import Reason
from ..foundation.thresholds import EQUALITY
from ..foundation.workers.threads import one_thread_calls
from .figures import block_report, rejection_warnings
from .lineage import state_accuracy
from .residuals import Residuals, compute_residuals
from .verdict import Evidence, Verdict, describe_residual_fields, find_reasons, summarise_accuracy


@dataclass(frozen=True, eq=False)
class JudgedBlock:
    """An adjusted block with all that its verdict is based on.

    evidence : adjustment, residuals, refined RPCs and their systematic errors
    figures : the report's entries on the adjustment
    verdict : level and reasons; warnings : for the user, without those that a reason repeats
    """

    evidence: Evidence
    figures: dict[str, Any]
    verdict: Verdict
    warnings: tuple[str, ...]

    @property
    def adjustment(self) -> Adjustment:
        """The adjustment."""
        return self.evidence.result

    @property
    def residuals(self) -> Residuals:
        """Its residuals."""
        return self.evidence.left


def judge_block(
    adjustment: Adjustment,
    warnings: Sequence[str] = (),
    reasons: Sequence[Reason] = (),
    lap: Callable[[str], None] = lambda part: None,
) -> JudgedBlock:
    """Return an adjusted block with its residuals, refined RPCs, figures, warnings and verdict.

    warnings : those found before; reasons : those found in the inputs
    lap : called with the name of each finished part
    """
    images = adjustment.block.images
    # Cameras are refitted with small matrices, for which BLAS threads only cost time
    with one_thread_calls(), ThreadPoolExecutor(1) as pool:
        # Python fits RPCs while compiled loops intersect the points
        cameras = list(zip(images, adjustment.values, strict=True))
        rpcs = [pool.submit(copy_context().run, adjustment.model.compute_refined_rpc, *camera) for camera in cameras]
        residuals = compute_residuals(adjustment)
        refined = state_accuracy(adjustment, [rpc.result() for rpc in rpcs])
        lap("residuals")
        evidence = Evidence(adjustment, residuals, refined)
        summary = pool.submit(copy_context().run, block_report, adjustment, residuals, refined)
        found, figures = find_reasons(evidence, reasons), summary.result()
        verdict = Verdict.create(summarise_accuracy(figures), found)
        different_rpcs = [
            f"{image.id}: the refined RPC differs from its model by up to {new.fit_max_px:.3f} px"
            for image, new in zip(images, refined, strict=True)
            if new.fit_max_px > EQUALITY.file_px
        ]
        texts = [
            *warnings,
            *adjustment.warnings,
            *rejection_warnings(adjustment),
            *different_rpcs,
            *describe_residual_fields(evidence),
        ]
    messages = tuple(reason.message for reason in verdict.reasons)
    return JudgedBlock(evidence, figures, verdict, tuple(text for text in texts if not text.startswith(messages)))


def judge(result: Adjustment, input_reasons: Sequence[Reason] = ()) -> Verdict:
    """Return the verdict on an adjustment.

    Parameters
    ----------
    result : Adjustment
        A finished adjustment.
    input_reasons : sequence of Reason
        Reasons found before it (`plausibility.check_block`).

    Returns
    -------
    Verdict
        Level, sentence and reasons.
    """
    return judge_block(result, reasons=input_reasons).verdict

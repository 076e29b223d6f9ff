"""What an adjustment comes to, assembled once: residuals, refined RPCs, the report's entries and the verdict.

Writers take it from here and know nothing of one another: layers, record, page and RPC files each have their own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..adjustment.joint_prior import JointCameras
from ..adjustment.result import Adjustment
from ..block.block import Image
from ..drawing.block_figures import ReportFigures
from ..foundation.reasons import Level, Reason
from ..foundation.thresholds import threshold, thresholds
from ..foundation.workers.threads import one_thread_calls
from ..io.geopackage.layers import Layer
from ..refinement.model import RefitRPC
from . import statistics
from .accuracy_statement import state_accuracy_by_standards
from .block_record import make_record
from .drawings import Outline, report_figures
from .figures import block_report, rejection_warnings
from .image_facts import add_image_facts
from .layers import block_layers, residuals_epsg
from .lineage import state_accuracy
from .residuals import Residuals, compute_residuals
from .tables import thinning_warnings
from .verdict import Evidence, Verdict, describe_residual_fields, find_reasons, summarise_accuracy


@thresholds
class RPC_AGREEMENT:
    """When a refined RPC does not reproduce its model."""

    warned_px: float = threshold(0.01, "px", "largest difference of a refined RPC from its model without a warning")


@dataclass(frozen=True, eq=False)
class BlockResult:
    """A block's results before anything is written.

    left : residuals of the adjustment; refined : the refined RPCs, one an image
    report : entries of ``report.json``; what is written, and where, is entered by who writes it
    verdict : whether it is usable, and why not
    """

    adjustment: Adjustment
    left: Residuals
    refined: Sequence[RefitRPC]
    report: dict[str, Any]
    verdict: Verdict

    @property
    def images(self) -> Sequence[Image]:
        """The images with their RPCs as they were."""
        return self.adjustment.block.images

    @property
    def joint(self) -> JointCameras | None:
        """What is known of all cameras together; None where each was adjusted by itself."""
        return self.adjustment.joint

    @property
    def is_unusable(self) -> bool:
        """Whether no refined RPC should be written."""
        return self.verdict.level is Level.UNUSABLE

    @property
    def record(self) -> dict[str, Any]:
        """What ``block.json`` holds, for images that join the block later."""
        return make_record(self.adjustment)

    def make_layers(self, residual_crs: str) -> list[Layer]:
        """Return the layers of ``block.gpkg``, residuals in ``both``, ``wgs84`` or ``utm``."""
        return block_layers(self.adjustment, self.left, residual_crs)

    def draw_figures(self, outline: Outline | None = None) -> ReportFigures:
        """Return the figures of the page, drawn where the refined RPCs see the ground."""
        delivered = [replace(image, rpc=new.rpc) for image, new in zip(self.images, self.refined, strict=True)]
        return report_figures(self.adjustment, self.left, delivered, outline)


@one_thread_calls()  # cameras are refitted by small matrices, between which BLAS's other threads would spin
def assemble_result(
    adjustment: Adjustment, record: Mapping[str, Any], warnings: Sequence[str], reasons: Sequence[Reason],
    entries: Mapping[str, Any], lap: Callable[[str], None],
) -> BlockResult:  # fmt: skip
    """Return what an adjustment comes to.

    record : what the report says of the run: version, options, inputs
    warnings : those from before the adjustment; reasons : what was found in the inputs
    entries : what the report has besides a block's entries
    lap : called with the name of each part that is done
    """
    images, model = adjustment.block.images, adjustment.model
    left = compute_residuals(adjustment)
    cameras = zip(images, adjustment.values, strict=True)
    refined = state_accuracy(adjustment, [model.compute_refined_rpc(image, values) for image, values in cameras])
    lap("residuals")
    evidence = Evidence(adjustment, left, refined)
    beside_model = [
        f"{image.id}: the refined RPC differs from its model by up to {new.fit_max_px:.3f} px"
        for image, new in zip(images, refined, strict=True)
        if new.fit_max_px > RPC_AGREEMENT.warned_px
    ]
    report = {
        **record, "verdict": {}, "seconds": {},
        "crs": {**record["crs"], "residuals": f"EPSG:{residuals_epsg(adjustment)}"},
        **block_report(adjustment, left, refined),
        **statistics.statistic_entries(adjustment, left),
        "accuracy": state_accuracy_by_standards(adjustment, left),
        "warnings": [*warnings, *adjustment.warnings, *rejection_warnings(adjustment), *thinning_warnings(adjustment),
                     *beside_model, *describe_residual_fields(evidence)],
        **entries,
    }  # fmt: skip
    report = add_image_facts(report, adjustment, left, refined)
    verdict = Verdict.create(summarise_accuracy(report), find_reasons(evidence, reasons))
    report["verdict"] = verdict.entry()
    told = tuple(reason.message for reason in verdict.reasons)
    report["warnings"] = [text for text in report["warnings"] if not text.startswith(told)]
    lap("judge")
    return BlockResult(adjustment, left, refined, report, verdict)

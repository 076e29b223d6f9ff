"""All results of an adjustment, assembled once: residuals, refined RPCs, the report's entries and the verdict.

Writers take them from here and do not depend on one another: layers, record, page and RPC files each have their own.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..block.block import Image, Role
from ..block.jitter_curve import JitterCurve
from ..drawing.block_figures import draw_figures
from ..foundation.large_arrays import finite_rows
from ..foundation.reasons import Level
from ..foundation.thresholds import threshold, thresholds
from ..foundation.workers.threads import one_thread_calls
from ..io.geopackage.layers import Layer
from ..refinement.model import RefitRPC
from . import statistics
from .block_record import joint_arrays, make_record
from .drawings import Outline, report_figures
from .image_facts import add_image_facts
from .judged_block import JudgedBlock
from .layers import block_layers, residuals_epsg
from .line_profiles import describe_line_profiles
from .lineage import lineage_items
from .residuals import Residuals, rmse
from .stac import describe_item
from .tables import iterate_tables, select_rows, selection_warnings
from .verdict import Verdict

NSSDA_PLAN, NSSDA_HEIGHT = 2.4477, 1.9600  # 95 % limits in plan and height, in standard deviations


@thresholds
class ACCURACY_STATEMENT:
    """Numbers of check points and ratio of RMSEs in accuracy standards."""

    asprs_points: int = threshold(30, "points", "fewest check points of a test", "ASPRS 2024, edition 2")
    nssda_points: int = threshold(20, "points", "fewest check points of a test", "FGDC-STD-007.3-1998")
    nssda_ratio: float = threshold(
        0.6, "", "smallest ratio of the RMSEs in plan for which the circular error is defined", "FGDC-STD-007.3-1998"
    )


@dataclass(frozen=True, eq=False)
class BlockResult:
    """A block's results before anything is written.

    adjustment, residuals : of the block
    pairs : the images with their original RPCs, and the refined ones
    report : entries of ``report.json``; those on written files are added by the writers
    verdict : level (ok, doubtful, unusable) and its reasons
    lineage : metadata of the refined images, by name
    items : refined images as STAC items without their files, if they were requested
    layers : those of ``block.gpkg``
    tables : parts of complete tables by layer, if the layers contain a selection of the points
    """

    adjustment: Adjustment
    residuals: Residuals
    pairs: Sequence[tuple[Image, RefitRPC]]
    report: dict[str, Any]
    verdict: Verdict
    lineage: Mapping[str, str]
    items: Sequence[dict[str, Any]]
    layers: Sequence[Layer]
    tables: Mapping[str, Iterable[Mapping[str, np.ndarray]]]

    @property
    def is_unusable(self) -> bool:
        """True if no refined RPC should be written."""
        return self.verdict.level is Level.UNUSABLE

    @property
    def record(self) -> dict[str, Any]:
        """Contents of ``block.json``, for images that are added to the block later."""
        return make_record(self.adjustment)

    @property
    def cameras(self) -> dict[str, np.ndarray] | None:
        """The joint estimates of all cameras, as arrays by name; None if images were adjusted separately."""
        return None if self.adjustment.joint is None else joint_arrays(self.adjustment.joint)

    @property
    def jitter_curves(self) -> Mapping[str, JitterCurve] | None:
        """Curves of the removed jitter, by image id; None if it was not estimated."""
        return None if self.adjustment.jitter is None else self.adjustment.jitter.curves

    def draw(self, outline: Outline) -> dict[str, Any]:
        """Return the drawings of the page; ``outline`` finds target outlines."""
        delivered = [replace(image, rpc=new.rpc) for image, new in self.pairs]
        return draw_figures(report_figures(self.adjustment, self.residuals, delivered, outline))


def assemble_result(
    judged: JudgedBlock,
    record: Mapping[str, Any],
    entries: Mapping[str, Any],
    report_path: str = "",
    with_items: bool = False,
) -> BlockResult:
    """Return the results of an adjustment.

    record : the report's entries on the run: version, options, inputs
    entries : further entries of the report, other than those on the block
    report_path : later path of the report; with_items : True if images are described as STAC items
    """
    evidence, adjustment, residuals = judged.evidence, judged.adjustment, judged.residuals
    refined, selection = evidence.refined, select_rows(adjustment, residuals)
    images = adjustment.block.images
    with one_thread_calls():  # many small matrices, for which BLAS threads only cost time
        report = {
            **record,
            "verdict": judged.verdict.entry(),
            "seconds": {},
            "crs": {**record["crs"], "residuals": f"EPSG:{residuals_epsg(adjustment)}"},
            **judged.figures,
            **statistics.statistic_entries(adjustment, residuals),
            "accuracy": state_accuracy_by_standards(adjustment, residuals),
            "line_profiles": describe_line_profiles(images, evidence.profiles, evidence.waves),
            "warnings": [*judged.warnings, *selection_warnings(selection)],
            **entries,
        }
        report = add_image_facts(report, adjustment, residuals, refined)
        pairs = list(zip(images, refined, strict=True))
        delivered = [replace(image, rpc=new.rpc) for image, new in pairs]
        layers = block_layers(adjustment, residuals, delivered, selection)
    complete = {} if selection.is_complete else iterate_tables(adjustment, residuals, selection)
    lineage, folder = lineage_items(report, report_path), os.path.dirname(report_path)
    items = [describe_item(image, new, report, folder) for image, new in pairs] if with_items else []
    return BlockResult(adjustment, residuals, pairs, report, judged.verdict, lineage, items, layers, complete)


def state_accuracy_by_standards(result: Adjustment, left: Residuals) -> dict[str, Any] | None:
    """Return mean errors of the check points and the statements of NSSDA and ASPRS, m; None without check points.

    A figure is None if its coordinates were not surveyed. Means are survey - computed.

    * NSSDA (FGDC-STD-007.3-1998, appendix 3-A), at 95 % confidence: 2.4477 · (RMSE_east + RMSE_north) / 2, defined if
        the smaller of the two is at least 0.6 of the larger; 1.9600 · RMSE_height; 20 check points are required.
    * ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (version 2, 2024). The standard adds
      the survey error of the check points to the errors found at them, and requires 30 check points::

          RMSE_H = sqrt(RMSE_H1² + RMSE_H2²)      RMSE_H1 = sqrt(RMSE_east² + RMSE_north²)      RMSE_H2: of the survey
          RMSE_V = sqrt(RMSE_V1² + RMSE_V2²)      RMSE_3D = sqrt(RMSE_H² + RMSE_V²)
    """
    check = np.flatnonzero(result.block.points.role == Role.CHECK)
    error = left.ground_m[check]
    plan = finite_rows(error[:, :2])
    if not plan.any() and not np.isfinite(error[:, 2]).any():
        return None
    variance = result.block.points.survey_covariance_m2(check).diagonal(axis1=1, axis2=2)
    survey = np.sqrt(np.where(np.isfinite(error), variance, np.nan))
    east, north, height = (rmse(error[:, axis]) for axis in range(3))
    of_survey = [rmse(survey[:, axis]) for axis in range(3)]
    plan_m, survey_plan_m = _join(east, north), _join(*of_survey[:2])
    total_h, total_v = _join(plan_m, survey_plan_m), _join(height, of_survey[2])
    nssda_plan, ratio = None, ACCURACY_STATEMENT.nssda_ratio
    if east is not None and north is not None and min(east, north) >= ratio * max(east, north):
        nssda_plan = NSSDA_PLAN * 0.5 * (east + north)
    points = int(max(plan.sum(), np.isfinite(error[:, 2]).sum()))
    return {
        "points_in_plan": int(plan.sum()),
        "points_in_height": int(np.isfinite(error[:, 2]).sum()),
        **{
            f"mean_{name}_m": float(np.nanmean(values)) if np.isfinite(values).any() else None
            for name, values in zip(("east", "north", "height"), error.T, strict=True)
        },
        "asprs": {
            "rmse_h_m": total_h,
            "rmse_v_m": total_v,
            "rmse_3d_m": _join(total_h, total_v),
            "found_rmse_h_m": plan_m,
            "found_rmse_v_m": height,
            "survey_rmse_h_m": survey_plan_m,
            "survey_rmse_v_m": of_survey[2],
            "points_required": ACCURACY_STATEMENT.asprs_points,
            "enough_points": points >= ACCURACY_STATEMENT.asprs_points,
        },
        "nssda": {
            "horizontal_m": nssda_plan,
            "vertical_m": None if height is None else NSSDA_HEIGHT * height,
            "points_required": ACCURACY_STATEMENT.nssda_points,
            "enough_points": points >= ACCURACY_STATEMENT.nssda_points,
        },
    }


def _join(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else float(np.hypot(first, second))

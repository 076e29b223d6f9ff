"""The verdict: the worst level of all reasons, and the accuracy of the block in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import floor, log10
from typing import Any

from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.robust_scale import ROBUST
from ..lineage import add_untested_error
from . import connections, ground_truth, heights, jitter, solution
from .evidence import Evidence

#: Every check of a finished adjustment; reasons of one level are listed in this order.
CHECKS: tuple[Callable[[Evidence], Iterator[Reason]], ...] = (
    solution.find_divergence,
    solution.find_implausible_sigmas,
    solution.find_implausible_drifts,
    solution.find_refit_errors,
    ground_truth.find_check_misfit_in_images,
    ground_truth.find_control_outliers,
    ground_truth.find_check_point_errors,
    ground_truth.find_leave_one_out_errors,
    heights.find_conflicting_heights,
    heights.find_heights_off_rpcs,
    heights.find_height_scatter,
    heights.find_laser_canopy,
    heights.find_unused_laser,
    connections.find_ties_left_out,
    connections.find_unconnected_images,
    connections.find_untied_images,
    connections.find_parts_without_control,
    connections.find_undetermined_accuracy,
    jitter.find_jitter,
    jitter.find_remaining_jitter,
    ground_truth.find_deformed_survey,
    solution.find_missing_grids,
    solution.find_ballpark_operations,
    heights.find_surface_reasons,
)

#: Reasons that are consequences of any wrong points.
CONSEQUENCES = frozenset({
    "not-converged", "sigmas-implausible", "control-misfit", "control-outliers", "check-misfit",
    "ties-wrong", "not-determined", "drift-implausible", "sources-disagree",
    "survey-deformed", "surface-offset",
})  # fmt: skip
#: Reasons that are reduced to doubtful if check points agree. These cannot detect errors common to them and the GCPs: a
#: wrong datum, and a correction by it beyond any error of an RPC.
MISFITS = frozenset({"sigmas-implausible", "control-misfit", "control-outliers", "sources-disagree"})


@dataclass(frozen=True)
class Verdict:
    """Accuracy of a block, and the reasons that an operator has to examine.

    Parameters
    ----------
    sentence : str
        The accuracy, as text.
    reasons : tuple of Reason
        The worst first.
    """

    sentence: str
    reasons: tuple[Reason, ...] = ()

    @classmethod
    def create(cls, sentence: str, reasons: Iterable[Reason]) -> Verdict:
        """Return the verdict with its reasons in the order of their levels.

        Parameters
        ----------
        sentence : str
            The accuracy, as text.
        reasons : iterable of Reason
            In any order.

        Returns
        -------
        Verdict
            The verdict, with the worst reasons first.
        """
        return cls(sentence, tuple(sorted(reasons, key=lambda reason: -reason.level)))

    @property
    def level(self) -> Level:
        """The worst level of the reasons."""
        return max((reason.level for reason in self.reasons), default=Level.OK)

    def entry(self) -> dict[str, Any]:
        """Return the verdict's entry in reports.

        Returns
        -------
        dict
            ``level``, ``sentence`` and ``reasons``, ready for JSON.
        """
        return {
            "level": self.level.label,
            "sentence": self.sentence,
            "reasons": [
                asdict(reason)
                | {"level": reason.level.label, "images": list(reason.images), "points": list(reason.points)}
                for reason in self.reasons
            ],
        }


def find_reasons(evidence: Evidence, input_reasons: Sequence[Reason] = ()) -> list[Reason]:
    """Return all reasons against a block: those found before its adjustment, and those of the result.

    If the inputs are unusable, residuals and corrections are consequences: they are omitted. Wrong GCPs that the
    adjustment rejected, with correct other ones, make no block unusable; nor do misfits if check points agree.

    evidence : the adjustment, its residuals and refined RPCs
    input_reasons : reasons found in the inputs before the adjustment
    Result: empty if there is no reason.
    """
    result_reasons = [reason for check in CHECKS for reason in check(evidence)]
    if ground_truth.do_check_points_agree(evidence):
        result_reasons, input_reasons = (
            [
                replace(reason, level=min(reason.level, Level.DOUBTFUL)) if reason.code in MISFITS else reason
                for reason in reasons
            ]
            for reasons in (result_reasons, input_reasons)
        )
    if all(reason.level is not Level.UNUSABLE for reason in result_reasons):
        input_reasons = [
            replace(reason, level=min(reason.level, Level.DOUBTFUL))
            if reason.code == "control-outliers" and ground_truth.are_other_gcps_consistent(evidence, reason.points)
            else reason
            for reason in input_reasons
        ]
    if any(reason.level is Level.UNUSABLE for reason in input_reasons):
        result_reasons = [reason for reason in result_reasons if reason.code not in CONSEQUENCES]
    levels = {reason.code: reason.level for reason in result_reasons}
    # The adjustment tests every tie point: it confirms a suspicion from a sample, or not
    input_reasons = [
        reason
        for reason in input_reasons
        if reason.level > levels.get(reason.code, Level.OK)
        and (reason.code != "ties-wrong" or reason.level is Level.UNUSABLE)
    ]
    codes = {reason.code for reason in input_reasons}
    return [*input_reasons, *(reason for reason in result_reasons if reason.code not in codes)]


def summarise_accuracy(report: Mapping[str, Any]) -> str:
    """Return the accuracy of a block in one sentence, from the figures of its report.

    ``3 images, tie points 0.06 px RMSE; 10 GCPs, 61 check points: CE90 0.9 m (predicted 0.9), LE90 1.9 m (…)``
    """
    images, ties, check = len(report["images"]), report["ties"], report["check"]
    tied = ties["images"]
    text = f"{tied} of {images} images" if 0 < tied < images else _format_count(images, "image")
    text += f", tie points {format_figure(ties['rmse_px'])} px RMSE" if tied else ""
    gcps, weak = report["control"]["points"], report["control"].get("weak") or {}
    limits = "; ".join(f"{len(ids)} {subject}: {list_ids(ids)}" for subject, ids in weak.items() if ids)
    text += f"; {_format_count(gcps, 'GCP')}{f' ({limits})' if limits else ''}"
    text += f", {_format_count(check['points'], 'check point')}"
    accuracy = _describe_check_points(check) if check["points"] else _describe_prediction(report)
    untested = report.get("untested_by_check_points")
    if untested is not None:  # the error of coordinate operations common to check points
        with_it = {
            name: add_untested_error(check[key], untested, key) for name, key in ACCURACIES.items() if untested[key]
        }
        figures = ", ".join(f"{name} {format_figure(value)} m" for name, value in with_it.items() if value is not None)
        limit = "including the coordinate operation, which the check points cannot test"
        accuracy += f"; {limit}: {figures}" if figures else ""
    return f"{text}: {accuracy}" if accuracy else text


def _format_count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _describe_check_points(check: Mapping[str, Any]) -> str:
    """Return the accuracy by check points as text, with the prediction for their errors, survey errors among them.

    Without ground position it is the accuracy in the image.
    """
    if check["ce90_m"] is None:
        if check["rmse_sample_px"] is None:
            return ""
        sample, line = (format_figure(check[key]) for key in ("rmse_sample_px", "rmse_line_px"))
        return f"RMSE {sample} px in sample, {line} px in line"
    parts = []
    for name, key in ACCURACIES.items():
        value, expected = check[key], check["predicted"].get(key)
        if value is None:
            continue
        prediction = f" (predicted {format_figure(expected)})" if expected is not None else ""
        parts.append(f"{name} {format_figure(value)} m{prediction}")
    return ", ".join(parts)


def _describe_prediction(report: Mapping[str, Any]) -> str:
    """Return the predicted accuracy of the largest part of the block as text."""
    part = next(iter(report["parts"]), None)
    if part is None:
        return ""
    if part["ce90_m"] is None:
        return "CE90 is not determined by the observations"
    determined = [
        f"{name} {format_figure(part[key])} m"
        for name, key in ACCURACIES.items()
        if part[key] is not None and key not in part["undetermined"]
    ]
    texts = [f"predicted {', '.join(determined)}"] if determined else []
    texts += [f"not determined: {text}" for text in connections.describe_weak_figures(part["undetermined"], part)]
    of_gcps = " (by leave-one-out of the GCPs)" if part["leave_one_out"] > 1.0 else ""
    sources = [one["source"] for one in report["heights"] if one["left_out"] < one["observations"]]
    if len(sources) == 1 and (sigma_m := report.get("rpcs_height_sigma_m")):
        unseen_m = format_figure(ROBUST.outlier * sigma_m)
        texts.append(f"heights rest on the {sources[0]} alone: an error of its datum below {unseen_m} m does not show")
    surface = next(iter(report["surface"]), None)
    if surface is not None and surface["holds_plan"]:
        unseen_m = format_figure(ROBUST.outlier * surface["pointing_m"])
        texts.append(f"the plan rests on the relief alone: a displacement of it below {unseen_m} m does not show")
    return f"{'; '.join(texts)}{of_gcps}"


#: Accuracy measures: key of the report.
ACCURACIES = {"CE90": "ce90_m", "LE90": "le90_m"}


def format_figure(value: float | None) -> str:
    """Return a figure as text with two significant digits and at most two decimals."""
    if value is None:
        return "-"
    if value == 0.0:
        return "0"
    decimals = min(max(1 - floor(log10(abs(value))), 0), 2)
    return f"{value:.{decimals}f}"

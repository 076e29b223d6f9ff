"""Summary of an adjusted block: the lines on the terminal, and the messages on the choice of a model."""

from collections.abc import Mapping
from typing import Any

from ...hrsi_engine.foundation.errors import IDS_NAMED
from ...hrsi_engine.io.jitter_files import JITTER_FILE
from ...hrsi_engine.refinement.selection import ModelChoice
from ..interface.declare import Report, reason_lines

COLUMN_WIDTHS = {"east_m": 10, "north_m": 10, "height_m": 10, "sample_px": 11, "line_px": 9}  #: by key of the report


def summarise(report: Report) -> str:
    """Return the lines on convergence, control and check points, warnings and verdict."""
    redundancy = report["redundancy"]
    explained = f"redundancy {redundancy:.1f} (parameters with a priori sigmas count in part)"
    lines = [
        f"model {report['model']}, sigma0 {report['sigma0']:.3f}, {report['status']} after {report['iterations']} "
        f"iterations, {report['observations']} observations, {report['unknowns']} unknowns",
        *([explained] if redundancy != round(redundancy) else []),
        "",
        f"{'points':<16}{'number':>7}"
        + "".join(f"{axis.replace('_', ' '):>{width}}" for axis, width in COLUMN_WIDTHS.items()),
    ]
    for role in ("control", "check"):
        entry = report[role]
        numbers = "".join(f"{format_digits(entry[f'rmse_{axis}']):>{width}}" for axis, width in COLUMN_WIDTHS.items())
        lines.append(f"{role + ' (RMSE)':<16}{entry['points']:>7}{numbers}")
    check, ties, outliers = report["check"], report["ties"], report["outliers"]
    if check["ce90_m"] is not None:
        lines.append(
            f"check: {_format_accuracy(check)}; predicted, with their survey errors: "
            f"{_format_accuracy(check['predicted'])}"
        )
    by_rpcs = "" if report["heights"] else " (absolute accuracy from the error terms of the RPCs)"
    lines += [
        f"{part['image_count']} images, predicted for points measured in them, without survey errors: "
        f"{_format_accuracy(part)}{'' if part['gcps'] else by_rpcs}"
        for part in report["parts"][:IDS_NAMED]
        if part["ce90_m"] is not None
    ]
    if ties["points"]:
        lines.append(
            f"tie points: {ties['points']}, {ties['observations']} observations, RMSE "
            f"{format_digits(ties['before_rmse_px'])} px before, {format_digits(ties['rmse_px'])} px after"
        )
    lines += [
        f"{name}: jitter of {of['rms_sample_px']:.2f} and {of['rms_line_px']:.2f} px (sample, line; RMS) was removed, "
        f"known to {of['sigma_sample_px']:.2f} and {of['sigma_line_px']:.2f} px; the RPC does not have it, "
        f"{JITTER_FILE} does"
        for name, entry in report["images"].items()
        if (of := entry.get("jitter"))
    ]
    if (held := report["held_out"])["points"]:
        rmse, epipolar = (
            f"{format_digits(held[key])} px ({format_digits(held['ties'][key])} px)"
            for key in ("rmse_px", "epipolar_rmse_px")
        )
        of_all = f" (even sample of {held['tracks']})" if held["points"] + held["wrong"] < held["tracks"] else ""
        lines.append(
            f"held-out tie points: {held['points']}{of_all}, {held['observations']} observations, without "
            f"{held['wrong']} wrong matches, RMSE {rmse}, from epipolar lines {epipolar} "
            "(in brackets: tie points of the adjustment)"
        )
    lines += [f"outlier: {row['id']} on {row['image']}, {row['statistic']:.1f} sigma" for row in outliers[:IDS_NAMED]]
    if report["outlier_count"] > IDS_NAMED:
        lines.append(f"outliers: {report['outlier_count']} in all, see the report")
    lines += [f"warning: {text}" for text in report["warnings"]]
    return "\n".join([*lines, "", *verdict_lines(report["verdict"])])


def verdict_lines(verdict: Mapping[str, Any]) -> list[str]:
    """Return the reasons with their advice, the worst last, and after them the verdict in one sentence."""
    return [*reason_lines(verdict), f"{verdict['sentence']}. Verdict: {verdict['level']}"]


def _format_accuracy(figures: Mapping[str, Any]) -> str:
    return f"CE90 {format_digits(figures['ce90_m'])} m, LE90 {format_digits(figures['le90_m'])} m"


def format_digits(value: float | None) -> str:
    """Return a number with three decimals, a dash for None."""
    return "-" if value is None else f"{value:.3f}"


def choice_warnings(choice: ModelChoice | None) -> list[str]:
    """Return the warnings on a choice of model, and the GCPs that were excluded from it."""
    suspects = () if choice is None else choice.suspects
    return [
        *(() if choice is None else choice.warnings),
        *(
            f"{suspect.image}: GCP {suspect.id} contradicts the others by {suspect.deviation_px:.1f} px; the model was "
            "chosen without it"
            for suspect in suspects
        ),
    ]


def choice_entries(rule: str, choice: ModelChoice | None) -> dict[str, Any]:
    """Return the report's entry on a choice of model; empty if the user named the model."""
    if choice is None:
        return {}
    entry = {
        "rule": rule,
        "model": choice.model,
        "reason": choice.reason,
        "prediction_rmse_px": dict(choice.scores),
        "leave_one_out": {
            name: {"block_px": choice.delivered.get(name), "single_images_px": choice.scores.get(name)}
            for name in dict.fromkeys([*choice.delivered, *choice.scores])
        },
        "suspects": [suspect._asdict() for suspect in choice.suspects],
    }
    return {"model_choice": entry}

"""What a person reads on the terminal after a block was adjusted; the last line says what was reached."""

from collections.abc import Mapping
from typing import Any

from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ..interface.declare import Report

COLUMN_WIDTHS = {"east_m": 10, "north_m": 10, "height_m": 10, "sample_px": 11, "line_px": 9}  #: by key of the report


@thresholds
class SUMMARY:
    """How much the last lines on the terminal name."""

    most_outliers: int = threshold(5, "outliers", "outliers named")
    most_parts: int = threshold(3, "parts", "parts of a block named")


def summarise(report: Report) -> str:
    """Return how it went, control and check points, what to be careful with, and where the results lie."""
    lines = [
        f"model {report['model']}, sigma0 {report['sigma0']:.3f}, {report['status']} after {report['iterations']} "
        f"iterations, {report['observations']} observations, {report['unknowns']} unknowns",
        *_explain_redundancy(report["redundancy"]),
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
        lines.append(f"check: CE90 {format_digits(check['ce90_m'])} m, LE90 {format_digits(check['le90_m'])} m")
    if ties["points"]:
        lines.append(
            f"ties: {ties['points']} points, {ties['observations']} observations, "
            f"RMSE {format_digits(ties['before_rmse_px'])} px before, {format_digits(ties['rmse_px'])} px after"
        )
    if report["held_out"]["points"]:
        lines.append(_describe_held_out(report["held_out"]))
    lines += [
        f"{part['image_count']} images without GCPs: absolute accuracy by the RPCs' error terms CE90 "
        f"{format_digits(part['ce90_m'])} m, LE90 {format_digits(part['le90_m'])} m"
        for part in report["parts"][: SUMMARY.most_parts]
        if not part["gcps"] and part["ce90_m"] is not None
    ]
    lines += [
        f"outlier: {row['id']} on {row['image']}, {row['statistic']:.1f} sigma"
        for row in outliers[: SUMMARY.most_outliers]
    ]
    if report["outlier_count"] > SUMMARY.most_outliers:
        lines.append(f"outliers: {report['outlier_count']} in all, see the report")
    lines += [f"warning: {text}" for text in report["warnings"]]
    lines += ["", *(f"{what:<8}{path}" for what, path in report["outputs"].items()), ""]
    return "\n".join([*lines, *verdict_lines(report["verdict"])])


def _explain_redundancy(redundancy: float) -> list[str]:
    if redundancy == round(redundancy):
        return []
    return [f"redundancy {redundancy:.1f}: a parameter with a prior counts by the share that follows from observations"]


def verdict_lines(verdict: Mapping[str, Any]) -> list[str]:
    """Return the reasons with what to do about each, the worst last, and below them the verdict in one sentence."""
    lines = []
    for reason in reversed(verdict["reasons"]):
        lines += [f"{reason['level']}: {reason['message']} [{reason['code']}]", f"    {reason['advice']}"]
    return [*lines, f"{verdict['sentence']}. Verdict: {verdict['level']}"]


def _describe_held_out(entry: Report) -> str:
    """Return how held-out ties fit, and in brackets the same figures of as many that adjusted."""
    rmse, epipolar = (
        f"{format_digits(entry[key])} px ({format_digits(entry['ties'][key])} px)"
        for key in ("rmse_px", "epipolar_rmse_px")
    )
    return (
        f"held-out ties: {entry['points']} points, {entry['observations']} observations, {entry['wrong']} wrong "
        f"matches apart, RMSE {rmse}, from epipolar lines {epipolar} (in brackets: ties that adjusted)"
    )


def format_digits(value: float | None) -> str:
    """Return a figure with three digits, a dash where there is none."""
    return "-" if value is None else f"{value:.3f}"

"""The output directory of an algorithm: its planned content (for a dry run), and writing it."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...hrsi_engine.foundation.progress import advance, stage
from ...hrsi_engine.foundation.reasons import Level
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.output_dir import check_output_dir, exists_anywhere, stage_folder
from ...hrsi_engine.io.pages.report import write_page, write_report_json
from ..interface.declare import Context, Report
from ..interface.option_groups import OptionalFolder, ResultFolder

REPORT_FILE, PAGE_FILE = "report.json", "report.html"


@thresholds
class LENGTH:
    """Lengths of lists in logs, pages and summaries."""

    picture_px: int = threshold(640, "px", "longer side of a picture of an orthoimage")
    most_outliers: int = threshold(5, "outliers", "largest number of outliers in a summary")


#: Sentences of the verdict of a dry run without and with findings.
NOTHING_WRONG, INPUTS_CHECKED = "nothing wrong was found", "the inputs were checked"


def plan(
    context: Context, folder: str | None, names: Sequence[str], counts: Mapping[str, int], warnings: Sequence[str] = (),
    verdict: Mapping[str, Any] | None = None,
) -> Report:  # fmt: skip
    """Return the report of a dry run: files that would be written, counts, and the result of the checks.

    folder : the output directory; None if the result would only be printed
    names : files that would be written, in the folder or with their own paths
    counts : numbers of inputs, by their name in the plural; warnings : for the user
    verdict : of the checks of the inputs; by default that nothing was found
    """
    files = [os.path.join(folder or "", name) for name in names]
    tell(warnings, context)
    return {
        **context.record,
        "dry_run": True,
        "files": [{"path": file, "replaces": exists_anywhere(file)} for file in files],
        "counts": dict(counts),
        "warnings": list(warnings),
        "verdict": dict(verdict or {"level": Level.OK.label, "sentence": NOTHING_WRONG, "reasons": []}),
    }


def check_folder(options: ResultFolder | OptionalFolder, context: Context) -> None:
    """Raise `InputError` if the output directory of the options, if any, cannot take a result."""
    if options.output_dir:
        check_output_dir(options.output_dir, options.overwrite, inputs=context.inputs)


def plan_folder(
    options: ResultFolder | OptionalFolder, file: str, counts: Mapping[str, int], warnings: Sequence[str],
    context: Context, page: bool = False,
) -> Report:  # fmt: skip
    """Return the report of a dry run that would write a report, one more file and, with ``page``, a page."""
    names = [REPORT_FILE, file, *([PAGE_FILE] if page else [])] if options.output_dir else []
    return plan(context, options.output_dir, names, counts, warnings)


@contextmanager
def stage_results(options: ResultFolder, report: Report, context: Context, **settings: Any) -> Iterator[Path]:
    """Yield a temporary folder, whose files move into the output directory with the report; log the warnings.

    ``settings`` are further arguments of `stage_folder`.
    """
    with stage_folder(options.output_dir, context.inputs, options.overwrite, **settings) as folder:
        yield folder
        write_report_json(str(folder / REPORT_FILE), report)
    tell(report["warnings"], context)
    advance(context.progress, 1.0, "done")


def write_folder(
    options: ResultFolder | OptionalFolder, report: Report, file: str, layers: Sequence[Layer], context: Context,
    page: str = "", **pictures: Any,
) -> None:  # fmt: skip
    """Write ``report.json``, a GeoPackage of layers and a ``page`` (a template) into the output directory, if any."""
    if options.output_dir:
        with stage_folder(options.output_dir, context.inputs, options.overwrite) as folder:
            write_geopackage(str(folder / file), layers, progress=stage(context.progress, 0.9, 1.0))
            if page:
                write_page(str(folder / PAGE_FILE), page, report, **pictures)
            write_report_json(str(folder / REPORT_FILE), report)
    advance(context.progress, 1.0, "done")


def tell(warnings: Sequence[str], context: Context) -> None:
    """Log warnings."""
    for warning in warnings:
        context.log(f"warning: {warning}")

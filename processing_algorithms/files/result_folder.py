"""Results of the algorithms on single images and points: a report and a GeoPackage, where a folder is asked for."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...hrsi_engine.foundation.progress import advance, stage
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.output_dir import check_output_dir, stage_folder
from ...hrsi_engine.io.pages.page import write_page
from ...hrsi_engine.io.pages.report import write_report_json
from ..interface.declare import Context, Report
from ..interface.option_groups import OptionalFolder, ResultFolder
from .dry_run import PAGE_FILE, REPORT_FILE, plan


@thresholds
class PAGE_LENGTH:
    """How much pages show."""

    most_chips: int = threshold(200, "targets", "whose chips are shown")
    most_maps: int = threshold(12, "maps", "of shifts between orthoimages")


def check_folder(options: ResultFolder | OptionalFolder, context: Context) -> None:
    """Raise `InputError` where the output directory of the options, if any, cannot take a result."""
    if options.output_dir:
        check_output_dir(options.output_dir, options.overwrite, inputs=context.inputs)


def plan_folder(
    options: ResultFolder | OptionalFolder, file: str, counts: Mapping[str, int], warnings: Sequence[str],
    context: Context,
) -> Report:  # fmt: skip
    """Return the report of a dry run of what `write_folder` writes."""
    names = [REPORT_FILE, file] if options.output_dir else []
    return plan(context, options.output_dir, names, counts, warnings)


def plan_page(
    options: ResultFolder, file: str, page: bool, counts: Mapping[str, int], warnings: Sequence[str], context: Context
) -> Report:
    """Return the report of a dry run that would write a report, perhaps its page, and one more file."""
    names = [REPORT_FILE, file, *([PAGE_FILE] if page else [])]
    return plan(context, options.output_dir, names, counts, warnings)


def write_folder(
    options: ResultFolder | OptionalFolder, report: Report, file: str, layers: Sequence[Layer], context: Context,
    page: str = "", **pictures: Any,
) -> None:  # fmt: skip
    """Write ``report.json``, the layers' GeoPackage and a ``page`` (its template) into the output directory, if any."""
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

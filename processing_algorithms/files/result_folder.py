"""Results of the algorithms on single images and points: a report and a GeoPackage, where a folder is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..interface.declare import Context, Kind, Param, Report

if TYPE_CHECKING:
    from ...hrsi_engine.io.layers import Layer

OPTIONAL_OUTPUT_PARAMS = (
    Param(
        "output-dir", Kind.OUTPUT_DIR, "Directory for report and layers; without it the result is only printed",
        metavar="DIR",
    ),
    Param("overwrite", Kind.FLAG, "Replace the results of an earlier run in the output directory", default=False),
)  # fmt: skip


def check_folder(options: Mapping[str, Any]) -> None:
    """Raise `InputError` where the output directory of the options, if any, cannot take a result."""
    from ...hrsi_engine.io.output_dir import check_output_dir

    if options["output_dir"]:
        check_output_dir(options["output_dir"], options["overwrite"])


def write_folder(
    options: Mapping[str, Any], report: Report, file: str, layers: Sequence[Layer], inputs: list[str], context: Context
) -> None:
    """Write ``report.json`` and the layers' GeoPackage into the output directory of the options, if there is one."""
    from ...hrsi_engine.foundation.progress import advance, stage
    from ...hrsi_engine.io.layers import write_geopackage
    from ...hrsi_engine.io.output_dir import stage_folder
    from ...hrsi_engine.io.report import write_report_json

    if options["output_dir"]:
        with stage_folder(options["output_dir"], inputs) as folder:
            write_geopackage(str(folder / file), layers, progress=stage(context.progress, 0.9, 1.0))
            write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")


def tell(warnings: Sequence[str], context: Context) -> None:
    """Log warnings."""
    for warning in warnings:
        context.log(f"warning: {warning}")

"""Results of the algorithms on single images and points: a report and a GeoPackage, where a folder is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...hrsi_engine.foundation.options import option
from ..interface.declare import Context, Kind, Report, ResultFolder, made_options, params_of

if TYPE_CHECKING:
    from ...hrsi_engine.io.layers import Layer


@dataclass(frozen=True)
class OptionalFolder:
    """Where results go, if anywhere."""

    output_dir: str | None = option(
        None,
        "Directory for report and layers; without it the result is only printed",
        kind=Kind.OUTPUT_DIR,
        metavar="DIR",
    )
    overwrite: bool = option(False, "Replace the results of an earlier run in the output directory")


OPTIONAL_OUTPUT_PARAMS = params_of(OptionalFolder)


def folder_of(options: ResultFolder | OptionalFolder | Mapping[str, Any]) -> ResultFolder | OptionalFolder:
    """Return the folder of options."""
    return made_options(OptionalFolder, options) if isinstance(options, Mapping) else options


def check_folder(options: ResultFolder | OptionalFolder | Mapping[str, Any]) -> None:
    """Raise `InputError` where the output directory of the options, if any, cannot take a result."""
    from ...hrsi_engine.io.output_dir import check_output_dir

    folder = folder_of(options)
    if folder.output_dir:
        check_output_dir(folder.output_dir, folder.overwrite)


def write_folder(
    options: ResultFolder | OptionalFolder | Mapping[str, Any],
    report: Report,
    file: str,
    layers: Sequence[Layer],
    context: Context,
) -> None:
    """Write ``report.json`` and the layers' GeoPackage into the output directory of the options, if there is one."""
    from ...hrsi_engine.foundation.progress import advance, stage
    from ...hrsi_engine.io.layers import write_geopackage
    from ...hrsi_engine.io.output_dir import stage_folder
    from ...hrsi_engine.io.report import write_report_json

    target = folder_of(options)
    if target.output_dir:
        with stage_folder(target.output_dir, context.inputs, target.overwrite) as folder:
            write_geopackage(str(folder / file), layers, progress=stage(context.progress, 0.9, 1.0))
            write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")


def tell(warnings: Sequence[str], context: Context) -> None:
    """Log warnings."""
    for warning in warnings:
        context.log(f"warning: {warning}")

"""Projects: the algorithm that runs all steps of a project file."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import Common, report_option


@options(kw_only=True)
class RunOptions:
    """What `run` takes."""

    project: str = option(help="Project file (TOML), as hrsi init writes it", kind=Kind.PROJECT, metavar="PROJECT")
    steps: tuple[str, ...] | None = option(
        None, "Only these steps, of triangulate, orthorectify, ortho-check, evaluate", metavar="A,B,…"
    )
    output_dir: str | None = option(
        None, "Directory for the results, instead of the one that the project names", kind=Kind.OUTPUT_DIR,
        metavar="DIR",
    )  # fmt: skip
    overwrite: bool = option(False, "Do all steps again, and replace what else is in the output directory")
    report: bool = report_option("Write report.html, with a chapter for each step")
    common: Common = nest_options(Common)


RUN = Algorithm(
    name="run", title="Run project", group="Project",
    summary="All steps of a project: triangulate, orthorectify, check and evaluate, with one report",
    help=(
        "Takes images, points, DEM and the options of each step from a project file and runs the steps one after the "
        "other, each on the results of those before: refined RPCs, orthoimages, their misregistration, and how well "
        "the refined RPCs fit beside the original ones. One image with GCPs is refined by itself. Each step has a "
        "folder in the output directory, and the report a chapter.\n\n"
        "A run that was stopped goes on where it was. Of a finished one only those steps are done again whose inputs "
        "(by their SHA-256) or options have changed. hrsi init writes the project file from what a folder holds."
    ),
    options=RunOptions,
    module=f"{__name__.partition('.declarations.')[0]}.run_project",
    examples=("hrsi run block/project.toml --output-dir project",),
)  # fmt: skip

ALGORITHMS = (RUN,)

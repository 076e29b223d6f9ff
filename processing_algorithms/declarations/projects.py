"""Declaration of the algorithm that runs all steps of a project file."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import Common, report_option


@options(kw_only=True)
class RunOptions:
    """Options of `run`."""

    project: str = option(help="Project file (TOML)", kind=Kind.PROJECT, metavar="PROJECT")
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
        "Reads images, points, DEM and the options of each step from a project file and runs the steps in order: "
        "refined RPCs, orthoimages, their misregistration, evaluation of the RPCs. Each step has a folder in the "
        "output directory and a chapter of the report. One image is refined from its GCPs alone.\n\n"
        "A stopped run continues. After a finished run only steps with other inputs (by SHA-256) or options are "
        "repeated."
    ),
    options=RunOptions,
    module=f"{__name__.partition('.declarations.')[0]}.run_project",
    examples=("hrsi run block/project.toml --output-dir project",),
)  # fmt: skip

ALGORITHMS = (RUN,)

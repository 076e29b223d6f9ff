"""Declarations of the algorithms of projects: a project file from a folder, and the run of all its steps."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import report_option


@options(kw_only=True)
class InitOptions:
    """Options of `init`."""

    folder: str = option(
        ".", "Folder of images, points, DEM and other data, as delivered", kind=Kind.RESULT, metavar="FOLDER"
    )
    height_datum: str | None = option(
        None,
        "Answer to the question on heights without datum: ellipsoidal, egm96, egm2008 or the file of a geoid "
        "grid; by default evidence decides",
        metavar="DATUM",
    )
    output: str | None = option(
        None, "Project file to be written; by default project.toml in the folder", metavar="PROJECT.toml"
    )
    overwrite: bool = option(False, "Replace an existing project file")


INIT = Algorithm(
    name="init",
    title="New block from a folder",
    group="Project",
    summary="Project file for run from the images, points and DEM of a folder",
    help=(
        "Opens all files of a folder and decides what each is: image, RPC, control or check points, measurements, tie "
        "points, DEM, laser points, reference orthoimage. Prints a table of the files with the reasons, writes a "
        "project file with the steps that apply, and checks these steps as a run would. A height datum that nothing "
        "states is decided by heights of points and rays; otherwise one question is asked, which `height_datum` "
        "answers."
    ),
    options=InitOptions,
    examples=("hrsi init block --output block/project.toml --overwrite",),
)


@options(kw_only=True)
class RunOptions:
    """Options of `run`."""

    project: str = option(
        help="Project file (TOML), or the folder of project.toml", kind=Kind.PROJECT, metavar="PROJECT"
    )
    steps: tuple[str, ...] | None = option(
        None, "Only these steps, of triangulate, surface-model, orthorectify, ortho-check, evaluate", metavar="A,B,…"
    )
    output_dir: str | None = option(
        None, "Directory for the results, instead of the one that the project names", kind=Kind.OUTPUT_DIR
    )
    overwrite: bool = option(False, "Do all steps again, and replace what else is in the output directory")
    report: bool = report_option("Write report.html, with a chapter for each step")


RUN = Algorithm(
    name="run",
    title="Run project",
    group="Project",
    summary="All steps of a project: triangulate, surface model, orthorectify, check, evaluate",
    help=(
        "Reads images, points, DEM and the options of each step from a project file and runs the steps in order: "
        "refined RPCs, surface model, orthoimages, their misregistration, evaluation of the RPCs. Each step has a "
        "folder in the output directory and a chapter of the report. One image is refined from its GCPs alone.\n\n"
        "A stopped run continues. After a finished run only steps with other inputs (by SHA-256) or options are "
        "repeated."
    ),
    options=RunOptions,
    module=f"{__name__.partition('.declarations.')[0]}.run_project",
    examples=("hrsi run block/project.toml --output-dir project",),
)

ALGORITHMS = (INIT, RUN)

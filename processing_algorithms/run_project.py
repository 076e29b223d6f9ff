"""`run`: the steps of a project in order, each with the results of earlier steps, and one report of all steps.

A step is not repeated if its folder contains its files, and its options and the content of its inputs are unchanged:
both are in the digest that ``report.json`` stores for each step. A stopped run therefore continues, and after a change
of an option of orthoimages they are made again, but tie points are not.
"""

import os
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..hrsi_engine.foundation.errors import Cancelled, HrsiError, InputError
from ..hrsi_engine.foundation.version import VERSION
from ..hrsi_engine.foundation.workers.scheduling import digest
from ..hrsi_engine.io.catalogue.deliveries import resolve_images
from ..hrsi_engine.io.catalogue.lineage import input_entries
from ..hrsi_engine.io.output_dir import check_output_dir, find_image_outputs, read_report
from ..hrsi_engine.io.pages.report import name_crs_unit, write_page, write_report_json
from ..hrsi_engine.io.safety.transactions import only_writer
from . import REGISTRY
from .block_steps.summary import verdict_lines
from .declarations.orthoimages import SURFACE_FILE
from .declarations.projects import RunOptions
from .files.result_folder import PAGE_FILE, REPORT_FILE, plan
from .interface.declare import Context, Report, is_unusable, spell_arguments
from .interface.options import check_options
from .projects.project_file import (
    FAILED,
    FOLDERS,
    GROUND_OPTIONS,
    LEFT_OUT,
    NOT_ASKED,
    Project,
    algorithm_of,
    check_plan,
    failures,
    judge_plan,
    read_project,
)

KEPT, MADE = "kept", "done"  #: further statuses of a step
RPC_TEXT = "_rpc.txt"  #: ending of a refined RPC without pixels


def run(options: RunOptions, context: Context) -> Report:
    """Run the steps that have changed, and compile the report."""
    begun, project = time.monotonic(), read_project(options.project)
    if wrong := [step for step in options.steps or () if step not in FOLDERS]:
        raise InputError(f"`steps` names {wrong[0]!r}: the steps are {', '.join(FOLDERS)}")
    folder = options.output_dir or project.texts.get("output_dir") or os.path.join(project.folder, "result")
    images = resolve_images(project.shared["images"], lambda text: None)
    if context.dry_run:
        entries = check_plan(project, context, options.steps)
        names = [REPORT_FILE, *(FOLDERS[step] for step, entry in entries.items() if entry["status"] != LEFT_OUT)]
        warnings = [f"{step}: {text}" for step, entry in entries.items() for text in entry.get("warnings", ())]
        counts = {"images": len(images), "steps": len(names) - 1}
        return {**plan(context, folder, names, counts, warnings, judge_plan(entries)), "steps": entries}
    earlier = read_report(os.path.join(folder, REPORT_FILE)) or {}
    if earlier.get("algorithm") != "run":
        check_output_dir(folder, options.overwrite, [REPORT_FILE, *FOLDERS.values()], context.inputs)
        earlier = {}
    report: Report = {
        **context.record,
        "seconds": {},
        "document": dict(project.texts),
        "folder": folder,
        "steps": dict(earlier.get("steps") or {}),
        "warnings": [],
    }
    results: dict[str, Report] = {}
    with only_writer(folder if options.output_dir is None else None):
        write_report_json(os.path.join(folder, REPORT_FILE), report)  # a run stopped in its first step continues
        for number, step in enumerate(FOLDERS):
            part = context.stage(number / len(FOLDERS), (number + 1) / len(FOLDERS))
            _do_step(step, project, images, results=results, report=report, options=options, context=part)
            write_report_json(os.path.join(folder, REPORT_FILE), report)
        report["verdict"], report["seconds"] = judge_plan(report["steps"]), {"total": time.monotonic() - begun}
        if failed := failures(report["steps"]):
            report["unsolved"], report["exit_code"] = report["verdict"]["sentence"], max(failed.values())
        report["outputs"] = {"report": os.path.join(folder, REPORT_FILE)}
        if options.report:
            report["outputs"]["html"] = os.path.join(folder, PAGE_FILE)
            chapters = _read_chapters(report)
            maps = [f"#{one['step']}-map" for one in chapters if f'id="{one["step"]}-map"' in one["html"]]
            write_page(
                report["outputs"]["html"], "project.html.j2", report, chapters=chapters, map_link=(maps or [""])[0]
            )
        write_report_json(os.path.join(folder, REPORT_FILE), report)
    return report


def summarise(report: Report) -> str:
    """Return the status of each step, the reasons with their advice, and the verdict."""
    width = max(map(len, report["steps"]), default=0)
    lines = [f"{name:{width}}  {entry['status']}: {entry['told']}" for name, entry in report["steps"].items()]
    return "\n".join([*lines, *verdict_lines(report["verdict"])])


def _do_step(
    step: str,
    project: Project,
    images: tuple[str, ...],
    results: dict[str, Report],
    report: Report,
    options: RunOptions,
    context: Context,
) -> None:
    """Run a step, or keep its earlier result; its entry is added to ``report``, its own report to ``results``."""
    entries, folder = report["steps"], os.path.join(report["folder"], FOLDERS[step])
    algorithm, past = algorithm_of(step, images), read_report(os.path.join(folder, REPORT_FILE))

    def spell(text: str) -> str:  # options as the project file names them
        return spell_arguments(text, REGISTRY[algorithm].params, lambda param: param.key)

    before = entries.pop(step, {})
    entries[step] = {"status": LEFT_OUT, "told": project.skipped.get(step, NOT_ASKED)}
    if options.steps and step not in options.steps:
        if past and before.get("status") in (KEPT, MADE):  # what later steps need
            entries[step], results[step] = before, past
        return
    if step not in project.steps:
        return
    try:
        given, lacking = _chain_inputs(step, project, images, results, report["folder"])
        if lacking:
            failed = {"status": FAILED, "told": lacking, "exit_code": 2}
            entries[step] = failed if options.steps or failures(entries) else {"status": LEFT_OUT, "told": lacking}
            return
        found = {**project.options_of(step, algorithm), **given, "output_dir": folder}
        values = check_options(REGISTRY[algorithm], found)
        mark = _digest_step(project, algorithm, values, report["folder"])
        sizes = {one.name: one.stat().st_size for one in Path(folder).glob("*") if one.is_file()}
        there = before.get("files", {}).items() <= sizes.items()
        if past and there and before.get("digest") == mark and not options.overwrite:
            entries[step], results[step] = {**before, "status": KEPT}, past
            context.log(f"{step}: nothing has changed, kept")
            return
        context.log(f"{step}:")
        values["overwrite"] = past is not None and (past["algorithm"] == algorithm or options.overwrite)
        inner = Context(context.progress, lambda text: context.log(spell(text)))
        made = results[step] = REGISTRY[algorithm].execute(values, inner)
    except Cancelled:
        raise
    except HrsiError as error:
        told = spell(str(error))
        entries[step] = {"status": FAILED, "told": told, "exit_code": error.exit_code}
        context.log(f"{step}: {told}")
        return
    files = [path for path in sorted(Path(folder).iterdir()) if path.is_file() and not path.name.startswith(".")]
    entries[step] = {
        "status": MADE,
        "algorithm": algorithm,
        "digest": mark,
        "told": _tell_result(made),
        "verdict": made.get("verdict"),
        "files": {path.name: path.stat().st_size for path in files},
    }


def _digest_step(project: Project, algorithm: str, values: Mapping[str, Any], folder: str) -> str:
    """Return the digest of a step's options and the contents of its inputs: that of a copied project is the same."""
    places = [(os.path.abspath(folder), "RESULT"), (os.path.abspath(project.folder), "PROJECT")]

    def relocate(text: str) -> str:
        for place, name in places:
            text = text.replace(place, name)
        return text

    kept = {key: _absolute(value) for key, value in values.items() if key not in ("threads", "output_dir")}
    contents = [
        f"{relocate(os.path.abspath(one['path']))} {one['sha256'] or one['sampled_sha256']}"
        for one in input_entries(REGISTRY[algorithm].files_by_option(values))
        if os.path.basename(one["path"]) not in (REPORT_FILE, PAGE_FILE)
    ]
    options = sorted(f"{key} {relocate(str(value))}" for key, value in kept.items())
    return digest(VERSION, algorithm, options, sorted(contents))


def _absolute(value: Any) -> Any:
    """Return an option's value with absolute paths of the files that it names."""
    if isinstance(value, (list, tuple)):
        return [_absolute(one) for one in value]
    path, bar, rest = value.partition("|") if isinstance(value, str) else ("", "", "")
    return f"{os.path.abspath(path)}{bar}{rest}" if path and os.path.exists(path) else value


def _chain_inputs(
    step: str, project: Project, images: tuple[str, ...], results: Mapping[str, Report], folder: str
) -> tuple[dict[str, Any], str]:
    """Return the options of a step from earlier steps, and the reason if it cannot run, else an empty text."""
    if step == "triangulate":
        texts = {key: text for key, text in project.texts.items() if key != "output_dir" and len(images) > 1}
        return {"images": images, **texts}, ""
    block, refined = results.get("triangulate"), os.path.join(folder, FOLDERS["triangulate"])
    is_refined = "triangulate" in project.steps
    if is_refined and (not block or is_unusable(block)):
        return {}, "the refined RPCs are unusable" if block else "there are no refined RPCs"
    if step == "evaluate":
        return {"images": images, "rpcs": [f"refined={refined}"] if is_refined else []}, ""
    if step == "surface-model":
        return {"result": refined}, "" if is_refined and len(images) > 1 else "there is no adjusted block"
    if step == "orthorectify":
        given: dict[str, Any] = {"images": images}
        if block is not None and is_refined:
            made = find_image_outputs(block, refined).values()
            given = {"images": [one for one in made if not one.lower().endswith(RPC_TEXT)]}
        if not GROUND_OPTIONS & project.steps[step].keys() and "surface-model" in results:
            # Images match on the surface of their own block better than on any DEM
            surface = os.path.join(folder, FOLDERS["surface-model"], SURFACE_FILE)
            given |= {"dem": surface, "dem_datum": "layer", "terrain_points": refined}
        elif not GROUND_OPTIONS & {*project.shared, *project.steps[step]}:
            given["terrain_points"] = refined
        return given, ""
    orthoimages = results.get("orthorectify")
    found = find_image_outputs(orthoimages, os.path.join(folder, FOLDERS["orthorectify"])) if orthoimages else {}
    return {"images": [*found.values()]}, "" if len(found) > 1 else f"{len(found)} orthoimages: two are needed"


def _tell_result(report: Report) -> str:
    """Return the result of a step in one line."""
    if report.get("verdict"):
        return str(report["verdict"]["sentence"])
    if report["algorithm"] == "orthorectify":
        return (
            f"{len(report['images'])} orthoimages, {report['grid']['crs']}, pixels of {report['grid']['resolution']:g} "
            + name_crs_unit(report["grid"]["crs"])
        )
    if report["algorithm"] == "ortho-check":
        after = report["all"]["after"]
        return f"misregistration: median {after['median_px']:.2f} px, 90 % within {after['p90_px']:.2f} px"
    lines = REGISTRY[report["algorithm"]].summarise(report).strip().splitlines()
    return next((line for line in reversed(lines) if not line.startswith("warning: ")), "done")


def _read_chapters(report: Report) -> list[Report]:
    """Return the pages of all steps for one document: without scripts, and with ids that are unique."""
    chapters = []
    for step, entry in report["steps"].items():
        page = os.path.join(report["folder"], FOLDERS[step], PAGE_FILE)
        if PAGE_FILE not in entry.get("files", ()) or not os.path.isfile(page):
            continue
        main = re.search(r"<main[^>]*>(.*)</main>", Path(page).read_text(encoding="utf-8"), re.DOTALL)
        html = re.sub(r"<script.*?</script>", "", main[1] if main else "", flags=re.DOTALL)
        # The document has the verdict and the settings once; those of a step are on its own page
        html = re.sub(r'<section (?:class="verdict|id="lineage").*?</section>', "", html, flags=re.DOTALL)
        html = re.sub(r'<li><a href="#lineage">.*?</a></li>', "", html)
        names = re.compile(r'(\b(?:id|for|aria-labelledby|aria-controls|aria-describedby)="|href="#|url\(#)([\w-])')
        html = names.sub(rf"\g<1>{step}-\g<2>", html)
        chapters.append({"step": step, "link": f"{FOLDERS[step]}/{PAGE_FILE}", "html": html})
    return chapters

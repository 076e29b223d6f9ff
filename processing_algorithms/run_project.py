"""`run`: the steps of a project in order, each with the results of earlier steps, and one report of all steps.

A step is not repeated if its folder contains its files, and its options and the content of its inputs are unchanged:
both are in the digest that ``report.json`` stores for each step. A stopped run therefore continues, and after a change
of the DEM orthoimages are made again, but tie points are not.
"""

import os
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..hrsi_engine.foundation.errors import InputError, SolveError
from ..hrsi_engine.foundation.reasons import Level
from ..hrsi_engine.foundation.version import VERSION
from ..hrsi_engine.foundation.workers.scheduling import digest
from ..hrsi_engine.io.catalogue.deliveries import resolve_images
from ..hrsi_engine.io.catalogue.lineage import input_entries
from ..hrsi_engine.io.output_dir import check_output_dir, read_report
from ..hrsi_engine.io.pages.report import write_page, write_report_json
from ..hrsi_engine.io.safety.folder_lock import only_writer
from . import REGISTRY
from .declarations.projects import RunOptions
from .files.result_folder import PAGE_FILE, REPORT_FILE, plan
from .interface.declare import Context, Report, is_unusable
from .interface.options import check_options
from .projects.project_file import FOLDERS, SINGLE, Project, read_project

KEPT, MADE, FAILED, LEFT_OUT = "kept", "done", "failed", "left out"  #: status of a step
LEVELS = [level.label for level in sorted(Level)]


def run(options: RunOptions, context: Context) -> Report:
    """Run the steps that have changed, and compile the report."""
    begun, project = time.monotonic(), read_project(options.project)
    wrong = [step for step in options.steps or () if step not in FOLDERS]
    if wrong:
        raise InputError(f"`steps` names {wrong[0]!r}: the steps are {', '.join(FOLDERS)}")
    beside = os.path.join(os.path.dirname(project.path), "result")
    folder = options.output_dir or project.texts.get("output_dir") or beside
    images = resolve_images(project.shared["images"], lambda text: None)
    if context.dry_run:
        counts = {"images": len(images), "steps": len(project.steps)}
        return plan(context, folder, [REPORT_FILE, *(FOLDERS[step] for step in project.steps)], counts)
    earlier = read_report(os.path.join(folder, REPORT_FILE)) or {}
    if earlier.get("algorithm") != "run":
        check_output_dir(folder, options.overwrite, [REPORT_FILE, *FOLDERS.values()], context.inputs)
        earlier = {}
    report: Report = {
        **context.record, "seconds": {}, "document": dict(project.texts), "folder": folder,
        "steps": dict(earlier.get("steps") or {}), "warnings": [],
    }  # fmt: skip
    results: dict[str, Report] = {}
    with only_writer(folder if options.output_dir is None else None):
        for number, step in enumerate(FOLDERS):
            part = context.stage(number / len(FOLDERS), (number + 1) / len(FOLDERS))
            _do_step(step, project, images, results, report, options, part)
            write_report_json(os.path.join(folder, REPORT_FILE), report)  # a killed run continues from here
        # The worst verdict of the steps with all their reasons; a failed step is doubtful
        steps = report["steps"]
        judged = [entry["verdict"] for entry in steps.values() if entry.get("verdict")]
        failed = [f"{name} failed" for name, entry in steps.items() if entry["status"] == FAILED]
        levels = [*(verdict["level"] for verdict in judged), *[Level.DOUBTFUL.label] * len(failed)]
        told = [*(verdict["sentence"] for verdict in judged), *failed]
        verdict = {
            "level": max(levels, key=LEVELS.index, default=Level.OK.label),
            "sentence": "; ".join(told) or "nothing was judged",
            "reasons": [reason for verdict in judged for reason in verdict["reasons"]],
        }  # fmt: skip
        report["verdict"], report["seconds"] = verdict, {"total": time.monotonic() - begun}
        report["outputs"] = {"report": os.path.join(folder, REPORT_FILE)}
        if options.report:
            report["outputs"]["html"] = os.path.join(folder, PAGE_FILE)
            write_page(report["outputs"]["html"], "project.html.j2", report, chapters=_read_chapters(report))
        write_report_json(os.path.join(folder, REPORT_FILE), report)
    return report


def summarise(report: Report) -> str:
    """Return the status of each step, and the verdict."""
    width = max(map(len, report["steps"]), default=0)
    lines = [f"{name:{width}}  {entry['status']}: {entry['told']}" for name, entry in report["steps"].items()]
    return "\n".join([*lines, f"{report['verdict']['sentence']}. Verdict: {report['verdict']['level']}"])


def _do_step(
    step: str, project: Project, images: tuple[str, ...], results: dict[str, Report], report: Report,
    options: RunOptions, context: Context,
) -> None:  # fmt: skip
    """Run a step, or keep its earlier result; its entry is added to ``report``, its own report to ``results``."""
    entries, folder = report["steps"], os.path.join(report["folder"], FOLDERS[step])
    algorithm = SINGLE if step == "triangulate" and len(images) == 1 else step
    if step not in project.steps or step not in (options.steps or FOLDERS):
        entries[step] = {"status": LEFT_OUT, "told": "not asked for"}
        return
    given, lacking = _chain_inputs(step, project, images, results, report["folder"])
    if lacking:
        entries[step] = {"status": LEFT_OUT, "told": lacking}
        return
    values = check_options(REGISTRY[algorithm], {**project.options_of(step, algorithm), **given, "output_dir": folder})
    inputs = input_entries(REGISTRY[algorithm].files_by_option(values))
    contents = sorted(f"{one['path']} {one['sha256'] or one['sampled_sha256']}" for one in inputs)
    mark = digest(VERSION, algorithm, sorted(f"{key} {value}" for key, value in values.items() if key != "threads"),
                  contents)  # fmt: skip
    before, past = entries.pop(step, {}), read_report(os.path.join(folder, REPORT_FILE))
    there = all(
        os.path.isfile(path) and os.path.getsize(path) == size for path, size in before.get("files", {}).items()
    )
    if past and there and before.get("digest") == mark and not options.overwrite:
        entries[step], results[step] = {**before, "status": KEPT}, past
        context.log(f"{step}: nothing has changed, kept")
        return
    context.log(f"{step}:")
    values["overwrite"] = past is not None and (past["algorithm"] == algorithm or options.overwrite)
    try:
        made = results[step] = REGISTRY[algorithm].execute(values, Context(context.progress, context.log))
    except SolveError as error:
        entries[step] = {"status": FAILED, "told": str(error)}
        return
    files = [path for path in sorted(Path(folder).iterdir()) if path.is_file() and not path.name.startswith(".")]
    entries[step] = {
        "status": MADE, "algorithm": algorithm, "digest": mark, "told": _tell_result(made),
        "verdict": made.get("verdict"), "files": {str(path): path.stat().st_size for path in files},
    }  # fmt: skip


def _chain_inputs(
    step: str, project: Project, images: tuple[str, ...], results: Mapping[str, Report], folder: str
) -> tuple[dict[str, Any], str]:
    """Return the options of a step from earlier steps, and the reason if it cannot run, else an empty text."""
    if step == "triangulate":
        texts = {key: text for key, text in project.texts.items() if key != "output_dir" and len(images) > 1}
        return {"images": images, **texts}, ""
    block, refined = results.get("triangulate"), os.path.join(folder, FOLDERS["triangulate"])
    if not block or is_unusable(block):
        return {}, "the refined RPCs are unusable" if block else "there are no refined RPCs"
    if step == "evaluate":
        return {"images": images, "rpcs": [f"refined={refined}"]}, ""
    source = block if step == "orthorectify" else results.get("orthorectify", {"images": {}})
    given: dict[str, Any] = {"images": [entry["output"] for entry in source["images"].values()]}
    if step == "ortho-check":
        return given, "" if len(given["images"]) > 1 else f"{len(given['images'])} orthoimages: two are needed"
    if not {"dem", "height", "terrain_points"} & {*project.shared, *project.steps[step]}:
        given["terrain_points"] = refined
    return given, ""


def _tell_result(report: Report) -> str:
    """Return the result of a step in one line."""
    if report.get("verdict"):
        return str(report["verdict"]["sentence"])
    if "grid" in report:
        return (
            f"{len(report['images'])} orthoimages, {report['grid']['crs']}, pixels of {report['grid']['resolution']:g}"
        )
    if "pairs" in report:
        after = report["all"]["after"]
        return f"misregistration: median {after['median_px']:.2f} px, 90 % within {after['p90_px']:.2f} px"
    return REGISTRY[report["algorithm"]].summarise(report).strip().splitlines()[-1]


def _read_chapters(report: Report) -> list[Report]:
    """Return the pages of all steps for one document: without scripts, and with ids that are unique."""
    chapters = []
    for step, entry in report["steps"].items():
        page = os.path.join(report["folder"], FOLDERS[step], PAGE_FILE)
        if page not in entry.get("files", ()):
            continue
        main = re.search(r"<main[^>]*>(.*)</main>", Path(page).read_text(encoding="utf-8"), re.DOTALL)
        html = re.sub(r"<script.*?</script>", "", main[1] if main else "", flags=re.DOTALL)
        names = re.compile(r'(\b(?:id|for|aria-labelledby|aria-controls|aria-describedby)="|href="#|url\(#)([\w-])')
        html = names.sub(rf"\g<1>{step}-\g<2>", html)
        chapters.append({"step": step, "link": f"{FOLDERS[step]}/{PAGE_FILE}", "html": html})
    return chapters

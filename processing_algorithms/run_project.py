"""`run`: the steps of a project one after the other, each on the results of those before, and one report of all.

A step is kept where its folder has what it made, and its options and the content of its inputs are those of then: both
are in the digest that ``report.json`` keeps of each step. So a run that was stopped goes on, and a change of the DEM
makes orthoimages again and no tie points.
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

KEPT, DONE, FAILED, LEFT_OUT = "kept", "done", "failed", "left out"  #: what became of a step
LEVELS = [level.label for level in sorted(Level)]


def run(options: RunOptions, context: Context) -> Report:
    """Run what has changed, and put the report together."""
    begun, project = time.monotonic(), read_project(options.project)
    wrong = [step for step in options.steps or () if step not in FOLDERS]
    if wrong:
        raise InputError(f"`steps` names {wrong[0]!r}: the steps are {', '.join(FOLDERS)}")
    folder = options.output_dir or project.texts.get("output_dir") or os.path.join(
        os.path.dirname(project.path), "result"
    )  # fmt: skip
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
    chain = _Chain(project, images, folder, options, context, report)
    with only_writer(folder if options.output_dir is None else None):
        for number, step in enumerate(FOLDERS):
            chain.do_step(step, context.stage(number / len(FOLDERS), (number + 1) / len(FOLDERS)))
            write_report_json(os.path.join(folder, REPORT_FILE), report)  # a run that is killed goes on from here
        report["verdict"], report["seconds"] = _judge_steps(report["steps"]), {"total": time.monotonic() - begun}
        report["outputs"] = {"report": os.path.join(folder, REPORT_FILE)}
        if options.report:
            report["outputs"]["html"] = os.path.join(folder, PAGE_FILE)
            write_page(report["outputs"]["html"], "project.html.j2", report, chapters=_read_chapters(report))
        write_report_json(os.path.join(folder, REPORT_FILE), report)
    return report


def summarise(report: Report) -> str:
    """Return what became of each step, and the verdict."""
    width = max(map(len, report["steps"]), default=0)
    lines = [f"{name:{width}}  {entry['status']}: {entry['told']}" for name, entry in report["steps"].items()]
    return "\n".join([*lines, f"{report['verdict']['sentence']}. Verdict: {report['verdict']['level']}"])


class _Chain:
    """The steps of a project with what they hand to one another; ``report`` gets an entry of each."""

    def __init__(
        self, project: Project, images: tuple[str, ...], folder: str, options: RunOptions, context: Context,
        report: Report,
    ) -> None:  # fmt: skip
        self.project, self.images, self.folder, self.options, self.report = project, images, folder, options, report
        self.results: dict[str, Report] = {}  #: reports of steps by name

    def do_step(self, step: str, context: Context) -> None:
        """Do a step, or keep what it made earlier; note what became of it."""
        entries, algorithm = self.report["steps"], step
        if step == "triangulate" and len(self.images) == 1:
            algorithm = SINGLE
        lacking = self._find_lack(step)
        if lacking:
            entries[step] = {"status": LEFT_OUT, "told": lacking}
            return
        given = {**self._inputs_of(step), "output_dir": os.path.join(self.folder, FOLDERS[step])}
        options = check_options(REGISTRY[algorithm], {**self.project.options_of(step, algorithm), **given})
        inputs = input_entries(REGISTRY[algorithm].files_by_option(options))
        contents = sorted(str((one["path"], one["sha256"] or one["sampled_sha256"])) for one in inputs)
        told = {key: value for key, value in options.items() if key not in ("threads", "overwrite")}
        mark = digest(VERSION, algorithm, sorted(map(repr, told.items())), contents)
        before = entries.get(step) or {}
        past = read_report(os.path.join(given["output_dir"], REPORT_FILE))
        if past and before.get("digest") == mark and not self.options.overwrite and _are_there(before["files"]):
            entries[step], self.results[step] = {**before, "status": KEPT}, past
            context.log(f"{step}: nothing has changed, kept")
            return
        context.log(f"{step}:")
        entries.pop(step, None)
        started = time.monotonic()
        try:
            own = bool(past) and (past["algorithm"] == algorithm or self.options.overwrite)
            made = REGISTRY[algorithm].execute({**options, "overwrite": own}, Context(context.progress, context.log))
        except SolveError as error:
            entries[step] = {"status": FAILED, "told": str(error), "algorithm": algorithm}
            return
        self.results[step] = made
        entries[step] = {
            "status": DONE, "algorithm": algorithm, "digest": mark, "verdict": made.get("verdict"),
            "told": _tell_result(made),
            "files": {str(path): path.stat().st_size for path in sorted(Path(given["output_dir"]).iterdir())
                      if path.is_file() and not path.name.startswith(".")},
            "seconds": time.monotonic() - started,
        }  # fmt: skip

    def _find_lack(self, step: str) -> str:
        """Return why a step cannot be done or is not asked for; empty where it can."""
        if step not in self.project.steps or step not in (self.options.steps or FOLDERS):
            return "not asked for"
        if step == "triangulate":
            return ""
        if not (block := self.results.get("triangulate")) or is_unusable(block):
            return "there are no refined RPCs" if block is None else "the refined RPCs are unusable"
        count = len(self.results.get("orthorectify", {}).get("images", ()))
        return f"{count} orthoimages: two are needed" if step == "ortho-check" and count < 2 else ""

    def _inputs_of(self, step: str) -> dict[str, Any]:
        """Return the options that earlier steps give."""
        if step == "triangulate":
            known = {param.key for param in REGISTRY[step].params}
            texts = {key: text for key, text in self.project.texts.items() if key in known and key != "output_dir"}
            return {"images": self.images, **({} if len(self.images) == 1 else texts)}
        folder = os.path.join(self.folder, FOLDERS["triangulate"])
        if step == "evaluate":
            return {"images": self.images, "rpcs": [f"refined={folder}"]}
        source = "triangulate" if step == "orthorectify" else "orthorectify"
        found: dict[str, Any] = {"images": [entry["output"] for entry in self.results[source]["images"].values()]}
        own = {**self.project.shared, **self.project.steps[step]}
        if step == "orthorectify" and not {"dem", "height", "terrain_points"} & {key for key in own if own[key]}:
            found["terrain_points"] = folder
        return found


def _tell_result(report: Report) -> str:
    """Return what a step found, on one line."""
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


def _are_there(files: Mapping[str, int]) -> bool:
    return all(os.path.isfile(path) and os.path.getsize(path) == size for path, size in files.items())


def _judge_steps(steps: Mapping[str, Report]) -> Report:
    """Return the worst verdict of the steps with all their reasons; a step that failed is doubtful."""
    judged = [entry["verdict"] for entry in steps.values() if entry.get("verdict")]
    levels = [verdict["level"] for verdict in judged]
    failed = [name for name, entry in steps.items() if entry["status"] == FAILED]
    levels += [Level.DOUBTFUL.label] * bool(failed)
    told = [verdict["sentence"] for verdict in judged] + [f"{', '.join(failed)} failed"] * bool(failed)
    return {
        "level": max(levels, key=LEVELS.index, default=Level.OK.label),
        "sentence": "; ".join(told) or "nothing was judged",
        "reasons": [reason for verdict in judged for reason in verdict["reasons"]],
    }  # fmt: skip


def _read_chapters(report: Report) -> list[Report]:
    """Return the content of the page of each step, its ids made its own, for one document without scripts."""
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

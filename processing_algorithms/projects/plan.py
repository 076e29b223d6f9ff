"""The plan of a project: which steps run with which options, and its check by the steps' own rules, without results."""

import os
import tempfile
from collections.abc import Iterator, Mapping
from typing import Any

from ...hrsi_engine.foundation.errors import HrsiError
from ...hrsi_engine.foundation.reasons import Level
from ...hrsi_engine.io.catalogue.deliveries import resolve_images
from ...hrsi_engine.io.rasters.images import open_image
from .. import REGISTRY
from ..files.result_folder import INPUTS_CHECKED, NOTHING_WRONG
from ..interface.declare import Context, Report
from ..interface.options import check_options
from .project_file import FOLDERS, GROUND_OPTIONS, SINGLE, Project

PLANNED, FAILED, LEFT_OUT = "planned", "failed", "left out"
NOT_ASKED = "not asked for"
LEVELS = [level.label for level in sorted(Level)]


def algorithm_of(step: str, images: tuple[str, ...]) -> str:
    """Return the algorithm of a step: one image is refined alone."""
    return SINGLE if step == "triangulate" and len(images) == 1 else step


def check_plan(project: Project, context: Context, steps: tuple[str, ...] | None = None) -> dict[str, Report]:
    """Return status, text and verdict of each step by its own dry run, with the delivered images for results."""
    images = resolve_images(project.shared["images"], lambda text: None)
    entries: dict[str, Report] = {}
    with tempfile.TemporaryDirectory(prefix="hrsi-plan-") as folder:
        for step in FOLDERS:
            if step not in project.steps or step not in (steps or FOLDERS):
                entries[step] = {"status": LEFT_OUT, "told": project.skipped.get(step, NOT_ASKED)}
            elif step == "surface-model":  # of the block that the run adjusts
                entries[step] = {"status": PLANNED, "told": f"surface of up to {len(images)} images"}
            elif step == "ortho-check":  # its inputs are made by the run
                entries[step] = {"status": PLANNED, "told": f"up to {len(images)} orthoimages"}
            else:
                entries[step] = _check_step(step, project, images, os.path.join(folder, step), context)
    return entries


def _check_step(step: str, project: Project, images: tuple[str, ...], folder: str, context: Context) -> Report:
    name = algorithm_of(step, images)
    given: dict[str, Any] = {"images": images, "output_dir": folder}
    options = {**project.options_of(step, name), **given}
    without_terrain = step == "orthorectify" and not GROUND_OPTIONS & options.keys()
    if without_terrain:  # points that are not adjusted yet
        options["height"] = open_image(images[0]).middle_height_m
    try:
        report = REGISTRY[name].execute(
            check_options(REGISTRY[name], options), Context(context.progress, lambda text: None, dry_run=True)
        )
    except HrsiError as error:
        return {"status": FAILED, "algorithm": name, "told": str(error), "exit_code": error.exit_code}
    counts = ", ".join(f"{count} {what}" for what, count in report["counts"].items())
    return {"status": PLANNED, "algorithm": name, "told": counts, "verdict": report["verdict"],
            "warnings": [] if without_terrain else report["warnings"]}  # fmt: skip


def judge_plan(entries: Mapping[str, Report]) -> Report:
    """Return the worst verdict of some steps with all their reasons; a failed step is a failure."""
    judged = [entry["verdict"] for entry in entries.values() if entry.get("verdict")]
    failed = [f"{name} failed: {entry['told']}" for name, entry in entries.items() if entry["status"] == FAILED]
    levels = [*(verdict["level"] for verdict in judged), *([Level.UNUSABLE.label] if failed else [])]
    level = max(levels, key=LEVELS.index, default=Level.DOUBTFUL.label)
    reasons = [reason for verdict in judged for reason in verdict["reasons"]]
    sentences = dict.fromkeys([*failed, *(_summarise(verdict) for verdict in judged)])
    if len(sentences) > 1:
        sentences.pop(NOTHING_WRONG, None)
    return {"level": level, "sentence": "; ".join(sentences) or "no step was judged", "reasons": reasons}


def _summarise(verdict: Report) -> str:
    """Return the sentence of a verdict; of a check of inputs, the worst of what it found."""
    if verdict["sentence"] == INPUTS_CHECKED and verdict["reasons"]:
        return str(verdict["reasons"][0]["message"])
    return str(verdict["sentence"])


def failures(entries: Mapping[str, Report]) -> Iterator[tuple[str, int]]:
    """Yield name and exit code of the failed steps."""
    for name, entry in entries.items():
        if entry["status"] == FAILED:
            yield name, int(entry.get("exit_code", 1))

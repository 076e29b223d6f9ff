"""A project file (TOML): its texts, the inputs that its steps share, and a table of options for each step.

The options are those of the algorithms, whose declarations check them and describe them to editors. Relative paths
refer to the folder of the file.

The plan of a project: which steps run with which options, and its check by the steps' own rules, without results.
"""

import os
import re
import tempfile
import tomllib
from collections.abc import Mapping
from typing import Any, NamedTuple

from ...hrsi_engine.foundation.errors import HrsiError, InputError
from ...hrsi_engine.foundation.reasons import Level
from ...hrsi_engine.io.catalogue.deliveries import resolve_images
from ...hrsi_engine.io.opening.files import require_size
from ...hrsi_engine.io.rasters.images import open_image
from .. import REGISTRY
from ..files.result_folder import INPUTS_CHECKED, NOTHING_WRONG
from ..interface.declare import READ_KINDS, Context, Kind, Param, Report
from ..interface.options import check_options, suggestion

#: Steps in their order, and the folder of each in the output directory.
FOLDERS = {
    "triangulate": "triangulated",
    "surface-model": "surface",
    "orthorectify": "orthoimages",
    "ortho-check": "check",
    "evaluate": "evaluation",
}
SINGLE = "refine-rpc"  #: replaces `triangulate` if there is one image
TEXTS = {
    "title": "Title of the report",
    "client": "Who the report is for",
    "place": "Where the images were taken",
    "output_dir": "Directory for the results",
}
SHARED = (
    "images", "gcps", "image_points", "gcp_ids", "check_ids", "ground_crs", "height_datum", "gcp_epoch", "dem",
    "dem_datum",
)  # fmt: skip
ONLY_ASKED = ("surface-model",)  #: steps that run only if the file has their table
GROUND_OPTIONS = frozenset({"dem", "height", "terrain_points"})  #: options that define the ground of orthoimages
#: Steps whose inputs are made by the run, and the text on them in its plan.
MADE_INPUTS = {"surface-model": "surface of up to {} images", "ortho-check": "up to {} orthoimages"}
SKIP = "skip"  #: a step with this key set, to true or to the reason, is not run


ASK = "ask"  #: value of a height datum that the user must set
PROJECT_FILE = "project.toml"


class Project(NamedTuple):
    """Texts for the report, inputs by option key, options of each step that is run, and reasons of the others."""

    path: str
    texts: Mapping[str, str]
    shared: Mapping[str, Any]
    steps: Mapping[str, Mapping[str, Any]]
    skipped: Mapping[str, str]

    @property
    def folder(self) -> str:
        """Folder of the file, to which its paths refer."""
        return os.path.dirname(self.path)

    def options_of(self, step: str, algorithm: str) -> dict[str, Any]:
        """Return the options of a step for an algorithm: its own, and the shared options that the algorithm has."""
        known = REGISTRY[algorithm].defaults()
        return {**{key: value for key, value in self.shared.items() if key in known}, **self.steps[step]}


def read_project(path: str, answer: str = "") -> Project:
    """Return the project of a file, or of a folder with one; raise `InputError` with the key of an invalid entry.

    ``answer`` is the height datum where the file leaves it to the user.
    """
    if os.path.isdir(path):
        folder, path = path, os.path.join(path, PROJECT_FILE)
        if not os.path.exists(path):
            raise InputError(f"{folder} has no {PROJECT_FILE}: make it with `hrsi init {folder}`")
    require_size(path, "names")
    try:
        with open(path, "rb") as file:
            content = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as a project file ({error}): correct it") from None
    known = [*TEXTS, *SHARED, *FOLDERS]
    if unknown := [key for key in content if key not in known]:
        near = suggestion(unknown[0], known)
        raise InputError(f"{path}: has no place for {unknown[0]!r}{near}: it has {', '.join(known)}")
    if not content.get("images"):
        raise InputError(f'{path}: names no images: add images = ["folder"]')
    asked = [key for key in SHARED if content.get(key) == ASK]
    content |= dict.fromkeys(asked, answer)
    if asked and not answer:
        raise InputError(
            f"{path}: do the heights refer to the ellipsoid or to the geoid (sea level)? Set {' and '.join(asked)} = "
            '"ellipsoidal" or "egm2008"'
        )
    texts = {key: str(content[key]) for key in TEXTS if content.get(key)}
    if "output_dir" in texts:
        texts["output_dir"] = os.path.join(os.path.dirname(path), texts["output_dir"])
    shared = _place_options(path, "triangulate", {key: content[key] for key in SHARED if key in content})
    tables = {name: content.get(name, {SKIP: True} if name in ONLY_ASKED else {}) for name in FOLDERS}
    if wrong := [name for name, table in tables.items() if not isinstance(table, dict)]:
        raise InputError(f"{path}: {wrong[0]} is no table: write [{wrong[0]}] above its options")
    skips = {name: table.pop(SKIP, False) for name, table in tables.items()}
    steps = {name: _place_options(path, name, table) for name, table in tables.items() if not skips[name]}
    skipped = {name: reason for name, reason in skips.items() if isinstance(reason, str) and reason}
    return Project(path, texts, shared, steps, skipped)


def _place_options(path: str, step: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by key, with file names that are valid in the working directory."""
    found, names = {}, [step, SINGLE] if step == "triangulate" else [step]
    params = {param.key: param for name in reversed(names) for param in REGISTRY[name].params}
    for name, value in table.items():
        key = name.replace("-", "_")
        if key not in params:
            raise InputError(f"{path}: [{step}] has no option {name}{suggestion(key, params)}; see hrsi help {step}")
        found[key] = _place_value(os.path.dirname(path), params[key], value)
    return found


def _place_value(folder: str, param: Param, value: Any) -> Any:
    """Return an option's value with file names that are valid in the working directory."""
    if param.kind is Kind.IMAGES:
        return [_place_file(folder, str(one)) for one in ([value] if isinstance(value, str) else value)]
    if not isinstance(value, str) or value in param.words or value in param.choices:
        return value
    if param.kind in READ_KINDS:
        return ";".join(_place_file(folder, part.strip()) for part in value.split(";"))
    placed = _place_file(folder, value)
    return placed if {"FILE", "DIR"} & set(param.metavar.split("|")) and os.path.exists(placed) else value


def _place_file(folder: str, name: str) -> str:
    """Return a file of the project's folder as seen from the working directory; URLs and ``@lists`` as they are."""
    prefix, path = split_virtual(name)
    is_elsewhere = name.startswith("@") or (not prefix and name.startswith("/vsi"))
    return name if is_elsewhere else prefix + os.path.join(folder, path)


def split_virtual(path: str) -> tuple[str, str]:
    """Return the prefix of a file in an archive, ``/vsizip/``, and its path; other paths have an empty prefix."""
    found = re.match(r"(/vsi(?:zip|gzip|tar)/)(?![{/]*vsi)(.*)", path)
    return (found[1], found[2]) if found else ("", path)


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
            elif step in MADE_INPUTS:
                entries[step] = {"status": PLANNED, "told": MADE_INPUTS[step].format(len(images))}
            else:
                entries[step] = _check_step(step, project, images, os.path.join(folder, step), context)
    return entries


def _check_step(step: str, project: Project, images: tuple[str, ...], folder: str, context: Context) -> Report:
    """Return the entry of one step by a dry run of its algorithm, or why that fails."""
    name = algorithm_of(step, images)
    options = {**project.options_of(step, name), "images": images, "output_dir": folder}
    without_terrain = step == "orthorectify" and not GROUND_OPTIONS & options.keys()
    if without_terrain:  # points that are not adjusted yet
        options["height"] = open_image(images[0]).middle_height_m
    try:
        report = REGISTRY[name].execute(
            check_options(REGISTRY[name], options), Context(context.progress, lambda text: None, dry_run=True)
        )
    except HrsiError as error:
        return {"status": FAILED, "algorithm": name, "told": str(error), "exit_code": error.exit_code}
    return {
        "status": PLANNED,
        "algorithm": name,
        "told": ", ".join(f"{count} {what}" for what, count in report["counts"].items()),
        "verdict": report["verdict"],
        "warnings": [] if without_terrain else report["warnings"],
    }


def judge_plan(entries: Mapping[str, Report]) -> Report:
    """Return the worst verdict of some steps with all their reasons; a failed step is a failure."""
    judged = [entry["verdict"] for entry in entries.values() if entry.get("verdict")]
    faults = {name: entry["told"] for name, entry in entries.items() if entry["status"] == FAILED}
    failed = [
        f"{', '.join(name for name in faults if faults[name] == fault)} failed: {fault}"
        for fault in dict.fromkeys(faults.values())
    ]
    levels = [*(verdict["level"] for verdict in judged), *([Level.UNUSABLE.label] if failed else [])]
    level = max(levels, key=LEVELS.index, default=Level.DOUBTFUL.label)
    reasons = [reason for verdict in judged for reason in verdict["reasons"]]
    # The sentence of each verdict; of a check of inputs, the worst of what it found
    found = [
        verdict["reasons"][0]["message"]
        if verdict["sentence"] == INPUTS_CHECKED and verdict["reasons"]
        else verdict["sentence"]
        for verdict in judged
    ]
    sentences = dict.fromkeys([*failed, *found])
    if len(sentences) > 1:
        sentences.pop(NOTHING_WRONG, None)
    return {"level": level, "sentence": "; ".join(sentences) or "no step was judged", "reasons": reasons}


def failures(entries: Mapping[str, Report]) -> dict[str, int]:
    """Return the exit code of each failed step."""
    return {name: int(entry.get("exit_code", 1)) for name, entry in entries.items() if entry["status"] == FAILED}

"""A project file (TOML): its texts, the inputs that its steps share, and a table of options for each step.

The options are those of the algorithms, whose declarations check them and describe them to editors. Relative paths
refer to the folder of the file.
"""

import os
import re
import tomllib
from collections.abc import Mapping
from typing import Any, NamedTuple

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.opening.files import require_size
from .. import REGISTRY
from ..interface.declare import READ_KINDS, Kind, Param
from ..interface.options import suggestion

#: Steps in their order, and the folder of each in the output directory.
FOLDERS = {
    "triangulate": "triangulated", "surface-model": "surface", "orthorectify": "orthoimages", "ortho-check": "check",
    "evaluate": "evaluation",
}  # fmt: skip
SINGLE = "refine-rpc"  #: replaces `triangulate` if there is one image
TEXTS = {
    "title": "Title of the report", "client": "Who the report is for", "place": "Where the images were taken",
    "output_dir": "Directory for the results",
}  # fmt: skip
SHARED = (
    "images", "gcps", "image_points", "gcp_ids", "check_ids", "ground_crs", "height_datum", "gcp_epoch", "dem",
    "dem_datum",
)  # fmt: skip
ONLY_ASKED = ("surface-model",)  #: steps that run only if the file has their table
GROUND_OPTIONS = frozenset({"dem", "height", "terrain_points"})  #: options that define the ground of orthoimages
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


def read_project(path: str) -> Project:
    """Return the project of a file, or of a folder with one; raise `InputError` with the key of an invalid entry."""
    path = os.path.join(path, PROJECT_FILE) if os.path.isdir(path) else path
    require_size(path, "names")
    try:
        with open(path, "rb") as file:
            content = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as a project file ({error}): correct it") from None
    known = [*TEXTS, *SHARED, *FOLDERS]
    for key in content:
        if key not in known:
            raise InputError(f"{path}: has no place for {key!r}{suggestion(key, known)}: it has {', '.join(known)}")
    if not content.get("images"):
        raise InputError(f'{path}: names no images: add images = ["folder"]')
    if asked := [key for key in SHARED if content.get(key) == ASK]:
        raise InputError(
            f"{path}: do the heights refer to the ellipsoid or to the geoid (sea level)? Set {' and '.join(asked)} = "
            '"ellipsoidal" or "egm2008"'
        )
    folder = os.path.dirname(path)
    texts = {key: str(content[key]) for key in TEXTS if content.get(key)}
    if "output_dir" in texts:
        texts["output_dir"] = os.path.join(folder, texts["output_dir"])
    shared = _place_options(path, "triangulate", {key: content[key] for key in SHARED if key in content})
    tables = {name: content.get(name, {SKIP: True} if name in ONLY_ASKED else {}) for name in FOLDERS}
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(f"{path}: {name} is no table: write [{name}] above its options")
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
    prefix, path = split_virtual(name)
    is_elsewhere = name.startswith("@") or (not prefix and name.startswith("/vsi"))
    return name if is_elsewhere else prefix + os.path.join(folder, path)


def split_virtual(path: str) -> tuple[str, str]:
    """Return the prefix of a file in an archive, ``/vsizip/``, and its path; other paths have an empty prefix."""
    found = re.match(r"(/vsi(?:zip|gzip|tar)/)(?![{/]*vsi)(.*)", path)
    return (found[1], found[2]) if found else ("", path)

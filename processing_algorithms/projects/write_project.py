"""The project file of a folder that was understood, with the roles of all files and the reasons of decisions."""

import os
from collections.abc import Iterator, Mapping
from typing import Any

from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.io.pages.report import write_text
from .project_file import FOLDERS, SKIP, split_virtual
from .understanding import Understanding

HEAD = """\
# HRSI project: hrsi run makes refined RPCs, orthoimages and a report of it.
# Paths count from this file's folder; hrsi help STEP lists the options of a step.

title = {title}
client = ""
place = ""
output_dir = "result"
"""
#: Options that name files; ``|`` separates the file from how it is read.
FILES = ("images", "gcps", "image_points", "tie_points", "tracks", "dem", "laser", "surface", "reference")
WIDEST_NAME = 60  #: characters: longer names do not widen the table
#: Remarks on options, for who edits the file.
REMARKS = {
    "height_datum": "of the points: layer (as the file states), ellipsoidal, egm96, egm2008 or a geoid grid file",
    "dem_datum": "of the DEM's heights: as above",
    "fill_gaps": "cells: interpolates gaps of the DEM",
    "height": "m, ellipsoidal: the height of the ground",
}
#: Options that are offered as comments, by step.
OFFERED = {
    "triangulate": ['# model = "auto"   # shift, affine, …: the correction of each RPC'],
    "orthorectify": [
        "# resolution = 0.5   # m; by default that of the images",
        "# visibility = true   # hidden ground is masked, on a surface model",
        "# mosaic = true   # also one image of all",
    ],
    "evaluate": ['# tracks = "none"   # compares at the known points only'],
}


def write_project(made: Understanding, path: str) -> None:
    """Write the project file, and next to it the virtual raster of a DEM of tiles, or without nodata value or CRS."""
    here = os.path.dirname(os.path.abspath(path))
    dem = next((one for one in made.content.heights if one.path == made.shared.get("dem")), None)
    shared = {**made.shared, **({"dem": dem.write_target(here)} if dem is not None else {})}
    title = json_text(os.path.basename(os.path.abspath(made.content.folder)))
    lines = [HEAD.format(title=title), *(f"# {line}" for line in describe_folder(made, here)), ""]
    lines += [f"# QUESTION: {made.question}"] if made.question else []
    lines += _assign(shared, here)
    for step in FOLDERS:
        lines += ["", f"[{step}]"]
        if step in made.steps:
            lines += [*_assign(made.steps[step], here)]
            lines += [line for line in OFFERED.get(step, []) if line.split()[1] not in made.steps[step]]
        else:
            lines.append(f"{SKIP} = {json_text(made.left_out[step])}")
    write_text(path, "\n".join(lines) + "\n")


def describe_folder(made: Understanding, here: str) -> list[str]:
    """Return a table of the files with their roles, and the decisions."""
    names = [os.path.relpath(split_virtual(one.path)[1], here) for one in made.roles]
    width = min(max(map(len, names)), WIDEST_NAME)
    told = [f"{one.role}{'' if one.sure else ' (?)'}{f': {one.reason}' if one.reason else ''}" for one in made.roles]
    table = [f"{name:{width}}  {text}" for name, text in zip(names, told, strict=True)]
    return [*table, *made.decisions]


def _assign(options: Mapping[str, Any], here: str) -> Iterator[str]:
    """Yield the lines of options; those that name files relative to the project file."""
    for key, value in options.items():
        remark = f"   # {REMARKS[key]}" if key in REMARKS else ""
        is_list = isinstance(value, (list, tuple))
        if key in FILES and value not in ("auto", "none"):
            named = [_relative(str(one), here) for one in (value if is_list else [value])]
            value = named if key == "images" else ";".join(named)
        if isinstance(value, (list, tuple)):
            texts = [json_text(one) for one in value]
            is_short = sum(map(len, texts)) < 90
            listed = ", ".join(texts) if is_short else "\n" + "".join(f"  {text},\n" for text in texts)
            yield f"{key} = [{listed}]"
        else:
            yield f"{key} = {json_text(value)}{remark}"


def _relative(spec: str, here: str) -> str:
    """Return a file, which may be in an archive or have a layer after ``|``, relative to a folder."""
    path, bar, rest = spec.partition("|")
    prefix, path = split_virtual(path)
    return f"{prefix}{path if prefix and not os.path.isabs(path) else os.path.relpath(path, here)}{bar}{rest}"

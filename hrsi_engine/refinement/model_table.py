"""The table of refinement models: one entry per model, from which the model is made and options take its name.

It also has the names of the rules that choose a model, and the options for refining an image. The module imports no
numerics, so that the command line has the choices without loading them. The modules of the families make the models
(`image_space`, `object_coordinates`, `object_space`, `pseudo_sensor`, `laboratory.direct_methods`).

Units and meanings of the models' parameters, derived from their names (`models.MODELS`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

from ..foundation.options import option, options


class ModelEntry(NamedTuple):
    """Declaration of a model.

    title : what it corrects, in a few words
    maker : name of the family's function that makes it
    settings : further arguments of that function, after name and title
    """

    title: str
    maker: str
    settings: tuple[Any, ...] = ()


#: Polynomials of the image position: powers of (sample, line), the same in both coordinates.
IMAGE_SPACE_TABLE = {
    "none": ModelEntry("no correction", "polynomial", ([],)),
    "shift": ModelEntry("a constant in sample and in line", "polynomial", ([(0, 0)],)),
    "shift-drift": ModelEntry("a constant and a drift along the lines", "polynomial", ([(0, 0), (0, 1)],)),
    "conformal": ModelEntry("shift, scale and rotation in the image", "similarity"),
    "affine": ModelEntry("an affine transformation of the image", "polynomial", ([(0, 0), (1, 0), (0, 1)],)),
    "quadratic": ModelEntry(
        "a polynomial of second degree in the image", "polynomial", ([(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)],)
    ),
}
#: Polynomials of the ground position, added in the image; the setting is their degree.
OBJECT_COORDINATES_TABLE = {
    "ground-linear": ModelEntry(
        "a first-order polynomial of lon, lat and height, added in the image", "polynomial", (1,)
    ),
    "ground-quadratic": ModelEntry(
        "a second-order polynomial of lon, lat and height, added in the image", "polynomial", (2,)
    ),
}
_SHIFTS = [(axis, 0) for axis in range(3)]
#: Corrections of the ground position: (axis, 0 for a constant or 1 + the axis that it is proportional to), fewest GCPs.
OBJECT_SPACE_TABLE = {
    "object-shift": ModelEntry("a shift of the ground coordinates", "correction", (_SHIFTS, 1)),
    "object-scale-shift": ModelEntry(
        "a shift and a scale of each ground coordinate",
        "correction",
        (_SHIFTS + [(axis, axis + 1) for axis in range(3)], 2),
    ),
    "object-affine": ModelEntry(
        "an affine transformation of the ground coordinates",
        "correction",
        (_SHIFTS + [(axis, by) for axis in range(3) for by in range(1, 4)], 4),
    ),
}
_TILT, _ALL = ("xs", "ys", "psi_x", "psi_y"), ("xs", "ys", "hs", "psi_x", "psi_y", "yaw", "psi_z")
#: Corrections of a pseudo sensor: quantities, whether linear in the image, fewest GCPs, factor of the drifts' sigmas.
PSEUDO_SENSOR_TABLE = {
    "generic-position": ModelEntry("sensor position, constant", "pseudo-sensor", (("xs", "ys"), False, 1)),
    "generic-shift": ModelEntry("sensor position, roll and pitch, constant", "pseudo-sensor", (_TILT, False, 1)),
    "generic-12": ModelEntry(
        "sensor position, roll and pitch, linear: the thesis's twelve", "pseudo-sensor", (_TILT, True, 3)
    ),
    "generic-affine": ModelEntry(
        "sensor position and attitude, linear in the image, drifts constrained", "pseudo-sensor", (_ALL, True, 3)
    ),
    "generic-full": ModelEntry(
        "sensor position and attitude, linear, for many GCPs", "pseudo-sensor", (_ALL, True, 9, 10.0)
    ),
}
_DIRECT_GRID, _PSEUDO_GRID = (10, 10, 5), (3, 3, 3)
#: New coefficients, for single images with GCPs: nodes (samples, lines, heights) of the grid of the old ones.
DIRECT_TABLE = {
    "direct": ModelEntry("all coefficients again from the GCPs", "loose"),
    "bils": ModelEntry("coefficients by batch least squares with their covariance", "grid", (_DIRECT_GRID,)),
    "idkf": ModelEntry("coefficients by a Kalman filter, GCP by GCP", "grid", (_DIRECT_GRID,)),
    "pg": ModelEntry("coefficients with pseudo GCPs of the old RPC", "grid", (_PSEUDO_GRID,)),
    "upoe": ModelEntry("coefficients with the old ones as observations", "coefficients"),
    "slss": ModelEntry("coefficients by one sequential update of the old solution", "grid", (_DIRECT_GRID,)),
}

#: Models for blocks and single images, and those for single images with GCPs only.
BLOCK_MODEL_NAMES = (*IMAGE_SPACE_TABLE, *OBJECT_COORDINATES_TABLE, *OBJECT_SPACE_TABLE, *PSEUDO_SENSOR_TABLE)
DIRECT_MODEL_NAMES = tuple(DIRECT_TABLE)
#: Rules that choose a model from the GCPs (`selection.RULES`).
RULE_NAMES = ("auto", "generic")


@options
class RefineOptions:
    """How to refine an image from its GCPs."""

    model: str = option(
        "auto", "Correction model of the RPCs", choices=(*RULE_NAMES, *BLOCK_MODEL_NAMES, *DIRECT_MODEL_NAMES)
    )
    leave_out: bool = option(True, "Reject GCPs that contradict the others; they are listed in any case", advanced=True)


Model = TypeVar("Model")


def make_models(table: Mapping[str, ModelEntry], makers: Mapping[str, Callable[..., Model]]) -> dict[str, Model]:
    """Return the models of a family's table, each made by the function (maker) that its entry names."""
    for name, entry in table.items():
        if entry.maker not in makers:
            maker_names = ", ".join(makers)
            raise LookupError(
                f"model {name!r}: its family has no maker {entry.maker!r}, only {maker_names}: add it there"
            )
    return {name: makers[entry.maker](name, entry.title, *entry.settings) for name, entry in table.items()}


#: Meaning and unit of the corrected quantities.
QUANTITY = {
    "sample": ("correction of the sample", "px"), "line": ("correction of the line", "px"),
    "east": ("shift to the east", "m"), "north": ("shift to the north", "m"), "up": ("shift upwards", "m"),
    "xs": ("sensor position along the samples", "m"), "ys": ("sensor position along the lines", "m"),
    "hs": ("sensor height", "m"), "psi_x": ("roll", "rad"), "psi_y": ("pitch", "rad"), "yaw": ("yaw", "rad"),
    "psi_z": ("rotation about the scene's middle", "rad"),
}  # fmt: skip
#: Names of the arguments that a correction is proportional to.
ARGUMENT = {
    "s": "sample",
    "l": "line",
    "x": "longitude",
    "y": "latitude",
    "z": "height",
    "east": "east",
    "north": "north",
    "up": "up",
}
WHOLE = {"scale": ("scale of the image, less 1", "px/px"), "rotation": ("rotation in the image", "rad")}


def describe_parameter(name: str) -> dict[str, str]:
    """Return ``unit`` and ``meaning`` of a model's parameter; empty texts for names that are not parameters.

    Sample and line are relative to the image's centre, in px if the correction is one of sample and line; other
    arguments are relative to half the image's extent, so that the parameter keeps the unit of the quantity.
    """
    plain = name.removeprefix("drift_")
    meaning, unit = WHOLE.get(plain, ("", ""))
    match = re.fullmatch(rf"({'|'.join(QUANTITY)})_(0|east|north|up|[slxyz]+)", plain)
    if match:
        (meaning, unit), argument = QUANTITY[match[1]], match[2]
        if argument != "0":
            arguments = [argument] if argument in ARGUMENT else list(argument)
            meaning += ", proportional to " + " · ".join(ARGUMENT[part] for part in arguments)
            if match[1] in ("sample", "line") and set(argument) <= set("sl"):
                unit = "px/px" if len(argument) == 1 else "px/px²"
        else:
            meaning += ", constant"
    return {"unit": unit, "meaning": meaning + (" (drift of the sensor)" if plain != name else "")}

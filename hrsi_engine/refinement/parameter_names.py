"""Units and meanings of the models' parameters, derived from their names (`models.MODELS`)."""

import re

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
    "s": "sample", "l": "line", "x": "longitude", "y": "latitude", "z": "height",
    "east": "east", "north": "north", "up": "up",
}  # fmt: skip
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

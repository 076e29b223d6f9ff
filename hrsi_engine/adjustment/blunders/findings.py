"""From the GCPs that are wrong to what is left out, and to sentences."""

import numpy as np

from ...foundation.errors import list_ids
from ..outcome import RoundFindings
from ..problem import Problem
from ..result import Decision, Finding
from .control import Suspect
from .discrepancies import Discrepancies

HORIZONTAL, VERTICAL = slice(0, 2), 2


def leave_out(
    problem: Problem, control: Discrepancies, suspect: Suspect, survey_weight: np.ndarray, found: RoundFindings
) -> None:
    """Take what is wrong with a GCP out of the surveys' weights ``(m, 3)`` and the measurements, in place."""
    point = int(control.points[suspect.gcp])
    rows, kind = np.zeros(0, dtype=np.int64), Decision.DOUBTFUL
    if suspect.what == "height":
        survey_weight[point, VERTICAL] = 0.0
    elif suspect.what == "image":
        rows, kind = np.array([suspect.row]), Decision.BLUNDER
    else:
        survey_weight[point] = 0.0
    if suspect.what == "all":
        rows = np.arange(problem.observations.first[point], problem.observations.first[point + 1])
    found.decision[rows] = int(kind)
    if found.failed is None:
        found.failed = np.full(len(found.decision), np.nan, dtype=np.float32)
    found.failed[rows] = suspect.statistic


def describe_suspect(problem: Problem, control: Discrepancies, suspect: Suspect) -> Finding:
    """Return what is to be said of a GCP, or of two groups of which one is wrong."""
    observations = problem.observations
    ids = problem.block.points.ids[observations.points[control.points]]
    name, size = str(ids[suspect.gcp]), float(np.linalg.norm(suspect.error))
    image = observations.images[observations.image[suspect.row]].id if suspect.what == "image" else None
    unit = "m" if image is None else "px"
    sigmas = f"({suspect.statistic:.0f} sigma)"
    if suspect.is_clear:
        east, north, up = suspect.error if image is None else (0.0, 0.0, 0.0)
        wrong = {
            "height": f"its height is {size:.1f} m too {'high' if up > 0.0 else 'low'} {sigmas}",
            "image": f"its measurement on image {image} is off by {size:.1f} px {sigmas}",
            "ground": f"its ground position is wrong by {east:+.1f} {north:+.1f} {up:+.1f} m east, north, up {sigmas}",
            "all": f"its ground position (off by {size:.1f} m) or its measurements are wrong and cannot be told apart "
            f"{sigmas}",
        }[suspect.what]
        message = f"GCP {name}: by the rest of the block {wrong}; it is left out"
    else:
        apart = f"{size:.1f} {unit} {sigmas}"
        here, there = list_ids(ids[list(suspect.group)]), list_ids(ids[list(suspect.rivals)])
        message = (
            f"GCP {here} and {there} disagree, {name} by {apart}; which of them are wrong cannot be told, all are "
            "kept: check them, or measure more"
        )
    return Finding(
        id=name, what={"image": image or "", "height": "height"}.get(suspect.what, "ground"),
        statistic=suspect.statistic, left_out=suspect.is_clear, message=message, size=size, unit=unit,
        group=tuple(str(one) for one in ids[list(suspect.group)]),
        rivals=tuple(str(one) for one in ids[list(suspect.rivals)]),
    )  # fmt: skip

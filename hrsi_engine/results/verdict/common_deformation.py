"""GCPs that are rotated, scaled or tilted as a whole: the drifts that they cause in the images have a common cause."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import special

from ...block.block import Image, Role, stack_rpcs
from ...foundation.reasons import Level, Reason
from ...foundation.thresholds import SAMPLES, SIGNIFICANCE
from ...ground.geodesy import ground_difference_m
from ...refinement.selection import SELECTION
from .evidence import Evidence

_DRIFTS = ("sample_s", "sample_l", "line_s", "line_l")


def find_deformed_survey(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for GCPs that rotate, scale or tilt the ground by more than the predicted accuracy.

    Drifts of images come from their own orbits and attitudes: the twelve drifts of three images do not agree with the
    six parameters of one linear deformation of the ground (two shears and two scales in plan, a tilt along two axes),
    unless the survey is deformed. It has to exceed what the sensors drift by themselves.
    """
    result = evidence.result
    estimated = result.cameras
    gcps = result.block.points.ground[result.block.points.role == Role.GCP]  # without GCPs of an earlier block
    if len(gcps) < SAMPLES.plane or not set(_DRIFTS) <= set(estimated.model.parameters):
        return
    columns = [estimated.model.parameters.index(name) for name in _DRIFTS]
    number = {image.id: index for index, image in enumerate(result.block.images)}
    for part in result.parts:
        rows = [number[name] for name in part.images]
        if part.gcps < SAMPLES.plane or len(rows) < 2 or part.ce90_m is None or part.le90_m is None:
            continue
        images = [result.block.images[row] for row in rows]
        drifts = np.ix_(rows, columns)
        gradient, excess, likeness = fit_deformation(images, estimated.values[drifts], evidence.value_sigmas[drifts])
        rim = np.stack([gcps.min(axis=0), gcps.max(axis=0)])
        half_m = float(np.linalg.norm(ground_difference_m(rim[1:], rim[:1])[0, :2])) / 2.0
        plan_m = half_m * float(np.linalg.norm(gradient[:2], 2))
        height_m = half_m * float(np.linalg.norm(gradient[2]))
        if (
            max(excess, likeness) < SIGNIFICANCE.false_alarm
            and max(plan_m / part.ce90_m, height_m / part.le90_m) > SELECTION.expected_error
        ):
            yield Reason(
                "survey-deformed",
                Level.DOUBTFUL,
                f"the GCPs rotate or scale the block by {1e6 * plan_m / half_m:.0f} mm/km and tilt it by "
                f"{1e6 * height_m / half_m:.0f} mm/km: {plan_m:.2g} m in plan and {height_m:.2g} m in height at its "
                f"edge; all {len(images)} images show this deformation, although their attitude drifts are "
                "independent",
                "check projection (map distances instead of ground distances), orientation and height datum of the "
                "survey",
                images=tuple(part.images),
            )


def fit_deformation(images: Sequence[Image], drifts: np.ndarray, sigmas: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Return the linear deformation of the ground that best explains the drifts of the images.

    images : two or more
    drifts : (n, 4) of sample by sample, sample by line, line by sample, line by line, px/px; ``sigmas`` of them
    Result: error in east, north and height per metre east and north ``(3, 2)``; the probability of such drifts by the
    sensors alone (chi² test of what the deformation explains), and of such agreement of independent drifts (F test).
    """
    weight = 1.0 / sigmas.ravel()
    # Derivatives (4 n, 6) of each image's drifts by the elements of a deformation of the ground
    stack, owner = stack_rpcs(images), np.arange(len(images))
    centres = np.array([image.centre_px for image in images])
    middle = stack.localize(owner, centres, np.array([image.rpc.height_off for image in images]))
    by_ground = stack.project_with_metric_jacobian(owner, middle)[1]  # (n, 2, 3), px/m
    by_pixel = np.linalg.inv(by_ground[:, :, :2])  # along the ground at one height, m/px
    design = -np.einsum("nia,nbj->nijab", by_ground, by_pixel).reshape(-1, 6) * weight[:, None]
    observed = drifts.ravel() * weight
    coefficients, *_ = np.linalg.lstsq(design, observed, rcond=None)
    explained = float(np.sum((design @ coefficients) ** 2))
    parameters, freedom = design.shape[1], len(design) - design.shape[1]
    residual_variance = float(np.sum((observed - design @ coefficients) ** 2)) / freedom
    likeness = float(special.fdtrc(parameters, freedom, explained / parameters / max(residual_variance, 1e-30)))
    return coefficients.reshape(3, 2), float(special.chdtrc(parameters, explained)), likeness

"""Warnings of an adjustment: weak parameters, parallel rays, and external heights and positions that do not fit."""

from collections.abc import Sequence

import numpy as np

from ...foundation.errors import list_ids
from ...foundation.thresholds import EQUALITY
from ..gauss_newton import GaussNewton
from ..preparation.problem import Problem
from ..result import DatumPart
from ..source_results import HeightAgreement, PlanAgreement
from ..starting_values.weak_geometry import RAY_GEOMETRY

WHAT_STANDS_OUT = {
    "DEM": "trees, buildings, or errors of the DEM",
    "laser": "canopy, clouds, or ground that has changed",
}


def warn_of_result(
    problem: Problem,
    loop: GaussNewton,
    prior_share: np.ndarray,
    parts: Sequence[DatumPart],
    heights: Sequence[HeightAgreement],
    plan: PlanAgreement | None,
) -> list[str]:
    """Return the warnings of a result; ``prior_share (cameras, p)`` is the share of each parameter by its prior."""
    return [
        *_warn_of_weak_parameters(problem, loop, prior_share),
        *_warn_of_heights(heights),
        *_warn_of_plan(plan),
        *(
            f"the rays of {len(part.parallel)} of {part.points + len(part.parallel)} points converge by less than "
            f"{RAY_GEOMETRY.weak_angle_deg:g} degrees: their heights are uncertain and not included in the predicted "
            f"accuracy: {list_ids(part.parallel)}"
            for part in parts
            if part.points and len(part.parallel) > EQUALITY.negligible * (part.points + len(part.parallel))
        ),
    ]


def _warn_of_weak_parameters(problem: Problem, loop: GaussNewton, prior_share: np.ndarray) -> list[str]:
    """Return warnings of parameters of images with GCPs that follow from their priors.

    Parameters whose prior was estimated from the block are not included.
    """
    names, observations = problem.model.parameters, problem.observations
    prior = problem.prior_weight[:, : prior_share.shape[1]]
    has_prior = prior == loop.prior_weight[:, : prior_share.shape[1]]
    poor = (prior_share > EQUALITY.majority) & has_prior & ~np.isinf(prior)
    by_set: dict[tuple[str, ...], list[str]] = {}
    for part in problem.parts:
        for index in part.images if part.gcps else ():
            parameter = poor[observations.camera_of_image[index]]
            if parameter.any():
                key = tuple(name for name, images_of in zip(names, parameter, strict=True) if images_of)
                by_set.setdefault(key, []).append(observations.images[index].id)
    return [
        f"{', '.join(key)} of image {list_ids(ids)} are not determined by the GCPs and tie points, and follow from "
        "their priors"
        for key, ids in by_set.items()
    ]


def _warn_of_plan(plan: PlanAgreement | None) -> list[str]:
    """Return warnings of parts of a reference that contradict the others, and of many places that do not fit."""
    if plan is None:
        return []
    warnings = []
    for group in plan.groups:
        if group.wrong:
            consequence = "not used" if group.left_out else "used, because the wrong ones cannot be identified"
            warnings.append(
                f"{plan.source}, {group.name}: its {group.observations} points deviate from the others by "
                f"{group.east_m:+.1f} m east and {group.north_m:+.1f} m north (sigma {group.sigma_m:.1f} m): "
                f"{consequence}"
            )
    lone = plan.left_out - sum(group.observations for group in plan.groups if group.left_out)
    if lone > EQUALITY.negligible * plan.observations:
        warnings.append(
            f"{lone} of {plan.observations} points of the {plan.source} are outliers and are not used: likely causes "
            "are changed ground, false matches or heights of the DEM"
        )
    return warnings


def _warn_of_heights(heights: Sequence[HeightAgreement]) -> list[str]:
    """Return warnings of sources many of whose heights do not fit, and of groups that contradict the others."""
    warnings = []
    for one in heights:
        all_wrong = len(one.groups) > 1 and one.contradicts
        if all_wrong:
            middle = float(np.median([group.offset_m for group in one.groups]))
            consequence = "not used" if one.groups[0].left_out else "used, because the wrong one cannot be identified"
            warnings.append(
                f"{one.source}: all {len(one.groups)} groups of its heights contradict the other constraints of the "
                f"block, by {middle:+.1f} m (median): {consequence}; check the height datum of both (`laser_datum`, "
                "`dem_datum`: heights above a geoid and above the ellipsoid differ by tens of metres)"
            )
        for group in () if all_wrong else one.groups:
            if group.wrong:
                consequence = "not used" if group.left_out else "used, because the wrong ones cannot be identified"
                warnings.append(
                    f"{one.source}, {group.name}: its {group.observations} heights deviate from the others by "
                    f"{group.offset_m:+.1f} m ({abs(group.offset_m) / group.sigma_m:.0f} sigma): {consequence}; "
                    "check their height datum"
                )
        wrong_groups = sum(group.observations for group in one.groups if group.left_out)
        if one.left_out - wrong_groups > EQUALITY.negligible * one.observations:
            source = WHAT_STANDS_OUT[one.source]
            warnings.append(
                f"{one.left_out} of {one.observations} heights of the {one.source} are outliers and are not used (the "
                f"points are {one.left_out_median_m:+.1f} m above it in the median): likely causes are {source}"
            )
    return warnings

"""Checks whether the inputs of a block are plausible, and whether the adjusted block agrees with the DEM."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.block.block import Block, Image, Role
from ...hrsi_engine.foundation.errors import InputError, SolveError
from ...hrsi_engine.foundation.large_arrays import finite_rows
from ...hrsi_engine.foundation.reasons import Reason
from ...hrsi_engine.foundation.robust_scale import robust_sigma
from ...hrsi_engine.foundation.thresholds import SAMPLES, SIGNIFICANCE, threshold, thresholds
from ...hrsi_engine.io.rasters.images import placement_doubt
from ...hrsi_engine.plausibility import check_block
from ...hrsi_engine.plausibility.accuracy import estimate_accuracies
from ...hrsi_engine.plausibility.places import list_placement_reasons
from ...hrsi_engine.plausibility.relief import find_relief_reasons
from ...hrsi_engine.surface.dem import HeightSurface, surface_heights
from ..interface.declare import Report


def input_reasons(
    block: Block, surface: HeightSurface | None, sigma_shift_px: float | None = None, sigma_drift: float | None = None
) -> list[Reason]:
    """Return the findings in a block's inputs that a careful operator would check, the worst first.

    The sigmas are a priori standard deviations of the RPCs, if the user gives them.
    """
    found = check_block(block, surface=surface, sigma_shift_px=sigma_shift_px or 0.0, sigma_drift=sigma_drift or 0.0)
    return found + placement_reasons(block.images)


def placement_reasons(images: Sequence[Image]) -> list[Reason]:
    """Return the reason for images whose RPC may not be that of their pixels."""
    doubts = {image.id: placement_doubt(image) for image in images if image.path}
    return list_placement_reasons({name: doubt for name, doubt in doubts.items() if doubt is not None})


@contextmanager
def explain_failures(reasons: Sequence[Reason]) -> Iterator[None]:
    """Replace the error of a failed adjustment by the worst finding in its inputs, if there is one."""
    try:
        yield
    except (SolveError, InputError) as error:
        if not reasons:
            raise
        raise InputError(f"{reasons[0].message}: {reasons[0].advice} ({reasons[0].code}; {error})") from error


@thresholds
class DEM_OFFSET:
    """Limits for the height difference of a block from the DEM."""

    least_m: float = threshold(1.0, "m", "smallest reported difference: grass, interpolation, errors of a DEM")


def heights_above(ground: np.ndarray, surface: HeightSurface) -> np.ndarray:
    """Return the heights ``(k,)`` m of ground points ``(n, 3)`` above a surface, where it has a height."""
    above = ground[:, 2] - surface_heights(surface, ground[:, :2])
    return above[np.isfinite(above)]


def describe_differences(values: np.ndarray, keys: Sequence[str]) -> Report:
    """Return number, median, NMAD (m) and 90th percentile of the absolute values (m) of differences, by four keys.

    Without any differences the number is 0 and the others are None.
    """
    if not len(values):
        return dict.fromkeys(keys) | {keys[0]: 0}
    middle = float(np.median(values))
    spread, largest = float(robust_sigma(values - middle)), float(np.percentile(np.abs(values), 90.0))
    return dict(zip(keys, (len(values), middle, spread, largest), strict=True))


def offset_warning(result: Adjustment, surface: HeightSurface | None, sigma_dem_m: float | None) -> list[str]:
    """Return a warning if the tie points of a block without GCPs clearly deviate from a DEM that is no constraint.

    Orthoimages made with this DEM are then displaced relative to each other by the deviation times the difference of
    the tangents of their view angles.
    """
    role = result.block.points.role
    if surface is None or sigma_dem_m is not None or np.any(role == Role.GCP):
        return []
    above = heights_above(result.ground[(role == Role.TIE) & finite_rows(result.ground)], surface)
    if len(above) < SAMPLES.tested:
        return []
    middle = float(np.median(above))
    spread = float(robust_sigma(above - middle))
    if abs(middle) <= max(DEM_OFFSET.least_m, SIGNIFICANCE.gross * 1.2533 * spread / np.sqrt(len(above))):
        return []
    return [
        f"the tie points are {abs(middle):.1f} m {'above' if middle > 0.0 else 'below'} the DEM (median of "
        f"{len(above)}), and without GCPs its heights do not constrain the block: orthoimages from this DEM will not "
        "match each other; give the accuracy of the DEM as `sigma_dem_m`, in metres"
    ]


def ground_reasons(result: Adjustment, surface: HeightSurface | None, sigma_dem_m: float | None) -> list[Reason]:
    """Return the reasons why the DEM does not show the ground of the adjusted tie points."""
    if surface is None:
        return []
    role = result.block.points.role
    chosen = (role == Role.TIE) & finite_rows(result.ground) & (result.block.rays_per_point() > 1)
    sigma = result.ground_sigma_m[chosen, 2]
    of_points = float(np.nanmedian(sigma)) if np.isfinite(sigma).any() else 0.0
    in_place = bool((role == Role.GCP).any()) or result.plan is not None
    holds = any(one.source == "DEM" and one.left_out < one.observations and one.share > 0.5 for one in result.heights)
    return find_relief_reasons(
        result.ground[chosen],
        surface,
        0.0 if in_place else max(accuracy.sigma_m for accuracy in estimate_accuracies(result.block.images)),
        float(np.hypot(of_points, sigma_dem_m or 0.0)),
        holds,
    )

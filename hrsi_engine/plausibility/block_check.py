"""Could the inputs be what they claim? Everything that can be asked of a block before it is adjusted."""

from __future__ import annotations

from ..block.block import Block
from ..foundation.reasons import Level, Reason
from ..surface.dem import HeightSurface
from .accuracy import estimate_accuracies
from .control import collect_control
from .control_reasons import OF_HEIGHTS, find_control_reasons
from .identities import find_spelling_reasons
from .places import find_crops, find_dem_reasons, find_duplicate_images, find_height_reasons, find_points_outside
from .survey import find_dependent_check_points, find_rounding_reasons
from .ties import find_tie_reasons

#: Slips of image coordinates or heights that explain why points lie outside an image, or heights outside a range.
OF_PIXELS = {
    "sample-line-swapped",
    "lines-from-below",
    "samples-from-right",
    "image-turned",
    "image-scale",
    "image-ids-permuted",
}
OF_SCATTER = {"control-implausible", "control-groups", "control-outliers"}  #: what lost decimals look like
EXPLAIN_RANGE = OF_HEIGHTS | {"heights-alike"}


def check_block(
    block: Block, *, surface: HeightSurface | None = None, sigma_shift_px: float = 0.0, sigma_drift: float = 0.0
) -> list[Reason]:
    """Return what in a block's inputs cannot be what it claims, worst first; nothing where all is plausible.

    Parameters
    ----------
    block : Block
        Images with the RPCs as they came, points and measurements.
    surface : HeightSurface, optional
        The DEM that comes with the block.
    sigma_shift_px, sigma_drift : float
        Standard deviations of the RPCs' errors (px, px/px) where the user knows them to be worse than the RPCs state.

    Returns
    -------
    list of Reason
        Worst first; empty where all is plausible.
    """
    accuracies = estimate_accuracies(block.images, sigma_shift_px, sigma_drift)
    control = collect_control(block, accuracies)
    reasons = [] if control is None else find_control_reasons(control)
    reasons += find_rounding_reasons(block, accuracies, max([Level.DOUBTFUL, *(reason.level for reason in reasons)]))
    reasons += find_dependent_check_points(block) + find_spelling_reasons(block, accuracies)
    reasons += find_height_reasons(block, contradicted=bool(reasons))
    reasons += find_tie_reasons(block, accuracies)
    reasons += [] if surface is None else find_dem_reasons(block, surface)
    reasons += find_points_outside(block) + find_crops(block)
    reasons += find_duplicate_images(block)
    return sorted(_without_consequences(reasons), key=lambda reason: -reason.level)


def _without_consequences(reasons: list[Reason]) -> list[Reason]:
    """Leave out what follows from a reason that is named, and a slip that is said of points and of ties alike."""
    codes = {reason.code for reason in reasons}
    kept: list[Reason] = []
    for reason in reasons:
        follows = (
            (reason.code == "outside-image" and codes & OF_PIXELS)
            or (reason.code == "heights-out-of-range" and codes & EXPLAIN_RANGE)
            or (reason.code in OF_SCATTER and "coordinates-rounded" in codes)
            or (reason.code in OF_HEIGHTS and any(other.code in OF_HEIGHTS for other in kept))
            or any(reason.code == other.code for other in kept if reason.code != "duplicate-images")
        )
        if not follows:
            kept.append(reason)
    return kept

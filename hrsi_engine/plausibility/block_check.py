"""All checks of a block's inputs before its adjustment; reasons that are consequences of other reasons are left out."""

from ..block.block import Block
from ..foundation.reasons import Level, Reason
from ..surface.dem import HeightSurface
from . import places
from .accuracy import estimate_accuracies
from .control import collect_control
from .control_reasons import HEIGHT_CODES, find_control_reasons
from .identities import find_spelling_reasons
from .ties import find_tie_reasons

#: Input errors of image coordinates that place points outside their image.
PIXEL_MISTAKE_CODES = {"image-axes", "image-scale", "ids-permuted"}


def check_block(
    block: Block, *, surface: HeightSurface | None = None, sigma_shift_px: float = 0.0, sigma_drift: float = 0.0
) -> list[Reason]:
    """Return the implausible parts of a block's inputs: errors of coordinates, ids, heights, datums, DEM and images.

    Parameters
    ----------
    block : Block
        Images with their RPCs before adjustment, points and measurements.
    surface : HeightSurface, optional
        The DEM given with the block.
    sigma_shift_px, sigma_drift : float
        Standard deviations of the RPCs' errors (px, px/px), where the user states larger ones than the RPCs do.

    Returns
    -------
    list of Reason
        The worst first; empty where everything is plausible.
    """
    accuracies = estimate_accuracies(block.images, sigma_shift_px, sigma_drift)
    control = collect_control(block, accuracies)
    reasons = [] if control is None else find_control_reasons(control)
    reasons += places.find_rounding_reasons(
        block, accuracies, max([Level.DOUBTFUL, *(reason.level for reason in reasons)])
    )
    reasons += places.find_dependent_check_points(block) + find_spelling_reasons(block, accuracies)
    reasons += places.find_height_reasons(block, contradicted=bool(reasons))
    reasons += find_tie_reasons(block, accuracies)
    reasons += [] if surface is None else places.find_dem_reasons(block, surface)
    reasons += (
        places.find_points_outside(block) + places.find_placement_reasons(block) + places.find_reordered_rpcs(block)
    )
    reasons += places.find_duplicate_images(block)
    # Leave out reasons that follow from others, and repeated codes (one input error found in GCPs and in tie points)
    codes = {reason.code for reason in reasons}
    kept: list[Reason] = []
    for reason in reasons:
        follows = (
            (reason.code == "outside-image" and codes & PIXEL_MISTAKE_CODES)
            or (reason.code == "height-offset" and "heights-alike" in codes)
            or (reason.code in {"control-implausible", "control-outliers"} and "coordinates-rounded" in codes)
            or (reason.code in HEIGHT_CODES and any(earlier.code in HEIGHT_CODES for earlier in kept))
            or any(reason.code == earlier.code for earlier in kept if reason.code != "duplicate-images")
        )
        if not follows:
            kept.append(reason)
    return sorted(kept, key=lambda reason: -reason.level)

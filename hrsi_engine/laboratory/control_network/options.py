"""How two windows are matched by control networks."""

from __future__ import annotations

from ...foundation.options import option, options, threads_option
from ..interest_points.options import DETECTOR_SETS


@options
class ControlNetworkOptions:
    """How two windows are matched."""

    scales: tuple[float, float] | None = option(
        None,
        "Scale of the second image relative to the first, or the range to search; by default from features, else 1 "
        "and then 0.6 to 1.7",
        name="scale",
        minimum=0.05,
        maximum=20.0,
        metavar="LOW,HIGH",
    )
    detector: str = option("harris", "Interest points to match", choices=tuple(DETECTOR_SETS))
    radius_px: float = option(
        3.0,
        "Corners are the strongest within this radius; it sets the tolerance too",
        name="radius",
        minimum=1.0,
        maximum=50.0,
        unit="px",
    )
    share: float = option(0.9, "Share of all local maxima that become interest points", minimum=0.0, maximum=1.0)
    max_slope_deg: float = option(
        5.0,
        "Slope of the ground that the tolerance of the networks allows for",
        name="max-slope",
        minimum=0.0,
        maximum=60.0,
        unit="°",
    )
    incidence_deg: float = option(
        10.0, "Incidence angle of both images that it allows for", name="incidence", minimum=0.0, maximum=60.0, unit="°"
    )
    reach_px: float = option(
        200.0, "Longest distance of a super point from its root", name="reach", minimum=20.0, unit="px", advanced=True
    )
    correlation: float = option(
        0.6, "Smallest correlation of two interest points' surroundings", minimum=0.0, maximum=1.0
    )
    consistency_px: float = option(
        1.5,
        "Largest difference from the neighbours, beyond their own spread",
        name="consistency",
        minimum=0.1,
        unit="px",
    )
    least: int = option(12, "Fewer correspondences than these are no match", minimum=6, advanced=True)
    mask_saturated: bool = option(
        True, "Leave out areas of the largest grey value, where many pixels have it", advanced=True
    )
    threads: int = threads_option()

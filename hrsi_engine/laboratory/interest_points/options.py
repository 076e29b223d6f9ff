"""What interest points to look for, and how."""

from __future__ import annotations

from ...foundation.options import nest_options, option, options, threads_option
from ...measurement.interest_points.options import CentreOptions

#: Detectors (`detectors.DETECTORS`) by the name of a choice of them.
DETECTOR_SETS = {
    "harris": ("harris",),
    "foerstner": ("foerstner",),
    "centres": ("centres",),
    "all": ("harris", "centres"),
}


@options
class CornerOptions:
    """How corners are found, on the strength of the normalised image."""

    kappa: float = option(0.04, "Weight of the trace in Harris's strength", minimum=0.0, maximum=0.25, advanced=True)
    radius_px: float = option(
        4.0, "Corners are the strongest within this radius", name="radius", minimum=1.0, maximum=50.0, unit="px"
    )
    interest_threshold: float | None = option(None, "The threshold TB itself", name="threshold", advanced=True)
    super_threshold: float | None = option(None, "The threshold TA itself", advanced=True)
    interest_share: float = option(
        0.5,
        "Share of all local maxima that become interest points (sets the threshold TB)",
        name="share",
        minimum=0.0,
        maximum=1.0,
    )
    super_share: float = option(
        0.07, "Share of all local maxima that become super points (sets the threshold TA)", minimum=0.0, maximum=1.0
    )


@options
class DetectionOptions:
    """What to look for, and how much of it."""

    corners: CornerOptions = nest_options(CornerOptions)
    centres: CentreOptions = nest_options(CentreOptions)
    per_cell: int = option(
        0, "Keep so many of the best points of each detector in every cell, to spread them; 0 keeps all", minimum=0
    )
    cell_px: float = option(256.0, "Side of the cells", name="cell", minimum=8.0, unit="px")
    mask_saturated: bool = option(
        True, "Leave out areas of the largest grey value, where many pixels have it", advanced=True
    )
    threads: int = threads_option()

"""What interest points to look for, and how."""

from __future__ import annotations

from ...foundation.options import nest_options, option, options, threads_option

STRONG_QUALITY = 0.5  # a centre's chance to be found again in another view
CANDIDATE_QUALITY = 0.33  # what matching gets: the partner of a strong one may be weaker
#: Detectors (`detectors.DETECTORS`) by the name of a choice of them.
DETECTOR_SETS = {
    "harris": ("harris",), "foerstner": ("foerstner",), "centres": ("centres",), "all": ("harris", "centres"),
}  # fmt: skip


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
        0.5, "Share of all local maxima that become interest points (sets the threshold TB)", name="share", minimum=0.0,
        maximum=1.0,
    )  # fmt: skip
    super_share: float = option(
        0.07, "Share of all local maxima that become super points (sets the threshold TA)", minimum=0.0, maximum=1.0
    )


@options
class CentreOptions:
    """How gravity centres are found."""

    smallest_px: float = option(
        5.0, "Smallest diameter of an object with a gravity centre", name="smallest", minimum=4.0, unit="px"
    )
    largest_px: float = option(160.0, "Largest diameter", name="largest", minimum=8.0, maximum=512.0, unit="px")
    contrast: float = option(
        0.8, "Smallest contrast of an object, in standard deviations of its surroundings", minimum=0.0, advanced=True
    )
    quality: float = option(
        STRONG_QUALITY,
        "Smallest quality of a gravity centre: its chance to be found again in a second view, as measured on real "
        f"pairs of one date. Of those from {STRONG_QUALITY} two in three have been; {CANDIDATE_QUALITY} adds dark "
        "spots, of which in towns one in three has", minimum=0.0, maximum=1.0,
    )  # fmt: skip


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

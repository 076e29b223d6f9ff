"""How gravity centres are found."""

from __future__ import annotations

from ...foundation.options import option, options

STRONG_QUALITY = 0.5  # probability that a centre is found again in another view
CANDIDATE_QUALITY = 0.33  # limit for matching: the partner of a strong centre may be weaker


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
        "spots, of which in towns one in three has",
        minimum=0.0,
        maximum=1.0,
    )

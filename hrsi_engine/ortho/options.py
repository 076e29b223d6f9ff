"""Options of the matching of windows of two orthoimages."""

from __future__ import annotations

from ..foundation.options import option, options


@options
class MisregistrationOptions:
    """How windows are matched.

    max_sigma_px : largest standard deviation of a shift that is used
    """

    window_px: int = option(
        48, "Side of a window, even", name="window", minimum=16, maximum=512, unit="px", metavar="PX"
    )
    search_px: int = option(
        8,
        "Largest difference of the shift of a window from the common shift of the pair",
        name="search",
        minimum=1,
        maximum=256,
        unit="px",
        metavar="PX",
    )
    min_correlation: float = option(
        0.6, "Smallest correlation of windows that are used", minimum=0.0, maximum=1.0, advanced=True
    )
    max_sigma_px: float = 0.1
    most: int = option(
        40, "Windows along the longer side of the common ground", minimum=1, maximum=1000, advanced=True, metavar="N"
    )

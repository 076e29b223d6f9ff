"""How places of a reference orthoimage are found in images."""

from __future__ import annotations

from ...foundation.options import option, options, threads_option


@options
class ReferenceOptions:
    """Matching with the reference; descriptions of options are also their help on the command line and in the dialogs.

    Parameters
    ----------
    window_px : int
        Side of a place's window in working pixels, odd.
    reach_px : int
        Half length of the search for a place around its position by RPC and bias, in working pixels.
    node_px : float
        Distance in working pixels at which rays are computed.
    """

    points: int = option(
        300,
        "Windows of the reference that are searched in each image",
        name="reference-points",
        minimum=12,
        advanced=True,
        metavar="N",
    )
    search_px: float = option(
        1024.0,
        "Largest error of the RPCs against the reference (search distance)",
        name="reference-search",
        minimum=16.0,
        unit="px",
        advanced=True,
        metavar="PX",
    )
    window_px: int = 41
    reach_px: int = 8
    node_px: float = 4.0
    threads: int = threads_option()

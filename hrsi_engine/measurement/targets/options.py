"""Where a target may be, and how large."""

from __future__ import annotations

from ...foundation.options import option, options


@options
class TargetOptions:
    """Where a target may be, and how large."""

    search_px: float = option(15.0, "The target lies within this distance", name="search", minimum=1.0, unit="px")
    smallest_px: float = option(5.0, "Smallest diameter of a centre's object", name="smallest", minimum=4.0, unit="px")
    largest_px: float = option(80.0, "Largest diameter", name="largest", minimum=8.0, maximum=512.0, unit="px")

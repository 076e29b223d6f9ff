"""Matching by control networks (thesis chapter 3): two windows, nothing known of their cameras.

Layers, each importing only those above it::

    options        how two windows are matched
    leaves         leaves in polar coordinates, their tolerances (eqs. 3.4-3.6), one-to-one assignment
    super_points   the best pair of roots and starting points (§3.3.2), its significance and rivals
    views          the windows with their interest points, correlation of patches
    network        nodes and fathers, robust local maps through them
    growth         interest-point matching by sub-networks (§3.3.3), then least-squares matching
    seeding        which super points are matched with which

    matching       all of it, scale from features where it is unknown: `match_windows`
"""

from ...foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "options": "ControlNetworkOptions",
        "matching": "ControlNetworkMatch match_windows",
        "super_points": "AMBIGUOUS FOUND NO_MATCH",
    },
)

"""Matching by control networks (thesis chapter 3): two windows, nothing known of their cameras.

Layers, each importing only those above it::

    options        how two windows are matched
    tolerances     tolerances from the radius of local maxima, slope and incidence (eqs. 3.4-3.6)
    polar          distance and direction of leaves from their root
    assignment     one-to-one assignment
    voting         how many correspondences two roots can have at most
    super_points   the best pair of roots and starting points (§3.3.2), its significance and rivals
    local_affine   robust local maps through the network's nodes
    views          the windows with their interest points
    grey_values    correlation of patches
    network        nodes and fathers
    growth         interest-point matching by sub-networks (§3.3.3)
    seeding        which super points are matched with which
    refinement     least-squares matching, neighbours and epipolar geometry
    matching       all of it: `match_windows`
"""

from ...foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "options": "ControlNetworkOptions",
    "matching": "ControlNetworkMatch match_windows",
    "super_points": "AMBIGUOUS FOUND NO_MATCH",
})  # fmt: skip

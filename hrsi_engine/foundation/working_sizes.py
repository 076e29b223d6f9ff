"""Sizes that many computations share: parts in memory, grids of positions, lists of a report.

They decide on time, memory and length, not on results; sizes of one method alone are in its module.
"""

from .thresholds import threshold, thresholds


@thresholds
class MEMORY:
    """Parts that are read, computed or kept in memory together."""

    rows: int = threshold(20_000, "rows", "points, rays or measurements that are computed together")
    values: int = threshold(4_000_000, "values", "numbers of one kind in memory")
    images: int = threshold(64, "images", "images or pairs of images whose features are in memory")
    part_px: int = threshold(1024, "px", "side of a part of an image, or lines of it, that are read together")
    window_px: int = threshold(512, "px", "side of a window that is matched, or whose statistics are computed, as one")
    border_px: int = threshold(24, "px", "border of such parts, for filters and windows of matching")


@thresholds
class GRIDS:
    """Positions and cells that are distributed over an image or area."""

    parts: int = threshold(3, "parts", "parts along each side that are compared with each other")
    cells: int = threshold(10, "cells", "cells along each side, from which points are chosen evenly")
    coarse: int = threshold(5, "nodes", "nodes along each side at which a smooth difference is computed")
    fine: int = threshold(41, "nodes", "nodes along each side at which the terrain, or an edge, is found")
    nodes: int = threshold(15, "nodes", "nodes along each side at which two cameras are compared")


@thresholds
class LISTS:
    """Lengths of the lists of a report; longer ones show the worst."""

    rows: int = threshold(200, "rows", "points, outliers or images in a list")
    images: int = threshold(24, "images", "images with a drawing of their own")

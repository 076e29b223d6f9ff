"""How to find tie points."""

from __future__ import annotations

from ..foundation.options import option, options
from .tile_matching.options import TileMatchOptions

AUTOMATIC_CELLS = 0
FULL_PER_CELL, SAMPLED_PER_CELL = 40, 2  # points of a cell where all of an image is matched, and where windows are


@options
class TieOptions:
    """How to find tie points; what is said of each option is also its help on the command line and in the dialogs.

    Parameters
    ----------
    match : TileMatchOptions
        How two windows are matched, of images that are matched everywhere.
    match_sampled : TileMatchOptions
        The same for windows of larger images, where a few points of each are enough.
    match_linked : TileMatchOptions
        The same in blocks where every image has many partners, each of which needs fewer points.
    match_dense : TileMatchOptions
        The same where points are to be dense: heights of small windows mix less of roofs and ground.
    """

    margin_px: float = option(
        128.0,
        "How far the RPCs may be off when tie points are searched; the search widens where it finds nothing",
        name="search-margin",
        minimum=0.0,
        unit="px",
        advanced=True,
        metavar="PX",
    )
    cells: int = option(
        12,
        "Every image is divided into N x N cells, which are filled evenly with tie points",
        minimum=1,
        maximum=1000,
        advanced=True,
        metavar="N",
    )
    per_cell: int = option(
        AUTOMATIC_CELLS,
        f"Tie points of a cell; 0 takes {FULL_PER_CELL} for images up to 2048 px, which are matched everywhere, else "
        f"{SAMPLED_PER_CELL} from a small window in the cell",
        minimum=0,
        advanced=True,
        metavar="N",
    )
    dense: bool = option(
        False,
        "Match all of every image, with small windows first, and keep all tie points: for terrain through them "
        "(orthorectify's `terrain_points`); some 15 s of one core for a pair's megapixel",
        advanced=True,
    )
    most_partners: int = option(
        8,
        "Match each image with so many others on average: all that overlap where these are few, else those that a "
        "probe says will match, in spanning trees of the block",
        name="partners",
        minimum=1,
        advanced=True,
        metavar="N",
    )
    smallest_overlap: float = option(
        0.02,
        "Share of an image that another must show to be matched",
        name="min-overlap",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
        metavar="SHARE",
    )
    match: TileMatchOptions = TileMatchOptions()
    match_sampled: TileMatchOptions = TileMatchOptions(finders=(), most_points=24, windows_px=(31,), bands=("fine",))
    match_linked: TileMatchOptions = TileMatchOptions(finders=(), most_points=150, windows_px=(31,))
    match_dense: TileMatchOptions = TileMatchOptions(spacing_px=1.0, windows_px=(15, 21, 31, 41))

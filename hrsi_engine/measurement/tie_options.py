"""Options and thresholds of the search for tie points."""

from __future__ import annotations

from ..foundation.options import option, options
from ..foundation.thresholds import threshold, thresholds
from .tile_matching.options import TileMatchOptions

AUTOMATIC_CELLS = 0
_KAHRAMANMARAS = "Pléiades, Kahramanmaras, 2026-11-22 (docs/many_dates.md)"


@thresholds
class TIE_SEARCH:
    """Density and thoroughness of the search for tie points, and division of the work."""

    full_per_cell: int = threshold(40, "points", "tie points per cell of images matched everywhere, without `per_cell`")
    sampled_per_cell: int = threshold(2, "points", "tie points per cell with one matched window")
    completed_partners: int = threshold(2, "images", "smallest number of images with a point for a search in others")
    completed_sigma_px: float = threshold(0.12, "px", "largest sigma of such a point", _KAHRAMANMARAS)


@options
class TieOptions:
    """How to find tie points; the descriptions of options are also their help on the command line and in the dialogs.

    Parameters
    ----------
    match : TileMatchOptions
        Matching of two windows, for images that are matched everywhere.
    match_sampled : TileMatchOptions
        The same for windows of larger images, where a few points of each are sufficient.
    match_linked : TileMatchOptions
        The same in blocks where every image has many partners, each of which needs fewer points.
    match_dense : TileMatchOptions
        The same for dense points: heights of small windows are less often means of roof and ground.
    """

    margin_px: float = option(
        128.0,
        "Largest error of the RPCs in the search for tie points; it is increased where nothing is found",
        name="search-margin",
        minimum=0.0,
        unit="px",
        advanced=True,
        metavar="PX",
    )
    cells: int = option(
        12,
        "Every image is divided into N x N cells, over which tie points are spread evenly",
        minimum=1,
        maximum=1000,
        advanced=True,
        metavar="N",
    )
    per_cell: int = option(
        AUTOMATIC_CELLS,
        f"Tie points of a cell; 0 takes {TIE_SEARCH.full_per_cell} for images up to 2048 px, which are matched "
        f"everywhere, else {TIE_SEARCH.sampled_per_cell} from a small window in the cell",
        minimum=0,
        advanced=True,
        metavar="N",
    )
    dense: bool = option(
        False,
        "Match all of every image, with small windows first, and keep all tie points, for a terrain model from "
        "them (`terrain_points` of orthorectify); takes about 15 s of one core per megapixel of a pair",
        advanced=True,
    )
    most_partners: int = option(
        8,
        "Average number of images that each image is matched with: all that overlap if these are few, else those "
        "with the best test matches, in spanning trees of the block",
        name="partners",
        minimum=1,
        advanced=True,
        metavar="N",
    )
    smallest_overlap: float = option(
        0.02,
        "Smallest overlap of two images that are matched, as a share of the image",
        name="min-overlap",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
        metavar="SHARE",
    )
    match: TileMatchOptions = TileMatchOptions()
    match_sampled: TileMatchOptions = TileMatchOptions(features=0, most_points=24, windows_px=(31,), bands=("fine",))
    match_linked: TileMatchOptions = TileMatchOptions(features=0, most_points=150, windows_px=(31,))
    match_dense: TileMatchOptions = TileMatchOptions(spacing_px=1.0, windows_px=(15, 21, 31, 41))

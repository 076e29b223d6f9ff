"""Completion of tracks: points are searched in the images that lack them, where all cameras together predict them.

An image is the reference of the pairs with images after it, so a point that a later image's star has on two others is
not looked for in the earlier ones; and what failed where a pair alone predicted it may succeed where three images do.
"""

from dataclasses import dataclass

import numpy as np

from ...block.block import Image
from ...foundation.workers.scheduling import PartResult
from ..tile_matching.options import TileMatchOptions
from ..tile_matching.pair_matching import transfer_points
from .local_geometry import fit_local_geometry
from .star import Partner, PartnerMatches, stack_matches
from .windows import TIE_WINDOWS, ImageWindow, predict_window, read_tile


@dataclass(frozen=True, eq=False)
class TransferJob:
    """Points of a reference image with heights, and a partner in which they are searched.

    windows : parts of the reference; xy : (n, 2) whole pixels; height_m : (n,)
    """

    number: int
    reference: Image
    windows: tuple[ImageWindow, ...]
    xy: np.ndarray
    height_m: np.ndarray
    partner: Partner
    options: TileMatchOptions


def transfer_star(job: TransferJob) -> PartResult:
    """Return the points that are found, in the columns of `match_stars`."""
    rows, other = [], job.partner
    for window in job.windows:
        inside = window.contains(job.xy)
        if not inside.any():
            continue
        geometry = fit_local_geometry(other.geometry, window)
        shown = predict_window(geometry, window, TIE_WINDOWS.border_px)
        tiles = (
            read_tile(job.reference, window.grow(TIE_WINDOWS.border_px)),
            read_tile(other.image, shown.inside(other.image.known_size)),
        )
        if tiles[0] is None or tiles[1] is None:
            continue
        found = transfer_points(tiles[0], tiles[1], geometry, job.xy[inside], job.height_m[inside], job.options)
        rows.append(PartnerMatches(other.number, found))
    return stack_matches([row for row in rows if len(row.matches)])

"""Tie points around laser points: interest points near a laser point, measured in all images that show it.

Every laser point is projected into the image with the smallest incidence angle. A few interest points around it are
then searched in the other images at the position predicted with its height, and measured as other tie points, with
sigmas by the same rule (`block_matching.joining`). Of large images only the windows with laser points are read. The
assignment of tie points to laser points is not stored: the adjustment repeats it with the adjusted positions of the tie
points (`adjustment.external.laser_heights`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..block.block import Image
from ..block.columns import rank_in_groups
from ..block.imaging_geometry import compute_view_directions
from ..block.laser import LASER_KIND, LaserPoints
from ..block.points import ImagePoints
from ..foundation.progress import Progress, advance, silent
from ..foundation.thresholds import MEMORY, SAMPLES, threshold, thresholds
from ..foundation.workers.scheduling import open_calls
from .block_matching.joining import collect_matches, to_image_points
from .block_matching.star import PartnerMatches, stack_matches
from .block_matching.windows import ImageWindow, predict_window, read_tile
from .given_matches import EXTERNAL
from .tile_matching.features import detect_tile_points
from .tile_matching.options import TileMatchOptions
from .tile_matching.pair_matching import transfer_points
from .tile_matching.types import TilePairGeometry


@thresholds
class LASER_TIES:
    """Selection of laser points, and of tie points around them."""

    radius_m: float = threshold(15.0, "m", "largest distance of tie points", "footprints: ICESat-2 11 m, GEDI 25 m")


MATCHED_AT_LASER = TileMatchOptions(features=0, windows_px=(31, 21), spacing_px=8.0, reach_px=(8.0, 8.0))
LASER_TIE_IDS, SOURCE = "L", "laser points"  # prefix of the tie point ids


class _Window(NamedTuple):
    """Laser points in one window of an image: positions ``(n, 2)`` in px, ellipsoidal heights ``(n,)``."""

    image: int
    window: ImageWindow
    xy: np.ndarray
    height_m: np.ndarray


def measure_laser_ties(
    images: Sequence[Image], laser: LaserPoints, threads: int = 0, progress: Progress = silent
) -> ImagePoints:
    """Return tie points around laser points, measured in all images that show them.

    images : those with pixels are used; the RPCs should agree to a pixel, and with the ground to a few metres
    laser : a bounded number of points without a ``doubt`` is used, distributed evenly along the tracks
    """
    usable = [number for number, image in enumerate(images) if image.raster is not None]
    certain = np.flatnonzero(laser.doubt == "")
    rows = certain[np.lexsort((laser.ground[certain, 0], laser.ground[certain, 1], laser.track[certain]))]
    rows = rows[:: max(1, int(np.ceil(len(rows) / SAMPLES.large)))]
    windows = _plan_windows(images, usable, laser.ground[rows])
    with open_calls(threads=threads) as calls:
        matches_by_image = []
        for number, part in enumerate(calls.answers(lambda window: _measure_window(images, usable, window), windows)):
            advance(progress, (number + 1) / len(windows), "measuring at laser points")
            matches_by_image.append((windows[number].image, stack_matches(part)))
    matches = collect_matches(matches_by_image)
    if not len(matches):
        return ImagePoints([], [], np.empty((0, 2)), source=SOURCE)
    matches = replace(matches, kind=np.full(len(matches), LASER_KIND))
    points, _ = to_image_points(matches, images, 1, dict.fromkeys(range(len(images)), len(matches)))
    return replace(points, ids=np.char.add(LASER_TIE_IDS, points.ids), source=SOURCE)


def _plan_windows(images: Sequence[Image], usable: Sequence[int], ground: np.ndarray) -> list[_Window]:
    """Return the windows with laser points that two or more images show, each in the image with the steepest view."""
    steep = np.full((len(images), len(ground)), -np.inf)
    place = np.zeros((len(images), len(ground), 2))
    for number in usable:
        image = images[number]
        place[number] = image.rpc.project(ground)
        size = np.array(image.known_size, dtype=np.float64)
        with np.errstate(invalid="ignore"):
            inside = np.all((place[number] > MEMORY.border_px) & (place[number] < size - MEMORY.border_px), 1)
        steep[number, inside] = compute_view_directions(image.rpc, ground[inside])[:, 2]
    best = steep.argmax(axis=0)
    is_stereo = np.isfinite(steep).sum(axis=0) >= 2
    windows = []
    for number in usable:
        rows_of_image = np.flatnonzero(is_stereo & (best == number))
        cells = np.floor(place[number, rows_of_image] / MEMORY.window_px).astype(np.int64)
        keys, inverse = np.unique(cells, axis=0, return_inverse=True)
        for key in range(len(keys)):
            rows = rows_of_image[inverse.ravel() == key]
            xy = place[number, rows]
            border = _radius_px(images[number], ground[rows[0]]) + MEMORY.border_px
            low, high = np.floor(xy.min(axis=0) - border), np.ceil(xy.max(axis=0) + border)
            window = ImageWindow(int(low[0]), int(low[1]), int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
            windows.append(_Window(number, window.inside(images[number].known_size), xy, ground[rows, 2]))
    return windows


def _radius_px(image: Image, ground: np.ndarray) -> float:
    return LASER_TIES.radius_m * float(image.rpc.px_per_m(ground[None])[0])


def _measure_window(images: Sequence[Image], usable: Sequence[int], task: _Window) -> list[PartnerMatches]:
    """Return the matches between the interest points around a window's laser points and all other images."""
    image = images[task.image]
    tile = read_tile(image, task.window)
    if tile is None:
        return []
    ground, _ = image.rpc.localize(task.xy[:1], task.height_m[:1])
    xy = tile.to_image(detect_tile_points(tile, MATCHED_AT_LASER))
    distance, nearest = cKDTree(task.xy).query(xy) if len(xy) else (np.zeros(0), np.zeros(0, np.int64))
    candidates = np.flatnonzero(distance <= _radius_px(image, ground[0]))
    # The nearest interest points of each laser point
    candidates = candidates[np.lexsort((distance[candidates], nearest[candidates]))]
    candidates = candidates[rank_in_groups(nearest[candidates]) < SAMPLES.redundant]
    xy, height = xy[candidates], task.height_m[nearest[candidates]]
    if not len(xy):
        return []
    partner_matches, margin_m = [], EXTERNAL.height_margin_m
    low, high = float(task.height_m.min()) - margin_m, float(task.height_m.max()) + margin_m
    for number in (number for number in usable if number != task.image):
        partner = images[number]
        geometry = TilePairGeometry(image.rpc, partner.rpc, low, high, margin_px=(4.0, 4.0))
        partner_window = predict_window(geometry, task.window, MEMORY.border_px).inside(partner.known_size)
        partner_tile = (
            read_tile(partner, partner_window)
            if min(partner_window.samples, partner_window.lines) > 2 * MEMORY.border_px
            else None
        )
        if partner_tile is not None:
            matches = transfer_points(tile, partner_tile, geometry, xy, height, MATCHED_AT_LASER)
            partner_matches.append(PartnerMatches(number, matches))
    return partner_matches

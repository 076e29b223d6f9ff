"""Matching of the windows of one image with all images that show them.

The image is the *reference*: its interest points depend on it alone, so that a point found in several partners is one
point in many images, a star. Points found in some partners are searched again in the others, at the position predicted
with their height.

**Windows.** An image up to 2048 px is matched everywhere. In a larger one every cell of a grid gets a small window, and
further ones if the first yields too few points (water, cloud, nodata): only a fraction of the pixels is read.

**Local geometry.** The position in the second image of a point of the first is a smooth function of sample, line and
height. Over a window it is a cubic polynomial with an error far below 0.001 pixel (checked for every window). About
fifty evaluations of it, for a few points each, take a tenth of the time of localizing and projecting.

**Completion.** An image is the reference of its pairs with later images. A point of a later image's star in two others
is therefore not searched in earlier images, and a failed prediction from one pair may succeed with three images. So
points are searched in the images without them, at positions predicted from all cameras together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...camera.rpc import Localization
from ...camera.rpc_fit import FIT
from ...camera.rpc_terms import monomials
from ...foundation.thresholds import GROUND, ITERATIONS, MEMORY, SAMPLES
from ...foundation.workers.scheduling import PartResult
from ..tile_matching.epipolar import transfer
from ..tile_matching.options import TileMatchOptions
from ..tile_matching.pair_matching import match_tile, transfer_points
from ..tile_matching.types import ImageTile, TileMatches, TilePairGeometry
from .windows import TIE_WINDOWS, ImageWindow, compute_height_limits, predict_window, read_tile

_AXIS = -np.cos(np.pi * np.arange(5) / 4.0)  # Chebyshev nodes, including the ends
_NODES = np.stack(np.meshgrid(_AXIS, _AXIS, _AXIS), axis=-1).reshape(-1, 3)
_TERMS = monomials(_NODES.T)
_FIT = np.linalg.pinv(_TERMS.T)


@dataclass(frozen=True, eq=False)
class _LocalTransfer:
    """Replaces both RPCs: its ground is sample, line and height of the first image, projected by a cubic polynomial."""

    height_range: tuple[float, float]
    middle: np.ndarray
    reach: np.ndarray
    coefficients: np.ndarray  #: (20, 2)

    def localize(self, image: np.ndarray, height_m: np.ndarray | float) -> Localization:
        ground = np.empty((len(image), 3))
        ground[:, :2], ground[:, 2] = image, height_m
        return Localization(ground, np.ones(len(image), dtype=bool))

    def project(self, ground: np.ndarray) -> np.ndarray:
        return np.asarray(monomials(((ground - self.middle) / self.reach).T).T @ self.coefficients)


def fit_local_geometry(geometry: TilePairGeometry, window: ImageWindow, border: int = 32) -> TilePairGeometry:
    """Return the geometry of a pair as polynomials that are valid in a window of the first image and at its heights.

    The geometry of the pair is returned unchanged if a cubic polynomial is not accurate enough.
    """
    corners = np.array([(window.sample, window.line), (window.sample + window.samples, window.line + window.lines)])
    low, high = compute_height_limits(geometry, corners.astype(np.float64))
    bottom, top = float(low.min()) - 2.0 * GROUND.margin_m, float(high.max()) + 2.0 * GROUND.margin_m
    middle = np.array([*corners.mean(axis=0), 0.5 * (bottom + top)])
    reach = np.array([0.5 * window.samples + border, 0.5 * window.lines + border, 0.5 * (top - bottom)])
    nodes = middle + reach * _NODES
    positions = transfer(geometry.first, geometry.second, nodes[:, :2], nodes[:, 2])
    if not np.isfinite(positions).all():
        return geometry
    coefficients = _FIT @ positions
    if np.abs(_TERMS.T @ coefficients - positions).max() > FIT.good_px:
        return geometry
    local_transfer = _LocalTransfer(geometry.first.height_range, middle, reach, coefficients)
    return replace(geometry, first=local_transfer, second=local_transfer)


@dataclass(frozen=True, eq=False)
class Partner:
    """An image that shows windows of the reference: its index in the block, its geometry and reduction factor."""

    number: int
    image: Image
    geometry: TilePairGeometry
    step: int = 1


@dataclass(frozen=True, eq=False)
class Cell:
    """A part of the reference: windows that are matched one after the other, until one yields ``enough`` points.

    own : of each window, the part whose points are used: windows overlap, their own parts do not
    """

    windows: tuple[ImageWindow, ...]
    own: tuple[ImageWindow, ...]
    enough: int
    most: int  #: limit of the points kept of a window, 0 for all


@dataclass(frozen=True, eq=False)
class StarJob:
    """Cells of one reference image and the images that may show them."""

    number: int
    reference: Image
    cells: tuple[Cell, ...]
    partners: tuple[Partner, ...]
    options: TileMatchOptions
    step: int = 1


class PartnerMatches(NamedTuple):
    """Matches of a window with one partner."""

    partner: int
    matches: TileMatches


def match_stars(job: StarJob) -> PartResult:
    """Return all matches of a job as columns, one row for each match.

    ``first_xy``, ``second_xy (n, 2)``, ``partner (n,)`` index of the second image, ``sigma_px``, ``quality``,
    ``kind``, ``height_m (n,)`` apparent heights of the pair. Matches with equal ``first_xy`` are of one point.
    """
    options = {partner.number: job.options for partner in job.partners}
    return stack_matches([row for cell in job.cells for row in _match_cell(job, cell, options)])


def stack_matches(rows: Sequence[PartnerMatches]) -> PartResult:
    """Return matches of windows with partners as the columns described in `match_stars`."""
    if not rows:
        nothing = np.empty(0)
        return {
            "first_xy": np.empty((0, 2)),
            "second_xy": np.empty((0, 2)),
            "partner": np.empty(0, np.int64),
            "sigma_px": nothing,
            "quality": nothing,
            "kind": np.empty(0, "U9"),
            "height_m": nothing,
        }
    columns = {
        name: np.concatenate([getattr(row.matches, name) for row in rows])
        for name in ("first_xy", "second_xy", "sigma_px", "quality", "kind", "height_m")
    }
    return columns | {"partner": np.repeat([row.partner for row in rows], [len(row.matches) for row in rows])}


def _match_cell(job: StarJob, cell: Cell, options: dict[int, TileMatchOptions]) -> Iterator[PartnerMatches]:
    """Match the windows of a cell in turn, each with the partners that still have too few points in the cell.

    ``options`` are those of each partner; the band selected in one window is used in the following ones.
    """
    lacking = list(job.partners)
    for window, own_window in zip(cell.windows, cell.own, strict=True):
        if not lacking:
            return
        local_partners = [
            replace(partner, geometry=fit_local_geometry(partner.geometry, window)) for partner in lacking
        ]
        # Windows of the partners that show a sufficient part of this window
        visible = []
        for partner in local_partners:
            border = MEMORY.border_px * partner.step
            place = predict_window(partner.geometry, window, border).inside(partner.image.known_size)
            if min(place.samples, place.lines) >= TIE_WINDOWS.side_px + border:
                visible.append((partner, place))
        tile = read_tile(job.reference, window, job.step) if visible else None
        if tile is None or tile.valid.mean() < TIE_WINDOWS.valid_share:
            continue
        rows = _limit_points(_match_window(tile, own_window, visible, options), cell.most)
        yield from rows
        satisfied = {row.partner for row in rows if len(row.matches) >= cell.enough}
        lacking = [partner for partner in lacking if partner.number not in satisfied]


def _match_window(
    tile: ImageTile,
    own_window: ImageWindow,
    places: Sequence[tuple[Partner, ImageWindow]],
    options: dict[int, TileMatchOptions],
) -> list[PartnerMatches]:
    """Match one window with its predicted windows in partners, then transfer points found in only some of them."""
    partner_tiles = [(partner, read_tile(partner.image, place, partner.step)) for partner, place in places]
    tiles = [(partner, partner_tile) for partner, partner_tile in partner_tiles if partner_tile is not None]
    matches_of_partners = []
    for partner, partner_tile in tiles:
        match_options = options[partner.number]
        ways = [
            match_tile(tile, partner_tile.times(c), partner.geometry, match_options) for c in partner.geometry.contrasts
        ]
        matches = join_tile_matches(ways) if len(ways) > 1 else ways[0]
        if len(ways) > 1:  # if a point is matched in both contrasts, the better match is kept
            best = np.argsort(-matches.quality, kind="stable")
            _, first = np.unique(_make_keys(matches.first_xy[best]), return_index=True)
            matches = matches.select(np.sort(best[first]))
        if matches.band:
            options[partner.number] = replace(match_options, bands=(matches.band,))
        matches_of_partners.append(matches.select(own_window.contains(matches.first_xy)))
    if len(tiles) > 1:
        matches_of_partners = [
            _complete_partner(index, tile, tiles, matches_of_partners, options[partner.number])
            for index, (partner, _) in enumerate(tiles)
        ]
    return [
        PartnerMatches(partner.number, matches)
        for (partner, _), matches in zip(tiles, matches_of_partners, strict=True)
        if len(matches)
    ]


def _complete_partner(
    index: int,
    tile: ImageTile,
    tiles: Sequence[tuple[Partner, ImageTile]],
    matches_of_partners: Sequence[TileMatches],
    options: TileMatchOptions,
) -> TileMatches:
    """Return a partner's matches, with points added that were found at heights determined by other partners."""
    own_matches = matches_of_partners[index]
    transferred = [
        _transfer_heights(own_matches, matches)
        for k, matches in enumerate(matches_of_partners)
        if k != index and len(matches)
    ]
    if not transferred:
        return own_matches
    xy, height = (np.concatenate(part) for part in zip(*transferred, strict=True))
    xy, first = np.unique(xy, axis=0, return_index=True)
    new = ~np.isin(_make_keys(xy), _make_keys(own_matches.first_xy))
    if not new.any():
        return own_matches
    partner, partner_tile = tiles[index]
    partner_tile = partner_tile.times(partner.geometry.contrasts[0])
    geometry = (
        replace(partner.geometry, bias_px=tuple(own_matches.bias_px.tolist())) if len(own_matches) else partner.geometry
    )
    added = transfer_points(tile, partner_tile, geometry, xy[new], height[first][new], options)
    return join_tile_matches([own_matches, added]) if len(added) else own_matches


def _transfer_heights(own_matches: TileMatches, other_matches: TileMatches) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of another partner with their heights converted to apparent heights of this pair.

    Apparent heights of two pairs differ by the errors of the RPCs along the lines; the median of common points is used.
    """
    _, mine, theirs = np.intersect1d(
        _make_keys(own_matches.first_xy), _make_keys(other_matches.first_xy), return_indices=True
    )
    shift = (
        np.median(own_matches.height_m[mine] - other_matches.height_m[theirs]) if len(mine) >= SAMPLES.plane else 0.0
    )
    return other_matches.first_xy, other_matches.height_m + shift


def _make_keys(xy: np.ndarray) -> np.ndarray:
    """Return positions ``(n, 2)`` as one number each; they are multiples of half a pixel."""
    return np.round(2.0 * xy[:, 0]) * 2.0**32 + np.round(2.0 * xy[:, 1])


def join_tile_matches(tables: Sequence[TileMatches]) -> TileMatches:
    """Return the concatenated rows of several matches of the same pair."""
    names = ("first_xy", "second_xy", "sigma_px", "quality", "kind", "height_m")
    columns = {name: np.concatenate([getattr(table, name) for table in tables]) for name in names}
    return TileMatches(**columns, bias_px=tables[0].bias_px, band=tables[0].band)


def _limit_points(rows: list[PartnerMatches], limit: int) -> list[PartnerMatches]:
    """Return at most ``limit`` points of each partner: those found in most partners first, then the best."""
    if not limit or not rows:
        return rows
    keys = np.concatenate([_make_keys(row.matches.first_xy) for row in rows])
    quality = np.concatenate([row.matches.quality for row in rows])
    points, inverse, count = np.unique(keys, return_inverse=True, return_counts=True)
    mean = np.bincount(inverse, quality) / count
    place = np.empty(len(points), dtype=np.int64)
    place[np.lexsort((points, -mean, -count))] = np.arange(len(points))
    thinned, start = [], 0
    for row in rows:
        ranks = place[inverse[start : start + len(row.matches)]]
        thinned.append(
            PartnerMatches(row.partner, row.matches.select(np.sort(np.argsort(ranks, kind="stable")[:limit])))
        )
        start += len(row.matches)
    return thinned


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
    """Return the points that were found, in the columns of `match_stars`."""
    rows, partner = [], job.partner
    for window in job.windows:
        inside = window.contains(job.xy)
        if not inside.any():
            continue
        geometry = fit_local_geometry(partner.geometry, window)
        partner_window = predict_window(geometry, window, MEMORY.border_px).inside(partner.image.known_size)
        reference_tile = read_tile(job.reference, window.grow(MEMORY.border_px))
        partner_tile = read_tile(partner.image, partner_window)
        if reference_tile is not None and partner_tile is not None:
            transferred = transfer_points(
                reference_tile, partner_tile, geometry, job.xy[inside], job.height_m[inside], job.options
            )
            rows.append(PartnerMatches(partner.number, transferred))
    return stack_matches([row for row in rows if len(row.matches)])


def is_matched_everywhere(image: Image, step: int = 1) -> bool:
    """Return whether all windows of an image are matched."""
    return max(image.known_size) <= TIE_WINDOWS.full_px * step


def plan_cells(image: Image, cells: int, per_cell: int, step: int = 1) -> list[list[Cell]]:
    """Return the cells of an image, as a list for each row of cells; the cells of a row share the lines that are read.

    step : reduction factor of the windows; they cover ``step`` times as many pixels
    """
    size, side, everywhere = image.known_size, TIE_WINDOWS.window_px * step, is_matched_everywhere(image, step)
    counts = (
        max(1, round(length / (MEMORY.window_px * step)) if everywhere else min(cells, length // side))
        for length in size
    )
    columns, rows = (
        [length * k // count for k in range(count + 1)] for length, count in zip(size, counts, strict=True)
    )
    grid = []
    for top, bottom in pairwise(rows):
        row = []
        for left, right in pairwise(columns):
            if everywhere:
                own_window = ImageWindow(left, top, right - left, bottom - top)
                row.append(Cell((own_window.grow(MEMORY.border_px * step).inside(size),), (own_window,), 0, 0))
                continue
            places = _place_windows(left, right, top, bottom, side, size)
            windows = tuple(ImageWindow(sample, line, side, side).inside(size) for sample, line in places)
            row.append(Cell(windows, windows, per_cell, TIE_WINDOWS.surplus * per_cell))
        grid.append(row)
    return grid


def _place_windows(
    left: int, right: int, top: int, bottom: int, side: int, size: tuple[int, int]
) -> list[tuple[int, int]]:
    """Return the positions of a cell's windows: the file's tile at the centre first, then others far from it."""
    samples, lines = (
        [
            start
            for start in range(first // side * side, last, side)
            if start >= first - side // 2 and start + side // 2 <= last
        ]
        or [max(0, min((first + last - side) // 2, image_length - side))]
        for first, last, image_length in ((left, right, size[0]), (top, bottom, size[1]))
    )
    middle = ((left + right - side) / 2.0, (top + bottom - side) / 2.0)
    places = [(sample, line) for line in lines for sample in samples]
    places.sort(key=lambda place: (place[0] - middle[0]) ** 2 + (place[1] - middle[1]) ** 2)
    selected = places[:1]
    while len(selected) < min(ITERATIONS.repeated, len(places)):  # the one farthest from those selected
        remaining = [place for place in places if place not in selected]
        selected.append(
            max(remaining, key=lambda place: min((place[0] - s) ** 2 + (place[1] - t) ** 2 for s, t in selected))
        )
    return selected

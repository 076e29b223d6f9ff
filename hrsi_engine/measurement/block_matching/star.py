"""The work on windows of one image: match each with all images that see it.

The image is the *reference*: its interest points depend on it alone, so that a point found in several partners is one
point on many images, a star. What some partners show and others do not give at once is looked for there again, at the
place where the known height puts it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...foundation.workers.scheduling import PartResult
from ..tile_matching.options import TileMatchOptions
from ..tile_matching.pair_matching import match_tile, transfer_points
from ..tile_matching.types import ImageTile, TileMatches, TilePairGeometry
from .local_geometry import fit_local_geometry
from .windows import TIE_WINDOWS, ImageWindow, predict_window, read_tile


@dataclass(frozen=True, eq=False)
class Partner:
    """An image that sees windows of the reference: its number in the block, where it sees them, at what resolution."""

    number: int
    image: Image
    geometry: TilePairGeometry
    step: int = 1


@dataclass(frozen=True, eq=False)
class Cell:
    """A part of the reference that wants points: windows to try one after the other, until one gives ``enough``.

    own : of each window, the part whose points count: windows overlap, their own parts do not
    """

    windows: tuple[ImageWindow, ...]
    own: tuple[ImageWindow, ...]
    enough: int
    most: int  #: points that are kept of a window, 0 for all


@dataclass(frozen=True, eq=False)
class StarJob:
    """Cells of one reference image and the images that may see them."""

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
    """Return all matches of a job as columns, one row a match.

    ``first_xy``, ``second_xy (n, 2)``, ``partner (n,)`` the number of the second image, ``sigma_px``, ``quality``,
    ``kind``, ``height_m (n,)`` apparent heights of the pair. PartnerMatches with equal ``first_xy`` are one point.
    """
    options = {partner.number: job.options for partner in job.partners}
    return stack_matches([row for cell in job.cells for row in _match_cell(job, cell, options)])


def stack_matches(rows: Sequence[PartnerMatches]) -> PartResult:
    """Return matches of windows with partners as the columns that `match_stars` tells of."""
    if not rows:
        nothing = np.empty(0)
        return {"first_xy": np.empty((0, 2)), "second_xy": np.empty((0, 2)), "partner": np.empty(0, np.int64),
                "sigma_px": nothing, "quality": nothing, "kind": np.empty(0, "U9"), "height_m": nothing}  # fmt: skip
    columns = {
        name: np.concatenate([getattr(row.matches, name) for row in rows])
        for name in ("first_xy", "second_xy", "sigma_px", "quality", "kind", "height_m")
    }
    return columns | {"partner": np.repeat([row.partner for row in rows], [len(row.matches) for row in rows])}


def _match_cell(job: StarJob, cell: Cell, options: dict[int, TileMatchOptions]) -> Iterator[PartnerMatches]:
    """Match the windows of a cell in turn, each with the partners that still lack points in the cell.

    ``options`` are those of each partner: the band chosen in one window is used in the others.
    """
    lacking = list(job.partners)
    for window, own in zip(cell.windows, cell.own, strict=True):
        if not lacking:
            return
        near = [replace(partner, geometry=fit_local_geometry(partner.geometry, window)) for partner in lacking]
        # The windows of partners that show this window, where they show a useful part of it
        seen = []
        for partner in near:
            border = TIE_WINDOWS.border_px * partner.step
            place = predict_window(partner.geometry, window, border).inside(partner.image.known_size)
            if min(place.samples, place.lines) >= TIE_WINDOWS.side_px + border:
                seen.append((partner, place))
        tile = read_tile(job.reference, window, job.step) if seen else None
        if tile is None or tile.valid.mean() < TIE_WINDOWS.valid_share:
            continue
        rows = _limit_points(_match_window(tile, own, seen, options), cell.most)
        yield from rows
        satisfied = {row.partner for row in rows if len(row.matches) >= cell.enough}
        lacking = [partner for partner in lacking if partner.number not in satisfied]


def _match_window(
    tile: ImageTile, own: ImageWindow, places: Sequence[tuple[Partner, ImageWindow]],
    options: dict[int, TileMatchOptions],
) -> list[PartnerMatches]:  # fmt: skip
    """Match one window with its places in partners, then transfer what only some of them gave."""
    shown = [(partner, read_tile(partner.image, place, partner.step)) for partner, place in places]
    tiles = [(partner, other) for partner, other in shown if other is not None]
    found = []
    for partner, other in tiles:
        how = options[partner.number]
        ways = [match_tile(tile, other.times(c), partner.geometry, how) for c in partner.geometry.contrasts]
        matches = ways[0] if len(ways) == 1 else _merge_contrasts(ways)
        if matches.band:
            options[partner.number] = replace(how, bands=(matches.band,))
        found.append(matches.select(own.contains(matches.first_xy)))
    if len(tiles) > 1:
        found = [
            _complete_partner(index, tile, tiles, found, options[partner.number])
            for index, (partner, _) in enumerate(tiles)
        ]
    return [
        PartnerMatches(partner.number, matches)
        for (partner, _), matches in zip(tiles, found, strict=True)
        if len(matches)
    ]


def _merge_contrasts(ways: Sequence[TileMatches]) -> TileMatches:
    """Return the matches of a window in one contrast or another; of a point in both, the better one."""
    joined = join_tile_matches(ways)
    best = np.argsort(-joined.quality, kind="stable")
    _, first = np.unique(_make_keys(joined.first_xy[best]), return_index=True)
    return joined.select(np.sort(best[first]))


def _complete_partner(
    index: int, tile: ImageTile, tiles: Sequence[tuple[Partner, ImageTile]], found: Sequence[TileMatches],
    options: TileMatchOptions,
) -> TileMatches:  # fmt: skip
    """Return a partner's matches with those added that the others' heights lead to."""
    own = found[index]
    others = [_transfer_heights(own, matches) for k, matches in enumerate(found) if k != index and len(matches)]
    if not others:
        return own
    xy, height = (np.concatenate(part) for part in zip(*others, strict=True))
    xy, first = np.unique(xy, axis=0, return_index=True)
    new = ~np.isin(_make_keys(xy), _make_keys(own.first_xy))
    if not new.any():
        return own
    partner, other = tiles[index]
    other = other.times(partner.geometry.contrasts[0])
    geometry = replace(partner.geometry, bias_px=tuple(own.bias_px.tolist())) if len(own) else partner.geometry
    added = transfer_points(tile, other, geometry, xy[new], height[first][new], options)
    return join_tile_matches([own, added]) if len(added) else own


def _transfer_heights(own: TileMatches, other: TileMatches) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of another partner with their heights as this pair would see them.

    Apparent heights of two pairs differ by what the RPCs are off along the lines; common points tell how much.
    """
    _, mine, theirs = np.intersect1d(_make_keys(own.first_xy), _make_keys(other.first_xy), return_indices=True)
    shift = np.median(own.height_m[mine] - other.height_m[theirs]) if len(mine) >= TIE_WINDOWS.fewest_common else 0.0
    return other.first_xy, other.height_m + shift


def _make_keys(xy: np.ndarray) -> np.ndarray:
    """Return positions ``(n, 2)`` as one number each; they are whole pixels or halves of them."""
    return np.round(2.0 * xy[:, 0]) * 2.0**32 + np.round(2.0 * xy[:, 1])


def join_tile_matches(tables: Sequence[TileMatches]) -> TileMatches:
    """Return the rows of several matches of the same pair in one."""
    names = ("first_xy", "second_xy", "sigma_px", "quality", "kind", "height_m")
    columns = {name: np.concatenate([getattr(table, name) for table in tables]) for name in names}
    return TileMatches(**columns, bias_px=tables[0].bias_px, band=tables[0].band)


def _limit_points(rows: list[PartnerMatches], most: int) -> list[PartnerMatches]:
    """Keep the points of a window that most partners show, then the best: at most ``most`` of each partner."""
    if not most or not rows:
        return rows
    keys = np.concatenate([_make_keys(row.matches.first_xy) for row in rows])
    quality = np.concatenate([row.matches.quality for row in rows])
    points, inverse, count = np.unique(keys, return_inverse=True, return_counts=True)
    mean = np.bincount(inverse, quality) / count
    place = np.empty(len(points), dtype=np.int64)
    place[np.lexsort((points, -mean, -count))] = np.arange(len(points))
    thinned, start = [], 0
    for row in rows:
        own = place[inverse[start : start + len(row.matches)]]
        thinned.append(PartnerMatches(row.partner, row.matches.select(np.sort(np.argsort(own, kind="stable")[:most]))))
        start += len(row.matches)
    return thinned

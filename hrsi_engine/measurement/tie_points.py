"""Automatic tie points of a block: features matched in windows that the RPCs predict, joined into tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..block import Image, ImagePoints
from ..errors import InputError
from ..progress import Progress, advance, silent
from .epipolar import overlap_window
from .features import FeatureStore
from .matching import mutual_matches, rpc_consistent
from .tracks import consistent_tracks, spread


@dataclass(frozen=True)
class TieOptions:
    """How to find tie points.

    heights_m : lowest and highest terrain (ellipsoidal); None takes the RPCs' height ranges
    margin_px : error of the RPCs that the search windows allow for
    per_tile : features per tile of about 1024 px; tiles_per_pair : tiles of the first image that are matched
    cells, per_cell : an image is divided into cells x cells, each of which is filled with that many points
    sigma_px : standard deviation of a matched position
    """

    heights_m: tuple[float, float] | None = None
    margin_px: float = 128.0
    per_tile: int = 8000
    tiles_per_pair: int = 25
    cells: int = 16
    per_cell: int = 12
    minimum: int = 8
    sigma_px: float = 0.3


class PairMatches(NamedTuple):
    """Matches of two images (indices): keypoint numbers on each."""

    first: int
    second: int
    first_number: np.ndarray
    second_number: np.ndarray


class TiePoints(NamedTuple):
    """Image points of all tracks, matches per pair of image ids, and what a user should know."""

    image_points: ImagePoints
    matches: dict[tuple[str, str], int]
    warnings: tuple[str, ...]


def find_tie_points(
    images: Sequence[Image], options: TieOptions | None = None, progress: Progress = silent
) -> TiePoints:
    """Find tie points between all overlapping images with pixels.

    Raises `InputError` when fewer than two images have pixels or no two of them overlap.
    """
    options = options or TieOptions()
    usable = [index for index, image in enumerate(images) if image.raster is not None]
    if len(usable) < 2:
        raise InputError("tie points need two images with pixels: give image files, or --tie-points none or FILE")
    stores = {index: FeatureStore(images[index], options.per_tile) for index in usable}
    pairs = [(a, b) for a, b in combinations(usable, 2) if _tiles_seen(stores[a], stores[b], options)]
    if not pairs:
        raise InputError(
            "no two images overlap between the heights of their RPCs: check that they show the same area, or name "
            "the terrain's heights with --dem"
        )
    found, warnings = [], []
    for done, (a, b) in enumerate(pairs):
        advance(progress, done / len(pairs), f"matching {images[a].id} and {images[b].id}")
        matches = _match_pair(a, b, stores, options)
        if len(matches.first_number) < options.minimum:
            warnings.append(f"{images[a].id} and {images[b].id}: {len(matches.first_number)} matches only, not used")
            continue
        found.append(matches)
    counts = {(images[m.first].id, images[m.second].id): len(m.first_number) for m in found}
    return TiePoints(_image_points(images, stores, found, options), counts, tuple(warnings))


def _heights(first: Image, second: Image, options: TieOptions) -> tuple[float, float]:
    if options.heights_m is not None:
        return options.heights_m
    (low1, high1), (low2, high2) = first.rpc.height_range, second.rpc.height_range
    low, high = max(low1, low2), min(high1, high2)
    return (low, high) if low < high else (min(low1, low2), max(high1, high2))


def _tiles_seen(first: FeatureStore, second: FeatureStore, options: TieOptions) -> list[tuple[int, tuple]]:
    """Return the tiles of the first image that the second can see, with the window to search there."""
    assert second.image.size is not None
    columns, rows = first.tile_grid
    width, height = second.image.size
    heights = _heights(first.image, second.image, options)
    seen = []
    for tile in range(columns * rows):
        s0, l0, samples, lines = first.window(tile)
        window = overlap_window(
            first.image.rpc, second.image.rpc, (s0, s0 + samples - 1, l0, l0 + lines - 1), heights, options.margin_px
        )
        if window[1] >= 0 and window[0] <= width - 1 and window[3] >= 0 and window[2] <= height - 1:
            seen.append((tile, window))
    return seen


def _evenly(items: list, most: int) -> list:
    """Return at most ``most`` items, evenly from the list."""
    if len(items) <= most:
        return items
    return [items[int(index)] for index in np.linspace(0, len(items) - 1, most).round()]


def _match_pair(a: int, b: int, stores: dict[int, FeatureStore], options: TieOptions) -> PairMatches:
    first, second = stores[a], stores[b]
    height = float(np.mean(_heights(first.image, second.image, options)))
    numbers: list[tuple[np.ndarray, np.ndarray]] = []
    positions: list[tuple[np.ndarray, np.ndarray]] = []
    for tile, window in _evenly(_tiles_seen(first, second, options), options.tiles_per_pair):
        features = first.tile(tile)
        xy, descriptors, number = second.inside(window)
        i, j = mutual_matches(features.descriptors, descriptors)
        numbers.append((features.first_number + i, number[j]))
        positions.append((features.xy[i], xy[j]))
    first_number, second_number = (np.concatenate(part) for part in zip(*numbers, strict=True))
    first_xy, second_xy = (np.concatenate(part) for part in zip(*positions, strict=True))
    good = rpc_consistent(first.image.rpc, second.image.rpc, first_xy, second_xy, height)
    return PairMatches(a, b, first_number[good], second_number[good])


def _image_points(
    images: Sequence[Image], stores: dict[int, FeatureStore], found: list[PairMatches], options: TieOptions
) -> ImagePoints:
    """Join matches into tracks, thin them out and number them."""
    if not found:
        return ImagePoints.create([], [], np.empty((0, 2)))
    all_xy = {index: store.positions() for index, store in stores.items()}
    offset = dict(zip(stores, np.cumsum([0] + [len(all_xy[k]) for k in stores])[:-1], strict=True))
    image_of_node = np.concatenate([np.full(len(all_xy[k]), k) for k in stores])
    xy = np.concatenate([all_xy[k] for k in stores])
    first = np.concatenate([offset[m.first] + m.first_number for m in found])
    second = np.concatenate([offset[m.second] + m.second_number for m in found])
    track = consistent_tracks(first, second, image_of_node)
    nodes = np.flatnonzero(track >= 0)
    confirmed = np.bincount(track[first][track[first] >= 0], minlength=track.max() + 1).astype(float)
    cell_px = np.array([np.maximum(np.array(image.size or (1, 1)) / options.cells, 1.0) for image in images])
    keep = spread(track[nodes], image_of_node[nodes], xy[nodes], confirmed, cell_px, options.per_cell)
    nodes = nodes[keep[track[nodes]]]
    number = np.cumsum(keep)[track[nodes]]
    width = len(str(int(keep.sum())))
    ids = np.char.add("T", np.char.zfill(number.astype(str), width))
    image_ids = np.array([image.id for image in images])[image_of_node[nodes]]
    return ImagePoints.create(
        ids, image_ids, xy[nodes], options.sigma_px, "sift", confirmed[track[nodes]], "tie points"
    )

"""SIFT (Lowe 2004) by NumPy and SciPy, for Python without OpenCV, with the scales, tests and orientations of OpenCV.

The image is enlarged by 2 and smoothed step by step; features are extrema of the differences of neighbouring scales in
position and scale, refined to the vertex of a paraboloid; edges and low contrast are rejected. A descriptor is a
histogram of gradient directions, relative to the feature's orientation, over 4 x 4 parts of its surroundings. The
sampling differs from OpenCV: a grid of 20 x 20 places is rotated and scaled with the feature, so that the share of each
place in each part is one matrix for all features.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ...foundation.pixel_filters import blur
from ...foundation.thresholds import threshold, thresholds

_LOWE = "Lowe 2004"


@thresholds
class SIFT:
    """Parameters of SIFT (Lowe 2004), with the values of OpenCV."""

    layers: int = threshold(3, "scales", "scales of an octave", _LOWE)
    first_sigma_px: float = threshold(1.6, "px", "sigma of the Gaussian of the first scale", _LOWE)
    image_sigma_px: float = threshold(0.5, "px", "assumed blur of the image (Gaussian)", _LOWE)
    edge_ratio: float = threshold(10.0, "", "largest ratio of principal curvatures (a larger one is an edge)", _LOWE)
    border_px: int = threshold(5, "px", "border of an octave without features", "OpenCV")
    moves: int = threshold(5, "moves", "largest number of moves to the extremum", "OpenCV")
    bins: int = threshold(36, "bins", "bins of the histogram of directions", _LOWE)
    second_peak: float = threshold(0.8, "", "share of the largest peak from which a direction is a new feature", _LOWE)
    reach: float = threshold(4.5, "scales", "half side of the square of gradients in the histogram", _LOWE)
    weight_sigma: float = threshold(1.5, "scales", "sigma of the Gaussian weights of gradients", _LOWE)
    part_scales: float = threshold(3.0, "scales", "side of a cell of the descriptor", "OpenCV")
    places: int = threshold(4, "places", "samples along a cell's side", "as good as OpenCV's, 2026-11-22")
    largest_share: float = threshold(0.2, "", "largest component of a descriptor over its length", _LOWE)
    batch: int = threshold(256, "features", "number of features described together (memory)")


DESCRIPTOR_PARTS, TURNS = 4, 8  # parts along each side of a descriptor, and directions in each part


class _Extrema(NamedTuple):
    """Features of an octave: nearest layer and pixel, position (pixels of the octave), scale, contrast."""

    layer: np.ndarray
    row: np.ndarray
    column: np.ndarray
    xy: np.ndarray
    sigma: np.ndarray
    contrast: np.ndarray


def detect_sift_by_numpy(
    grey: np.ndarray, usable: np.ndarray, most: int, contrast: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions ``(n, 2)``, strengths ``(n,)`` and descriptors ``(n, 128)`` uint8 of the strongest.

    ``grey`` has 8 bit; features are at usable pixels; ``contrast`` is the lower limit, as a share of the range.
    """
    octaves = []
    for size_px, scales in _build_octaves(grey):
        found = _find_extrema(scales, contrast)
        xy = found.xy * size_px
        column, row = np.clip(np.rint(xy).astype(np.int64), 0, np.array(grey.shape[::-1]) - 1).T
        keep = usable[row, column]
        octaves.append((size_px, scales, _Extrema(*(values[keep] for values in found))))
    strengths = np.concatenate([found.contrast for _, _, found in octaves])
    least = np.partition(strengths, -most)[-most] if len(strengths) > most else 0.0
    described = []
    for size_px, scales, found in octaves:
        strong = _Extrema(*(values[found.contrast >= least] for values in found))
        for layer in np.unique(strong.layer).tolist():
            part = _Extrema(*(values[strong.layer == layer] for values in strong))
            feature, angle = _assign_directions(scales[layer], part)
            descriptors = _describe(scales[layer], part.xy[feature], part.sigma[feature], angle)
            described.append((part.xy[feature] * size_px, part.contrast[feature], descriptors))
    if not described:
        return np.empty((0, 2)), np.empty(0), np.empty((0, DESCRIPTOR_PARTS * DESCRIPTOR_PARTS * TURNS), np.uint8)
    xy, strength, descriptors = (np.concatenate(column) for column in zip(*described, strict=True))
    order = np.argsort(-strength, kind="stable")[:most]
    return xy[order], strength[order], descriptors[order]


def _build_octaves(grey: np.ndarray) -> Iterator[tuple[float, list[np.ndarray]]]:
    """Yield the side of each octave's pixels in those of the image, and its smoothed images, float32."""
    rows, columns = grey.shape
    first = np.empty((2 * rows, 2 * columns), np.float32)
    first[::2, ::2] = grey
    first[::2, 1:-1:2] = (first[::2, :-2:2] + first[::2, 2::2]) / 2.0
    first[::2, -1] = first[::2, -2]
    first[1:-1:2] = (first[:-2:2] + first[2::2]) / 2.0
    first[-1] = first[-2]
    first = blur(first, np.sqrt(SIFT.first_sigma_px**2 - 4.0 * SIFT.image_sigma_px**2))
    sigma = SIFT.first_sigma_px * 2.0 ** (np.arange(SIFT.layers + 3) / SIFT.layers)
    for octave in range(max(round(np.log2(min(first.shape)) - 2.0), 1)):
        scales = [first]
        for before, after in pairwise(sigma):
            scales.append(blur(scales[-1], np.sqrt(after**2 - before**2)))
        yield 0.5 * 2.0**octave, scales
        first = np.ascontiguousarray(scales[SIFT.layers][::2, ::2])
        if min(first.shape) <= 2 * SIFT.border_px + 2:
            return


def _find_extrema(scales: list[np.ndarray], contrast: float) -> _Extrema:
    """Return the features of an octave."""
    difference = np.stack([after - before for before, after in pairwise(scales)])
    layer, row, column = _find_peaks(difference, 0.5 * contrast * 255.0 / SIFT.layers)
    settled = np.zeros(len(layer), dtype=bool)
    offset = np.zeros((len(layer), 3))
    value, edge = np.zeros(len(layer)), np.full(len(layer), np.inf)
    going = np.arange(len(layer))
    for _ in range(SIFT.moves):
        slope, curvature, here = _compute_derivatives(difference, layer[going], row[going], column[going])
        regular = np.abs(np.linalg.det(curvature)) > 1e-12
        going, slope, curvature, here = going[regular], slope[regular], curvature[regular], here[regular]
        step = -np.linalg.solve(curvature, slope[..., None])[..., 0]  # column, row, layer
        near = np.all(np.abs(step) < 0.5, axis=1)
        done = going[near]
        settled[done], offset[done] = True, step[near]
        value[done] = np.abs(here + 0.5 * np.sum(slope * step, axis=1))[near]
        trace = curvature[near, 0, 0] + curvature[near, 1, 1]
        determinant = curvature[near, 0, 0] * curvature[near, 1, 1] - curvature[near, 0, 1] ** 2
        with np.errstate(divide="ignore"):
            edge[done] = np.where(determinant > 0.0, trace**2 / determinant, np.inf)
        moved = going[~near]
        move = np.rint(np.clip(step[~near], -1e6, 1e6)).astype(np.int64)
        column[moved], row[moved], layer[moved] = (
            at[moved] + move[:, k] for k, at in enumerate((column, row, layer))
        )  # fmt: skip
        inside = (layer[moved] >= 1) & (layer[moved] <= SIFT.layers)
        for at, length in ((row, difference.shape[1]), (column, difference.shape[2])):
            inside &= (at[moved] >= SIFT.border_px) & (at[moved] < length - SIFT.border_px)
        going = moved[inside]
        if not len(going):
            break
    good = settled & (value * SIFT.layers >= contrast * 255.0) & (edge < (SIFT.edge_ratio + 1.0) ** 2 / SIFT.edge_ratio)
    _, once = np.unique(np.column_stack([layer, row, column])[good], axis=0, return_index=True)  # equal after moving
    rows = np.flatnonzero(good)[once]
    return _Extrema(
        layer[rows], row[rows], column[rows], np.column_stack([column, row])[rows] + offset[rows, :2],
        SIFT.first_sigma_px * 2.0 ** ((layer[rows] + offset[rows, 2]) / SIFT.layers), value[rows],
    )  # fmt: skip


def _find_peaks(difference: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return layer, row and column of pixels that are the maximum or minimum of their 27 neighbours."""
    found = []
    inner = np.s_[SIFT.border_px : -SIFT.border_px, SIFT.border_px : -SIFT.border_px]
    columns = difference.shape[2]
    beside = [dy * columns + dx for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    for layer in range(1, SIFT.layers + 1):
        flat = [difference[k].ravel() for k in (layer, layer - 1, layer + 1)]
        middle = difference[layer]
        for sign in (1.0, -1.0):
            # Most pixels are excluded by their neighbours in the row; the others are compared with all other neighbours
            here = middle[inner]
            left = middle[SIFT.border_px : -SIFT.border_px, SIFT.border_px - 1 : -SIFT.border_px - 1]
            right = middle[SIFT.border_px : -SIFT.border_px, SIFT.border_px + 1 : columns - SIFT.border_px + 1]
            if sign > 0.0:
                candidate = (here > least) & (here >= left) & (here >= right)
            else:
                candidate = (here < -least) & (here <= left) & (here <= right)
            row, column = np.nonzero(candidate)
            at = (row + SIFT.border_px) * columns + column + SIFT.border_px
            for values in flat:
                for step in beside:
                    at = at[sign * flat[0].take(at) >= sign * values.take(at + step)]
            found.append((np.full(len(at), layer), *np.divmod(at, columns)))
    layer_of, row, column = (np.concatenate(part) for part in zip(*found, strict=True))
    return layer_of, row, column


def _compute_derivatives(
    difference: np.ndarray, layer: np.ndarray, row: np.ndarray, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return gradients ``(n, 3)`` and second derivatives ``(n, 3, 3)`` by column, row and layer; values ``(n,)``."""

    def value_at(dx: int = 0, dy: int = 0, ds: int = 0) -> np.ndarray:
        return difference[layer + ds, row + dy, column + dx].astype(np.float64)

    axes = {0: {"dx": 1}, 1: {"dy": 1}, 2: {"ds": 1}}
    here = value_at()
    slope, curvature = np.empty((len(layer), 3)), np.empty((len(layer), 3, 3))
    for a, along in axes.items():
        after, before = value_at(**along), value_at(**{name: -1 for name in along})
        slope[:, a], curvature[:, a, a] = (after - before) / 2.0, after + before - 2.0 * here
        for b in range(a):
            corners = [
                value_at(**{name: s for name in along}, **{name: t for name in axes[b]}) * s * t
                for s in (1, -1) for t in (1, -1)
            ]  # fmt: skip
            curvature[:, a, b] = curvature[:, b, a] = sum(corners) / 4.0
    return slope, curvature, here


# ---- orientations and descriptors ----------------------------------------------------------------------------------


def _compute_gradients(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return length and direction (radians, counterclockwise from the rows) of the gradients at positions.

    0 outside the image.
    """
    rows, columns = image.shape
    column, row = np.rint(x).astype(np.int64), np.rint(y).astype(np.int64)
    inside = (column > 0) & (row > 0) & (column < columns - 1) & (row < rows - 1)
    at = np.where(inside, row * columns + column, columns + 1)
    flat = image.ravel()
    by_x = flat.take(at + 1) - flat.take(at - 1)
    by_y = flat.take(at - columns) - flat.take(at + columns)
    return np.where(inside, np.hypot(by_x, by_y), np.float32(0.0)), np.arctan2(by_y, by_x)


def _assign_directions(image: np.ndarray, features: _Extrema) -> tuple[np.ndarray, np.ndarray]:
    """Return features and their orientations (radians): the peaks of the gradient histogram around each feature."""
    line = np.linspace(-SIFT.reach, SIFT.reach, 15)
    dx, dy = (offset.ravel() for offset in np.meshgrid(line, line))
    near = np.exp(-0.5 * (dx**2 + dy**2) / SIFT.weight_sigma**2).astype(np.float32)
    histogram = np.zeros((len(features.xy), SIFT.bins))
    for start in range(0, len(histogram), SIFT.batch):
        part = slice(start, start + SIFT.batch)
        xy, sigma = features.xy[part], features.sigma[part, None]
        length, angle = _compute_gradients(image, xy[:, :1] + sigma * dx, xy[:, 1:] + sigma * dy)
        bin_of = np.rint(angle * (SIFT.bins / (2.0 * np.pi))).astype(np.int64) % SIFT.bins
        place = bin_of + SIFT.bins * np.arange(len(xy))[:, None]
        sums = np.bincount(place.ravel(), (length * near).ravel(), SIFT.bins * len(xy))
        histogram[part] = sums.reshape(-1, SIFT.bins)
    smooth = ndimage.correlate1d(histogram, (1.0, 4.0, 6.0, 4.0, 1.0), axis=1, mode="wrap")
    before, after = np.roll(smooth, 1, axis=1), np.roll(smooth, -1, axis=1)
    peak = (smooth > before) & (smooth > after) & (smooth >= SIFT.second_peak * smooth.max(axis=1, keepdims=True))
    feature, bin_of = np.nonzero(peak)
    low, here, high = (values[feature, bin_of] for values in (before, smooth, after))
    fraction = 0.5 * (low - high) / (low - 2.0 * here + high)
    return feature, (bin_of + fraction) * (2.0 * np.pi / SIFT.bins)


def _describe(image: np.ndarray, xy: np.ndarray, sigma: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return descriptors ``(n, 128)`` of 8 bit: row of parts, column of parts, direction."""
    reach = (DESCRIPTOR_PARTS + 1) / 2.0
    line = (np.arange(SIFT.places * (DESCRIPTOR_PARTS + 1)) + 0.5) / SIFT.places - reach
    across, down = (offset.ravel() for offset in np.meshgrid(line, line))
    middle = np.arange(DESCRIPTOR_PARTS) - (DESCRIPTOR_PARTS - 1) / 2.0
    in_row, in_column = (np.maximum(1.0 - np.abs(offset[:, None] - middle), 0.0) for offset in (down, across))
    share = (in_row[:, :, None] * in_column[:, None, :]).reshape(len(across), -1)
    share *= np.exp(-(across**2 + down**2) / (0.5 * DESCRIPTOR_PARTS**2))[:, None]
    share = share.astype(np.float32)
    result = np.empty((len(xy), DESCRIPTOR_PARTS * DESCRIPTOR_PARTS * TURNS), np.uint8)
    for start in range(0, len(xy), SIFT.batch):
        part = slice(start, start + SIFT.batch)
        side = (SIFT.part_scales * sigma[part])[:, None]
        cosine, sine = np.cos(angle[part])[:, None] * side, np.sin(angle[part])[:, None] * side
        length, direction = _compute_gradients(
            image, xy[part, :1] + cosine * across + sine * down, xy[part, 1:] - sine * across + cosine * down
        )
        turn = (direction - angle[part, None].astype(np.float32)) * np.float32(TURNS / (2.0 * np.pi))
        numbers = np.empty((len(length), DESCRIPTOR_PARTS * DESCRIPTOR_PARTS, TURNS), np.float32)
        for k in range(TURNS):
            away = np.abs((turn - np.float32(k) + np.float32(TURNS / 2)) % np.float32(TURNS) - np.float32(TURNS / 2))
            numbers[:, :, k] = (length * np.maximum(np.float32(1.0) - away, np.float32(0.0))) @ share
        numbers = numbers.reshape(len(numbers), -1)
        limit = SIFT.largest_share * np.linalg.norm(numbers, axis=1, keepdims=True)
        numbers = np.minimum(numbers, limit)
        norm = np.maximum(np.linalg.norm(numbers, axis=1, keepdims=True), 1e-12)
        result[part] = np.minimum(np.rint(512.0 * numbers / norm), 255.0)
    return result

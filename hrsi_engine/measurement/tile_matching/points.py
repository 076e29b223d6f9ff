"""Interest points of one window: places where least-squares matching will be precise, whatever the other image is.

Points are corners (the smaller eigenvalue of the structure tensor has a local maximum) at whole pixels. How precise a
match can become follows from the tensor over the matching window and the image's noise (Foerstner 1982: the covariance
of a shift is noise² times the inverse of the summed tensor); where that is poor - water, saturated areas, fog - there
is no point at all.
"""

import numpy as np

from ...foundation.pixel_filters import box_mean, compute_smaller_eigenvalue
from ..interest_points.corners import compute_structure_tensor, find_local_maxima, mask_usable_surroundings
from ..interest_points.statistics import estimate_noise
from .options import TILE_MATCH, TileMatchOptions
from .types import ImageTile


def detect_tile_points(tile: ImageTile, options: TileMatchOptions) -> np.ndarray:
    """Return columns and rows ``(n, 2)``, int64, of the interest points of a tile; they depend on this tile alone."""
    half = max(options.windows_px) // 2
    if min(tile.pixels.shape) <= 2 * half + 2 * TILE_MATCH.edge_px:
        return np.empty((0, 2), dtype=np.int64)
    tensor = compute_structure_tensor(tile.pixels)
    strength = compute_smaller_eigenvalue(tensor.xx, tensor.yy, tensor.xy)
    smallest = min(options.windows_px) // 2
    strength[~mask_usable_surroundings(tile.valid, smallest + TILE_MATCH.edge_px)] = 0.0
    margin = smallest + TILE_MATCH.edge_px
    strength[:margin], strength[-margin:], strength[:, :margin], strength[:, -margin:] = 0.0, 0.0, 0.0, 0.0
    rows, columns = np.nonzero(find_local_maxima(strength, options.spacing_px))
    noise = estimate_noise(tile.pixels, tile.valid) if tile.noise is None else tile.noise
    # What noise alone leaves of a match's precision, px: the tensor is averaged over the matching window
    side = 2 * smallest + 1
    xx, xy, yy = (box_mean(layer, side)[rows, columns].astype(np.float64) for layer in tensor)
    pixels = side**2
    # the derivatives' own noise (a Gaussian of 1 px: 1 / 8 pi) adds to the tensor of an area without any texture
    own = noise**2 / (8.0 * np.pi)
    xx, yy = np.maximum(xx - own, 1e-12), np.maximum(yy - own, 1e-12)
    expected = noise / np.sqrt(np.maximum(compute_smaller_eigenvalue(xx, yy, xy), 1e-12) * pixels)
    at = strength[rows, columns]
    good = expected < TILE_MATCH.expected_sigma_px
    if len(at):
        good &= at > TILE_MATCH.weakest_corner * np.median(at)
    points = np.column_stack([columns, rows])[good].astype(np.int64)
    if options.most_points and len(points) > options.most_points:
        size = tile.pixels.shape[0], tile.pixels.shape[1]
        points = points[_select_by_cell(points, expected[good], size, options.most_points)]
    return points


def _select_by_cell(points: np.ndarray, expected: np.ndarray, shape: tuple[int, int], most: int) -> np.ndarray:
    """Return indices of the best points of each cell of a grid, the same number in each as far as there are any."""
    cell = np.floor(points * (TILE_MATCH.cells / np.array(shape[::-1]))).astype(np.int64) @ [1, TILE_MATCH.cells]
    order = np.lexsort((expected, cell))
    first = np.searchsorted(cell[order], cell[order])
    rank = np.empty(len(points), dtype=np.int64)
    rank[order] = np.arange(len(points)) - first
    return np.sort(np.lexsort((expected, rank))[:most])

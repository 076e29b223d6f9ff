"""Features of a window: SIFT features that determine its geometry, and interest points that are then measured.

SIFT is computed from grey values stretched to 8 bit. Interest points are places where least-squares matching will be
precise in any other image: corners (local maxima of the smaller eigenvalue of the structure tensor) at whole pixels.
The precision follows from the tensor over the matching window and the noise of the image (Foerstner 1982: the
covariance of a shift is noise² times the inverse of the summed tensor); in areas where it is too low (water, saturated
areas, fog) there are no points.
"""

from typing import NamedTuple

import numpy as np

from ...block.columns import rank_in_groups
from ...foundation.pixel_filters import STRETCH, box_mean, compute_smaller_eigenvalue, erode, load_opencv
from ...foundation.thresholds import threshold, thresholds
from ..interest_points.corners import compute_structure_tensor, find_local_maxima, mask_usable_surroundings
from ..interest_points.windows import estimate_noise
from ..window_matching.windows import MATCHING
from .options import TILE_MATCH, TileMatchOptions
from .types import ImageTile


@thresholds
class FEATURES:
    """Detection and comparison of SIFT features in satellite images."""

    contrast: float = threshold(0.01, "", "smallest contrast of a feature", "Lowe 2004: 0.03; lower for 11 bit")
    valid_px: int = threshold(9, "px", "side of the square of valid pixels around a feature")
    lenient_ratio: float = threshold(0.9, "", "largest ratio of descriptors' distances", "Lowe 2004: 0.8; RPCs follow")


class SiftFeatures(NamedTuple):
    """Positions ``(n, 2)`` (column, row), strengths ``(n,)`` and descriptors ``(n, 128)`` uint8."""

    xy: np.ndarray
    strength: np.ndarray
    descriptors: np.ndarray


def detect_sift_features(grey: np.ndarray, valid: np.ndarray, limit: int) -> SiftFeatures:
    """Return the strongest SIFT features (Lowe 2004) of a window."""
    byte = stretch_to_byte(grey, valid)
    if byte is None:
        return SiftFeatures(np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.uint8))
    usable = erode(valid, FEATURES.valid_px)
    sift = load_opencv().SIFT_create(nfeatures=limit, contrastThreshold=FEATURES.contrast, enable_precise_upscale=True)
    points, descriptors = sift.detectAndCompute(byte, None if usable.all() else usable.view(np.uint8))
    if not points:
        return SiftFeatures(np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.uint8))
    xy = np.array([point.pt for point in points], dtype=np.float64)
    strength = np.array([point.response for point in points])
    return SiftFeatures(xy, strength, np.clip(descriptors, 0, 255).astype(np.uint8))


def stretch_to_byte(grey: np.ndarray, valid: np.ndarray) -> np.ndarray | None:
    """Return the window as 8 bit, stretched between the 1st and 99th percentile; None without any texture."""
    if not valid.any():
        return None
    low, high = np.percentile(grey[valid][::7], STRETCH.percent)
    if not high > low:
        return None
    return np.clip((grey.astype(np.float32) - low) * (255.0 / (high - low)), 0.0, 255.0).astype(np.uint8)


def compute_root_sift(descriptors: np.ndarray) -> np.ndarray:
    """Return square roots of L1-normalised descriptors: their dot product is Hellinger's (Arandjelovic 2012)."""
    total = descriptors.sum(axis=1, keepdims=True, dtype=np.float32)
    return np.sqrt(descriptors / np.maximum(total, 1e-7)).astype(np.float32)


def invert_descriptors(descriptors: np.ndarray) -> np.ndarray:
    """Return the SIFT descriptors ``(n, 128)`` of the same points in the negative of the image.

    All gradients are rotated by 180 degrees, and with them the orientation of the feature, to which they are relative:
    the 4 x 4 parts of a descriptor are exchanged with the opposite ones; the 8 directions in each do not change.
    """
    return descriptors.reshape(-1, 4, 4, 8)[:, ::-1, ::-1].reshape(-1, 128)


def detect_tile_points(tile: ImageTile, options: TileMatchOptions) -> np.ndarray:
    """Return columns and rows ``(n, 2)``, int64, of the interest points of a tile; they depend on this tile alone."""
    half = max(options.windows_px) // 2
    if min(tile.pixels.shape) <= 2 * half + 2 * MATCHING.edge_px:
        return np.empty((0, 2), dtype=np.int64)
    tensor = compute_structure_tensor(tile.pixels)
    strength = compute_smaller_eigenvalue(tensor.xx, tensor.yy, tensor.xy)
    smallest = min(options.windows_px) // 2
    strength[~mask_usable_surroundings(tile.valid, smallest + MATCHING.edge_px)] = 0.0
    margin = smallest + MATCHING.edge_px
    strength[:margin], strength[-margin:], strength[:, :margin], strength[:, -margin:] = 0.0, 0.0, 0.0, 0.0
    rows, columns = np.nonzero(find_local_maxima(strength, options.spacing_px))
    noise = estimate_noise(tile.pixels, tile.valid) if tile.noise is None else tile.noise
    # Standard deviation (px) of a match due to noise: the tensor is averaged over the matching window
    side = 2 * smallest + 1
    xx, xy, yy = (box_mean(layer, side)[rows, columns].astype(np.float64) for layer in tensor)
    pixels = side**2
    # the noise of the derivatives (a Gaussian of 1 px: 1 / 8 pi) adds to the tensor of an area without any texture
    noise_part = noise**2 / (8.0 * np.pi)
    xx, yy = np.maximum(xx - noise_part, 1e-12), np.maximum(yy - noise_part, 1e-12)
    expected = noise / np.sqrt(np.maximum(compute_smaller_eigenvalue(xx, yy, xy), 1e-12) * pixels)
    corner_strength = strength[rows, columns]
    precise = expected < TILE_MATCH.expected_sigma_px
    if len(corner_strength):
        precise &= corner_strength > TILE_MATCH.weakest_corner * np.median(corner_strength)
    points = np.column_stack([columns, rows])[precise].astype(np.int64)
    if options.most_points and len(points) > options.most_points:
        # The best points of each cell of a grid, in equal numbers if there are enough
        expected, size = expected[precise], np.array(tile.pixels.shape[::-1])
        cell = np.floor(points * (TILE_MATCH.cells / size)).astype(np.int64) @ [1, TILE_MATCH.cells]
        order = np.lexsort((expected, cell))
        rank = np.empty(len(points), dtype=np.int64)
        rank[order] = rank_in_groups(cell[order])
        points = points[np.sort(np.lexsort((expected, rank))[: options.most_points])]
    return points

"""The scale between two windows of which nothing is known: from features that do not depend on it.

SIFT (Lowe 2004) tells its own scale and direction; the pairs that pass the ratio test vote for one similarity by random
samples (Fischler and Bolles 1981). Only the scale is taken from it: what is matched is for the networks to decide.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...block.block import Raster
from ..interest_points.windows import Area
from ..tile_matching.features import SIFT_CONTRAST, root_sift, stretch_to_byte
from ..tile_matching.rpc_consistency import mutual_matches

SCALE_FEATURES = 6000
SCALE_RATIO = 0.85  # lenient: the vote rejects what is wrong
VOTE_PX = 4.0  # relief moves points
FEWEST_VOTES = 10
UNKNOWN_SCALES = (0.6, 1.7)  # searched step by step where features tell nothing
AROUND = 1.05  # factor to both sides of the scale found
GLANCE_PX, LOOK_PX = 500_000, 16_000_000  # pixels of a window that features are found in: quickly, and thoroughly


def likely_scales(
    first: Raster, second: Raster, first_window: Area, second_window: Area, most_px: int = GLANCE_PX
) -> tuple[float, float]:
    """Return the range of scales, pixels of the second window for one of the first, in which the true one lies.

    Both windows are reduced alike until the larger has at most ``most_px`` pixels: that is quick, and tells as much
    where they show the same; `UNKNOWN_SCALES` where features tell nothing.
    """
    areas = first_window, second_window
    largest = max((area.right - area.left) * (area.bottom - area.top) for area in areas)
    reduction = max(float(np.sqrt(largest / most_px)), 1.0)
    (xy1, descriptors1), (xy2, descriptors2) = (
        _scale_features(raster, area, reduction) for raster, area in zip((first, second), areas, strict=True)
    )
    i, j = mutual_matches(root_sift(descriptors1), root_sift(descriptors2), SCALE_RATIO)
    if len(i) < FEWEST_VOTES:
        return UNKNOWN_SCALES
    cv2.setRNGSeed(1)
    similarity, chosen = cv2.estimateAffinePartial2D(
        xy1[i], xy2[j], method=cv2.RANSAC, ransacReprojThreshold=VOTE_PX, maxIters=5000
    )
    if similarity is None or int(chosen.sum()) < FEWEST_VOTES:
        return UNKNOWN_SCALES
    scale = float(np.hypot(*similarity[:, 0]))
    return scale / AROUND, scale * AROUND


def _scale_features(raster: Raster, area: Area, reduction: float) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and descriptors of a reduced window's features."""
    grey, valid = raster.read(area.left, area.top, area.right - area.left, area.bottom - area.top)
    if reduction > 1.0:
        size = int(grey.shape[1] / reduction), int(grey.shape[0] / reduction)
        grey = cv2.resize(np.asarray(grey, np.float32), size, interpolation=cv2.INTER_AREA)
        valid = cv2.resize(valid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST).astype(bool)
    byte = stretch_to_byte(grey, valid)
    nothing = np.empty((0, 2)), np.empty((0, 128), np.float32)
    if byte is None:
        return nothing
    mask = None if valid.all() else cv2.erode(valid.astype(np.uint8), np.ones((9, 9), np.uint8))
    points, descriptors = cv2.SIFT_create(SCALE_FEATURES, contrastThreshold=SIFT_CONTRAST).detectAndCompute(byte, mask)
    return (np.array([point.pt for point in points]), descriptors) if points else nothing

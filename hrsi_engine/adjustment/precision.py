"""Precision of the unknowns from the factors of the normal equations (thesis eqs. 5.50-5.55).

The covariance of the image parameters is the inverse of the reduced matrix; only the blocks of images that share
points are kept. A point's cofactor follows from its own block and the images that see it::

    Qx = V^-1 + V^-1 (sum_ij W_i' Q_ij W_j) V^-1
"""

from __future__ import annotations

import numpy as np

from .camera_system import CameraSystem
from .normals import Linearisation, PointBlocks, Structure, cross_blocks

COLUMNS_PER_SOLVE = 256


def parameter_cofactors(pattern: Structure, system: CameraSystem) -> np.ndarray:
    """Return the blocks ``(blocks, p, p)`` of the inverse reduced matrix on its own pattern."""
    p = pattern.parameters
    result = np.empty((pattern.blocks, p, p))
    images_per_solve = max(1, COLUMNS_PER_SOLVE // max(p, 1))
    by_column = np.argsort(pattern.block_column, kind="stable")
    bounds = np.searchsorted(pattern.block_column[by_column], np.arange(pattern.images + 1))
    for first in range(0, pattern.images, images_per_solve):
        last = min(first + images_per_solve, pattern.images)
        unit = np.zeros((system.size, (last - first) * p))
        unit[np.arange(first * p, last * p), np.arange((last - first) * p)] = 1.0
        columns = system.solve(unit).reshape(pattern.images, p, last - first, p)
        chosen = by_column[bounds[first] : bounds[last]]
        result[chosen] = columns[pattern.block_row[chosen], :, pattern.block_column[chosen] - first, :]
    return result


def point_cofactors(
    pattern: Structure, linear: Linearisation, weight: np.ndarray, points: PointBlocks, cofactors: np.ndarray
) -> np.ndarray:
    """Return the cofactor matrices ``(m, 3, 3)`` of the points in m², east, north, up."""
    result = points.inverse.copy()
    for batch in pattern.batches:
        count, length = batch.rows.shape
        gain = points.inverse[batch.points][:, None] @ cross_blocks(linear, weight, batch).transpose(0, 1, 3, 2)
        between = cofactors[batch.pair_block].reshape(count, length, length, pattern.parameters, pattern.parameters)
        result[batch.points] += np.einsum("aixp,aijpq,ajyq->axy", gain, between, gain, optimize=True)
    return result

"""Epipolar geometry of a pair over one tile of the map grid.

Over a few hundred metres both cameras are affine to some thousandths of a pixel. The affine epipolar constraint
``a x1 + b x2 + c = 0`` of image points x1, x2 of the same ground point (Hartley and Zisserman, chapter 14) is fitted to
projected nodes by total least squares: the singular vector of the smallest singular value. It gives a coordinate ``v``
that both images share. Along the epipolar lines, ``u1`` is a rotation of the first image, and ``u2`` an affine function
of the second one, chosen such that the disparity ``d = u1 - u2`` is 0 on a reference plane and proportional to the
height above it.

What the RPCs have beyond affinity is not lost: position and height on the map are cubic polynomials of (u, v, d),
fitted to the same nodes. A node's v is the mean of its two images, thus the polynomials intersect both rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..block.block import Image
from ..foundation.errors import SolveError
from ..ortho.grid import GridWindow, MapGrid

TILE_NODES = 7  #: nodes along each side of a tile, and in height, to which the geometry is fitted
MARGIN_PX = 24  #: margin of rectified tiles, for windows and the aggregation of costs


@dataclass(frozen=True)
class RectifiedTile:
    """Rectification of a pair over a tile.

    left, right : (2, 3) affine transformations from rectified positions (u, v) to image positions (sample, line)
    size : columns and rows of the rectified tile
    disparities : smallest and largest disparity (px) of the heights of the tile
    error_px : RMS of the nodes' distances from their epipolar lines, in pixels of the first image
    centre, scale : (3,) of (u, v, d), which bring them to [-1, 1]
    polynomials : (20, 3) column, row, height (m) by the terms of `cubic_terms`
    """

    left: np.ndarray
    right: np.ndarray
    size: tuple[int, int]
    disparities: tuple[float, float]
    error_px: float
    centre: np.ndarray
    scale: np.ndarray
    polynomials: np.ndarray

    def intersect(self, u: np.ndarray, v: np.ndarray, disparity: np.ndarray) -> np.ndarray:
        """Return column, row and height ``(3, n)`` on the map grid, of rectified positions and disparities (n,)."""
        normalised = (np.stack([u, v, disparity]) - self.centre[:, None]) / self.scale[:, None]
        return np.asarray(self.polynomials.T @ cubic_terms(normalised))

    def height_per_px(self) -> float:
        """Return the change of height (m) with disparity (px) in the middle of the tile."""
        return float(self.polynomials[3, 2] / self.scale[2])


def cubic_terms(x: np.ndarray) -> np.ndarray:
    """Return all monomials up to degree 3 of three coordinates ``(3, n)``: ``(20, n)``, the linear ones second."""
    pairs = [x[i] * x[j] for i in range(3) for j in range(i, 3)]
    triples = [x[i] * x[j] * x[k] for i in range(3) for j in range(i, 3) for k in range(j, 3)]
    return np.stack([np.ones_like(x[0]), *x, *pairs, *triples])


def rectify_tile(
    images: tuple[Image, Image], grid: MapGrid, window: GridWindow, heights_m: tuple[float, float], plane: np.ndarray
) -> RectifiedTile:
    """Return the rectification of a pair over a window of the map grid.

    heights_m : lowest and highest ellipsoidal height of its ground
    plane : (3,) reference height = plane @ (column, row, 1)

    Raises `SolveError` if the rays of both images are parallel.
    """
    side = np.linspace(0.0, 1.0, TILE_NODES)
    height, row, column = (axis.ravel() for axis in np.meshgrid(side, side, side, indexing="ij"))
    column, row = window.column - 0.5 + column * window.columns, window.row - 0.5 + row * window.rows
    lowest, highest = heights_m
    half_range = max(highest - lowest, 2.0) / 2.0
    height = (lowest + highest) / 2.0 + (2.0 * height - 1.0) * half_range
    ground = np.column_stack([grid.lonlat(np.column_stack([column, row])), height])
    first, second = (image.rpc.project(ground) for image in images)

    # Epipolar lines: a, b, c of the module's head
    centres = first.mean(axis=0), second.mean(axis=0)
    centred = np.hstack([first - centres[0], second - centres[1]])
    _, singular, axes = np.linalg.svd(centred, full_matrices=False)
    a, b = axes[3, :2], axes[3, 2:]
    across = np.linalg.norm(a)
    along = np.array([a[1], -a[0]]) / across
    u1, v1 = centred[:, :2] @ along, centred[:, :2] @ a / across
    v2 = -(centred[:, 2:] @ b) / across
    above = height - plane @ np.stack([column, row, np.ones_like(row)])
    design = np.column_stack([centred[:, 2:], np.ones_like(above), above])
    (p_sample, p_line, shift, per_m), *_ = np.linalg.lstsq(design, u1, rcond=None)
    if per_m < 0.0:  # mirrored, so that disparities increase with heights
        along, u1, p_sample, p_line, shift = -along, -u1, -p_sample, -p_line, -shift
    u2 = centred[:, 2:] @ np.array([p_sample, p_line]) + shift
    if abs(per_m) * half_range < 1e-3:
        raise SolveError("both images look from the same direction")

    disparity, v = u1 - u2, (v1 + v2) / 2.0
    low, high = float(disparity.min()), float(disparity.max())
    reach = MARGIN_PX + max(abs(low), abs(high))
    origin = np.array([np.floor(u1.min() - reach), np.floor(v.min() - MARGIN_PX)])
    size = np.ceil([u1.max() + reach, v.max() + MARGIN_PX]) - origin
    # From rectified to image positions: inverses of (u, v) = A x + t
    to_left = np.linalg.inv(np.stack([along, a / across]))
    to_right = np.linalg.inv(np.stack([[p_sample, p_line], -b / across]))
    left = np.column_stack([to_left, centres[0] + to_left @ origin])
    right = np.column_stack([to_right, centres[1] + to_right @ (origin - [shift, 0.0])])

    place = np.stack([u1 - origin[0], v - origin[1], disparity])
    middle, scale = (place.max(axis=1) + place.min(axis=1)) / 2.0, np.maximum(np.ptp(place, axis=1) / 2.0, 1e-6)
    terms = cubic_terms((place - middle[:, None]) / scale[:, None])
    polynomials, *_ = np.linalg.lstsq(terms.T, np.column_stack([column, row, height]), rcond=None)
    error = float(singular[3] / np.sqrt(len(height)) / across)
    return RectifiedTile(left, right, (int(size[0]), int(size[1])), (low, high), error, middle, scale, polynomials)

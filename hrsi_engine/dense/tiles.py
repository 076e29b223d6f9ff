"""Heights of the tiles of a surface model by all pairs of a block: first coarsely, then at full resolution.

A coarse surface of the block comes from images reduced by a factor of up to 8, over the complete range of heights. Its
heights limit the search of a tile, so that the cost of a tile does not depend on the relief of the block.

Pairs are rectified tile by tile. Over a few hundred metres both cameras are affine to some thousandths of a pixel. The
affine epipolar constraint ``a x1 + b x2 + c = 0`` of image points x1, x2 of the same ground point (Hartley and
Zisserman, chapter 14) is fitted to projected nodes by total least squares: the singular vector of the smallest singular
value. It gives a coordinate ``v`` that both images share. Along the epipolar lines, ``u1`` is a rotation of the first
image, and ``u2`` an affine function of the second one, chosen such that the disparity ``d = u1 - u2`` is 0 on a
reference plane and proportional to the height above it.

What the RPCs have beyond affinity is not lost: position and height on the map are cubic polynomials of (u, v, d),
fitted to the same nodes. A node's v is the mean of its two images, thus the polynomials intersect both rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..block.block import ArrayRaster, Image, read_overview_pixels
from ..foundation.errors import SolveError
from ..foundation.pixel_filters import load_opencv
from ..foundation.thresholds import GRIDS, GROUND, threshold, thresholds
from ..ortho.grid import GridWindow, MapGrid
from .disparity import compute_disparities, normalise_contrast
from .gridding import fuse_heights, grid_heights


@thresholds
class DENSE:
    """Levels and search ranges of dense matching."""

    margin_px: float = threshold(12.0, "px", "disparities searched beyond those of the coarse surface")


REDUCTIONS = (8, 4, 2)  #: reductions of the images for the coarse surface
MARGIN_CELLS = 8  #: cells of the coarse surface around a tile that also limit its heights
RANGE_SHARE = 0.2  #: enlargement of the range of known heights for the coarse surface
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
    return RectifiedTile(
        left=left,
        right=right,
        size=(int(size[0]), int(size[1])),
        disparities=(low, high),
        error_px=error,
        centre=middle,
        scale=scale,
        polynomials=polynomials,
    )


class PairHeights(NamedTuple):
    """Heights of a window by each pair ``(pairs, rows, columns)``, their sigmas (m), and errors of rectification (px).

    NaN where a pair has no height.
    """

    height: np.ndarray
    sigma: np.ndarray
    error_px: np.ndarray


@dataclass(frozen=True, eq=False)
class DenseBlock:
    """Images, pairs (indices of the first and second image) and the map grid of a surface model.

    cell_m : side of a cell in metres
    """

    images: tuple[Image, ...]
    pairs: tuple[tuple[int, int], ...]
    grid: MapGrid
    cell_m: float

    def coarsen(self, factor: int) -> DenseBlock:
        """Return the block of reduced images (in memory), with cells larger by the same factor."""
        images = []
        for image in self.images:
            rpc = image.rpc.resample((float(factor), float(factor)), ((factor - 1) / 2.0, (factor - 1) / 2.0))
            images.append(replace(image, raster=ArrayRaster(*read_overview_pixels(image, factor)), rpc=rpc))
        grid = MapGrid.from_bounds(self.grid.crs, self.grid.resolution * factor, self.grid.bounds)
        return replace(self, images=tuple(images), grid=grid, cell_m=self.cell_m * factor)


class CoarseSurface(NamedTuple):
    """Heights (rows, columns) of a coarse grid, NaN where there are none, and its cells per cell of the fine grid."""

    heights: np.ndarray
    grid: MapGrid

    def limit_window(self, grid: MapGrid, window: GridWindow) -> tuple[np.ndarray, tuple[float, float]] | None:
        """Return the plane through the surface in a window of a finer grid, and its lowest and highest height.

        Result: (3,) plane @ (column, row, 1) of the fine grid, and metres; None without heights.
        """
        factor = self.grid.resolution / grid.resolution
        # Position of the centre of fine cell 0 in the coarse grid
        x0 = (grid.left + 0.5) / factor - self.grid.left - 0.5
        y0 = self.grid.top - (grid.top - 0.5) / factor - 0.5
        margin = MARGIN_CELLS
        first = np.floor([y0 + window.row / factor, x0 + window.column / factor]).astype(int) - margin
        last = first + np.ceil([window.rows / factor, window.columns / factor]).astype(int) + 2 * margin
        (top, left), (bottom, right) = np.maximum(first, 0), np.maximum(last, 0)
        part = self.heights[top:bottom, left:right]
        row, column = np.nonzero(np.isfinite(part))
        if not len(row):
            return None
        height = part[row, column].astype(np.float64)
        x, y = (column + left - x0) * factor, (row + top - y0) * factor
        design = np.column_stack([x, y, np.ones(len(x))])
        plane = np.array([0.0, 0.0, height.mean()])
        if len(height) > 10:
            plane = np.linalg.lstsq(design, height, rcond=None)[0]
        return plane, (float(height.min()), float(height.max()))


def match_surface_tile(
    block: DenseBlock, window: GridWindow, plane: np.ndarray, heights_m: tuple[float, float]
) -> PairHeights:
    """Return the heights of a window of the map grid by each pair.

    plane : (3,) reference of disparities, plane @ (column, row, 1)
    heights_m : lowest and highest height that is searched
    """
    shape = len(block.pairs), window.rows, window.columns
    result = PairHeights(np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32), np.zeros(shape[0]))
    for number, (first, second) in enumerate(block.pairs):
        images = block.images[first], block.images[second]
        tile = rectify_tile(images, block.grid, window, heights_m, plane)
        result.error_px[number] = tile.error_px
        pixels = [_warp(image, affine, tile) for image, affine in zip(images, (tile.left, tile.right), strict=True)]
        if not all(valid.any() for _, valid in pixels):
            continue
        left, right = (normalise_contrast(grey, valid) for grey, valid in pixels)
        matches = compute_disparities(left, right, pixels[0][1], tile.disparities)
        v, u = np.nonzero(np.isfinite(matches.disparity))
        if not len(u):
            continue
        points = tile.intersect(u.astype(float), v.astype(float), matches.disparity[v, u].astype(float))
        metres = tile.height_per_px()
        sigma = matches.sigma_px[v, u].astype(float) * metres
        result.height[number], result.sigma[number] = grid_heights(points, sigma, window, block.cell_m, metres)
    return result


def _warp(image: Image, affine: np.ndarray, tile: RectifiedTile) -> tuple[np.ndarray, np.ndarray]:
    """Return the grey values (float32) and the mask of an image in the rectified geometry of a tile."""
    cv2 = load_opencv()
    columns, rows = tile.size
    corners = np.array([[0, 0, 1], [columns, 0, 1], [0, rows, 1], [columns, rows, 1]]) @ affine.T
    size = np.array(image.known_size)
    low = np.clip(np.floor(corners.min(axis=0)).astype(int) - 4, 0, size)
    extent = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 5, 0, size) - low
    if (extent < 2).any():
        return np.zeros((rows, columns), np.float32), np.zeros((rows, columns), bool)
    grey, valid = image.pixels.read(int(low[0]), int(low[1]), int(extent[0]), int(extent[1]))
    local = affine - np.column_stack([np.zeros((2, 2)), low])
    back = cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(grey.astype(np.float32), local, tile.size, flags=cv2.INTER_CUBIC | back)
    mask = cv2.warpAffine(valid.astype(np.float32), local, tile.size, flags=cv2.INTER_LINEAR | back)
    return warped, mask > 0.999


def match_coarse_surface(block: DenseBlock, known_m: Sequence[float]) -> CoarseSurface:
    """Return a coarse surface of a block.

    known_m : heights that are known, of tie points or a DEM, which limit the search
    """
    shortest = min(min(image.known_size) for image in block.images)
    factor = next((one for one in REDUCTIONS if shortest >= one * GRIDS.fine), 1)
    coarse = block.coarsen(factor) if factor > 1 else block
    low, high = float(np.min(known_m)), float(np.max(known_m))
    more = max(GROUND.margin_m, RANGE_SHARE * (high - low))
    grid, plane = coarse.grid, np.array([0.0, 0.0, (low + high) / 2.0])
    heights = np.full((grid.rows, grid.columns), np.nan, np.float32)
    for window in grid.chunks(512):
        matched = match_surface_tile(coarse, window, plane, (low - more, high + more))
        fused = fuse_heights(matched.height, matched.sigma)
        heights[window.row : window.row + window.rows, window.column : window.column + window.columns] = fused.height
    return CoarseSurface(heights, grid)


def limit_search(
    block: DenseBlock, coarse: CoarseSurface, window: GridWindow
) -> tuple[np.ndarray, tuple[float, float]] | None:
    """Return the reference plane and the range of heights of a tile at full resolution; None where nothing is known."""
    limits = coarse.limit_window(block.grid, window)
    if limits is None:
        return None
    plane, (low, high) = limits
    more = 0.0
    for first, second in block.pairs:
        tile = rectify_tile((block.images[first], block.images[second]), block.grid, window, (low, high), plane)
        more = max(more, DENSE.margin_px * tile.height_per_px())
    return plane, (low - more, high + more)

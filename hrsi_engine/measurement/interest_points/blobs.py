"""Blobs: spots of several scales inside a closed outline of gradient edges, and their grey-weighted centres.

Where a town or open country has no shape that repeats, its spots do: chimneys, dormers, cars, small roofs, bushes.
Seeds are maxima of the Hessian's determinant at several scales (Lindeberg 1998). Around each, the outline is the closed
path over `RAYS` rays that runs along the steepest slopes of its sign, found by dynamic programming; no level and no
threshold takes part in it. The centre is the mean of the grey values above the surroundings within that outline, moved
to itself (Comaniciu and Meer 2002), so that a weak part of the outline hardly counts. A spot without contrast to what
is around, or whose outline leads away from its seed, is none.

The `chance` of a blob to be found again is a logistic function of what predicts it on real pairs (`CHANCE_TERMS`): its
size, how even its outline is, and whether it is bright; dark ones are shadows and gaps more often than things.
`benchmarks/interest_points_real.py` judges it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.pixel_filters import blur, filter_separably, largest_within, reduce_by_area, slopes
from .options import CentreOptions
from .outlines import bilinear

SEED_SIGMAS_PX = tuple(1.6 * 2.0 ** (k / 2.0) for k in range(7))  # discs of 5 to 36 px
LARGEST_AT_LEVEL_PX = 6.4  # seeds of a larger scale are looked for in the image reduced by 2, 4
SEED_STRENGTH = 0.45  # square root of the determinant, in local deviations
RADIUS_OF_SIGMA = 1.4  # of the disc that answers most
RAYS, RADII = 32, 24
NEAREST_RADIUS, FARTHEST_RADIUS = 0.45, 2.2  # radii searched, times the expected one
OUTLINE_PX = 0.8  # standard deviation of the Gaussian of the slopes
TURN_COST = 0.3  # of a step by one radius from ray to ray
FINE_RADIUS_PX = 8.0  # outlines of more than twice that radius are sought in the reduced image
STARS_PER_BATCH = 512  # tables that fit into the processor's cache
MOST_SHIFTED = 0.5  # of the radius, from a seed to the centre of its outline
LARGEST_RADIUS_PX = 18.0
SIZE_TOLERANCE_PX = 0.4  # the diameter of a small spot is known to about half a pixel
LEAST_CONTRAST, MOVED_CONTRAST = 1.0, 0.25  # local deviations, about the seed and about the grey-weighted centre
BESIDE_BLOB_PX = 1.5
CENTRE_SAMPLES, CENTRE_LEVEL = 10, 0.3  # along each ray; share of the contrast that counts nothing
CENTRE_ROUNDS = 3
SAME_BLOB = 0.35  # of the radius: centres so near of like size are one blob
BLOB_SIGMA_PX = (0.15, 0.03)  # of a coordinate: px, and share of the radius (residuals of real pairs)
#: Logarithm of the odds to be found again: constant, logarithm of radius / 4 px and its square, unevenness, dark.
CHANCE_TERMS = (0.82, 0.42, -0.94, -0.45, -0.82)

_DIRECTION = np.exp(2j * np.pi * np.arange(RAYS) / RAYS)


class Blobs(NamedTuple):
    """Blobs of a window, columns of length n.

    xy : (n, 2) column, row; sign : 1 bright, -1 dark; radii : (n, RAYS) of the outline about the centre
    contrast : in local deviations; chance : to be found again
    """

    xy: np.ndarray
    sign: np.ndarray
    radii: np.ndarray
    contrast: np.ndarray
    chance: np.ndarray

    @property
    def radius(self) -> np.ndarray:
        """Of the circle of the same area, ``(n,)`` px."""
        return np.sqrt(np.mean(self.radii**2, axis=1))

    @property
    def sigma_px(self) -> np.ndarray:
        """Standard deviation of a coordinate, ``(n,)``."""
        return BLOB_SIGMA_PX[0] + BLOB_SIGMA_PX[1] * self.radius

    def ellipse(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the longer and shorter diameter ``(n, 2)`` of the oval, its azimuth and RMS about it ``(n,)``."""
        wave = np.fft.rfft(self.radii, axis=1)[:, 2] / RAYS
        length = np.minimum(2.0 * np.abs(wave), 0.8 * self.radius)
        size = 2.0 * np.column_stack([self.radius + length, self.radius - length])
        return size, -np.angle(wave) / 2.0, _unevenness_px(self.radii)

    def grey_contrast(self, grey: np.ndarray) -> np.ndarray:
        """Return grey values inside - outside, ``(n,)``."""
        inside, outside = (_ring(grey, self.xy, self.radii, *at) for at in ((0.5, 0.0), (1.0, BESIDE_BLOB_PX)))
        return inside - outside

    def select(self, keep: np.ndarray) -> Blobs:
        """Return some blobs (mask or indices)."""
        return Blobs(*(column[keep] for column in self))


def find_blobs(z: np.ndarray, usable: np.ndarray, options: CentreOptions) -> Blobs:
    """Return the blobs of an image in local deviations, float32; those that touch pixels not usable are left out."""
    xy, sigma, sign = _seeds(z)
    radius = RADIUS_OF_SIGMA * sigma
    levels = _Levels(z)
    for _ in range(2):
        if not len(xy):
            break
        radii = _outlines(levels, xy, radius, sign)
        centre, size = _middles(xy, radii)
        shifted = np.hypot(*(centre - xy).T)
        keep = (shifted <= MOST_SHIFTED * radius) & (size <= LARGEST_RADIUS_PX)
        keep &= (2.0 * size >= options.smallest_px - SIZE_TOLERANCE_PX) & (2.0 * size <= options.largest_px)
        xy, radius, sign, radii = centre[keep], size[keep], sign[keep], radii[keep]
    if not len(xy):
        return Blobs(np.empty((0, 2)), np.empty(0), np.empty((0, RAYS)), np.empty(0), np.empty(0))
    inside, outside = (_ring(z, xy, radii, *at) for at in ((0.5, 0.0), (1.0, BESIDE_BLOB_PX)))
    contrast = sign * (inside - outside)
    clear = np.flatnonzero(contrast >= LEAST_CONTRAST)
    xy, radii, sign = xy[clear], radii[clear], sign[clear]
    for _ in range(CENTRE_ROUNDS):
        xy = _grey_centres(z, xy, radii, inside[clear], outside[clear])
    # What the centre has moved to must stand out as well, and lie on usable pixels
    moved_in, moved_out = (_ring(z, xy, radii, *at) for at in ((0.5, 0.0), (1.0, BESIDE_BLOB_PX)))
    contrast = sign * (moved_in - moved_out)
    keep = (contrast >= MOVED_CONTRAST) & _free(usable, xy, radii)
    xy, radii, sign, contrast = xy[keep], radii[keep], sign[keep], contrast[keep]
    blobs = Blobs(xy, sign, radii, contrast, _chance(radii, sign))
    return blobs.select(_different_blobs(blobs))


def _seeds(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions ``(n, 2)``, scales and signs ``(n,)`` of the maxima of the Hessian's determinant."""
    second, first, one = (np.array(kernel, np.float32) for kernel in ([1, -2, 1], [-0.5, 0, 0.5], [1]))
    factor, level = 1, z
    found = []
    for sigma in SEED_SIGMAS_PX:
        if sigma / factor > LARGEST_AT_LEVEL_PX:
            factor *= 2
            level = reduce_by_area(z, (z.shape[1] // factor, z.shape[0] // factor))
        scale = sigma / factor
        smooth = blur(level, np.sqrt(scale**2 - 0.25), "reflect")
        xx = filter_separably(smooth, second, one, "reflect")
        yy = filter_separably(smooth, one, second, "reflect")
        mixed = filter_separably(smooth, first, first, "reflect")
        strength = np.float32(scale**4) * (xx * yy - mixed * mixed)
        peak = (strength >= largest_within(strength, 1.5)) & (strength > SEED_STRENGTH**2)
        row, column = np.nonzero(peak)
        bright = np.where(xx[row, column] + yy[row, column] < 0.0, 1.0, -1.0)
        at = (np.column_stack([column, row]) + 0.5) * factor - 0.5
        found.append((at, np.full(len(row), sigma), bright))
    xy, sigma, sign = (np.concatenate(part) for part in zip(*found, strict=True))
    return xy, sigma, sign


class _Levels:
    """Slopes of an image and of it reduced by 2 and 4, complex: by column + 1j by row."""

    def __init__(self, z: np.ndarray) -> None:
        self._z = z
        self._slopes: dict[int, np.ndarray] = {}

    def slopes(self, factor: int) -> np.ndarray:
        """Return the slopes of the image reduced by a factor, per pixel of it."""
        if factor not in self._slopes:
            size = self._z.shape[1] // factor, self._z.shape[0] // factor
            level = self._z if factor == 1 else reduce_by_area(self._z, size)
            smooth = blur(level, OUTLINE_PX, "reflect")
            half, one = np.array([-0.5, 0.0, 0.5], np.float32), np.array([1.0], np.float32)
            by = np.empty((*smooth.shape, 2), np.float32)
            by[..., 0], by[..., 1] = slopes(smooth, one, half, "reflect")
            self._slopes[factor] = by.view(np.complex64)[..., 0]
        return self._slopes[factor]


def _outlines(levels: _Levels, xy: np.ndarray, radius: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """Return the radii ``(n, RAYS)`` of the best closed outline around each point."""
    factor = np.where(radius < 2.0 * FINE_RADIUS_PX, 1, 2)
    radii = np.empty((len(xy), RAYS))
    for reduced in np.unique(factor).tolist():
        rows = np.flatnonzero(factor == reduced)
        for start in range(0, len(rows), STARS_PER_BATCH):
            part = rows[start : start + STARS_PER_BATCH]
            radii[part] = _best_paths(levels.slopes(reduced), reduced, xy[part], radius[part], sign[part])
    return radii


def _best_paths(
    slopes: np.ndarray, factor: int, xy: np.ndarray, radius: np.ndarray, sign: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Return the radii along each ray of the closed path with the most slope and the fewest turns, ``(n, RAYS)``."""
    step = (FARTHEST_RADIUS / NEAREST_RADIUS) ** (1.0 / (RADII - 1))
    distance = radius[:, None] * NEAREST_RADIUS * step ** np.arange(RADII)
    x = (xy[:, :1, None] + _DIRECTION.real[:, None] * distance[:, None] + 0.5) / factor - 0.5
    y = (xy[:, 1:, None] + _DIRECTION.imag[:, None] * distance[:, None] + 0.5) / factor - 0.5
    slope = bilinear(slopes, x, y)
    ray = _DIRECTION.astype(np.complex64)[:, None]
    outwards = -sign[:, None, None].astype(np.float32) * (slope.real * ray.real + slope.imag * ray.imag)
    usual = np.maximum(np.median(outwards.max(axis=2), axis=1), 1e-3)[:, None, None]
    gain = np.maximum(outwards, 0.0) / usual
    gain = 2.0 * gain / (1.0 + gain)  # a very steep edge beside does not draw the path away
    index = _closed_path(np.ascontiguousarray(np.moveaxis(gain, 1, 0)))
    # The parabola through the slopes around the path
    middle = np.clip(index, 1, RADII - 2)[..., None]
    before, at, after = (np.take_along_axis(outwards, middle + k, axis=2)[..., 0] for k in (-1, 0, 1))
    bend = before - 2.0 * at + after
    shift = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)
    return radius[:, None] * NEAREST_RADIUS * step ** (middle[..., 0] + np.clip(shift, -0.5, 0.5))


def _closed_path(gain: np.ndarray) -> np.ndarray:
    """Return the index on each ray ``(n, RAYS)`` of the path with the largest sum of ``gain (RAYS, n, RADII)``.

    Two times around: the second round begins where the first one ended, and its result closes.
    """
    rays, count, radii = gain.shape
    best = np.zeros((count, radii), np.float32)
    came = np.empty((2 * rays, count, radii), np.int8)
    from_within, from_beyond = np.full((2, count, radii), -np.inf, np.float32)
    for turn in range(2 * rays):
        from_within[:, 1:] = best[:, :-1] - np.float32(TURN_COST)
        from_beyond[:, :-1] = best[:, 1:] - np.float32(TURN_COST)
        other = np.maximum(from_within, from_beyond)
        came[turn] = np.where(best >= other, 0, np.where(from_within >= from_beyond, -1, 1))
        best = np.maximum(best, other) + gain[turn % rays]
    at, row = best.argmax(axis=1), np.arange(count)
    path = np.empty((count, 2 * rays), np.int64)
    for turn in range(2 * rays - 1, -1, -1):
        path[:, turn] = at
        at = at + came[turn, row, at]
    half = rays // 2
    return np.concatenate([path[:, rays : rays + half], path[:, half:rays]], axis=1)


def _middles(xy: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres of gravity ``(n, 2)`` of outlines, and the radii of circles of their area ``(n,)``."""
    corner = radii * _DIRECTION
    following = np.roll(corner, -1, axis=1)
    cross = corner.real * following.imag - following.real * corner.imag
    area = cross.sum(axis=1)
    centre = ((corner + following) * cross).sum(axis=1) / (3.0 * area)
    return xy + np.column_stack([centre.real, centre.imag]), np.sqrt(area / (2.0 * np.pi))


def _ring(z: np.ndarray, xy: np.ndarray, radii: np.ndarray, share: float, beyond_px: float) -> np.ndarray:
    """Return the median ``(n,)`` along outlines at a share of their radii and so far beyond."""
    at = xy[:, 0, None] + 1j * xy[:, 1, None] + (share * radii + beyond_px) * _DIRECTION
    return np.asarray(np.median(bilinear(z, at.real, at.imag), axis=1))


def _free(usable: np.ndarray, xy: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return the mask of outlines inside the window with nothing but usable pixels in them and around."""
    reach = np.concatenate([radii + 2.0 * BESIDE_BLOB_PX, radii, radii / 2.0, np.zeros((len(xy), 1))], axis=1)
    at = xy[:, 0, None] + 1j * xy[:, 1, None] + reach * np.r_[_DIRECTION, _DIRECTION, _DIRECTION, 1.0]
    column, row = np.rint(at.real).astype(np.int64), np.rint(at.imag).astype(np.int64)
    inside = (column >= 0) & (row >= 0) & (column < usable.shape[1]) & (row < usable.shape[0])
    return np.asarray((inside & usable[row * inside, column * inside]).all(axis=1))


def _grey_centres(
    z: np.ndarray, xy: np.ndarray, radii: np.ndarray, inside: np.ndarray, outside: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Return the means ``(n, 2)`` of positions within outlines, weighted by what is above the surroundings."""
    share = (np.arange(CENTRE_SAMPLES) + 0.5) / CENTRE_SAMPLES
    reach = (radii + BESIDE_BLOB_PX)[:, :, None]
    offset = reach * share * _DIRECTION[:, None]
    grey = bilinear(z, xy[:, :1, None] + offset.real, xy[:, 1:, None] + offset.imag)
    above = (grey - outside[:, None, None]) / (inside - outside)[:, None, None]
    weight = np.clip(above - CENTRE_LEVEL, 0.0, 1.0) * reach**2 * share
    moved = (weight * offset).sum(axis=(1, 2)) / np.maximum(weight.sum(axis=(1, 2)), 1e-9)
    return xy + np.column_stack([moved.real, moved.imag])


def chance_terms(radii: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """Return what a blob's chance is told by ``(n, 5)``, as `CHANCE_TERMS` weighs it."""
    radius = np.sqrt(np.mean(radii**2, axis=1))
    size, uneven = np.log(radius / 4.0), np.minimum(10.0 * _unevenness_px(radii) / radius, 3.0)
    return np.column_stack([np.ones(len(radius)), size, size**2, uneven, sign < 0.0])


def _chance(radii: np.ndarray, sign: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 / (1.0 + np.exp(-chance_terms(radii, sign) @ CHANCE_TERMS)))


def _unevenness_px(radii: np.ndarray) -> np.ndarray:
    """Return the RMS ``(n,)`` of an outline about the smooth oval through it."""
    waves = np.abs(np.fft.rfft(radii, axis=1)) / RAYS
    return np.asarray(np.sqrt(2.0 * np.sum(waves[:, 3:] ** 2, axis=1)))


def _different_blobs(blobs: Blobs) -> np.ndarray:
    """Return the indices of blobs of which no better one has the same place and sign."""
    radius = blobs.radius
    if not len(radius):
        return np.empty(0, np.int64)
    near = cKDTree(blobs.xy).query_pairs(SAME_BLOB * LARGEST_RADIUS_PX, output_type="ndarray")
    first, second = near.T
    away = np.hypot(*(blobs.xy[first] - blobs.xy[second]).T)
    same = (away < np.maximum(SAME_BLOB * np.minimum(radius[first], radius[second]), 1.0)) & (
        blobs.sign[first] == blobs.sign[second]
    )
    rank = np.lexsort((blobs.xy[:, 0], blobs.xy[:, 1], -blobs.contrast * np.sqrt(radius))).argsort()
    neighbours: dict[int, list[int]] = {}
    for a, b in near[same].tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    free = np.ones(len(radius), dtype=bool)
    for row in np.argsort(rank).tolist():
        if free[row]:
            free[neighbours.get(row, [])] = False
    return np.flatnonzero(free)

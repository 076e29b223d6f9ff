"""Blobs: spots of several scales inside a closed outline of gradient edges, and their grey-weighted centres.

Where a town or open country has no shape that repeats, its spots do: chimneys, dormers, cars, small roofs, bushes.
Seeds are maxima of the Hessian's determinant at several scales (Lindeberg 1998). Around each, the outline is the closed
path over the rays that runs along the steepest slopes of its sign, found by dynamic programming, without level or
threshold. The centre is the mean of the grey values above the surroundings within that outline, moved
to itself (Comaniciu and Meer 2002), so that a weak part of the outline hardly counts. A spot without contrast to what
is around, or whose outline leads away from its seed, is none.

The `chance` of a blob to be found again is a logistic function of what predicts it on real pairs (`CHANCE_TERMS`): its
size, how even its outline is, and whether it is bright; dark ones are more often shadows and gaps than objects.
"""

from __future__ import annotations

from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.pixel_filters import blur, compute_local_maximum, filter_separable, reduce_by_area, slopes
from ...foundation.thresholds import threshold, thresholds
from ...measurement.interest_points.options import CentreOptions
from ...measurement.interest_points.outlines import interpolate_bilinear

BLOB_PAIRS = "real pairs s2p 01-03 and Kahramanmaras before, 2026-11-22"


@thresholds
class BLOBS:
    """Search of seeds of blobs, their outlines, and tests of them."""

    seed_sigmas_px: tuple[float, ...] = threshold(
        tuple(1.6 * 2.0 ** (k / 2.0) for k in range(7)), "px", "scales, for discs of 5 to 36 px"
    )
    largest_at_level_px: float = threshold(
        6.4, "px", "largest scale at full resolution; beyond, the image is reduced by 2 or 4"
    )
    seed_strength: float = threshold(0.45, "sigma", "smallest square root of the Hessian's determinant", BLOB_PAIRS)
    radius_of_sigma: float = threshold(1.4, "", "radius of a disc over the scale with the largest response")
    rays: int = threshold(32, "", "rays of an outline")
    radii: int = threshold(24, "", "number of radii tried along each ray")
    nearest_radius: float = threshold(0.45, "", "smallest radius tried, relative to the expected one")
    farthest_radius: float = threshold(2.2, "", "largest radius tried, relative to the expected one")
    slope_px: float = threshold(0.8, "px", "standard deviation of the Gaussian derivative")
    turn_cost: float = threshold(
        0.3, "", "cost of a change by one radius between rays, in median gradients", BLOB_PAIRS
    )
    fine_radius_px: float = threshold(8.0, "px", "half the radius from which the reduced image is used")
    batch: int = threshold(512, "blobs", "outlines computed together (processor's cache)")
    largest_shift: float = threshold(0.5, "", "largest distance of seed and centre over the radius", BLOB_PAIRS)
    largest_radius_px: float = threshold(18.0, "px", "largest radius of a blob")
    size_tolerance_px: float = threshold(0.4, "px", "uncertainty of the diameter of a small blob", BLOB_PAIRS)
    least_contrast: float = threshold(1.0, "sigma", "smallest contrast about the seed", BLOB_PAIRS)
    moved_contrast: float = threshold(0.25, "sigma", "smallest contrast about the grey-weighted centre", BLOB_PAIRS)
    surroundings_px: float = threshold(1.5, "px", "distance outside the outline at which the surroundings are sampled")
    centre_samples: int = threshold(10, "points", "samples along each ray for the grey-weighted centre")
    centre_level: float = threshold(0.3, "", "share of the contrast up to which a grey value has no weight", BLOB_PAIRS)
    centre_rounds: int = threshold(3, "rounds", "iterations of the grey-weighted centre", BLOB_PAIRS)
    same_blob: float = threshold(0.35, "", "largest distance of the centres of one blob over its radius")
    sigma_px: tuple[float, float] = threshold((0.15, 0.03), "px, share", "sigma of a coordinate", BLOB_PAIRS)


#: Log odds of detection in another view: constant, logarithm of radius / 4 px and its square, unevenness, dark.
CHANCE_TERMS = (0.82, 0.42, -0.94, -0.45, -0.82)

#: Where the inside and the surroundings are sampled: at a share of the outline's radii, and so far beyond.
_INSIDE_OUTSIDE = ((0.5, 0.0), (1.0, BLOBS.surroundings_px))
_DIRECTION = np.exp(2j * np.pi * np.arange(BLOBS.rays) / BLOBS.rays)


class Blobs(NamedTuple):
    """Blobs of a window, columns of length n.

    xy : (n, 2) column, row; sign : 1 bright, -1 dark; radii : (n, rays) of the outline about the centre
    contrast : in local standard deviations; chance : probability of being detected in another view
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
        return BLOBS.sigma_px[0] + BLOBS.sigma_px[1] * self.radius

    def ellipse(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the longer and shorter diameter ``(n, 2)`` of the oval, its azimuth and RMS about it ``(n,)``."""
        wave = np.fft.rfft(self.radii, axis=1)[:, 2] / BLOBS.rays
        length = np.minimum(2.0 * np.abs(wave), 0.8 * self.radius)
        size = 2.0 * np.column_stack([self.radius + length, self.radius - length])
        return size, -np.angle(wave) / 2.0, _compute_roughness_px(self.radii)

    def grey_contrast(self, grey: np.ndarray) -> np.ndarray:
        """Return grey values inside - outside, ``(n,)``."""
        inside, outside = (_sample_ring(grey, self.xy, self.radii, *ring) for ring in _INSIDE_OUTSIDE)
        return inside - outside

    def select(self, keep: np.ndarray) -> Blobs:
        """Return some blobs (mask or indices)."""
        return Blobs(*(column[keep] for column in self))


def find_blobs(z: np.ndarray, usable: np.ndarray, options: CentreOptions) -> Blobs:
    """Return the blobs of a normalised image (float32); those that touch unusable pixels are left out."""
    xy, sigma, sign = _find_seeds(z)
    radius = BLOBS.radius_of_sigma * sigma
    slopes_of = cache(partial(_compute_slopes, z))  # by the factor of reduction
    for _ in range(2):
        if not len(xy):
            break
        # The radii (n, rays) of the best closed outline around each point
        factor = np.where(radius < 2.0 * BLOBS.fine_radius_px, 1, 2)
        radii = np.empty((len(xy), BLOBS.rays))
        for reduced in np.unique(factor).tolist():
            rows = np.flatnonzero(factor == reduced)
            for start in range(0, len(rows), BLOBS.batch):
                part = rows[start : start + BLOBS.batch]
                radii[part] = _trace_best_paths(slopes_of(reduced), reduced, xy[part], radius[part], sign[part])
        # The centres of gravity of the outlines, and the radii of circles of their area
        corner = radii * _DIRECTION
        following = np.roll(corner, -1, axis=1)
        cross = corner.real * following.imag - following.real * corner.imag
        area = cross.sum(axis=1)
        centroid = ((corner + following) * cross).sum(axis=1) / (3.0 * area)
        centre, size = xy + np.column_stack([centroid.real, centroid.imag]), np.sqrt(area / (2.0 * np.pi))
        shifted = np.hypot(*(centre - xy).T)
        keep = (shifted <= BLOBS.largest_shift * radius) & (size <= BLOBS.largest_radius_px)
        keep &= (2.0 * size >= options.smallest_px - BLOBS.size_tolerance_px) & (2.0 * size <= options.largest_px)
        xy, radius, sign, radii = centre[keep], size[keep], sign[keep], radii[keep]
    if not len(xy):
        return Blobs(np.empty((0, 2)), np.empty(0), np.empty((0, BLOBS.rays)), np.empty(0), np.empty(0))
    inside, outside = (_sample_ring(z, xy, radii, *at) for at in _INSIDE_OUTSIDE)
    contrast = sign * (inside - outside)
    clear = np.flatnonzero(contrast >= BLOBS.least_contrast)
    xy, radii, sign = xy[clear], radii[clear], sign[clear]
    for _ in range(BLOBS.centre_rounds):
        xy = _compute_grey_centres(z, xy, radii, inside[clear], outside[clear])
    # The blob about the moved centre must have contrast as well, and lie on usable pixels
    moved_in, moved_out = (_sample_ring(z, xy, radii, *at) for at in _INSIDE_OUTSIDE)
    contrast = sign * (moved_in - moved_out)
    reach = np.concatenate([radii + 2.0 * BLOBS.surroundings_px, radii, radii / 2.0, np.zeros((len(xy), 1))], axis=1)
    at = xy[:, 0, None] + 1j * xy[:, 1, None] + reach * np.r_[_DIRECTION, _DIRECTION, _DIRECTION, 1.0]
    column, row = np.rint(at.real).astype(np.int64), np.rint(at.imag).astype(np.int64)
    is_inside = (column >= 0) & (row >= 0) & (column < usable.shape[1]) & (row < usable.shape[0])
    keep = (contrast >= BLOBS.moved_contrast) & (is_inside & usable[row * is_inside, column * is_inside]).all(axis=1)
    xy, radii, sign, contrast = xy[keep], radii[keep], sign[keep], contrast[keep]
    chance = 1.0 / (1.0 + np.exp(-compute_chance_terms(radii, sign) @ CHANCE_TERMS))
    blobs = Blobs(xy, sign, radii, contrast, chance)
    return blobs.select(_select_distinct(blobs))


def _find_seeds(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions ``(n, 2)``, scales and signs ``(n,)`` of the maxima of the Hessian's determinant."""
    second, first, one = (np.array(kernel, np.float32) for kernel in ([1, -2, 1], [-0.5, 0, 0.5], [1]))
    factor, level = 1, z
    seeds = []
    for sigma in BLOBS.seed_sigmas_px:
        if sigma / factor > BLOBS.largest_at_level_px:
            factor *= 2
            level = reduce_by_area(z, (z.shape[1] // factor, z.shape[0] // factor))
        scale = sigma / factor
        smooth = blur(level, np.sqrt(scale**2 - 0.25), "reflect")
        xx = filter_separable(smooth, second, one, "reflect")
        yy = filter_separable(smooth, one, second, "reflect")
        mixed = filter_separable(smooth, first, first, "reflect")
        strength = np.float32(scale**4) * (xx * yy - mixed * mixed)
        peak = (strength >= compute_local_maximum(strength, 1.5)) & (strength > BLOBS.seed_strength**2)
        row, column = np.nonzero(peak)
        bright = np.where(xx[row, column] + yy[row, column] < 0.0, 1.0, -1.0)
        position = (np.column_stack([column, row]) + 0.5) * factor - 0.5
        seeds.append((position, np.full(len(row), sigma), bright))
    xy, scales, sign = (np.concatenate(part) for part in zip(*seeds, strict=True))
    return xy, scales, sign


def _compute_slopes(z: np.ndarray, factor: int) -> np.ndarray:
    """Return the slopes of an image reduced by a factor, per pixel of it, complex: by column + 1j by row."""
    level = z if factor == 1 else reduce_by_area(z, (z.shape[1] // factor, z.shape[0] // factor))
    smooth = blur(level, BLOBS.slope_px, "reflect")
    half, one = np.array([-0.5, 0.0, 0.5], np.float32), np.array([1.0], np.float32)
    derivatives = np.empty((*smooth.shape, 2), np.float32)
    derivatives[..., 0], derivatives[..., 1] = slopes(smooth, one, half, "reflect")
    return derivatives.view(np.complex64)[..., 0]


def _trace_best_paths(
    slopes: np.ndarray, factor: int, xy: np.ndarray, radius: np.ndarray, sign: np.ndarray
) -> np.ndarray:
    """Return the radii along each ray of the closed path with the most slope and the fewest turns, ``(n, rays)``."""
    step = (BLOBS.farthest_radius / BLOBS.nearest_radius) ** (1.0 / (BLOBS.radii - 1))
    distance = radius[:, None] * BLOBS.nearest_radius * step ** np.arange(BLOBS.radii)
    x = (xy[:, :1, None] + _DIRECTION.real[:, None] * distance[:, None] + 0.5) / factor - 0.5
    y = (xy[:, 1:, None] + _DIRECTION.imag[:, None] * distance[:, None] + 0.5) / factor - 0.5
    slope = interpolate_bilinear(slopes, x, y)
    ray = _DIRECTION.astype(np.complex64)[:, None]
    outwards = -sign[:, None, None].astype(np.float32) * (slope.real * ray.real + slope.imag * ray.imag)
    usual = np.maximum(np.median(outwards.max(axis=2), axis=1), 1e-3)[:, None, None]
    gain = np.maximum(outwards, 0.0) / usual
    gain = 2.0 * gain / (1.0 + gain)  # a very steep edge next to it does not draw the path away
    # Index on each ray (n, rays) of the closed path with the largest sum of gain
    gain = np.ascontiguousarray(np.moveaxis(gain, 1, 0))
    rays, count, radii = gain.shape
    best = np.zeros((count, radii), np.float32)
    came = np.empty((2 * rays, count, radii), np.int8)
    from_within, from_beyond = np.full((2, count, radii), -np.inf, np.float32)
    for turn in range(2 * rays):
        from_within[:, 1:] = best[:, :-1] - np.float32(BLOBS.turn_cost)
        from_beyond[:, :-1] = best[:, 1:] - np.float32(BLOBS.turn_cost)
        neighbour_gain = np.maximum(from_within, from_beyond)
        came[turn] = np.where(best >= neighbour_gain, 0, np.where(from_within >= from_beyond, -1, 1))
        best = np.maximum(best, neighbour_gain) + gain[turn % rays]
    at, row = best.argmax(axis=1), np.arange(count)
    path = np.empty((count, 2 * rays), np.int64)
    for turn in range(2 * rays - 1, -1, -1):
        path[:, turn] = at
        at = at + came[turn, row, at]
    half = rays // 2
    index = np.concatenate([path[:, rays : rays + half], path[:, half:rays]], axis=1)
    # The parabola through the slopes around the path
    middle = np.clip(index, 1, BLOBS.radii - 2)[..., None]
    previous_gain, at, next_gain = (np.take_along_axis(outwards, middle + k, axis=2)[..., 0] for k in (-1, 0, 1))
    bend = previous_gain - 2.0 * at + next_gain
    shift = np.where(bend < 0.0, 0.5 * (previous_gain - next_gain) / np.where(bend < 0.0, bend, 1.0), 0.0)
    return radius[:, None] * BLOBS.nearest_radius * step ** (middle[..., 0] + np.clip(shift, -0.5, 0.5))


def _sample_ring(z: np.ndarray, xy: np.ndarray, radii: np.ndarray, share: float, beyond_px: float) -> np.ndarray:
    """Return the median ``(n,)`` along outlines at a share of their radii and so far beyond."""
    positions = xy[:, 0, None] + 1j * xy[:, 1, None] + (share * radii + beyond_px) * _DIRECTION
    return np.asarray(np.median(interpolate_bilinear(z, positions.real, positions.imag), axis=1))


def _compute_grey_centres(
    z: np.ndarray, xy: np.ndarray, radii: np.ndarray, inside: np.ndarray, outside: np.ndarray
) -> np.ndarray:
    """Return the means ``(n, 2)`` of positions within outlines, weighted by the grey value above the surroundings."""
    share = (np.arange(BLOBS.centre_samples) + 0.5) / BLOBS.centre_samples
    reach = (radii + BLOBS.surroundings_px)[:, :, None]
    offset = reach * share * _DIRECTION[:, None]
    grey = interpolate_bilinear(z, xy[:, :1, None] + offset.real, xy[:, 1:, None] + offset.imag)
    above = (grey - outside[:, None, None]) / (inside - outside)[:, None, None]
    weight = np.clip(above - BLOBS.centre_level, 0.0, 1.0) * reach**2 * share
    shift = (weight * offset).sum(axis=(1, 2)) / np.maximum(weight.sum(axis=(1, 2)), 1e-9)
    return xy + np.column_stack([shift.real, shift.imag])


def compute_chance_terms(radii: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """Return the predictors ``(n, 5)`` of the log odds of detection, in the order of `CHANCE_TERMS`."""
    radius = np.sqrt(np.mean(radii**2, axis=1))
    size, uneven = np.log(radius / 4.0), np.minimum(10.0 * _compute_roughness_px(radii) / radius, 3.0)
    return np.column_stack([np.ones(len(radius)), size, size**2, uneven, sign < 0.0])


def _compute_roughness_px(radii: np.ndarray) -> np.ndarray:
    """Return the RMS ``(n,)`` of an outline about the smooth oval through it."""
    waves = np.abs(np.fft.rfft(radii, axis=1)) / BLOBS.rays
    return np.asarray(np.sqrt(2.0 * np.sum(waves[:, 3:] ** 2, axis=1)))


def _select_distinct(blobs: Blobs) -> np.ndarray:
    """Return the indices of blobs of which no better one has the same place and sign."""
    radius = blobs.radius
    if not len(radius):
        return np.empty(0, np.int64)
    pairs = cKDTree(blobs.xy).query_pairs(BLOBS.same_blob * BLOBS.largest_radius_px, output_type="ndarray")
    first, second = pairs.T
    distance_px = np.hypot(*(blobs.xy[first] - blobs.xy[second]).T)
    is_duplicate = (distance_px < np.maximum(BLOBS.same_blob * np.minimum(radius[first], radius[second]), 1.0)) & (
        blobs.sign[first] == blobs.sign[second]
    )
    rank = np.lexsort((blobs.xy[:, 0], blobs.xy[:, 1], -blobs.contrast * np.sqrt(radius))).argsort()
    neighbours: dict[int, list[int]] = {}
    for a, b in pairs[is_duplicate].tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    free = np.ones(len(radius), dtype=bool)
    for row in np.argsort(rank).tolist():
        if free[row]:
            free[neighbours.get(row, [])] = False
    return np.flatnonzero(free)

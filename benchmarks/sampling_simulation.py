"""Sampling errors of corners and centres by Monte Carlo: where the 47 % and 60 % of thesis table 2.3 hold, where not.

A square of any size, position and orientation is seen by two images, the second with the same or a coarser pixel, each
with its blur and noise. Both images measure the same corner and the same centre, as whole pixels (recognised where more
than half covered, as in the thesis) or to a fraction of a pixel; the error is what the two measurements differ by, in
pixels of the first image. The pixel's own integration is a Gaussian of the same variance (1/12 px²).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from scipy.special import ndtr

from ..hrsi_engine.laboratory.interest_points.corners import compute_harris_strength, compute_peak_offsets
from ..hrsi_engine.laboratory.interest_points.options import CornerOptions
from ..hrsi_engine.measurement.interest_points.corners import compute_structure_tensor

PIXEL_SIGMA = 1.0 / np.sqrt(12.0)
MARGIN_PX = 8


@dataclass(frozen=True)
class SamplingCase:
    """What is sampled: side of the square in pixels of the first image, size of the second image's pixel in them.

    noise : share of the contrast; psf_px : standard deviation of the blur in each image's own pixels;
    oblique : any orientation, else along the pixels; subpixel : fractions of a pixel are measured
    """

    side_px: float
    pixel_ratio: float = 1.0
    noise: float = 0.0
    psf_px: float = 0.0
    oblique: bool = False
    subpixel: bool = False


class SamplingResult(NamedTuple):
    """Root mean square distances (px of the first image) between both images' measurements, and centre over corner.

    ``corner_steady_px`` is the part of the corner's error that is the same in every trial, along the diagonal.
    """

    corner_px: float
    centre_px: float
    ratio: float
    corner_steady_px: float


def simulate_sampling(case: SamplingCase, trials: int = 1000, seed: int = 1) -> SamplingResult:
    """Return the errors of corners and centres in many random trials; the same seed gives the same result."""
    rng = np.random.default_rng(seed)
    corner, centre = np.empty((trials, 2)), np.empty((trials, 2))
    measure_corner, measure_centre = MEASURES[case.subpixel]
    for trial in range(trials):
        azimuth = rng.uniform(0.0, np.pi / 2.0) if case.oblique else 0.0
        outward = np.array([np.cos(azimuth + np.pi / 4.0), np.sin(azimuth + np.pi / 4.0)])
        found = []
        for pixel in (1.0, case.pixel_ratio):
            offset = rng.uniform(-0.5, 0.5, 2)
            patch, origin = _patch(case, pixel, azimuth, offset, rng)
            # undo the random position: what remains is the error, in pixels of the first image
            found.append(
                [(measure(patch, outward) + origin - offset) * pixel for measure in (measure_corner, measure_centre)]
            )
        turn = np.array([outward, [-outward[1], outward[0]]])
        corner[trial] = turn @ (found[1][0] - found[0][0])
        centre[trial] = found[1][1] - found[0][1]
    rms = [float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) for error in (corner, centre)]
    return SamplingResult(rms[0], rms[1], rms[1] / rms[0], float(abs(corner[:, 0].mean())))


def _patch(
    case: SamplingCase, pixel: float, azimuth: float, offset: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return an image (0 background, 1 object) in its own pixels, and the position of its first pixel's middle.

    Positions count from the object's centre before it is moved by ``offset``.
    """
    half = case.side_px / pixel / 2.0
    reach = int(np.ceil(1.5 * half)) + MARGIN_PX
    axis = np.arange(-reach, reach + 1, dtype=np.float64)
    x, y = np.meshgrid(axis - offset[0], axis - offset[1])
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    blur = np.hypot(PIXEL_SIGMA, case.psf_px)
    cover = np.ones_like(x)
    for along in (cos * x + sin * y, cos * y - sin * x):
        cover *= ndtr((half - along) / blur) - ndtr((-half - along) / blur)
    return cover + case.noise * rng.standard_normal(cover.shape), np.array([-reach, -reach], dtype=np.float64)


# ---- measurements: position in the patch -----------------------------------------------------------------------


def _recognised(patch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return columns and rows of the pixels of the largest recognised object."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((patch > 0.5).astype(np.uint8), connectivity=4)
    if count < 2:
        row, column = np.unravel_index(np.argmax(patch), patch.shape)
        return np.array([column]), np.array([row])
    rows, columns = np.nonzero(labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return columns, rows


def _corner_pixel(patch: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """Return the recognised pixel farthest along the corner's diagonal; the mean of equals."""
    columns, rows = _recognised(patch)
    far = columns * outward[0] + rows * outward[1]
    best = far > far.max() - 1e-6
    return np.array([columns[best].mean(), rows[best].mean()])


def _centre_pixels(patch: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """Return the mean of the recognised pixels."""
    columns, rows = _recognised(patch)
    return np.array([columns.mean(), rows.mean()])


def _corner_peak(patch: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """Return the sub-pixel peak of Harris's strength nearest to the corner pixel."""
    strength = compute_harris_strength(compute_structure_tensor(patch.astype(np.float32)), CornerOptions())
    guess = np.rint(_corner_pixel(patch, outward)).astype(int)
    low = np.maximum(guess - 4, 1)
    near = strength[low[1] : guess[1] + 5, low[0] : guess[0] + 5]
    row, column = np.unravel_index(np.argmax(near), near.shape)
    rows, columns = np.array([row + low[1]]), np.array([column + low[0]])
    return np.array([columns[0], rows[0]]) + compute_peak_offsets(np.pad(strength, 1), rows + 1, columns + 1)[0]


def _weighted_centre(patch: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """Return the grey-weighted centroid of the object and the pixels beside it."""
    columns, rows = _recognised(patch)
    mask = np.zeros(patch.shape, np.uint8)
    mask[rows, columns] = 1
    weight = patch * cv2.dilate(mask, np.ones((5, 5), np.uint8))
    row, column = np.indices(patch.shape)
    return np.array([(weight * column).sum(), (weight * row).sum()]) / weight.sum()


Measure = Callable[[np.ndarray, np.ndarray], np.ndarray]
#: How corner and centre are measured: as whole pixels, or to a fraction of a pixel.
MEASURES: dict[bool, tuple[Measure, Measure]] = {
    False: (_corner_pixel, _centre_pixels),
    True: (_corner_peak, _weighted_centre),
}

#: Cases that show where the thesis's ratios hold, by the question that they answer.
CASES: dict[str, SamplingCase] = {
    "same resolution, 6 px, as in table 2.2": SamplingCase(6.0),
    "same, 6 px, any orientation": SamplingCase(6.0, oblique=True),
    "same, 20 px, along the pixels": SamplingCase(20.0),
    "same, 20 px, any orientation": SamplingCase(20.0, oblique=True),
    "same, 6 px, blur 0.7 px, noise 5 %": SamplingCase(6.0, noise=0.05, psf_px=0.7, oblique=True),
    "same, 20 px, blur 0.7 px, noise 5 %": SamplingCase(20.0, noise=0.05, psf_px=0.7, oblique=True),
    "same, 20 px, sub-pixel": SamplingCase(20.0, noise=0.05, psf_px=0.7, oblique=True, subpixel=True),
    "same, 20 px, sub-pixel, noise 20 %": SamplingCase(20.0, noise=0.2, psf_px=0.7, oblique=True, subpixel=True),
    "1:4, 8 px, as in table 2.1": SamplingCase(8.0, 4.0),
    "1:4, 8 px, any orientation": SamplingCase(8.0, 4.0, oblique=True),
    "1:4, 24 px, along the pixels": SamplingCase(24.0, 4.0),
    "1:4, 24 px, any orientation": SamplingCase(24.0, 4.0, oblique=True),
    "1:4, 80 px, any orientation": SamplingCase(80.0, 4.0, oblique=True),
    "1:4, 24 px, blur 0.7 px, noise 5 %": SamplingCase(24.0, 4.0, 0.05, 0.7, oblique=True),
    "1:4, 40 px, sub-pixel": SamplingCase(40.0, 4.0, 0.05, 0.7, oblique=True, subpixel=True),
    "1:4, 80 px, sub-pixel": SamplingCase(80.0, 4.0, 0.05, 0.7, oblique=True, subpixel=True),
}

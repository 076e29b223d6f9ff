"""Mosaic of orthoimages: radiometric levelling, seamlines, the image of every pixel, and blending at the seams.

The image with the smallest incidence angle is preferred. Where its area ends, the seamline to the next one is the
minimum cut through a band inside that area, of the differences of the levelled grey values at reduced resolution
(Kwatra et al. 2003, by OpenCV). Hidden ground does not move seamlines: at full resolution, pixels that the image of
their area does not show, and those next to them, are taken from the other images.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy import ndimage

from ..foundation.pixel_filters import blur, load_opencv
from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import MEMORY, REDUNDANCY, SIGNIFICANCE, threshold, thresholds
from .grid import ORTHO

NONE = -1  #: label of pixels that no image shows


@thresholds
class MOSAIC:
    """Seamlines, levelling and blending."""

    reduced_px: int = threshold(250_000, "px", "size at which seamlines are searched, at most (time of the cut)")
    band_px: int = threshold(24, "px", "width of the band in which a seamline lies, at reduced resolution")
    fewest_px: int = threshold(
        200, "px", "smallest overlap that determines the levels of a pair, at reduced resolution"
    )
    gains: tuple[float, float] = threshold((0.5, 2.0), "", "smallest and largest gain of an image")
    blend_px: float = threshold(1.0, "px", "standard deviation of the transition at a seamline")


def fit_levels(bands: np.ndarray) -> np.ndarray:
    """Return gain and offset ``(n, 2)`` by which n images get equal levels in their overlaps, changed least.

    The ratios of the robust scatters in the overlaps of all pairs, then the medians of the differences, are adjusted by
    least squares.

    bands : (n, rows, columns) grey values of one band at reduced resolution, NaN where there are none
    """
    count = len(bands)
    middle = np.array([np.nanmedian(band) if np.isfinite(band).any() else 0.0 for band in bands])
    pairs: list[tuple[int, int]] = []
    overlaps, ratios = [], []
    for i, j in combinations(range(count), 2):
        common = np.isfinite(bands[i]) & np.isfinite(bands[j])
        values = bands[[i, j]][:, common] - middle[[i, j], None]
        values = values[:, :: 1 + values.shape[1] // MEMORY.rows]
        if values.shape[1] < MOSAIC.fewest_px:
            continue
        values, scatter = _leave_out_changes(values)
        if (scatter > 0.0).all():
            pairs.append((i, j))
            overlaps.append(values)
            ratios.append(np.log(scatter[1] / scatter[0]))
    design = np.zeros((len(pairs) + count, count))
    for row, (i, j) in enumerate(pairs):
        design[row, [i, j]] = 1.0, -1.0
    design[len(pairs) :] = REDUNDANCY.regularised * np.eye(count)

    def solve(differences: Sequence[float]) -> np.ndarray:
        return np.linalg.lstsq(design, np.r_[differences, np.zeros(count)], rcond=None)[0]

    # Gains apply to deviations from the median of the image, so that they do not change its level
    gain = np.clip(np.exp(solve(ratios)), *MOSAIC.gains)
    differences = [
        float(np.median(middle[j] + gain[j] * second - middle[i] - gain[i] * first))
        for (i, j), (first, second) in zip(pairs, overlaps, strict=True)
    ]
    return np.column_stack([gain, middle * (1.0 - gain) + solve(differences)])


def _leave_out_changes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the grey values ``(2, m)`` of a pair without those that changed, and their robust scatters ``(2,)``."""
    for _ in range(2):
        deviation = values - np.median(values, axis=1)[:, None]
        scatter = robust_sigma(deviation, axis=1)
        first, second = deviation / np.where(scatter > 0.0, scatter, 1.0)[:, None]
        difference = np.abs(first - second)
        values = values[:, difference <= SIGNIFICANCE.sigmas * robust_sigma(difference)]
    return values, scatter


def find_seams(grey: np.ndarray, incidence_deg: Sequence[float]) -> np.ndarray:
    """Return the index of the image to which each pixel belongs, at reduced resolution; `NONE` beyond all images.

    grey : (n, rows, columns) levelled grey values, float32, NaN where there are none; incidence_deg : of the images
    """
    cv2 = load_opencv()
    # Gaps within an image, such as hidden ground, are part of its area
    areas = np.array([ndimage.binary_fill_holes(np.isfinite(one)) for one in grey])
    labels = np.full(grey.shape[1:], NONE)
    for image in np.argsort(incidence_deg, kind="stable")[::-1]:
        labels[areas[image]] = image
    masks, pictures, corners = [], [], []
    present = np.unique(labels[labels != NONE]).tolist()
    if len(present) < 2:
        return labels
    for image in present:
        near = ndimage.distance_transform_cdt(labels != image) <= MOSAIC.band_px
        ends = (labels == NONE) | (labels == image)
        # The band lies inside the area of the preferred image: other images are extended into it
        mask = (labels == image) | (near & areas[image] & ~ends)
        rows, columns = (slice(int(k.min()), int(k.max()) + 1) for k in np.nonzero(mask))
        level = np.nan_to_num(grey[image, rows, columns], nan=float(np.nanmedian(grey[image])))
        pictures.append(np.repeat(level[..., None], 3, axis=2).astype(np.float32))
        masks.append(mask[rows, columns].astype(np.uint8) * 255)
        corners.append((columns.start, rows.start))
    cut = cv2.detail_GraphCutSeamFinder("COST_COLOR").find(pictures, corners, masks)
    for image, (left, top), mask in zip(present, corners, cut, strict=True):
        inside = (mask.get() if hasattr(mask, "get") else mask) > 0
        labels[top : top + inside.shape[0], left : left + inside.shape[1]][inside] = image
    return labels


def choose_images(valid: np.ndarray, areas: np.ndarray, order: Sequence[int]) -> np.ndarray:
    """Return the index of the image that each pixel is taken from; `NONE` if no image shows it.

    The image of the area is used where it shows the pixel and those around it, then the others in their order; then
    images that show the pixel itself.

    valid : (n, rows, columns) whether the image shows the pixel; areas : (rows, columns) of `find_seams`
    order : indices of the images, the best one first
    """
    cv2 = load_opencv()
    kernel = np.ones((2 * ORTHO.margin_px + 1,) * 2, np.uint8)
    labels = np.full(areas.shape, NONE)
    away = np.array([cv2.erode(one.astype(np.uint8), kernel) > 0 for one in valid])
    row, column = np.indices(areas.shape, sparse=True)
    for shown in (away, valid):
        by_area = shown[areas, row, column] & (areas != NONE)
        labels[by_area & (labels == NONE)] = areas[by_area & (labels == NONE)]
        for image in order:
            labels[shown[image] & (labels == NONE)] = image
    return labels


def blend(values: np.ndarray, valid: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the grey values ``(bands, rows, columns)`` of a mosaic: those of the labels, blended where they change.

    values : (n, bands, rows, columns) levelled grey values; valid : (n, rows, columns); labels : of `choose_images`
    """
    weights = np.array([blur((labels == k).astype(np.float32), MOSAIC.blend_px) * one for k, one in enumerate(valid)])
    total = weights.sum(axis=0)
    weights /= np.where(total > 0.0, total, 1.0)
    return np.asarray(np.einsum("nrc,nbrc->brc", weights, np.where(valid[:, None], values, 0.0)))

"""What OpenCV does where it is there, NumPy and SciPy do where it is not: the same filters, features and contours."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.foundation.array_filters import ArrayFilters
from hrsi.hrsi_engine.foundation.opencv_filters import OpenCVFilters
from hrsi.hrsi_engine.measurement.interest_points.level_regions import (
    MserLimits,
    find_mser_by_opencv,
    find_mser_by_tree,
)
from hrsi.hrsi_engine.measurement.interest_points.outlines import trace_contours
from hrsi.hrsi_engine.measurement.tile_matching.sift_arrays import detect_sift_by_numpy
from hrsi.hrsi_engine.measurement.window_matching.correlation import correlate_template

RNG = np.random.default_rng(3)
IMAGE = RNG.normal(500.0, 100.0, (75, 256)).astype(np.float32)  # 256: columns on the same lines of a cache
MASK = RNG.random((75, 256)) > 0.05
FLOAT32 = 2e-4  # grey values: sums of some hundred float32 numbers of 500, in another order


def texture(size: int) -> np.ndarray:
    """Return a smooth texture with details of all sizes, 8 bit."""
    rng = np.random.default_rng(7)
    layers = [
        2.0**octave * cv2.resize(rng.normal(size=(size >> octave,) * 2), (size, size), interpolation=cv2.INTER_CUBIC)
        for octave in range(1, 6)
    ]
    total = np.sum(layers, axis=0)
    return np.clip(128.0 + 40.0 * total / total.std(), 0, 255).astype(np.uint8)


CALLS = {
    "separable, reflect": ("filter_separable", (IMAGE, np.float32([-1, 0, 1]), np.float32([1, 2, 1]), "reflect")),
    "separable, mirror": ("filter_separable", (IMAGE, np.float32([1, 2, 1]), np.float32([1]), "mirror")),
    "separable, constant": ("filter_separable", (IMAGE.astype(float), np.ones(5), np.ones(5), "constant")),
    "blur": ("blur", (IMAGE, 1.7, "mirror")),
    "box": ("box_mean", (IMAGE, 7)),
    "erode": ("erode", (MASK, 5, True)),
    "erode, outside False": ("erode", (MASK, 3, False)),
    "erode, all True": ("erode", (np.ones((9, 12), bool), 5, False)),
    "erode, smaller than the square": ("erode", (np.ones((3, 4), bool), 9, False)),
    "largest, square": ("compute_local_maximum", (IMAGE, 1.5)),
    "largest, disc": ("compute_local_maximum", (IMAGE, 4.3)),
    "reduce": ("reduce_by_area", (IMAGE, (100, 31))),
    "reduce by 4": ("reduce_by_area", (IMAGE[:72], (64, 18))),
    "reduce a mask": ("reduce_mask", (MASK, (100, 31))),
    "enlarge": ("enlarge", (IMAGE, 8)),
}


@pytest.mark.parametrize("name", CALLS)
def test_filters_give_the_same(name: str):
    function, arguments = CALLS[name]
    by_arrays, by_opencv = (getattr(way, function)(*arguments) for way in (ArrayFilters, OpenCVFilters))
    assert by_arrays.dtype == by_opencv.dtype
    assert by_arrays.shape == by_opencv.shape
    np.testing.assert_allclose(by_arrays.astype(float), by_opencv.astype(float), rtol=1e-6, atol=FLOAT32)


@pytest.mark.parametrize(("order", "outside"), [(0, None), (0, 0.0), (1, None), (1, 0.0), (3, None)])
def test_resampling_gives_the_same(order: int, outside: float | None):
    """At positions in 32nds of a pixel, which are OpenCV's; inside, at the edge and far beyond."""
    x, y = (np.round(RNG.uniform(-9.0, size + 9.0, (40, 50)) * 32.0) / 32.0 for size in (256, 75))
    if order == 0:
        x, y = np.floor(x) + 0.25, np.floor(y) + 0.75  # halves may go either way
    x, y = x.astype(np.float32), y.astype(np.float32)
    by_arrays, by_opencv = (way.interpolate(IMAGE, x, y, order, outside) for way in (ArrayFilters, OpenCVFilters))
    np.testing.assert_allclose(by_arrays, by_opencv, atol=0.02)  # weights of OpenCV are rounded to 2^-15


def test_maps_longer_than_opencv_takes():
    x = np.linspace(0.0, 200.0, 40000, dtype=np.float32)[None]
    np.testing.assert_allclose(
        OpenCVFilters.interpolate(IMAGE, x, x / 4.0, 1, None),
        ArrayFilters.interpolate(IMAGE, x, x / 4.0, 1, None), atol=12.0,
    )  # fmt: skip  # 1/64 of a pixel, by the largest differences of neighbours


def test_correlation_of_a_window():
    area, window = IMAGE[10:60, 20:90], IMAGE[30:47, 41:60]
    surface = correlate_template(window, area)
    np.testing.assert_allclose(surface, cv2.matchTemplate(area, window, cv2.TM_CCOEFF_NORMED), atol=1e-4)
    assert np.unravel_index(surface.argmax(), surface.shape) == (20, 21)
    assert surface.max() == pytest.approx(1.0)
    assert (correlate_template(window, np.full((40, 40), 7.0)) == -1.0).all()  # nothing to see


def test_sift_finds_what_opencv_finds():
    image = texture(256)
    points, _ = cv2.SIFT_create(600, contrastThreshold=0.01, enable_precise_upscale=True).detectAndCompute(image, None)
    theirs = np.array([point.pt for point in points])
    xy, strength, descriptors = detect_sift_by_numpy(image, np.ones(image.shape, bool), 600, 0.01)
    nearest = np.linalg.norm(xy[:, None] - theirs, axis=2).min(axis=0)
    assert (nearest < 0.01).mean() > 0.97
    assert (np.diff(strength) <= 0.0).all()
    assert descriptors.shape == (len(xy), 128)


@pytest.mark.parametrize(("scale", "turn_deg"), mark_beyond(1, "thorough", [(1.0, 0.0), (0.8, 40.0), (1.3, 200.0)]))
def test_sift_matches_a_turned_image(scale: float, turn_deg: float):
    """The mutual nearest descriptors of an image and its known similarity lie on one another."""
    first = texture(256)
    similarity = cv2.getRotationMatrix2D((127.5, 127.5), turn_deg, scale)
    smooth = cv2.GaussianBlur(first, (0, 0), 0.5 / scale) if scale < 1.0 else first
    second = cv2.warpAffine(smooth, similarity, (256, 256), flags=cv2.INTER_CUBIC)
    seen = cv2.warpAffine(np.ones_like(first), similarity, (256, 256)) > 0
    seen = cv2.erode(seen.astype(np.uint8), np.ones((31, 31))).astype(bool)
    (xy1, _, d1), (xy2, _, d2) = (
        detect_sift_by_numpy(image, usable, 500, 0.01)
        for image, usable in ((first, np.ones_like(seen)), (second, seen))
    )
    distance = np.linalg.norm(d1[:, None].astype(float) - d2, axis=2)
    there = distance.argmin(axis=1)
    mutual = distance.argmin(axis=0)[there] == np.arange(len(d1))
    error = xy1[mutual] @ similarity[:, :2].T + similarity[:, 2] - xy2[there[mutual]]
    right = np.linalg.norm(error, axis=1) < 1.0
    print(f"scale {scale}, turn {turn_deg}: {right.sum()} of {mutual.sum()} mutual pairs within 1 px")
    assert right.sum() > 60
    assert right.mean() > 0.5


def test_contours_are_those_of_opencv():
    masks = []
    for number in range(40):
        rng = np.random.default_rng(number)
        mask = cv2.GaussianBlur(rng.normal(size=(30, 40)), (0, 0), 2.0) > 0.02
        mask[[0, -1]] = False
        mask[:, [0, -1]] = False
        labels = cv2.connectedComponents(mask.astype(np.uint8))[1]
        masks.append(labels == 1)
    masks.append(np.pad(np.ones((1, 1), bool), 1))
    for mask, contour in zip(masks, trace_contours(masks), strict=True):
        (theirs,), _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        theirs = theirs[:, 0][::-1]
        start = int(np.flatnonzero((theirs == contour[0]).all(axis=1))[0])
        assert len(contour) == len(theirs)
        turned = np.roll(theirs, -start, axis=0)
        assert (contour == turned).all() or {*map(tuple, contour)} == {*map(tuple, theirs)}


def key(region: np.ndarray) -> tuple[tuple[int, int], ...]:
    return tuple(sorted(map(tuple, region.tolist())))


@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize(("delta", "change"), [(4, 0.7), (16, 1.0)])
def test_stable_regions_are_those_of_opencv(invert: bool, delta: int, change: float):
    """Pixel by pixel; of a hundred a few are others, where two regions change alike."""
    image = texture(400) ^ (255 if invert else 0)
    limits = MserLimits(delta, 12, 1600, change)
    theirs, ours = (set(map(key, find(image, limits))) for find in (find_mser_by_opencv, find_mser_by_tree))
    print(f"{len(theirs)} regions of OpenCV, {len(ours)} by a tree, {len(theirs & ours)} the same")
    assert len(theirs) >= 20
    assert len(theirs & ours) >= 0.95 * max(len(theirs), len(ours))


@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (3, 3), (60, 60)])
def test_even_images_have_no_stable_region(shape: tuple[int, int]):
    """A part of them would be one, and the whole is too small or too large."""
    assert find_mser_by_tree(np.full(shape, 7, np.uint8), MserLimits(4, 12, 1600, 0.7)) == []

"""Filters, resampling and contours of `pixel_filters` against SciPy, and what happens without OpenCV or numba."""

import pickle
import subprocess
import sys

import cv2
import numpy as np
import pytest
from scipy import ndimage

from hrsi.hrsi_engine.foundation import pixel_filters as filters
from hrsi.hrsi_engine.foundation.errors import InputError, MissingPackageError
from hrsi.hrsi_engine.foundation.packages import PIXEL_PACKAGES
from hrsi.hrsi_engine.measurement.interest_points.outlines import trace_contour
from hrsi.hrsi_engine.measurement.window_matching.correlation import correlate_template

RNG = np.random.default_rng(3)
IMAGE = RNG.normal(500.0, 100.0, (75, 256)).astype(np.float32)
MASK = RNG.random((75, 256)) > 0.05
FLOAT32 = 2e-4  # grey values: sums of some hundred float32 numbers of 500, in another order
ONE, DIFF = np.array([1.0, 2.0, 1.0]), np.array([-1.0, 0.0, 1.0])


def correlate(image: np.ndarray, row: np.ndarray, column: np.ndarray, mode: str) -> np.ndarray:
    return ndimage.correlate1d(ndimage.correlate1d(image, row, 1, mode=mode), column, 0, mode=mode)


def disc(radius: float) -> np.ndarray:
    y, x = np.mgrid[-int(radius) : int(radius) + 1, -int(radius) : int(radius) + 1]
    return np.hypot(x, y) <= radius


BLOCKS = IMAGE[:72].reshape(18, 4, 64, 4)
CASES = {
    "reflect": (filters.filter_separable(IMAGE, DIFF, ONE, "reflect"), correlate(IMAGE, DIFF, ONE, "reflect")),
    "mirror": (filters.filter_separable(IMAGE, ONE, [1.0]), correlate(IMAGE, ONE, np.ones(1), "mirror")),
    "constant": (filters.filter_separable(IMAGE, ONE, ONE, "constant"), correlate(IMAGE, ONE, ONE, "constant")),
    "blur": (filters.blur(IMAGE, 1.7), ndimage.gaussian_filter(IMAGE, 1.7, mode="mirror")),
    "box": (filters.box_mean(IMAGE, 7), ndimage.uniform_filter(IMAGE, 7, mode="mirror")),
    "erode": (filters.erode(MASK, 5), ndimage.binary_erosion(MASK, np.ones((5, 5)), border_value=1)),
    "erode, outside False": (filters.erode(MASK, 3, False), ndimage.binary_erosion(MASK, np.ones((3, 3)))),
    "dilate": (filters.dilate(MASK, 5), ndimage.binary_dilation(MASK, np.ones((5, 5)))),
    "largest": (filters.compute_local_maximum(IMAGE, 4.3), ndimage.maximum_filter(IMAGE, footprint=disc(4.3))),
    "reduce": (filters.reduce_by_area(IMAGE[:72], (64, 18)), BLOCKS.mean(axis=(1, 3))),
    "reduce a mask": (filters.reduce_mask(MASK[:72], (64, 18)), MASK[:72:4, ::4]),
    "enlarge": (filters.enlarge(IMAGE, 5)[2::5, 2::5], IMAGE),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_filters_are_those_of_scipy(name: str):
    ours, theirs = CASES[name]
    assert ours.dtype == theirs.dtype
    np.testing.assert_allclose(ours.astype(float), theirs.astype(float), rtol=1e-6, atol=FLOAT32)


@pytest.mark.parametrize("outside", [None, 0.0])
@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("count", [2000, 40000])  # the second is longer than a map of OpenCV may be
def test_resampling_is_that_of_scipy(order: int, outside: float | None, count: int):
    """At positions in 32nds of a pixel, which are OpenCV's; inside, at the edge and far beyond."""
    x, y = (np.round(RNG.uniform(-9.0, size + 9.0, (1, count)) * 32.0) / 32.0 for size in (256, 75))
    if order == 0:
        x, y = np.floor(x) + 0.25, np.floor(y) + 0.75  # halves may go either way
    ours = filters.interpolate(IMAGE, x.astype(np.float32), y.astype(np.float32), order, outside)
    border = {"mode": "nearest"} if outside is None else {"mode": "grid-constant", "cval": outside}
    theirs = ndimage.map_coordinates(IMAGE, [y, x], order=order, **border)
    np.testing.assert_allclose(ours, theirs, atol=0.03)  # weights of OpenCV are rounded to 2^-15


def test_correlation_of_a_window():
    area, window = IMAGE[10:60, 20:90], IMAGE[30:47, 41:60]
    surface = correlate_template(window, area)
    np.testing.assert_allclose(surface, cv2.matchTemplate(area, window, cv2.TM_CCOEFF_NORMED), atol=1e-4)
    assert np.unravel_index(surface.argmax(), surface.shape) == (20, 21)
    assert surface.max() == pytest.approx(1.0)
    assert (correlate_template(window, np.full((40, 40), 7.0)) == -1.0).all()  # nothing to see


def test_contours_go_round_the_outermost_pixels():
    """Each is a pixel of the region with a neighbour outside; the next is one of its 8 neighbours, clockwise."""
    for number in range(40):
        grey = ndimage.gaussian_filter(np.random.default_rng(number).normal(size=(30, 40)), 2.0)
        labels, _ = ndimage.label(np.pad(grey > 0.02, 1), np.ones((3, 3)))
        mask = ndimage.binary_fill_holes(labels == 1)
        contour = trace_contour(mask)
        rim = mask & ~ndimage.binary_erosion(mask)
        assert {*map(tuple, contour.tolist())} == {*zip(*np.nonzero(rim)[::-1], strict=True)}
        assert np.abs(np.diff(contour, axis=0, append=contour[:1])).max() <= 1
        assert tuple(contour[0]) == (int(mask[mask.any(axis=1)][0].argmax()), int(mask.any(axis=1).argmax()))
        x, y = contour.T.astype(float)
        assert np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) >= 0.0  # clockwise with lines downwards


WITHOUT = """
import sys
sys.modules[{module!r}] = None
import numpy as np
from hrsi.hrsi_engine.foundation.errors import MissingPackageError
from hrsi.hrsi_engine.measurement.window_matching.least_squares_matching import match_patches
from hrsi.hrsi_engine.measurement.window_matching.windows import MATCHING_BANDS
grey = np.random.default_rng(1).normal(500.0, 100.0, (90, 90)).astype(np.float32)
try:
    images = [MATCHING_BANDS["fine"].filter_image(grey, np.ones(grey.shape, bool))] * 2
    match_patches(*images, np.array([[45, 45]]), np.array([[45.2, 45.0]]), np.eye(2)[None])
except MissingPackageError as error:
    print(error.package, error.exit_code, error, sep="|")
"""


@pytest.mark.parametrize("module", PIXEL_PACKAGES)
def test_matching_names_the_package_that_it_lacks(module: str):
    told = subprocess.run(
        [sys.executable, "-c", WITHOUT.format(module=module)], capture_output=True, text=True, check=True
    )
    package, code, message = told.stdout.strip().split("|")
    assert (package, code) == (PIXEL_PACKAGES[module], "2")
    assert f"pip install {package}" in message


def test_a_missing_package_is_told_across_processes():
    error = pickle.loads(pickle.dumps(MissingPackageError("no cv2", "opencv-python-headless")))
    assert isinstance(error, InputError) and error.package == "opencv-python-headless" and str(error) == "no cv2"

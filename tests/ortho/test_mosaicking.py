"""Levels, seamlines and the choice of images of a mosaic, against constructed truth and choice pixel by pixel."""

import numpy as np
import pytest

from hrsi.hrsi_engine.ortho import mosaicking
from hrsi.hrsi_engine.ortho.grid import ORTHO
from hrsi.hrsi_engine.ortho.mosaicking import MOSAIC, NONE


def test_levels_of_three_images_are_made_equal() -> None:
    """Gains and offsets are known but for those common to all images; overlaps form a chain, with outliers."""
    rng = np.random.default_rng(5)
    ground = 500.0 + 80.0 * rng.normal(size=(60, 300))
    bands = np.array([(ground - offset) / gain for gain, offset in ((1.2, 30.0), (1.0, -20.0), (0.8, 90.0))])
    bands[0, :, 120:], bands[1, :, :80], bands[1, :, 220:], bands[2, :, :180] = np.nan, np.nan, np.nan, np.nan
    bands[1, :9, 90:110] = 4000.0  # changed between the dates
    gain, offset = mosaicking.fit_levels(bands).T
    level = gain[:, None, None] * bands + offset[:, None, None]
    for i, j in ((0, 1), (1, 2)):
        both = np.isfinite(bands[i]) & np.isfinite(bands[j])
        both[:9] = False
        difference = (level[i] - level[j])[both]
        assert abs(difference.mean()) < 2.0 and np.std(difference) < 8.0  # contrast: 80
    assert np.prod(gain) == pytest.approx(1.0, abs=0.05)


def test_images_without_overlap_keep_their_levels() -> None:
    bands = np.full((2, 40, 40), np.nan)
    bands[0, :, :20], bands[1, :, 20:] = 100.0, 900.0
    assert np.array_equal(mosaicking.fit_levels(bands), [[1.0, 0.0], [1.0, 0.0]])


def test_a_seamline_follows_the_equal_pixels_within_its_band() -> None:
    """The right image differs everywhere but on a winding path, which the cut takes; it stays near the border."""
    rows, columns = 80, 200
    rng = np.random.default_rng(2)
    path = 110 + np.rint(5.0 * np.sin(np.arange(rows) / 8.0)).astype(int)
    left = 500.0 + rng.normal(size=(rows, columns))
    right = left + 100.0
    for row, column in enumerate(path):
        right[row, column - 1 : column + 2] = left[row, column - 1 : column + 2]
    left[:, 120:], right[:, :60] = np.nan, np.nan
    labels = mosaicking.find_seams(np.array([left, right], np.float32), [10.0, 20.0])
    seam = np.argmax(labels == 1, axis=1)
    assert np.abs(seam - path).max() <= 2
    # Preferred is the image with the smaller angle, up to the band at its border
    assert (labels[:, : 120 - MOSAIC.band_px] == 0).all() and (labels[:, 120:] == 1).all()


def test_hidden_ground_moves_no_seamline() -> None:
    grey = np.random.default_rng(1).normal(500.0, 10.0, (2, 90, 90)).astype(np.float32)
    grey[0, 30:50, 40:60] = np.nan
    assert (mosaicking.find_seams(grey, [5.0, 15.0]) == 0).all()


def test_the_image_of_a_pixel_is_chosen_as_one_by_one() -> None:
    """The image of the area, then the others by their order, each first where all pixels around it are valid."""
    rng = np.random.default_rng(3)
    valid = rng.random((3, 40, 50)) > 0.02
    valid[:, 5:9, 5:9] = False
    areas = rng.integers(NONE, 3, (40, 50))
    order = [2, 0, 1]
    labels = mosaicking.choose_images(valid, areas, order)
    reach = ORTHO.margin_px
    for row, column in rng.integers([0, 0], [40, 50], (300, 2)).tolist():
        around = valid[:, max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
        turn = [areas[row, column]] * int(areas[row, column] != NONE) + order
        expected = [k for k in turn if around[k].all()] or [k for k in turn if valid[k, row, column]] or [NONE]
        assert labels[row, column] == expected[0]


def test_blending_is_narrow_and_uses_valid_pixels_only() -> None:
    values = np.stack([np.full((1, 30, 40), 100.0), np.full((1, 30, 40), 200.0)])
    values[1, :, :, :19] = -9999.0
    valid = np.array([np.ones((30, 40), bool), np.arange(40) >= np.full((30, 1), 19)])
    labels = np.where(np.arange(40) < 20, 0, 1) * np.ones((30, 1), dtype=int)
    (mosaic,) = mosaicking.blend(values, valid, labels)
    assert (mosaic[:, :16] == 100.0).all() and (mosaic[:, 25:] == 200.0).all()
    assert (np.diff(mosaic, axis=1) >= 0.0).all() and (mosaic[:, 19] > 100.0).all()

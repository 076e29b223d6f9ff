"""The common shift of two textures, one of them moved exactly by its Fourier transform."""

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.ortho.misregistration import SHIFT, find_common_shift
from hrsi.tests.ortho.scenes import texture
from hrsi.tests.ortho.test_misregistration import shifted

SIDE = 900


def reader(grey: np.ndarray):
    """Return a reader of the middle part of an array, which also reads what lies around it; nothing beyond."""
    padded = np.pad(grey, SHIFT.probe_px)
    known = np.pad(np.ones(grey.shape, dtype=bool), SHIFT.probe_px)

    def read(x: int, y: int, columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
        place = np.s_[y + SHIFT.probe_px : y + SHIFT.probe_px + rows, x + SHIFT.probe_px : x + SHIFT.probe_px + columns]
        return padded[place], known[place]

    return read


@pytest.mark.parametrize(
    ("dx", "dy"), mark_beyond(1, "thorough", [(12.0, -7.0), (0.0, 0.0), (-101.5, 63.5), (210.0, 180.0)])
)
def test_common_shift_comes_back(dx: float, dy: float) -> None:
    """Also where one image is a negative of the other with noise, as over another season; to a reduced pixel."""
    rng = np.random.default_rng(3)
    grey = texture(SIDE, SIDE)
    other = 1.0 - 0.8 * shifted(grey, dx, dy) + rng.normal(0.0, 0.1 * grey.std(), grey.shape)
    found = find_common_shift(reader(grey), reader(other), SIDE, SIDE)
    assert np.abs(found - (dx, dy)).max() <= SHIFT.reduction


def test_unlike_or_empty_or_small_images_have_none() -> None:
    grey, other, flat = texture(SIDE, SIDE), texture(SIDE, SIDE, seed=99), np.full((SIDE, SIDE), 5.0)
    for second in (other, flat):
        assert find_common_shift(reader(grey), reader(second), SIDE, SIDE).tolist() == [0, 0]
    assert find_common_shift(reader(grey), reader(grey), 40, 40).tolist() == [0, 0]

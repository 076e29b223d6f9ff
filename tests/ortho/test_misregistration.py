"""Shifts between windows: textures shifted exactly by their Fourier transform are the truth."""

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.ortho.misregistration import (
    MisregistrationOptions,
    WindowOutcome,
    WindowShifts,
    measure_shifts,
    shift_statistics,
    window_centres,
)
from hrsi.tests.ortho.scenes import texture

SIDE = 320
BIAS_PX = 0.02  # the issue allows 0.05


def shifted(grey: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """Return a periodic texture whose content lies dx to the right and dy down."""
    across, down = np.meshgrid(np.fft.fftfreq(grey.shape[1]), np.fft.fftfreq(grey.shape[0]))
    return np.real(np.fft.ifft2(np.fft.fft2(grey) * np.exp(-2j * np.pi * (across * dx + down * dy))))


def matched(first: np.ndarray, second: np.ndarray, valid: np.ndarray | None = None) -> WindowShifts:
    options = MisregistrationOptions(most=8)
    mask = np.ones(first.shape, dtype=bool) if valid is None else valid

    def reader(grey: np.ndarray, known: np.ndarray):
        return lambda x, y, columns, rows: (grey[y : y + rows, x : x + columns], known[y : y + rows, x : x + columns])

    centres = window_centres(first.shape[1], first.shape[0], options)
    return measure_shifts(reader(first, mask), reader(second, np.ones_like(mask)), centres, options)


@pytest.mark.parametrize("noise", [0.0, 15.0])
@pytest.mark.parametrize(
    ("dx", "dy"),
    mark_beyond(3, "thorough", [(0.0, 0.0), (0.25, -0.4), (0.5, 0.5), (-0.1, 0.75), (-2.3, 3.6), (5.05, -6.9)]),
)
def test_known_shifts_come_back_without_bias(dx: float, dy: float, noise: float) -> None:
    """Also with another gain and offset, grey values rounded, and noise of 1/20 of the contrast."""
    rng = np.random.default_rng(11)
    grey = texture(SIDE, SIDE)
    first = np.rint(300.0 + 1500.0 * grey + rng.normal(0.0, 1.0, grey.shape) * noise)
    second = np.rint(500.0 + 1000.0 * shifted(grey, dx, dy) + rng.normal(0.0, 1.0, grey.shape) * noise)
    found = matched(first, second)
    assert found.good.mean() > 0.9
    error = found.shift_px[found.good] - (dx, dy)
    assert np.abs(error.mean(axis=0)).max() < BIAS_PX
    assert error.std(axis=0).max() < 0.05
    if noise:  # the stated sigma is that of the errors
        assert 0.7 < error.std() / np.median(found.sigma_px[found.good]) < 1.4


def test_mirrored_windows_have_mirrored_shifts() -> None:
    """Both axes reversed: no side of a window is preferred, and noise moves the result as much to the other side."""
    rng, options = np.random.default_rng(4), MisregistrationOptions(window_px=32, search_px=6)
    grey = texture(SIDE, SIDE)
    pair = [1000.0 * one + rng.normal(0.0, 30.0, grey.shape) for one in (grey, shifted(grey, 0.3, -0.2))]
    mask, centres = np.ones(grey.shape, dtype=bool), np.array([[80, 90], [150, 100], [200, 220], [110, 240]])

    def find(pair: list[np.ndarray], centres: np.ndarray) -> WindowShifts:
        first, second = (
            lambda x, y, columns, rows, one=one: (
                one[y : y + rows, x : x + columns],
                mask[y : y + rows, x : x + columns],
            )
            for one in pair
        )
        return measure_shifts(first, second, centres, options)

    ahead, back = find(pair, centres), find([one[::-1, ::-1] for one in pair], SIDE - centres)
    assert ahead.good.all() and back.good.all()
    np.testing.assert_allclose(back.shift_px, -ahead.shift_px, atol=1e-3)


def test_windows_that_cannot_be_matched_say_why() -> None:
    grey = 1000.0 * texture(SIDE, SIDE)
    other = 1000.0 * texture(SIDE, SIDE, seed=99)
    flat = np.full_like(grey, 700.0)
    nowhere = np.zeros(grey.shape, dtype=bool)
    assert set(matched(grey, other).outcome) <= {WindowOutcome.UNLIKE, WindowOutcome.FAR, WindowOutcome.UNSTEADY}
    assert set(matched(flat, grey).outcome) == {WindowOutcome.FLAT}
    assert set(matched(grey, grey, nowhere).outcome) == {WindowOutcome.NODATA}
    far = matched(grey, shifted(grey, 30.0, 0.0))
    assert not far.good.any() and np.isnan(far.shift_px).all()


def test_windows_fit_into_the_area_with_all_that_they_need() -> None:
    options = MisregistrationOptions(window_px=32, search_px=8, most=10)
    centres = window_centres(300, 200, options)
    reach = 16 + 8 + 4
    assert len(centres) > 20
    assert (centres >= reach).all() and (centres <= np.array([300, 200]) - reach).all()
    assert len(window_centres(50, 300, options)) == 0


def test_statistics_of_normal_shifts() -> None:
    """Medians, NMAD and percentiles of a Rayleigh-distributed length, sigma 0.1: 1.1774 and 2.1460 sigma."""
    rng = np.random.default_rng(2)
    figures = shift_statistics(rng.normal(0.0, 0.1, (40_000, 2)) + (0.0, 0.0), 0.5)
    assert figures["median_px"] == pytest.approx(0.11774, rel=0.02)
    assert figures["p90_px"] == pytest.approx(0.21460, rel=0.02)
    assert figures["nmad_dx_px"] == pytest.approx(0.1, rel=0.02)
    assert figures["median_m"] == pytest.approx(0.5 * 0.11774, rel=0.02)
    assert shift_statistics(np.empty((0, 2)), 0.5) == {**dict.fromkeys(figures), "windows": 0}

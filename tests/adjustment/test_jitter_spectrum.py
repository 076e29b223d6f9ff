"""Waves in residuals along the lines: against known sines, scipy's periodogram and noise."""

import numpy as np
import pytest
from scipy.signal import lombscargle

from hrsi.hrsi_engine.adjustment.jitter.spectrum import LineProfile, estimate_spectrum, find_waves
from hrsi.hrsi_engine.foundation.thresholds import SIGNIFICANCE

LINES = 12000.0


def make_profile(rng: np.random.Generator, count: int, shift: np.ndarray, noise_px: float, line: np.ndarray):
    """Return a profile with the displacements ``(n, 2)`` of the lines and normal noise."""
    sample = rng.uniform(0.0, 4000.0, count)
    noisy = shift + noise_px * rng.standard_normal((count, 2))
    return LineProfile("image", 0, line, sample, noisy, np.full((count, 2), noise_px**-2))


def test_waves_are_found_with_period_amplitude_and_phase():
    rng = np.random.default_rng(3)
    line = rng.uniform(0.0, LINES, 600)
    shift = np.zeros((600, 2))
    shift[:, 0] = 0.5 * np.sin(2.0 * np.pi * line / 900.0 + 1.0) + 2.0 * (line / LINES) ** 2  # and a trend
    shift[:, 1] = 1.5 * np.sin(2.0 * np.pi * line / 4000.0 - 2.0) + 0.4 * np.sin(2.0 * np.pi * line / 250.0)
    found = find_waves(make_profile(rng, 600, shift, 0.3, line))
    assert [wave.axis for wave in found] == ["along", "across", "along"]
    # a sine's amplitude has the standard deviation noise * sqrt(2 / n), 0.017 px; the fits take a little of the waves
    assert [wave.amplitude_px for wave in found] == pytest.approx([1.5, 0.5, 0.4], abs=0.06)
    assert [wave.period_lines for wave in found] == pytest.approx([4000.0, 900.0, 250.0], rel=0.02)
    assert found[1].evaluate(np.array([3000.0]))[0] == pytest.approx(0.5 * np.sin(2 * np.pi * 3000 / 900 + 1), abs=0.1)
    assert found[0].sigma_px == pytest.approx(0.3 * np.sqrt(2.0 / 600), rel=0.15)


def test_spectrum_is_that_of_scipy():
    rng = np.random.default_rng(4)
    # measurements in the middle of cells, one in each: then the cells are the measurements
    line = np.sort(rng.choice(np.arange(960), 500, replace=False)) * 12.5
    profile = make_profile(rng, 500, 0.2 * np.sin(line / 70.0)[:, None] * np.ones(2), 0.3, line)
    spectrum = estimate_spectrum(profile, "across")
    # scipy's periodogram knows no trend: take it out before
    u, v = line / line.max(), profile.sample / 4000.0
    trend = np.column_stack([u**0, u, u**2, u**3, v, v * u, v * u**2])
    left = profile.shift_px[:, 0] - trend @ np.linalg.lstsq(trend, profile.shift_px[:, 0], rcond=None)[0]
    power = lombscargle(line, left, 2.0 * np.pi / spectrum.period_lines, normalize=True)
    short = spectrum.period_lines < 3000.0  # longer ones are taken by the trend in part
    assert spectrum.power[short] == pytest.approx(power[short], abs=0.01)
    assert spectrum.period_lines[np.argmax(spectrum.power)] == pytest.approx(2.0 * np.pi * 70.0, rel=0.02)
    assert spectrum.amplitude_px.max() == pytest.approx(0.2, abs=0.04) and spectrum.significant_px < 0.15


def test_residuals_of_one_strip_are_no_wave():
    """Relief or a bad seam on one side is no vibration: that displaces all samples of a line."""
    rng = np.random.default_rng(5)
    line = rng.uniform(0.0, LINES, 800)
    profile = make_profile(rng, 800, np.zeros((800, 2)), 0.2, line)
    profile.shift_px[:, 0] += np.where(profile.sample < 1000.0, 1.0, 0.0) * np.sin(2.0 * np.pi * line / 1500.0)
    assert find_waves(profile) == ()


def test_too_few_or_too_short_is_nothing():
    rng = np.random.default_rng(6)
    line = rng.uniform(0.0, LINES, 20)
    assert find_waves(make_profile(rng, 20, np.ones((20, 2)), 0.1, line)) == ()
    assert estimate_spectrum(make_profile(rng, 60, np.ones((60, 2)), 0.1, np.linspace(0, 120, 60)), "along") is None


@pytest.mark.coverage
def test_noise_has_waves_as_rarely_as_stated():
    """2000 profiles of noise with blunders: 0.2 are expected at the risk of 1e-4.

    Power (binomial, 2000 trials, 0 to 3): 0.0001 fails with 0 %, 0.004 with 95.8 %
    """
    rng, false = np.random.default_rng(7), 0
    for _ in range(2000):
        count = int(rng.choice((40, 200, 800)))
        shift = np.where(rng.random((count, 2)) < 0.03, rng.normal(0.0, 5.0, (count, 2)), 0.0)
        line = rng.uniform(0.0, rng.choice((4000.0, 8000.0, 12000.0)), count)
        false += bool(find_waves(make_profile(rng, count, shift, 0.3, line)))
    assert SIGNIFICANCE.false_alarm == 1e-4 and false <= 3

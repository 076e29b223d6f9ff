"""Least-squares matching against windows whose true displacement is known: shifted exactly in the frequency domain."""

from __future__ import annotations

import numpy as np
import pytest

from hrsi.hrsi_engine.measurement.window_matching.least_squares_matching import match_patches
from hrsi.hrsi_engine.measurement.window_matching.window_search import search_windows
from hrsi.hrsi_engine.measurement.window_matching.windows import (
    DONE,
    MATCHING_BANDS,
    OUTSIDE,
    WEAK,
    LsmOptions,
    MatchImage,
)

SIZE, POINTS = 320, 120
GREY, CONTRAST = 600.0, 100.0


@pytest.fixture(scope="module", params=["1", "0"], ids=["compiled", "arrays"])
def way(request):
    """Both implementations."""
    patch = pytest.MonkeyPatch()
    patch.setenv("HRSI_COMPILED", request.param)
    yield request.param
    patch.undo()


def texture(shift=(0.0, 0.0), seed=1) -> np.ndarray:
    """Return a periodic texture of unit contrast whose grey values are displaced by exactly ``shift`` px."""
    fx, fy = np.meshgrid(np.fft.fftfreq(SIZE), np.fft.fftfreq(SIZE))
    radius = np.hypot(fx, fy)
    white = np.fft.fft2(np.random.default_rng(seed).normal(size=(SIZE, SIZE)))
    spectrum = white / (0.02 + radius) * np.exp(-0.5 * (radius / 0.2) ** 2)
    field = np.real(np.fft.ifft2(spectrum * np.exp(-2j * np.pi * (fx * shift[0] + fy * shift[1]))))
    return field / np.sqrt(np.mean(np.abs(spectrum) ** 2)) * SIZE


def noisy(field: np.ndarray, noise: float, seed: int, gain: float = 1.0) -> np.ndarray:
    return GREY + gain * CONTRAST * field + np.random.default_rng(seed).normal(0.0, noise, field.shape)


def centres(count=POINTS) -> np.ndarray:
    return np.random.default_rng(5).integers(40, SIZE - 40, (count, 2))


def everywhere() -> np.ndarray:
    return np.ones((SIZE, SIZE), bool)


def identity(count=POINTS) -> np.ndarray:
    return np.tile(np.eye(2), (count, 1, 1))


def matched(first, second, band="fine", window=31, start=0.4):
    images = [MATCHING_BANDS[band].filter_image(grey, everywhere()) for grey in (first, second)]
    return match_patches(*images, centres(), centres() + start, identity(), LsmOptions(window))


@pytest.mark.parametrize("band", MATCHING_BANDS)
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.25, 0.5), (-0.5, 0.1)])
def test_no_pixel_locking_and_honest_sigma(band: str, shift):
    """The median error is below 0.02 px whatever the fraction of a pixel; errors are as large as their sigmas say."""
    found = matched(noisy(texture(), 10.0, 1), noisy(texture(shift), 10.0, 2, gain=0.8), band)
    good = found.status == DONE
    error = (found.xy - centres() - shift)[good]
    sigma = MATCHING_BANDS[band].sigma_factor * np.sqrt(np.einsum("nii->ni", found.covariance[good]))
    ratio = float(1.4826 * np.median(np.abs((error - np.median(error, axis=0)) / sigma)))
    print(
        f"{band} {shift}: bias {np.median(error, axis=0).round(4)}, RMS {error.std():.4f} px, error / sigma {ratio:.2f}"
    )
    assert good.mean() > 0.97
    assert np.abs(np.median(error, axis=0)).max() < 0.02
    assert error.std() < 0.05
    assert 0.6 < ratio < 1.4  # the factor is one for all textures; where it errs it should be on the careful side
    np.testing.assert_allclose(np.median(found.gain[good]), 0.8, rtol=0.25)  # less where noise is much of the texture


def test_both_ways_agree():
    patch = pytest.MonkeyPatch()
    results = []
    for setting in ("1", "0"):
        patch.setenv("HRSI_COMPILED", setting)
        results.append(matched(noisy(texture(), 5.0, 1), noisy(texture((0.3, -0.6)), 5.0, 2)))
    patch.undo()
    for name, ours, theirs in zip(results[0]._fields, *results, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-7, rtol=1e-6, err_msg=name)


def test_affine_shape_is_found(way):
    """The second image is the first, turned by 3° and stretched by 4 %: shape and position come back."""
    from scipy import ndimage

    angle, middle = np.radians(3.0), (SIZE - 1) / 2.0
    A = 1.04 * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    first = CONTRAST * texture()
    inverse = np.linalg.inv(A)[::-1, ::-1]  # of (row, column)
    second = ndimage.affine_transform(first, inverse, middle - inverse @ [middle, middle], order=5, mode="grid-wrap")
    points = np.random.default_rng(2).integers(110, 210, (60, 2))
    truth = (points - middle) @ A.T + middle
    images = MatchImage(first, everywhere()), MatchImage(second, everywhere())
    found = match_patches(*images, points, truth + 0.5, identity(60), LsmOptions(31))
    assert (found.status == DONE).all()
    assert np.abs(found.xy - truth).max() < 0.02
    assert np.abs(found.affine - A).max() < 0.01


def test_slopes_are_the_derivatives_of_the_interpolation():
    """Central differences of SciPy's spline at the pixels, step 1e-3: the slopes, to float32's accuracy."""
    from scipy import ndimage

    image = MatchImage(GREY + CONTRAST * texture(), everywhere())
    at = centres().T[::-1].astype(float)
    for axis, slope in enumerate(image.slopes[::-1]):
        step = np.zeros((2, 1))
        step[axis] = 1e-3
        ends = [
            ndimage.map_coordinates(image.grey.astype(np.float64), at + sign * step, order=3, mode="mirror")
            for sign in (1.0, -1.0)
        ]
        np.testing.assert_allclose(slope[centres()[:, 1], centres()[:, 0]], (ends[0] - ends[1]) / 2e-3, atol=0.02)


def test_windows_on_invalid_pixels_and_without_texture_are_refused(way):
    first = GREY + CONTRAST * texture()
    first[:, :160] = GREY
    valid = everywhere()
    valid[:160] = False
    images = MatchImage(first, everywhere()), MatchImage(first, valid)
    points = np.array([[80, 250], [250, 80], [250, 170], [250, 250], [5, 250]])
    found = match_patches(*images, points, points + 0.3, identity(5), LsmOptions(31))
    np.testing.assert_array_equal(found.status, [WEAK, OUTSIDE, OUTSIDE, DONE, OUTSIDE])


@pytest.mark.thorough
@pytest.mark.parametrize("setting", ["1", "0"])
def test_search_finds_the_window_and_its_rival(monkeypatch, setting: str):
    """Windows moved by whole pixels are found; in a pattern that repeats after 8 px the rival is as good."""
    monkeypatch.setenv("HRSI_COMPILED", setting)
    field = texture()
    stripes = np.tile(np.kron(np.random.default_rng(0).normal(size=(1, 4)), np.ones((1, 2))), (SIZE, SIZE // 8))
    reach, along = np.tile([10.0, 2.0], (POINTS, 1)), np.tile([1.0, 0.0], (POINTS, 1))
    for grey, repeats in ((field, False), (stripes + 0.01 * field, True)):
        images = MatchImage(grey, everywhere()), MatchImage(np.roll(grey, (1, 3), axis=(0, 1)), everywhere())
        found = search_windows(*images, centres(), centres().astype(float), along, reach, 12)
        assert (found.rival > 0.95 * found.correlation).all() == repeats
        if not repeats:
            np.testing.assert_array_equal(found.xy, centres() + (3, 1))
            assert found.inside.all()
            assert found.rival.max() < 0.9
    edge = search_windows(*images, centres(), centres() - (9.0, 0.0), along, reach, 12)
    assert not edge.inside[edge.xy[:, 0] == centres()[:, 0] + 1].any()  # at the end of the box


def test_spline_coefficients_give_the_grey_values_back():
    """The spline (1, 4, 1) / 6 of them in both directions, to the borders, where the image goes on as in a mirror."""
    grey = np.random.default_rng(2).uniform(0.0, 2000.0, (70, 90)).astype(np.float32)
    image = MatchImage(grey, np.ones(grey.shape, dtype=bool))
    padded = np.pad(image.coefficients.astype(np.float64), 1, mode="reflect")
    rows = (padded[:-2] + 4.0 * padded[1:-1] + padded[2:]) / 6.0
    back = (rows[:, :-2] + 4.0 * rows[:, 1:-1] + rows[:, 2:]) / 6.0
    assert np.abs(back - grey).max() < 0.005  # grey values of 11 bits, rounded to 1

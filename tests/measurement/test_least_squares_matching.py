"""Least-squares matching against windows whose true displacement is known: shifted exactly in the frequency domain."""

import numpy as np
import pytest
from scipy import ndimage

from hrsi.hrsi_engine.measurement.window_matching.least_squares_matching import match_patches, search_windows
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
    assert good.mean() > 0.97
    assert np.abs(np.median(error, axis=0)).max() < 0.02
    assert error.std() < 0.05
    assert 0.6 < ratio < 1.4  # the factor is one for all textures; where it errs it should be on the careful side
    np.testing.assert_allclose(np.median(found.gain[good]), 0.8, rtol=0.25)  # less where noise is much of the texture


def test_equal_windows_have_a_sigma():
    """Without noise no residual remains, and matches are weighed and scaled by the inverse of their sigmas."""
    grey = noisy(texture(), 0.0, 1)
    found = matched(grey, grey)
    good = found.status == DONE
    assert good.mean() > 0.97
    assert np.abs(found.xy[good] - centres()[good]).max() < 1e-3
    assert (found.sigma_px[good] > 0.0).all()
    assert found.sigma_px[good].max() < 1e-3


def test_result_solves_the_normal_equations():
    """At the warp found, NumPy's least squares of SciPy's spline give no further shift, and the figures stated."""
    first, second = (
        MATCHING_BANDS["fine"].filter_image(grey, everywhere())
        for grey in (noisy(texture(), 5.0, 1), noisy(texture((0.3, -0.6)), 5.0, 2))
    )
    options = LsmOptions(31, closure_px=1e-6)
    found = match_patches(first, second, centres(), centres() + 0.4, identity(), options)
    weight, line = options.make_weights().ravel(), np.arange(-options.half, options.half + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    for n in np.flatnonzero(found.status == DONE):
        column, row = centres()[n]
        patch = np.s_[row + line[0] : row + line[-1] + 1, column + line[0] : column + line[-1] + 1]
        gx, gy, grey = (layer[patch].ravel().astype(float) for layer in (*first.slopes, first.grey))
        grey -= np.average(grey, weights=weight)
        A = np.column_stack([gx, gy, gx * x, gx * y, gy * x, gy * y, grey, np.ones_like(grey)])
        at = found.xy[n][:, None] + found.affine[n] @ [x, y]
        seen = ndimage.map_coordinates(second.grey.astype(float), at[::-1], order=3, mode="mirror")
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(A * root[:, None], seen * root, rcond=None)[0]
        residual = seen - A @ solution
        rms = np.sqrt(np.average(residual**2, weights=weight))
        N = A.T @ (A * weight[:, None])
        assert np.abs(solution[:2] / solution[6]).max() < 2e-4  # px; float32 of the spline
        assert found.gain[n] == pytest.approx(solution[6], rel=1e-4)
        assert found.rms[n] == pytest.approx(rms, rel=1e-4)
        spread = np.average((seen - np.average(seen, weights=weight)) ** 2, weights=weight)
        own = np.average(grey**2, weights=weight)
        assert found.correlation[n] == pytest.approx(
            np.average(grey * seen, weights=weight) / np.sqrt(own * spread), abs=1e-4
        )
        cofactor = found.affine[n] @ np.linalg.inv(N)[:2, :2] @ found.affine[n].T
        np.testing.assert_allclose(found.covariance[n], cofactor * (rms / solution[6]) ** 2, rtol=1e-3)


def test_affine_shape_is_found():
    """The second image is the first, turned by 3° and stretched by 4 %: shape and position come back."""
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


def test_windows_on_invalid_pixels_and_without_texture_are_refused():
    first = GREY + CONTRAST * texture()
    first[:, :160] = GREY
    valid = everywhere()
    valid[:160] = False
    images = MatchImage(first, everywhere()), MatchImage(first, valid)
    points = np.array([[80, 250], [250, 80], [250, 170], [250, 250], [5, 250]])
    found = match_patches(*images, points, points + 0.3, identity(5), LsmOptions(31))
    np.testing.assert_array_equal(found.status, [WEAK, OUTSIDE, OUTSIDE, DONE, OUTSIDE])


def test_search_finds_the_window_and_its_rival():
    """Windows moved by whole pixels are found; in a pattern that repeats after 8 px the rival is as good."""
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

"""RPC fitting: a pushbroom's own equations, refits of real RPCs, exact folds, degenerate input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.camera.rpc_fit import CHECK_GRID, FIT, fit_rpc, fold_affine, refit_rpc
from hrsi.hrsi_engine.foundation.errors import SolveError
from hrsi.hrsi_engine.ground.geodesy import LocalFrame
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.tests.test_rpc import synthetic_rpc

REFIT_PX = 1e-4  # a hundredth of what is ever measured; most fits are a thousand times better
DOMAIN = (0.0, 10999.0, 0.0, 10799.0)


def pushbroom_points(count: tuple[int, int, int], lon: float = 5.0, lat: float = 45.0) -> tuple[np.ndarray, np.ndarray]:
    """Return ground and image points of a line scanner 700 km up, 20 000 x 20 000 px of 0.7 m, 15 degrees off nadir.

    Each line is a perspective of its own, from a position that moves along a straight orbit.
    """
    frame = LocalFrame(lon, lat)
    sample, line, height = (a.ravel() for a in np.meshgrid(*(np.linspace(-1, 1, n) for n in count), indexing="ij"))
    altitude, up = 700e3, 500.0 + 500.0 * height
    position = np.column_stack([np.full(line.size, -187e3), 7000.0 * line, np.full(line.size, altitude)])
    across = 0.2610 + 0.01 * sample  # angle from the vertical, rad
    along = 0.02 + 1e-3 * line  # pitch drifts
    direction = np.column_stack([np.tan(across), np.tan(along), -np.ones(line.size)])
    local = position + direction * (altitude - up)[:, None]
    return frame.to_ground(local), np.column_stack([10000.0 + 10000.0 * sample, 10000.0 + 10000.0 * line])


def scaled(image: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """An affine correction with cross terms, as a drift and a small rotation make it."""
    return image @ np.array([[1.0 + 2e-5, 3e-5], [-4e-5, 1.0 - 1e-5]]) + [12.0, -7.0]


# ---- fit -------------------------------------------------------------------------------------------------------


def test_a_pushbroom_is_fitted_to_a_millionth_of_a_pixel() -> None:
    fit = fit_rpc(*pushbroom_points(FIT.grid))
    ground, image = pushbroom_points(CHECK_GRID)
    assert fit.warnings == ()
    assert np.abs(fit.rpc.project(ground) - image).max() < 1e-6 * 5


def test_common_denominators_are_common() -> None:
    fit = fit_rpc(*pushbroom_points(FIT.grid), common_denominator=True)
    np.testing.assert_array_equal(fit.rpc.samp_den, fit.rpc.line_den)
    assert fit.max_px < 1e-3
    assert fold_affine(fit.rpc, np.array([[1.0, 1.0, 0.01], [2.0, -0.02, 1.0]])) is not None


@pytest.mark.parametrize("lon", [179.99, -179.98, 180.0])
def test_points_on_both_sides_of_the_180_degree_meridian(lon: float) -> None:
    ground, image = pushbroom_points(FIT.grid, lon=lon)
    fit = fit_rpc(ground, image)
    assert fit.max_px < 1e-5
    assert -180.0 <= fit.rpc.long_off <= 180.0
    assert fit.rpc.long_scale < 1.0


def test_high_latitudes() -> None:
    assert fit_rpc(*pushbroom_points(FIT.grid, lat=82.0)).max_px < 1e-4


def test_flat_points_give_an_rpc_without_height_and_a_warning() -> None:
    image = np.random.default_rng(40).uniform(0, 10800, (200, 2))
    ground = synthetic_rpc(5.0, 45.0).localize(image, 300.0).ground
    fit = fit_rpc(ground, image)
    assert fit.max_px < 1e-4
    assert "does not depend on height" in fit.warnings[0]
    raised = ground + [0.0, 0.0, 300.0]
    np.testing.assert_allclose(fit.rpc.project(raised), fit.rpc.project(ground))


@pytest.mark.parametrize("levels", [2, 3])
def test_few_height_levels_are_enough_for_a_stable_fit(levels: int) -> None:
    """Between and below the levels too, where the fit has seen nothing: its low terms carry the height."""
    fit = fit_rpc(*pushbroom_points((12, 12, levels)))
    ground, image = pushbroom_points((5, 5, 8))
    assert np.abs(fit.rpc.project(ground) - image).max() < 0.05


def test_few_noisy_points_use_few_terms() -> None:
    ground, image = pushbroom_points((3, 3, 2))
    noisy = image + np.random.default_rng(41).normal(0, 0.3, image.shape)
    fit = fit_rpc(ground, noisy)
    assert "18 correspondences" in fit.warnings[0]
    check, expected = pushbroom_points((4, 4, 3))
    assert np.sqrt(np.mean((fit.rpc.project(check) - expected) ** 2)) < 5.0


def test_weights_leave_blunders_out() -> None:
    ground, image = pushbroom_points((10, 10, 4))
    wrong = image.copy()
    wrong[::50] += 100.0
    weights = np.ones(len(image))
    weights[::50] = 1e-12
    fit = fit_rpc(ground, wrong, weights=weights)
    np.testing.assert_allclose(fit.rpc.project(ground), image, atol=1e-3)


@pytest.mark.parametrize(
    ("ground", "message"),
    [
        (np.tile([5.0, 45.0, 100.0], (50, 1)), "at one place"),
        (np.linspace([5.0, 45.0, 100.0], [5.1, 45.1, 100.0], 50), "on a line"),
        (np.tile([5.0, 45.0, 100.0], (4, 1)), "4 correspondences"),
    ],
)
def test_what_cannot_be_fitted_is_said(ground: np.ndarray, message: str) -> None:
    image = np.random.default_rng(43).uniform(0, 100, (len(ground), 2))
    with pytest.raises(SolveError, match=message):
        fit_rpc(ground, image)


# ---- refit -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "s2p_triplet_phr/img_01.tif", "qb2_gcp/qb2_basic1b.tif", "spot7_tiepoints/RPC_1A.xml",
        "zy3_stereo_gcp/zy301a_fwd_381_6138_rpc.txt", "formats/wv_isd_xml/rpc_WV2.xml",
        "kahramanmaras_phr4/post_event_img1.tif", "formats/rpc_txt/rpc_IKONOS.txt",
    ],
)  # fmt: skip
def test_real_rpcs_with_a_correction(real_data: Path, name: str) -> None:
    source = read_rpc(str(real_data / name))
    size = source.size or (11000, 11000)
    domain = (0.0, size[0] - 1.0, 0.0, size[1] - 1.0)
    fit = refit_rpc(source.rpc, scaled, domain, source.rpc.height_range)
    assert fit.rms_px <= fit.max_px < REFIT_PX
    assert (fit.rpc.err_bias, fit.rpc.err_rand) == (source.rpc.err_bias, source.rpc.err_rand)
    # not only on grids: random points of the domain
    rng = np.random.default_rng(44)
    image = rng.uniform(domain[::2], domain[1::2], (1000, 2))
    ground, _ = source.rpc.localize(image, rng.uniform(*source.rpc.height_range, 1000))
    np.testing.assert_allclose(fit.rpc.project(ground), scaled(image, ground), atol=REFIT_PX, rtol=0)


def test_the_stated_difference_is_that_of_the_independent_grid() -> None:
    """A correction that no RPC can follow is reported as such."""
    waves = refit_rpc(
        synthetic_rpc(5.0, 45.0), lambda image, ground: image + np.sin(image / 300.0), DOMAIN, (0.0, 600.0)
    )
    assert 0.3 < waves.max_px < 5.0
    assert waves.rms_px < waves.max_px


def test_a_correction_that_depends_on_the_ground() -> None:
    """Parallax: the shift grows with height, as an error of attitude makes it."""
    rpc = synthetic_rpc(5.0, 45.0)
    fit = refit_rpc(rpc, lambda image, ground: image + 0.01 * ground[:, 2:], DOMAIN, (0.0, 600.0))
    ground = np.array([[5.01, 45.02, 450.0]])
    np.testing.assert_allclose(fit.rpc.project(ground), rpc.project(ground) + 4.5, atol=1e-6)


def test_an_rpc_without_ground_positions_is_an_error() -> None:
    rpc = replace(synthetic_rpc(5.0, 45.0), samp_num=np.zeros(20))
    with pytest.raises(SolveError, match="no ground positions"):
        refit_rpc(rpc, scaled, DOMAIN, (0.0, 600.0))


# ---- folds -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "matrix",
    [
        [[3.5, 1.0, 0.0], [-2.0, 0.0, 1.0]],
        [[3.5, 1.001, 0.0], [-2.0, 0.0, 0.99]],
        [[9.0, -1.0, 0.0], [1.0, 0.0, 0.5]],
        [[0.0, 0.0, 1.0], [5.0, 1.0, 0.0]],
        [[3.5, 1.001, 0.02], [-2.0, -0.03, 0.99]],
    ],
    ids=["shift", "scale", "mirror", "transposed", "affine, one denominator"],
)
def test_exact_folds(matrix: list[list[float]]) -> None:
    rpc = synthetic_rpc(5.0, 45.0)
    folded = fold_affine(rpc, np.array(matrix))
    ground = np.random.default_rng(45).uniform((4.95, 44.95, 0), (5.05, 45.05, 600), (200, 3))
    image = rpc.project(ground)
    expected = np.column_stack([np.ones(200), image]) @ np.array(matrix).T
    np.testing.assert_allclose(folded.project(ground), expected, atol=1e-9, rtol=0)
    assert folded.samp_scale > 0.0
    assert folded.line_scale > 0.0


def test_cross_terms_do_not_fold_into_different_denominators() -> None:
    rpc = synthetic_rpc(5.0, 45.0)
    different = replace(rpc, line_den=rpc.line_den + 1e-6 * np.arange(20))
    assert fold_affine(different, np.array([[0.0, 1.0, 1e-5], [0.0, 0.0, 1.0]])) is None
    assert fold_affine(different, np.array([[4.0, 1.0, 0.0], [0.0, 0.0, 1.1]])) is not None


def test_a_singular_transformation_is_refused() -> None:
    with pytest.raises(ValueError, match="one line"):
        fold_affine(synthetic_rpc(5.0, 45.0), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))

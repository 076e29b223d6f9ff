"""Registration of two images: exact transformations, the thesis's QuickBird points, outliers, failures."""

import csv

import cv2
import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError, SolveError
from hrsi.hrsi_engine.laboratory.registration import REGISTRATION_FORMS, apply_matrix, compare_kinds, register_points

MATRICES = {
    "shift": [[1, 0, 31.5], [0, 1, -12.25], [0, 0, 1]],
    "conformal": [[0.9, -0.3, 10], [0.3, 0.9, -4], [0, 0, 1]],
    "affine": [[3.9, 0.02, 270], [-0.01, 4.05, -1290], [0, 0, 1]],
    "projective": [[3.9, 0.02, 270], [-0.01, 4.05, -1290], [2e-6, -3e-6, 1]],
}


def points(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 5000, (count, 2))


@pytest.mark.parametrize("model", REGISTRATION_FORMS)
def test_exact_transformations_come_back(model: str):
    H, first = np.array(MATRICES[model], dtype=float), points(12)
    found = register_points(first, apply_matrix(H, first), model)
    np.testing.assert_allclose(apply_matrix(found.matrix, first), apply_matrix(H, first), atol=1e-6)
    assert np.abs(found.residual_px).max() < 1e-6


def squares(H: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    return float(np.sum((second - apply_matrix(H, first)) ** 2))


def test_projective_has_the_least_squares():
    """Not worse than OpenCV's homography, which stops after few iterations, and no step of 1e-3 px makes it better."""
    rng, first = np.random.default_rng(5), points(40)
    second = apply_matrix(np.array(MATRICES["projective"]), first) + rng.normal(0, 0.5, (40, 2))
    H = register_points(first, second, "projective").matrix
    assert squares(H, first, second) <= squares(cv2.findHomography(first, second, 0)[0], first, second)
    for row in range(3):
        for column in range(3 if row < 2 else 2):
            for sign in (-1.0, 1.0):
                moved = H.copy()
                moved[row, column] += sign * 1e-3 / (5000.0 if column < 2 else 1.0) / (20000.0 if row == 2 else 1.0)
                assert squares(moved, first, second) >= squares(H, first, second)


def test_blunders_are_left_out():
    rng, first = np.random.default_rng(6), points(30)
    second = apply_matrix(np.array(MATRICES["affine"]), first) + rng.normal(0, 0.2, (30, 2))
    second[:3] += 40.0
    found = register_points(first, second, "affine", reject_sigma=4.0)
    assert not found.used[:3].any()
    assert found.used[3:].sum() >= 26  # 4 sigma of a Rayleigh distribution: 3 in 10 000 beyond
    assert np.abs(found.residual_px[3:]).max() < 1.0


def test_quickbird_centres_are_better_by_half(thesis_data):
    """An independent calculation gives 1.0 and 2.1 m; whole-pixel measurements, so 0.05 m is what rounding allows."""
    with open(thesis_data / "quickbird_ms_pan_tie_points.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    ms, pan = (np.array([[float(r[f"{i}_sample"]), float(r[f"{i}_line"])] for r in rows]) for i in ("ms", "pan"))
    kinds = np.array([r["kind"] for r in rows])
    result = compare_kinds(ms, pan, kinds, unit=0.61)
    centre = np.column_stack([ms, np.ones(len(ms))])[kinds == "center"]
    left = pan[kinds == "center"] - centre @ np.linalg.lstsq(centre, pan[kinds == "center"], rcond=None)[0]
    assert result.alone["center"].distance == pytest.approx(0.61 * np.hypot(*left.std(axis=0, ddof=1)), rel=1e-6)
    assert result.together["center"].distance == pytest.approx(1.0, abs=0.05)
    assert result.together["corner"].distance == pytest.approx(2.1, abs=0.05)
    assert result.alone["center"].distance <= 1.0
    assert result.alone["corner"].distance <= 2.1
    assert result.ratio() < 0.5


@pytest.mark.parametrize(
    ("first", "model", "error", "reason"),
    [
        (points(2), "affine", SolveError, "too few"),
        (np.column_stack([np.arange(6.0), np.arange(6.0)]), "affine", SolveError, "line"),
        (points(6), "splines", InputError, "is not one of"),
    ],
)
def test_failures(first: np.ndarray, model: str, error: type, reason: str):
    with pytest.raises(error, match=reason):
        register_points(first, first + 1.0, model)

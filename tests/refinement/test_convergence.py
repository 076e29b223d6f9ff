"""Every model of a single image ends at the minimum that SciPy finds."""

from dataclasses import replace

import numpy as np
import pytest
from long_tests import mark_beyond
from scipy.optimize import least_squares

from hrsi.benchmarks import real_blocks
from hrsi.benchmarks.spot5 import read_spot5
from hrsi.hrsi_engine.block.block import Block, Image, Role
from hrsi.hrsi_engine.foundation.thresholds import ITERATIONS
from hrsi.hrsi_engine.refinement.estimate import CONTROL_ONLY, ESTIMATION, Control, Estimate, estimate
from hrsi.processing_algorithms.laboratory.direct_methods import SINGLE_IMAGE_MODELS

ONE_PASS = ("idkf", "slss")
ITERATED = [name for name in SINGLE_IMAGE_MODELS if name not in ONE_PASS]
TIGHT = {"xtol": 1e-13, "ftol": 1e-13, "gtol": 1e-13, "x_scale": "jac", "max_nfev": 80}


def control_of(block: Block, image: int, role: Role) -> Control:
    """Return the points of a role that are measured on an image."""
    measured = block.measurements
    rows = np.flatnonzero((measured.image == image) & (block.points.role[measured.point] == role))
    points = measured.point[rows]
    return Control(block.points.ground[points], measured.xy[rows], block.points.ids[points], measured.sigma_px[rows])


def sigmas_from_minimum(image: Image, control: Control, name: str, found: Estimate) -> float:
    """Return sqrt(2 (cost - reference)): the distance from SciPy's minimum in standard deviations of one unknown.

    SciPy starts at the vendor's RPC and where the engine ended. Its residuals are those of `project`, the corrected
    camera itself, and not of the linearised equations that the engine iterates, of which it takes the derivatives.
    """
    model, sigmas = SINGLE_IMAGE_MODELS[name], SINGLE_IMAGE_MODELS[name].prior_sigmas(image, CONTROL_ONLY)
    linearise = model.equations(image, control.xy)

    def residuals(scaled: np.ndarray) -> np.ndarray:
        missed = control.xy - model.project(image, sigmas * scaled, control.ground)
        missed = np.where(np.isfinite(missed), missed, 1e6)  # where the model has no answer
        return np.concatenate([np.einsum("nij,nj->ni", found.roots, missed).ravel(), scaled])

    def jacobian(scaled: np.ndarray) -> np.ndarray:
        by_values = linearise(sigmas * scaled, control.ground).by_values * sigmas
        slopes = -(found.roots @ by_values).reshape(2 * len(control), -1)
        return np.vstack([np.where(np.isfinite(slopes), slopes, 0.0), np.eye(len(sigmas))])

    if not len(sigmas):
        return 0.0
    ours = np.divide(found.values, sigmas, out=np.zeros(len(sigmas)), where=sigmas > 0.0)
    reference = min(least_squares(residuals, start, jac=jacobian, **TIGHT).cost for start in (0.0 * ours, ours))
    return float(np.sqrt(max(np.sum(residuals(ours) ** 2) - 2.0 * reference, 0.0)))


@pytest.fixture(scope="module")
def images(thesis_data) -> dict[str, tuple[Image, Control]]:
    """IKONOS, ZY-3, QuickBird-2 and SPOT 5, each with its GCPs."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(real_blocks, "DATA", thesis_data.parent)
        for name in ("hobart", "zy3", "quickbird"):
            if name == "hobart" or (thesis_data.parent / "real").is_dir():
                block = getattr(real_blocks, name)()
                found[name] = block.images[0], control_of(block, 0, Role.GCP)
    spot5 = read_spot5(thesis_data)
    return found | {f"SPOT 5, {count} GCPs": (spot5.image(0), spot5.control(count)[0]) for count in (3, 7, 37)}


@pytest.fixture(scope="module")
def hobart(images) -> tuple[Image, Control]:
    """The first image and its ten GCPs."""
    return images["hobart"]


@pytest.mark.parametrize("name", mark_beyond(6, "thorough", ITERATED))
def test_models_end_where_scipy_does(name, images):
    """A thousandth of a sigma is nothing that a result could show."""
    for title, (image, control) in images.items():
        if len(control) < SINGLE_IMAGE_MODELS[name].least_points:
            continue
        found = estimate(SINGLE_IMAGE_MODELS[name], image, control)
        assert found.converged, f"{title}: {found.status}"
        assert found.iterations <= ITERATIONS.most
        assert sigmas_from_minimum(image, control, name, found) < 1e-3, title


@pytest.mark.parametrize("name", ["generic-shift", "generic-affine", "object-affine", "direct", "pg"])
def test_large_errors_do_not_keep_them_from_it(name, thesis_data):
    """0.1 rad: 33 000 px; the residuals of generic-shift, which knows no yaw, are hundreds of pixels."""
    spot5 = read_spot5(thesis_data)
    found = estimate(SINGLE_IMAGE_MODELS[name], spot5.image(1), spot5.control(7)[0])
    assert found.converged, found.status
    assert found.iterations <= ITERATIONS.most


def test_a_single_pass_says_how_far_it_got(thesis_data):
    spot5 = read_spot5(thesis_data)
    near, far = (estimate(SINGLE_IMAGE_MODELS["slss"], spot5.image(case), spot5.control(7)[0]) for case in (0, 1))
    assert near.converged
    assert not far.converged
    assert "passed over the points once" in far.status


def test_easy_models_need_no_curvature(hobart, monkeypatch):
    """Where Gauss and Newton's steps do, no others are taken: quadratic convergence, in five steps or so."""
    image, control = hobart
    monkeypatch.setattr("hrsi.hrsi_engine.refinement.estimate.ESTIMATION", replace(ESTIMATION, gauss_newton_steps=6))
    for name in ("shift", "affine", "ground-linear", "generic-shift", "generic-affine"):
        found = estimate(SINGLE_IMAGE_MODELS[name], image, control)
        assert found.converged
        assert found.iterations <= 6, name
        assert np.isfinite(found.values).all()

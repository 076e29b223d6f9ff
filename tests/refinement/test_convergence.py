"""Every model of a single image ends at the minimum that SciPy finds; the whole table is benchmarks/convergence.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.benchmarks import convergence, real_blocks
from hrsi.benchmarks.spot5 import read_spot5
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.foundation.thresholds import ITERATIONS
from hrsi.hrsi_engine.refinement.estimate import ESTIMATION, estimate
from hrsi.processing_algorithms.laboratory.direct_methods import SINGLE_IMAGE_MODELS

ONE_PASS = ("idkf", "slss")
ITERATED = [name for name in SINGLE_IMAGE_MODELS if name not in ONE_PASS]


@pytest.fixture(scope="module")
def hobart(thesis_data):
    """The first image: the ten GCPs, and the others to check."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(real_blocks, "DATA", thesis_data.parent)
        block = real_blocks.hobart()
    return block.images[0], *(convergence.control_of(block, 0, role) for role in (Role.GCP, Role.CHECK))


@pytest.mark.parametrize("name", mark_beyond(6, "thorough", ITERATED))
def test_models_end_where_scipy_does(name, hobart):
    """A thousandth of a sigma is nothing that a result could show."""
    run = convergence.run_image(*hobart, name)
    assert run.converged, run.status
    assert run.steps <= ITERATIONS.most
    assert run.away < 1e-3


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
    image, control, _ = hobart
    monkeypatch.setattr("hrsi.hrsi_engine.refinement.estimate.ESTIMATION", replace(ESTIMATION, gauss_newton_steps=6))
    for name in ("shift", "affine", "ground-linear", "generic-shift", "generic-affine"):
        found = estimate(SINGLE_IMAGE_MODELS[name], image, control)
        assert found.converged
        assert found.iterations <= 6, name
        assert np.isfinite(found.values).all()

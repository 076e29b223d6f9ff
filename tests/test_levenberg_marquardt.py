"""The descent of every least-squares loop, on curved valleys, large residuals and easy problems."""

from dataclasses import dataclass

import numpy as np
import pytest
from long_tests import mark_beyond
from scipy.optimize import least_squares

from hrsi.benchmarks import real_blocks
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.foundation.levenberg_marquardt import Step, descend
from hrsi.hrsi_engine.refinement import MODELS

MOST = 30


@dataclass(frozen=True)
class Point:
    x: np.ndarray
    cost: float


def descent(residuals, jacobian, start, most=MOST):
    """Minimise half the sum of squares from a start."""

    def at(x):
        return Point(x, 0.5 * float(np.sum(residuals(x) ** 2)))

    def step(place, damping):
        J, r = jacobian(place.x), residuals(place.x)
        N, g = J.T @ J, -J.T @ r
        s = np.linalg.solve(N + damping * np.diag(np.diag(N)), g)
        braked = 0.5 * damping * float(s @ (np.diag(N) * s))
        return Step(at(place.x + s), 0.5 * float(g @ s) + braked, braked)

    return descend(at(np.asarray(start, dtype=float)), step, lambda place: 1.0, most)


def rosenbrock(bend):
    def residuals(x):
        return np.array([bend * (x[1] - x[0] ** 2), 1.0 - x[0]])

    def jacobian(x):
        return np.array([[-2.0 * bend * x[0], bend], [-1.0, 0.0]])

    return residuals, jacobian


@pytest.mark.parametrize("bend", [10.0, 1e3, 1e5])
def test_a_curved_valley_is_crossed(bend):
    """A method that refuses every uphill step creeps along: SciPy's needs hundreds of evaluations for bend 1e5."""
    found = descent(*rosenbrock(bend), [-1.2, 1.0])
    assert found.converged and found.steps < 10
    np.testing.assert_allclose(found.at.x, 1.0, atol=1e-6)


def test_large_residuals_need_damping():
    """A decay fitted to what does not decay so: undamped steps overshoot, and SciPy's minimum is the judge."""
    t = np.linspace(0.0, 4.0, 30)
    seen = np.cos(3.0 * t) + np.exp(-0.3 * t)

    def residuals(x):
        return x[0] * np.exp(-x[1] * t) + x[2] * np.sin(x[3] * t) - seen

    def jacobian(x):
        decay, wave = np.exp(-x[1] * t), np.cos(x[3] * t)
        return np.column_stack([decay, -x[0] * t * decay, np.sin(x[3] * t), x[2] * t * wave])

    start = [3.0, 2.0, 0.5, 2.0]
    expected = least_squares(residuals, start, jacobian, xtol=1e-14, ftol=1e-14, gtol=1e-12, max_nfev=5000)
    found = descent(residuals, jacobian, start)
    assert found.converged
    assert found.at.cost < expected.cost * (1.0 + 1e-8)


def test_an_easy_problem_takes_gauss_newton_steps():
    rng = np.random.default_rng(3)
    A, b = rng.normal(size=(20, 4)), rng.normal(size=20)
    found = descent(lambda x: A @ x - b, lambda x: A, np.zeros(4))
    assert found.converged and found.steps == 2
    np.testing.assert_allclose(found.at.x, np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-10)


def test_what_is_left_is_said_at_the_limit():
    found = descent(*rosenbrock(10.0), [-1.2, 1.0], 2)
    assert not found.converged
    assert "stopped at the iteration limit" in found.status and "sigma from the minimum" in found.status


def test_no_step_helps_where_the_derivatives_are_wrong():
    residuals, jacobian = rosenbrock(10.0)
    found = descent(residuals, lambda x: -jacobian(x), [-1.2, 1.0])
    assert not found.converged


@pytest.mark.parametrize("name", mark_beyond(4, "thorough", list(MODELS)))
def test_every_model_of_a_real_block_converges(name, thesis_data, monkeypatch):
    """All 71 points of Hobart are GCPs: a curved valley for generic-full."""
    monkeypatch.setattr(real_blocks, "DATA", thesis_data.parent)
    everything = real_blocks.hobart(tuple(real_blocks.hobart().points.ids.tolist()))
    one_descent = AdjustOptions(model=name, test_sigmas=False, reject_sigma=0.0)  # the history holds all rounds
    result = adjust(everything, one_descent)
    assert result.converged, result.status
    assert len(result.history) <= MOST

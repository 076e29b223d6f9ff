"""Normal equations, sparse factors and cofactors: compiled, NumPy's, and dense, each against the others."""

from contextlib import nullcontext
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond
from scipy import sparse

from hrsi.hrsi_engine.adjustment.equations import NormalEquations
from hrsi.hrsi_engine.adjustment.equations.camera_system import CameraSystem
from hrsi.hrsi_engine.adjustment.equations.linearisation import CamerasByImage, take_whole_block
from hrsi.hrsi_engine.adjustment.equations.nested_dissection import SparseFactor
from hrsi.hrsi_engine.adjustment.equations.pattern import Pattern, find_pattern
from hrsi.hrsi_engine.adjustment.equations.states import PointPriors, State
from hrsi.hrsi_engine.adjustment.observations import select_observations
from hrsi.hrsi_engine.foundation.workers.threads import one_thread_calls
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.refinement import MODELS


def grid_matrix(width: int, size: int, seed: int = 0) -> tuple[Pattern, np.ndarray, np.ndarray]:
    """Return pattern, upper blocks and dense matrix of cameras on a square grid, each linked to its neighbours."""
    rng = np.random.default_rng(seed)
    count = width * width
    row, column = np.divmod(np.arange(count), width)
    near = (abs(row[:, None] - row) <= 1) & (abs(column[:, None] - column) <= 1)
    upper = sparse.csr_matrix(np.triu(near))
    pattern = Pattern(
        count, size, upper.indptr.astype(np.int64), upper.indices.astype(np.int32), np.column_stack([row, column])
    )
    blocks_ = rng.normal(0.0, 0.3, (pattern.blocks, size, size))
    own = blocks_[pattern.diagonal]
    blocks_[pattern.diagonal] = own + own.transpose(0, 2, 1) + 9.0 * size * np.eye(size)
    dense = np.zeros((count, size, count, size))
    dense[pattern.rows, :, pattern.columns, :] = blocks_
    dense[pattern.columns, :, pattern.rows, :] = blocks_.transpose(0, 2, 1)
    return pattern, blocks_, dense.reshape(count * size, count * size)


@pytest.mark.parametrize("calls", [nullcontext, one_thread_calls])  # the products of NumPy, and those of SciPy
@pytest.mark.parametrize(("width", "size"), mark_beyond(2, "thorough", [(1, 6), (3, 2), (14, 6), (25, 2)]))
def test_nested_dissection_equals_dense_algebra(width, size, calls):
    with calls():
        equals_dense_algebra(width, size)


def equals_dense_algebra(width: int, size: int) -> None:
    """Check solution, inverse and quadratic forms of a matrix on a grid."""
    pattern, upper, dense = grid_matrix(width, size)
    factor = SparseFactor(pattern.graph, pattern.start, pattern.columns, size, pattern.position)
    factor.factorise(upper)
    right = np.random.default_rng(1).normal(size=(len(dense), 3))
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), rtol=1e-9, atol=1e-12)
    inverse = np.linalg.inv(dense).reshape(pattern.cameras, size, pattern.cameras, size)
    expected = inverse[pattern.rows, :, pattern.columns, :]
    np.testing.assert_allclose(factor.invert_on_pattern(), expected, rtol=1e-8, atol=1e-13)
    rows = sparse.random(40, len(dense), 0.01, "csr", random_state=2)  # some of them empty
    expected = rows @ np.linalg.inv(dense) @ rows.T
    np.testing.assert_allclose(factor.project_cofactors(rows), expected, rtol=1e-8, atol=1e-13)


def test_camera_system_equals_dense_algebra():
    pattern, upper, dense = grid_matrix(14, 6)
    prior = np.full((pattern.cameras, 6), 0.1)
    prior[3] = np.inf
    right = np.random.default_rng(2).normal(size=prior.shape)
    rows = sparse.random(5, prior.size, 0.02, "csr", random_state=2)
    free = np.isfinite(prior.ravel())
    inverse = np.zeros_like(dense)
    inverse[np.ix_(free, free)] = np.linalg.inv((dense + 0.1 * np.eye(len(dense)))[np.ix_(free, free)])
    system = CameraSystem(pattern)
    system.factorise(upper, prior)
    solved, cofactors = system.solve(right), system.project_cofactors(rows)
    np.testing.assert_allclose(solved.ravel(), inverse @ right.ravel(), rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(cofactors, rows @ inverse @ rows.T, rtol=1e-7, atol=1e-10)
    assert not solved[3].any()


@pytest.mark.parametrize(("change", "factors"), [(0.05, 1), (30.0, 2)])
def test_a_matrix_near_the_last_one_needs_no_new_factors(change, factors, monkeypatch):
    """Both solutions are those of dense algebra; a matrix far from the last one gets factors of its own."""
    made = []
    factorise = SparseFactor.factorise
    monkeypatch.setattr(SparseFactor, "factorise", lambda *given: (made.append(1), factorise(*given)))
    pattern, upper, dense = grid_matrix(14, 6)
    system, prior = CameraSystem(pattern), np.full((pattern.cameras, 6), 0.1)
    prior[3] = np.inf
    right = np.random.default_rng(2).normal(size=prior.shape)
    system.factorise(upper, prior)
    system.factorise(upper, prior)
    free = np.isfinite(prior.ravel())
    factor = 1.0 + change * np.random.default_rng(4).random(pattern.cameras)  # D S D, positive definite as well
    other = upper * factor[pattern.rows][:, None, None] * factor[pattern.columns][:, None, None]
    found = system.solve_nearby(other, prior, 0.0, right)
    scaled = np.repeat(factor, 6)
    whole = dense * scaled[:, None] * scaled + 0.1 * np.eye(len(dense))
    expected = np.zeros(prior.size)
    expected[free] = np.linalg.solve(whole[np.ix_(free, free)], right.ravel()[free])
    tolerance = 1e-6 * np.abs(expected).max()
    np.testing.assert_allclose(found.ravel(), expected, rtol=1e-5, atol=tolerance)
    assert len(made) == factors


def linearised(name: str):
    """Return observations, model, pattern, a state away from the solution, weights and priors of a small block."""
    block, _, _ = blocks.block(gcps=6, checks=5, ties=40, count=4, seed=3)
    observations, model = select_observations(block), MODELS[name]
    rng = np.random.default_rng(4)
    reach = np.array([1.0 / model.prior_sigmas(image, blocks_priors()) for image in block.images])
    values = rng.normal(0, 1e-3, reach.shape) / np.maximum(reach, 1e-12)
    ground = block.points.ground.copy()
    ground[~np.isfinite(ground).all(axis=1)] = blocks.ground(len(ground), 9)[~np.isfinite(ground).all(axis=1)]
    state = State(values, ground[observations.points])
    weight = 1.0 / observations.sigma_px**2 * (rng.random(observations.count) > 0.1)
    return observations, model, find_pattern(observations, len(model.parameters)), state, weight


def blocks_priors():
    from hrsi.hrsi_engine.refinement.model import CONTROLLED

    return CONTROLLED


@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("name", mark_beyond(2, "thorough", sorted(MODELS, key=lambda name: name != "affine")))
def test_compiled_equations_equal_numpys(name, shared, monkeypatch):
    """Every model, also where images share a set of parameters (a point is then measured twice by one camera)."""
    observations, model, pattern, state, weight = linearised(name)
    if shared:
        observations = replace(observations, camera_of_image=np.array([0, 1, 1, 0], dtype=np.int32))
        pattern, state = find_pattern(observations, len(model.parameters)), state._replace(values=state.values[:2])
    priors, contributes = PointPriors.from_surveys(observations, state.ground), observations.contributing_points
    results = []
    for compiled in "01":
        monkeypatch.setenv("HRSI_COMPILED", compiled)
        equations = NormalEquations(observations, model, pattern)
        normals = equations.form_normals(state, weight, priors, contributes)
        cofactors = equations.compute_cofactors(state, weight, normals, np.abs(normals.blocks))
        _, local = equations.linearise_points(state, np.array([3, 8, 20]))
        results.append(
            (
                normals.residual, normals.blocks, normals.right, normals.inverse, normals.point_right,
                equations.compute_point_steps(state, weight, normals, state.values), equations.compute_residuals(state),
                cofactors.points, cofactors.computed, local.residual, local.by_ground,
                equations.intersect(state, weight, priors),
            )
        )  # fmt: skip
    assert len(results) == 2
    for ours, theirs in zip(*results, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-10 * np.abs(ours).max(initial=0.0))


def test_the_cost_of_priors_is_their_quadratic_form():
    """A surface observes east and north together, a DEM the height: each weight counts once, correlated ones too."""
    rng = np.random.default_rng(3)
    priors = PointPriors(
        np.tile([24.5, -28.7, 200.0], (8, 1)), rng.uniform(1.0, 2.0, (8, 3)), np.tile([False, False, True], (8, 1)),
        np.column_stack([rng.uniform(-0.5, 0.5, 8), np.zeros((8, 2))]),
    )  # fmt: skip
    ground, counting = move_ground(priors.target, rng.normal(0.0, 3.0, (8, 3))), np.ones(8, dtype=bool)
    miss = priors.compute_misclosures_m(ground)
    expected = np.einsum("ki,kij,kj->", miss, priors.build_weight_matrices(), miss)
    found = priors.sum_of_squares(ground, counting) + priors.sum_weak_squares(ground, counting)
    assert found == pytest.approx(expected, rel=1e-5)


def relative(found: np.ndarray, expected: np.ndarray, left: np.ndarray, right: np.ndarray) -> float:
    """Return the largest difference of cofactors ``(k, a, b)`` in units of their standard deviations' products."""
    return float(np.abs((found - expected) / (left[:, :, None] * right[:, None, :])).max())


# position and attitude of a pseudo sensor are nearly collinear, which costs the dense inverse two digits
@pytest.mark.parametrize(("name", "tolerance"), [("shift", 1e-8), ("affine", 1e-8), ("generic-shift", 1e-6)])
def test_reduced_system_equals_the_dense_normal_matrix(name, tolerance):
    """Elimination, back substitution and all cofactors against one dense matrix over all unknowns."""
    observations, model, pattern, state, weight = linearised(name)
    p, cameras, points = pattern.parameters, pattern.cameras, len(observations.points)
    priors, contributes = PointPriors.from_surveys(observations, state.ground), np.ones(points, dtype=bool)
    equations = NormalEquations(observations, model, pattern)
    linear = CamerasByImage(observations, model).linearise_at(state)(take_whole_block(observations))
    design = np.zeros((2 * observations.count, cameras * p + 3 * points))
    for row in range(observations.count):
        image, point = observations.image[row], observations.point[row]
        design[2 * row : 2 * row + 2, image * p : image * p + p] = linear.by_quantity[row]
        design[2 * row : 2 * row + 2, cameras * p + 3 * point + np.arange(3)] = linear.by_ground[row]
    prior_weight = np.array([1.0 / model.prior_sigmas(image, blocks_priors()) ** 2 for image in observations.images])
    normal = design.T @ (design * np.repeat(weight, 2)[:, None])
    normal[np.diag_indices_from(normal)] += np.concatenate([prior_weight.ravel(), priors.weight.ravel()])
    scale = 1.0 / np.sqrt(np.diag(normal))
    inverse = np.linalg.inv(normal * scale[:, None] * scale) * scale[:, None] * scale
    right = design.T @ (np.repeat(weight, 2) * linear.residual.ravel())
    right[cameras * p :] += (priors.weight * priors.compute_misclosures_m(state.ground)).ravel()

    normals = equations.form_normals(state, weight, priors, contributes)
    system = CameraSystem(pattern)
    system.factorise(normals.blocks, prior_weight)
    step = system.solve(normals.right)
    moved = equations.compute_point_steps(state, weight, normals, step)
    found_steps = np.concatenate([step.ravel(), moved.ravel()])
    sigma = np.sqrt(np.diag(inverse))
    # in standard deviations: position and attitude of a sensor are nearly collinear, their sum is what counts
    assert np.abs((found_steps - inverse @ right) / sigma).max() < 1e-4
    found = equations.compute_cofactors(state, weight, normals, system.compute_cofactors())
    n, every = observations.count, np.arange(points)
    ground = inverse[step.size :, step.size :].reshape(points, 3, points, 3)[every, :, every, :]
    sigma_ground = sigma[step.size :].reshape(points, 3)
    assert relative(found.points, ground, sigma_ground, sigma_ground) < tolerance
    computed = np.einsum("nci,ij,ndj->ncd", design.reshape(n, 2, -1), inverse, design.reshape(n, 2, -1))
    sigma_px = np.sqrt(np.einsum("ncc->nc", computed))
    assert relative(found.computed, computed, sigma_px, sigma_px) < tolerance
    own = inverse[: step.size, : step.size].reshape(cameras, p, cameras, p)[pattern.rows, :, pattern.columns, :]
    sigma_values = sigma[: step.size].reshape(cameras, p)
    difference = relative(system.compute_cofactors(), own, sigma_values[pattern.rows], sigma_values[pattern.columns])
    assert difference < tolerance

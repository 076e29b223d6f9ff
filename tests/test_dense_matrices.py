"""Products and factors by SciPy's BLAS against NumPy's operators; parts of matrices, transposes and empty ones."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from hrsi.hrsi_engine.adjustment.equations import dense_matrices as dense


@pytest.fixture(name="whole")
def symmetric_matrix():
    factor = np.random.default_rng(1).normal(size=(23, 23))
    return factor @ factor.T + np.eye(23)


@pytest.mark.parametrize("own", [0, 1, 14, 23])
def test_a_front_is_eliminated_and_inverted(whole, own):
    """The steps of nested dissection, which see the lower triangle only, give Schur complement and inverse."""
    front = np.tril(whole)
    factor = dense.inverse_cholesky(front[:own, :own])
    np.testing.assert_allclose(factor, np.linalg.inv(np.linalg.cholesky(whole[:own, :own])), atol=1e-12)
    coupling = dense.multiply_by_triangle(front[own:, :own], factor, transposed=True)
    np.testing.assert_allclose(coupling, whole[own:, :own] @ factor.T, atol=1e-12)
    dense.subtract_square(front[own:, own:], coupling)
    left = whole[own:, own:] - whole[own:, :own] @ np.linalg.inv(whole[:own, :own]) @ whole[:own, own:]
    np.testing.assert_allclose(np.tril(front[own:, own:]), np.tril(left), atol=1e-11)
    assert not np.triu(front, 1).any()
    outer = np.tril(np.linalg.inv(left))
    gain = dense.multiply_by_triangle(coupling, factor)
    pulled = dense.multiply_symmetric(outer, gain)
    inner = dense.square_lower(factor)
    dense.add_product(inner, gain, pulled)
    inverse = np.linalg.inv(whole)
    np.testing.assert_allclose(-pulled, inverse[own:, :own], atol=1e-11)
    np.testing.assert_allclose(np.tril(inner), np.tril(inverse[:own, :own]), atol=1e-11)


@pytest.mark.parametrize("shape", [(5, 9), (9, 5), (0, 4), (4, 0)])
def test_an_inner_square(shape):
    matrix = np.random.default_rng(4).normal(size=shape)
    np.testing.assert_allclose(dense.multiply_by_own_transpose(matrix), np.tril(matrix.T @ matrix), atol=1e-13)


def test_what_is_not_positive_definite_or_not_in_rows_is_refused(whole):
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        dense.inverse_cholesky(whole - 100.0 * np.eye(len(whole)))
    with pytest.raises(ValueError, match="rows of float64"):
        dense.subtract_square(whole[::2, ::2], whole[::2, ::2])


def test_other_threads_go_on_meanwhile():
    """While a product is made in another thread, this one counts: with Python's lock kept, it would not."""
    large, made = np.ones((2500, 2500)), np.zeros((2500, 2500))
    with ThreadPoolExecutor(1) as pool:
        making, counted = pool.submit(dense.add_product, made, large, large), 0
        while not making.done():
            counted += 1
            time.sleep(1e-3)
    assert counted >= 3
    making.result()
    assert made[0, 0] == 2500.0

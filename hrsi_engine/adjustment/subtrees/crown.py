"""What leaves and separators hand up and down the tree, and the separators' part of the solution.

A node hands up the *update*, what is left of its equations when its own unknowns are eliminated, for the cameras of
its border; a separator adds those of its children, its own priors and damping, and eliminates its own cameras. Down
come the steps of the border, from which its own follow, and for the precision the inverse of the border (the formulas
are those of `equations.nested_dissection`). Of symmetric matrices the lower triangle is made and handed on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...foundation.workers.threads import one_thread_calls
from ..equations.camera_system import unit_scales
from ..equations.dense_matrices import add_product, own_square, subtract_square, symmetric_times, times_triangle
from ..equations.nested_dissection import MatrixPart, factor_of, parts_at, runs_of


class Update(NamedTuple):
    """What is left for a border.

    border : (b,) cameras
    matrix, right : (b p, b p), its lower triangle, and (b, p), the equations without priors
    diagonal : (b, p) of the matrix before anything was eliminated: what damping and scales refer to
    """

    border: np.ndarray
    matrix: np.ndarray
    right: np.ndarray
    diagonal: np.ndarray


class Steps(NamedTuple):
    """Steps ``(k, p)`` of cameras ``(k,)``, sorted by camera."""

    cameras: np.ndarray
    step: np.ndarray

    def of(self, cameras: np.ndarray) -> np.ndarray:
        """Return the steps of some of the cameras."""
        return np.asarray(self.step[np.searchsorted(self.cameras, cameras)])


class BorderInverse(NamedTuple):
    """The lower triangle of the inverse ``(k p, k p)`` over cameras ``(k,)``, sorted by camera."""

    cameras: np.ndarray
    matrix: np.ndarray

    def of(self, cameras: np.ndarray) -> np.ndarray:
        """Return the part of some of the cameras."""
        if not len(cameras):
            return np.zeros((0, 0))
        chosen = unknowns(np.searchsorted(self.cameras, cameras), len(self.matrix) // len(self.cameras))
        return _part(self.matrix, chosen)


class Separator(NamedTuple):
    """A separator's factors in scaled unknowns, and what its own steps are weighed with.

    factor, coupling, forward : L^-1, B and L^-1 g; scale : (k, p)
    pulled : (2, k, p) the total diagonal, and the prior weights times the values
    """

    own: np.ndarray
    border: np.ndarray
    factor: np.ndarray
    coupling: np.ndarray
    forward: np.ndarray
    scale: np.ndarray
    pulled: np.ndarray


def unknowns(cameras: np.ndarray, size: int) -> np.ndarray:
    """Return the numbers of the unknowns of cameras with ``size`` each."""
    return np.asarray((cameras[:, None] * size + np.arange(size)).ravel())


def join(
    own: np.ndarray, prior: np.ndarray, values: np.ndarray, damping: float, *updates: Update
) -> tuple[Separator, Update]:
    """Put the updates of the children of a separator together and eliminate its own cameras: return what is left, too.

    Parameters
    ----------
    own : (k,) its cameras; prior, values : (k, p) of them
    damping : times the diagonal
    updates : of its children
    """
    size = prior.shape[1]
    reached = np.unique(np.concatenate([own, *(update.border for update in updates)]))
    border = np.setdiff1d(reached, own)
    cameras = np.concatenate([own, border])
    place_of = np.argsort(cameras)
    matrix = np.zeros((len(cameras) * size,) * 2)
    right, diagonal = np.zeros((len(cameras), size)), np.zeros((len(cameras), size))
    for update in updates:
        place = place_of[np.searchsorted(cameras, update.border, sorter=place_of)]
        chosen = unknowns(place, size)
        for part, there, turned in _lower_parts(chosen):
            matrix[there] += update.matrix[part].T if turned else update.matrix[part]
        right[place] += update.right
        diagonal[place] += update.diagonal
    mine, n = len(own), len(own) * size
    scale = unit_scales(diagonal[:mine], prior)
    free = scale > 0.0
    right[:mine] -= np.where(free, prior, 0.0) * values if mine else 0.0
    total = np.where(free, diagonal[:mine] + np.where(free, prior, 0.0), 0.0)
    flat, diagonal_of = scale.ravel(), np.arange(n)
    matrix[diagonal_of, diagonal_of] += np.where(free, np.where(free, prior, 0.0) + damping * total, 0.0).ravel()
    matrix[:n, :n] *= flat[:, None]
    matrix[:, :n] *= flat  # what is right of it is not looked at
    matrix[diagonal_of, diagonal_of] += ~free.ravel()
    with one_thread_calls():
        factor = factor_of(matrix[:n, :n])
        coupling = times_triangle(matrix[n:, :n], factor, transposed=True)
        subtract_square(matrix[n:, n:], coupling)
    forward = factor @ (scale * right[:mine]).ravel()
    rest = right[mine:] - (coupling @ forward).reshape(-1, size)
    pulled = np.stack([total, np.where(free, prior, 0.0) * values]) if mine else np.zeros((2, 0, size))
    left = Update(border, matrix[n:, n:].copy(), rest, diagonal[mine:])  # a copy, or all of the front would be kept
    return Separator(own, border, factor, coupling, forward, scale, pulled), left


def steps_of(node: Separator, above: Steps | None) -> Steps:
    """Return the steps of a separator's own cameras and its border."""
    size = node.scale.shape[1]
    outer = np.zeros((0, size)) if above is None else above.of(node.border)
    own = node.scale * (node.factor.T @ (node.forward - node.coupling.T @ outer.ravel())).reshape(-1, size)
    cameras = np.concatenate([node.own, node.border])
    order = np.argsort(cameras)
    return Steps(cameras[order], np.concatenate([own, outer])[order])


def own_step(node: Separator, steps: Steps) -> tuple[np.ndarray, float, float]:
    """Return a separator's own step, its weighted square in the total diagonal, and what its priors say of it."""
    own = steps.of(node.own) if len(node.own) else np.zeros((0, node.scale.shape[1]))
    return own, float(np.sum(node.pulled[0] * own**2)), float(np.sum(node.pulled[1] * own))


def invert(node: Separator, above: BorderInverse | None) -> BorderInverse:
    """Return the inverse over a separator's own cameras and its border."""
    size = node.scale.shape[1]
    outer = np.zeros((0, 0)) if above is None else above.of(node.border)
    n = len(node.own) * size
    inverse = np.zeros((n + len(outer),) * 2)
    with one_thread_calls():
        gain = times_triangle(node.coupling, node.factor)
        pulled = symmetric_times(outer, gain)
        own = own_square(node.factor)
        add_product(own, gain, pulled)
    scale = node.scale.ravel()
    inverse[n:, n:] = outer
    inverse[n:, :n] = -pulled * scale
    inverse[:n, :n] = own * scale * scale[:, None]
    cameras = np.concatenate([node.own, node.border])
    order = np.argsort(cameras)
    chosen = unknowns(order, size)
    return BorderInverse(cameras[order], _part(inverse, chosen))


def _part(matrix: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return the lower triangle of the rows and columns of some unknowns, from that of the matrix."""
    result = np.zeros((len(chosen),) * 2)
    for part, there, turned in _lower_parts(chosen):
        result[part] = matrix[there].T if turned else matrix[there]
    return result


def _lower_parts(place: np.ndarray) -> Iterator[tuple[MatrixPart, MatrixPart, bool]]:
    """Yield the parts of a small lower triangle, those of the large one where they stand, and whether turned there."""
    for part, (rows, columns) in parts_at(runs_of(place), lower=True):
        turned = rows.start < columns.start
        yield part, (columns, rows) if turned else (rows, columns), turned


def own_inverse(node: Separator, inverse: BorderInverse) -> np.ndarray:
    """Return the cofactors ``(k, p, p)`` of each of a separator's own cameras."""
    size, place = node.scale.shape[1], np.searchsorted(inverse.cameras, node.own)
    blocks = inverse.matrix.reshape(len(inverse.cameras), size, len(inverse.cameras), size)
    lower = np.tril(blocks[place, :, place, :])
    return np.asarray(lower + np.tril(lower, -1).transpose(0, 2, 1))


def sum_of(parts: Sequence[tuple[float, ...]]) -> np.ndarray:
    """Return sums of the columns of numbers, in their order."""
    return np.sum(np.array(parts, dtype=np.float64), axis=0)

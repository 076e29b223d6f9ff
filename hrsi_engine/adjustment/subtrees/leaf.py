"""A leaf: part of a block with all points that its cameras share, as workers keep it.

Its *inner* cameras are seen by no other leaf's points and are eliminated here after the points; the others are its
border.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ...foundation.workers.threads import one_thread_calls
from ...ground.geodesy import moved_ground
from ...refinement.model import RefinementModel
from ..equations import NormalEquations, Normals, Pattern, PointPriors, State, find_pattern
from ..equations.camera_system import scaled_blocks, unit_scales
from ..equations.nested_dissection import SparseFactor
from ..joint_prior import JointPrior
from ..observations import Observations
from ..weights import WEIGHTS
from .crown import BorderInverse, Steps, Update, unknowns


@dataclass(eq=False)
class Leaf:
    """What stays the same of a leaf: observations, with images, points and cameras counted from its own first ones.

    Parameters
    ----------
    observations : Observations
        Of its points.
    model : RefinementModel
        Of the cameras.
    cameras : (c,) ndarray
        Numbers of its cameras in the block, sorted.
    inner : (c,) ndarray
        Which of them no other leaf sees.
    earlier : JointPrior, optional
        The part of what an earlier adjustment says of cameras that is said here.
    """

    observations: Observations
    model: RefinementModel
    cameras: np.ndarray
    inner: np.ndarray
    earlier: JointPrior | None = None
    _made: tuple[Pattern, NormalEquations, SparseFactor] | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_made": None}  # compiled tables are made where the leaf is

    @property
    def pattern(self) -> Pattern:
        """Which of its cameras share points, or are known together."""
        pairs = None if self.earlier is None else self.earlier.pairs
        return find_pattern(self.observations, len(self.model.parameters), pairs)

    @property
    def made(self) -> tuple[Pattern, NormalEquations, SparseFactor]:
        """Its pattern, its equations and its factors."""
        if self._made is None:
            pattern = self.pattern
            equations = NormalEquations(self.observations, self.model, pattern, threads=1)
            factor = SparseFactor(
                pattern.graph, pattern.start, pattern.columns, pattern.parameters, pattern.position,
                kept=np.flatnonzero(~self.inner), threads=1,
            )  # fmt: skip
            self._made = pattern, equations, factor
        return self._made


class LeafStart(NamedTuple):
    """Where a leaf begins, and what its observations weigh: see `gauss_newton.Weighting`.

    values, prior : (c, p) of its cameras; robust : (n,) factors
    """

    values: np.ndarray
    ground: np.ndarray
    prior: np.ndarray
    image: np.ndarray
    points: PointPriors
    contributes: np.ndarray
    robust: np.ndarray


@dataclass(frozen=True, eq=False)
class LeafAt:
    """A leaf's equations at a state. ``sums`` is its part of the cost and of the redundancy."""

    start: LeafStart
    state: State
    normals: Normals
    sums: tuple[float, float]

    @property
    def weight(self) -> np.ndarray:
        """Weights of the image points, robust factors included."""
        return self.start.image * self.start.robust


class Eliminated(NamedTuple):
    """A leaf with its inner cameras eliminated.

    forward : (c p,) right-hand side, in scaled unknowns; scale : (c, p), 1 for the border
    factor : (L^-1, coupling) of each front; total : (c, p) what the damping multiplies, 0 beside inner cameras
    """

    forward: np.ndarray
    scale: np.ndarray
    factor: list[tuple[np.ndarray, np.ndarray]]
    total: np.ndarray


LoadLeaf = Callable[[], Leaf]


def load(stored: LoadLeaf) -> Leaf:
    """Return a leaf."""
    return stored()


def begin(leaf: Leaf, stored: Callable[[], LeafStart]) -> LeafAt:
    """Return a leaf's equations where it begins."""
    start = stored()
    return _at(leaf, start, State(start.values, start.ground))


def _at(leaf: Leaf, start: LeafStart, state: State) -> LeafAt:
    pattern, equations, _ = leaf.made
    normals = equations.normals(state, start.image * start.robust, start.points, start.contributes)
    if leaf.earlier is not None:
        leaf.earlier.add_to(normals, state.values, pattern)
    residual, observations = normals.residual, leaf.observations
    used = start.contributes[observations.point]
    lengths = np.einsum("nc,nc->n", residual, residual) * start.image * start.robust
    squares = float(lengths @ used) + start.points.sum_of_squares(state.ground, start.contributes)
    prior = np.where(np.isinf(start.prior), 0.0, start.prior)[leaf.inner]
    squares += float(np.sum(prior * state.values[leaf.inner] ** 2))
    squares += 0.0 if leaf.earlier is None else 2.0 * leaf.earlier.cost(state.values)
    rows = int(((start.image > 0.0) & used).sum())
    freedom = 2 * rows + int(start.points.observed[start.contributes].sum())
    freedom -= 3 * int(start.contributes.sum()) + int((prior > 0.0).sum())
    return LeafAt(start, state, normals, (0.5 * squares, float(freedom)))


def sums_of(at: LeafAt) -> tuple[float, float]:
    """Return a leaf's part of the cost and of the redundancy."""
    return at.sums


def points_of(at: LeafAt) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of a leaf's points, and their cofactors for the cameras as they are."""
    return at.state.ground, at.normals.inverse


def reweight(leaf: Leaf, at: LeafAt, robust: str, stored: Callable[[], PointPriors] | None = None) -> LeafAt:
    """Return the same state with robust factors from its residuals, and with other priors of its points, if any."""
    t = np.linalg.norm(at.normals.residual, axis=1) * np.sqrt(at.start.image)
    points = at.start.points if stored is None else stored()
    return _at(leaf, at.start._replace(robust=WEIGHTS[robust](t), points=points), at.state)


def eliminate_inner(leaf: Leaf, at: LeafAt, damping: float) -> tuple[Eliminated, Update]:
    """Eliminate the inner cameras of a leaf, whose points are: return what is left, too."""
    pattern, _, factor = leaf.made
    blocks, inner = at.normals.blocks, leaf.inner
    own = np.einsum("cpp->cp", blocks[pattern.diagonal])
    prior = np.where(inner[:, None], at.start.prior, 0.0)
    scale = np.ones_like(own)
    scale[inner] = unit_scales(own[inner], prior[inner])
    with one_thread_calls():
        remainder = factor.factorise(scaled_blocks(pattern, blocks, scale, damping, inner))
    finite = np.where(np.isinf(prior), 0.0, prior)
    right = scale * (at.normals.right - finite * at.state.values)
    forward = factor.forward(right.ravel())
    border = np.flatnonzero(~inner)
    total = np.where(inner[:, None] & (scale > 0.0), own + finite, 0.0)
    update = Update(leaf.cameras[border], remainder, forward.reshape(scale.shape)[border], own[border])
    return Eliminated(forward, scale, [(front.factor, front.coupling) for front in factor.fronts], total), update


def _with_factor(leaf: Leaf, eliminated: Eliminated) -> SparseFactor:
    """Return the leaf's factors with the numbers of an elimination, which may have been another worker's."""
    _, _, factor = leaf.made
    for front, (own, coupling) in zip(factor.fronts, eliminated.factor, strict=True):
        front.factor, front.coupling = own, coupling
    return factor


def move_on(
    leaf: Leaf, at: LeafAt, eliminated: Eliminated, above: Steps | None
) -> tuple[LeafAt, tuple[float, float, float]]:
    """Return the equations one step ahead, and what the step promises.

    That is (right-hand sides times steps, gain of the points, weighted square in the damping), each this leaf's part.
    """
    _, equations, _ = leaf.made
    factor = _with_factor(leaf, eliminated)
    x = eliminated.forward.copy()
    shape = eliminated.scale.shape
    border = np.flatnonzero(~leaf.inner)
    if above is not None:
        x[unknowns(border, shape[1])] = above.of(leaf.cameras[border]).ravel()
    step = eliminated.scale * factor.back(x).reshape(shape)
    by_ground = equations.point_steps(at.state, at.weight, at.normals, step)
    ahead = _at(leaf, at.start, State(at.state.values + step, moved_ground(at.state.ground, by_ground)))
    prior = np.where(leaf.inner[:, None] & ~np.isinf(at.start.prior), at.start.prior, 0.0)
    gained = float(np.sum((at.normals.right - prior * at.state.values) * step))
    right = at.normals.point_right
    points = float(np.einsum("mi,mij,mj->m", right, at.normals.inverse, right) @ at.start.contributes)
    return ahead, (gained, points, float(np.sum(eliminated.total * step**2)))


def first_of(pair: tuple[Any, Any]) -> Any:
    """Return the first of two."""
    return pair[0]


def second_of(pair: tuple[Any, Any]) -> Any:
    """Return the second of two."""
    return pair[1]


class LeafPrecision(NamedTuple):
    """Cofactors of a leaf: cameras ``(blocks, p, p)`` on its pattern, points (m, 3, 3), computed (n, 2, 2)."""

    cameras: np.ndarray
    points: np.ndarray
    computed: np.ndarray


def precise(leaf: Leaf, at: LeafAt, eliminated: Eliminated, above: BorderInverse | None) -> LeafPrecision:
    """Return the cofactors of a leaf from the inverse of its border."""
    pattern, equations, _ = leaf.made
    factor = _with_factor(leaf, eliminated)
    border = np.flatnonzero(~leaf.inner)
    kept = np.zeros((0, 0)) if above is None else above.of(leaf.cameras[border])
    with one_thread_calls():
        cameras = factor.inverse_blocks(kept)
    cameras *= eliminated.scale[pattern.rows][:, :, None]
    cameras *= eliminated.scale[pattern.columns][:, None, :]
    spread = equations.cofactors(at.state, at.weight, at.normals, cameras)
    return LeafPrecision(cameras, spread.points, spread.computed)


def part_of(observations: Observations, points: np.ndarray, own: np.ndarray) -> tuple[Observations, np.ndarray]:
    """Return the observations of some points, counted from a leaf's first ones, and the numbers of its cameras.

    ``own`` are cameras that are the leaf's whether a point sees them or not.
    """
    lost = np.ones(len(observations.points), dtype=bool)
    lost[points] = False
    chosen = observations.without(lost)
    cameras = np.union1d(own, np.unique(chosen.camera))
    images = np.flatnonzero(np.isin(observations.camera_of_image, cameras))
    place = np.full(len(observations.images), -1)
    place[images] = np.arange(len(images))
    return replace(
        chosen, images=tuple(observations.images[k] for k in images), image=place[chosen.image],
        camera_of_image=np.searchsorted(cameras, observations.camera_of_image[images]).astype(np.int32),
    ), cameras  # fmt: skip

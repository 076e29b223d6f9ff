"""The Gauss-Newton loop of a block that lies on this machine, iterated by workers.

Between runs, when measurements are judged and weights change, columns of the length of the block are here, as
everywhere in an adjustment. For a run each leaf's part of them is laid down where workers read it, and the result is
fetched leaf by leaf; while the loop iterates nothing of that length is moved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from ...foundation.progress import Progress
from ...foundation.workers.certificates import CONFIGURED, Certificates
from ...foundation.workers.cluster import connected
from ...refinement.model import RefinementModel
from ..equations import Cofactors, Normals, Pattern, PointPriors, State
from ..gauss_newton import ROBUST_TOLERANCE, GaussNewton, Solution, Weighting
from ..joint_prior import JointPrior
from ..observations import Observations
from ..weights import WEIGHTS, least_squares
from .descent import BlockAt, SeparatorPriors, Workers
from .division import Division, divide
from .leaf import Leaf, LeafAt, LeafStart, part_of, points_of


class Deposit(Protocol):
    """Where objects are laid down for other processes; `hrsi_engine.io` has one of files."""

    def put(self, name: str, value: Any) -> Callable[[], Any]:
        """Keep an object; return what returns it in any process that can reach the place."""


class InGraph:
    """Objects that travel with the calls themselves: for small blocks."""

    def put(self, name: str, value: Any) -> Callable[[], Any]:
        """As `Deposit.put`."""
        return _Carried(value)


@dataclass(frozen=True, eq=False)
class _Carried:
    value: Any

    def __call__(self) -> Any:
        return self.value


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """Workers of a scheduler, and where they find what they need."""

    client: Any
    deposit: Deposit = field(default_factory=InGraph)


@contextmanager
def open_workers(
    address: str, certificates: Certificates = CONFIGURED, deposit: Deposit | None = None
) -> Iterator[Elsewhere]:
    """Give the workers of a Dask scheduler; see `foundation.workers.cluster.connected`.

    Parameters
    ----------
    address : str
        Of the scheduler.
    certificates : Certificates
        For an address that begins with ``tls://``.
    deposit : Deposit, optional
        Where parts of the block are laid down for them; by default they travel with the calls.

    Yields
    ------
    Elsewhere
        What `adjust` takes.
    """
    with connected(address, certificates) as client:
        yield Elsewhere(client, deposit or InGraph())


@dataclass(frozen=True, eq=False)
class _Share:
    """A leaf's part of the block: its points and image points, its cameras, and its blocks of the pattern."""

    points: np.ndarray
    rows: np.ndarray
    cameras: np.ndarray
    inner: np.ndarray
    blocks: np.ndarray


@dataclass(eq=False)
class Shares:
    """A block in parts, laid down for workers."""

    division: Division
    shares: dict[int, _Share]
    workers: Workers
    deposit: Deposit

    @classmethod
    def of(
        cls, observations: Observations, model: RefinementModel, pattern: Pattern, elsewhere: Elsewhere,
        earlier: JointPrior | None = None,
    ) -> Shares:  # fmt: skip
        """Cut a block along its tree, and with it what is known of its cameras together, and lay the leaves down."""
        division = divide(pattern)
        leaf_of_point = division.leaf_of_points(observations)
        known = None if earlier is None else division.leaf_of_pairs(*earlier.pairs)
        leaves, shares = {}, {}
        for number in division.leaves:
            points = np.flatnonzero(leaf_of_point == number)
            own_cameras = division.nodes[number].own
            said = np.flatnonzero(known == number) if known is not None else np.zeros(0, dtype=np.int64)
            together = [pairs[said] for pairs in earlier.pairs] if earlier is not None else []
            part, cameras = part_of(observations, points, np.unique(np.concatenate([own_cameras, *together])))
            inner = np.isin(cameras, own_cameras)
            prior = earlier.part(said, cameras) if earlier is not None and len(said) else None
            leaf = Leaf(part, model, cameras, inner, prior)
            own = leaf.pattern
            blocks = pattern.find(cameras[own.rows], cameras[own.columns])
            rows, _ = observations.rows_of(points)
            shares[number] = _Share(points, rows, cameras, inner, blocks)
            leaves[number] = elsewhere.deposit.put(f"leaf_{number}", leaf)
        return cls(division, shares, Workers(elsewhere.client, division, leaves), elsewhere.deposit)


@dataclass(eq=False)
class WorkersLoop(GaussNewton):
    """The loop on workers; ``shares`` is the block as it lies there."""

    shares: Shares = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._last: tuple[Solution, np.ndarray, BlockAt] | None = None

    def run(self, state: State, weighting: Weighting, robust: str, tolerance: float, progress: Progress) -> Solution:
        """As `GaussNewton.run`."""
        return self._away(state, weighting, np.ones(len(weighting.image)), robust, tolerance, progress)

    def run_on(self, last: Solution, robust: str, tolerance: float, progress: Progress) -> Solution:
        """As `GaussNewton.run_on`."""
        return self._away(last.state, last.weighting, last.factor, robust, tolerance, progress)

    def _away(
        self, state: State, weighting: Weighting, factor: np.ndarray, robust: str, tolerance: float, progress: Progress
    ) -> Solution:
        if WEIGHTS[robust] is not least_squares:
            tolerance = max(tolerance, ROBUST_TOLERANCE)
        begin = replace(self._begin(state, weighting, factor), points=weighting.points if self.held else None)
        ended = self.shares.workers.descend(
            begin, self._priors, robust, tolerance, self.max_iterations, self.history, progress,
            self._judge_held if self.held else None,
        )  # fmt: skip
        self.solves += ended.steps
        weighting = weighting if ended.at.points is None else replace(weighting, points=ended.at.points)
        solution = self._fetched(ended.at, weighting, len(factor))
        solution = replace(solution, converged=ended.converged, status=ended.status)
        self._last = solution, self.prior_weight, ended.at
        return solution

    def _judge_held(
        self, at: BlockAt, priors: PointPriors
    ) -> tuple[PointPriors, Mapping[int, Callable[[], PointPriors]]]:
        """Judge what holds points where they are now: how well a source fits shows in all of the block only."""
        there, points = self.shares, len(self.rows_per_point)
        ground, inverse = np.empty((points, 3)), np.empty((points, 3, 3))
        places = {number: there.workers.ask(number, points_of, at.leaves[number]) for number in there.shares}
        for number, share in there.shares.items():
            ground[share.points], inverse[share.points] = there.workers.gather(places[number])
        for held in self.held:
            priors = held.apply(priors, ground, inverse)
        parts = {
            number: there.deposit.put(f"points_{number}", _some(priors, share.points))
            for number, share in there.shares.items()
        }
        return priors, parts

    @property
    def _separators(self) -> dict[int, np.ndarray]:
        return {k: node.own for k, node in enumerate(self.shares.division.nodes) if not node.is_leaf}

    @property
    def _priors(self) -> SeparatorPriors:
        return SeparatorPriors({k: self.prior_weight[own] for k, own in self._separators.items()})

    def _begin(self, state: State, weighting: Weighting, factor: np.ndarray) -> BlockAt:
        there, starts = self.shares, {}
        for number, share in there.shares.items():
            points, rows, priors = share.points, share.rows, weighting.points
            starts[number] = there.deposit.put(
                f"start_{number}",
                LeafStart(
                    state.values[share.cameras], state.ground[points], self.prior_weight[share.cameras],
                    weighting.image[rows], _some(priors, points), weighting.contributes[points], factor[rows],
                ),
            )  # fmt: skip
        values = {k: state.values[own] for k, own in self._separators.items()}
        return there.workers.begin(starts, values, self._priors)

    def _fetched(self, at: BlockAt, weighting: Weighting, rows: int) -> Solution:
        """Return the solution of all leaves, put together one by one."""
        there, p = self.shares, self.pattern.parameters
        points = len(self.rows_per_point)
        values, ground = np.zeros((self.pattern.cameras, p)), np.empty((points, 3))
        normals = Normals(
            np.empty((rows, 2)), np.zeros((self.pattern.blocks, p, p)), np.zeros((self.pattern.cameras, p)),
            np.empty((points, 3, 3)), np.empty((points, 3)),
        )  # fmt: skip
        factor = np.empty(rows)
        for number, share in there.shares.items():
            found: LeafAt = there.workers.gather(at.leaves[number])
            values[share.cameras[share.inner]] = found.state.values[share.inner]
            ground[share.points], factor[share.rows] = found.state.ground, found.start.robust
            normals.residual[share.rows], normals.inverse[share.points] = found.normals.residual, found.normals.inverse
            normals.point_right[share.points] = found.normals.point_right
            normals.blocks[share.blocks] += found.normals.blocks
            normals.right[share.cameras] += found.normals.right
        for number, own in self._separators.items():
            values[own] = at.values[number]
        return Solution(State(values, ground), weighting, normals, factor, at.cost)

    def cofactors(self, solution: Solution) -> tuple[np.ndarray, Cofactors]:
        """As `GaussNewton.cofactors`."""
        there, p = self.shares, self.pattern.parameters
        last = self._last
        if last is not None and last[0] is solution and last[1] is self.prior_weight:
            at = last[2]
        else:
            at = self._begin(solution.state, solution.weighting, solution.factor)
        leaves, separators = there.workers.precise(at, self._priors)
        cameras = np.zeros((self.pattern.blocks, p, p))
        spread = Cofactors(np.empty((len(self.rows_per_point), 3, 3)), np.empty((len(solution.factor), 2, 2)))
        for number, share in there.shares.items():
            found = there.workers.gather(leaves[number])
            cameras[share.blocks] = found.cameras
            spread.points[share.points], spread.computed[share.rows] = found.points, found.computed
        for number, own in self._separators.items():
            cameras[self.pattern.diagonal[own]] = separators[number]
        return cameras, spread


def _some(priors: PointPriors, points: np.ndarray) -> PointPriors:
    """Return the priors of some of the points."""
    mixed = priors.mixed[points] if priors.correlated else priors.mixed
    return PointPriors(priors.target[points], priors.weight[points], priors.observed[points], mixed)

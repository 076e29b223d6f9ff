"""The damped Gauss-Newton loop over leaves and separators that Dask workers hold.

Every pass: leaves eliminate their points and inner cameras, separators join what is left from below, up to the root;
steps go down again, and the leaves move. What a leaf hands up or gets down is of the size of its border. Here are the
values of the separators, and sums of costs. Which steps count is `foundation.levenberg_marquardt`'s, as everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...foundation.levenberg_marquardt import Descent, Step, descend
from ...foundation.progress import Progress, advance
from ...foundation.workers.cluster import OnWorker
from ..equations import PointPriors
from ..result import Iteration
from ..weights import WEIGHTS, least_squares
from . import crown, leaf
from .division import Division


@dataclass(frozen=True, eq=False)
class BlockAt:
    """A block's state: references to each leaf's equations on the workers, values of the separators, and sums.

    ``points`` are the priors of all points, where more than surveys holds them; else only the leaves have them.
    """

    leaves: Mapping[int, Any]
    values: Mapping[int, np.ndarray]
    cost: float
    freedom: float
    points: PointPriors | None = None


#: Judges what holds points, under their priors: returns the new priors of all, and what returns those of each leaf.
Hold = Callable[[BlockAt, PointPriors], tuple[PointPriors, Mapping[int, Callable[[], PointPriors]]]]


class Workers:
    """Leaves on Dask workers.

    Parameters
    ----------
    client : distributed.Client
        Of a scheduler with workers.
    division : Division
        The tree.
    leaves : mapping of int to callable
        By leaf, what returns a `Leaf` in whatever process; called again when a worker was lost.
    """

    def __init__(self, client: Any, division: Division, leaves: Mapping[int, Callable[[], leaf.Leaf]]) -> None:
        self._client, self.division = client, division
        # Leaves next to each other in the tree lie on one worker, where there is a choice
        addresses = sorted(client.scheduler_info(n_workers=-1)["workers"]) or [None]
        share = -(-len(division.leaves) // len(addresses))
        self._home = {number: addresses[k // share] for k, number in enumerate(division.leaves)}
        self.leaves = {number: self.ask(number, leaf.load, stored) for number, stored in leaves.items()}

    def ask(self, number: int | None, function: Callable[..., Any], *given: Any) -> Any:
        """Hand a call out, for the worker of a leaf where that lives."""
        home = self._home.get(number) if number is not None else None
        where = {} if home is None else {"workers": [home], "allow_other_workers": True}
        # Calls are made in the order in which they are handed out: Dask takes those of 0.1 s as equal by default
        return self._client.submit(OnWorker(function), *given, pure=False, fifo_timeout=0, **where)

    def every(self, function: Callable[..., Any], *given: Any) -> dict[int, Any]:
        """Call a function for every leaf; mappings by leaf are given as the leaf's own, references as what they are."""
        return {
            number: self.ask(number, function, *(one[number] if isinstance(one, Mapping) else one for one in given))
            for number in self.division.leaves
        }

    def gather(self, references: Any) -> Any:
        """Return what references stand for."""
        return self._client.gather(references)

    # ---- states ------------------------------------------------------------------------------------------------------

    def begin(self, starts: Mapping[int, Any], values: Mapping[int, np.ndarray], priors: SeparatorPriors) -> BlockAt:
        """Return the state that leaves (callables that return a `LeafStart`) and separators begin with."""
        return self._state(self.every(leaf.begin, self.leaves, starts), values, priors)

    def _state(self, leaves: Mapping[int, Any], values: Mapping[int, np.ndarray], priors: SeparatorPriors) -> BlockAt:
        sums = self.gather([self.ask(number, leaf.sums_of, at) for number, at in leaves.items()])
        cost, freedom = crown.sum_of(sums).tolist()
        return BlockAt(leaves, values, cost + priors.cost(values), freedom - priors.count)

    def reweighted(self, at: BlockAt, robust: str, priors: SeparatorPriors, hold: Hold | None = None) -> BlockAt:
        """Return the same state with robust factors from its residuals, and from what holds points."""
        points, parts = (None, None) if hold is None or at.points is None else hold(at, at.points)
        leaves = self.every(leaf.reweight, self.leaves, at.leaves, robust, parts)
        return replace(self._state(leaves, at.values, priors), points=points)

    # ---- up and down -------------------------------------------------------------------------------------------------

    def _up(self, at: BlockAt, damping: float, priors: SeparatorPriors) -> dict[int, Any]:
        """Return references to the eliminated leaves and the separators.

        Each node comes right after those below it, and its update is let go of as soon as the parent has it: of all
        updates, which are several times as large as the factors, few exist at a time.
        """
        gone: dict[int, Any] = {}
        updates: dict[int, Any] = {}
        for number, node in enumerate(self.division.nodes):
            home = int(self.division.leaf_below[number])
            if node.is_leaf:
                pair = self.ask(home, leaf.eliminate_inner, self.leaves[number], at.leaves[number], damping)
            else:
                below = [updates.pop(child) for child in node.children]
                pair = self.ask(
                    home, crown.join, node.own, priors.weight[number], at.values[number], damping, *below
                )  # fmt: skip
            gone[number], updates[number] = self.ask(home, leaf.first_of, pair), self.ask(home, leaf.second_of, pair)
        return gone

    def _down(
        self, at: BlockAt, gone: dict[int, Any], through: Callable[..., Any], own: Callable[..., Any],
        into: Callable[..., Any],
    ) -> tuple[dict[int, Any], dict[int, Any]]:  # fmt: skip
        """Return references to what leaves make ``into`` of what comes down ``through`` separators, and to these' own.

        Each node comes before those below it, half by half, and takes its reference out of ``gone``: what nobody needs
        any more goes.
        """
        leaves: dict[int, Any] = {}
        owns: dict[int, Any] = {}
        above: dict[int, Any] = {len(self.division.nodes) - 1: None}
        for number in reversed(range(len(self.division.nodes))):
            node, home = self.division.nodes[number], int(self.division.leaf_below[number])
            come, eliminated = above.pop(number), gone.pop(number)
            if node.is_leaf:
                leaves[number] = self.ask(home, into, self.leaves[number], at.leaves[number], eliminated, come)
            else:
                found = self.ask(home, through, eliminated, come)
                owns[number] = self.ask(home, own, eliminated, found)
                above |= dict.fromkeys(node.children, found)
        return dict(sorted(leaves.items())), dict(sorted(owns.items()))  # sums are in the order of the tree

    def step(self, at: BlockAt, damping: float, priors: SeparatorPriors) -> Step[BlockAt]:
        """Return the next state and the decrease of the cost that the equations promise for it."""
        taken, mine = self._down(at, self._up(at, damping, priors), crown.steps_of, crown.own_step, leaf.move_on)
        promises = [self.ask(number, leaf.second_of, pair) for number, pair in taken.items()]
        promised, own = self.gather([promises, mine])
        gained, points, braked = crown.sum_of(promised).tolist()
        values = {number: at.values[number] + step for number, (step, _, _) in own.items()}
        braked = 0.5 * damping * (braked + sum(square for _, square, _ in own.values()))
        gained -= sum(pulled for _, _, pulled in own.values())
        ahead = {number: self.ask(number, leaf.first_of, pair) for number, pair in taken.items()}
        moved = replace(self._state(ahead, values, priors), points=at.points)
        return Step(moved, 0.5 * (gained + points) + braked, braked)

    def descend(
        self, begin: BlockAt, priors: SeparatorPriors, robust: str, tolerance: float, most: int,
        history: list[Iteration], progress: Progress, hold: Hold | None = None,
    ) -> Descent[BlockAt]:  # fmt: skip
        """Iterate from a state as `GaussNewton.run` does; the history grows by a row a step."""
        first = len(history)

        def step(at: BlockAt, damping: float) -> Step[BlockAt]:
            advance(progress, 1.0 - 0.6 ** (len(history) - first), f"adjustment, iteration {len(history) + 1}")
            taken = self.step(at, damping, priors)
            history.append(Iteration(at.cost, taken.promised, damping))
            return taken

        reweighting = WEIGHTS[robust] is not least_squares or hold is not None
        return descend(
            begin, step, lambda at: max(1.0, 2.0 * at.cost / max(at.freedom, 1.0)), most,
            (lambda at: self.reweighted(at, robust, priors, hold)) if reweighting else None, tolerance,
        )  # fmt: skip

    def precise(self, at: BlockAt, priors: SeparatorPriors) -> tuple[dict[int, Any], dict[int, np.ndarray]]:
        """Return references to the leaves' cofactors (`leaf.LeafPrecision`), and those of the separators' cameras."""
        leaves, own = self._down(at, self._up(at, 0.0, priors), crown.invert, crown.own_inverse, leaf.precise)
        return leaves, self.gather(own)


@dataclass(frozen=True, eq=False)
class SeparatorPriors:
    """Weights of the priors of the separators' cameras, by node; infinite where fixed."""

    weight: Mapping[int, np.ndarray]

    @property
    def count(self) -> int:
        """How many parameters have one."""
        return sum(int(((weight > 0.0) & np.isfinite(weight)).sum()) for weight in self.weight.values())

    def cost(self, values: Mapping[int, np.ndarray]) -> float:
        """Return half the weighted sum of squares of the values."""
        return 0.5 * sum(
            float(np.sum(np.where(np.isinf(weight), 0.0, weight) * values[number] ** 2))
            for number, weight in self.weight.items()
        )

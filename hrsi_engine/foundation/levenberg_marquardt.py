"""Levenberg-Marquardt descent: the one damping rule of every least-squares loop, single images and blocks alike.

Minimised is a cost, half a weighted sum of squares, whose normal equations ``(N + damping diag N) step = g`` the caller
solves. Three rules (Marquardt 1963; Nielsen 1999, IMM-REP-1999-05; Chamberlain, Powell, Lemarechal and Pedersen 1982,
"the watchdog technique", Math. Programming Study 16):

1. Damping starts at 0, so that an easy problem is Gauss-Newton's and converges quadratically. A step that does not help
   raises it, faster each time; one that does lowers it by what the gain ratio says of the curvature. It is never
   dropped to 0 where it was needed, but for the last test (3).
2. A step that raises the cost may still be a good one: along a curved valley it leaves the floor by the square of its
   length, and the next step comes back to it, far ahead. So a step is refused only when further ones from its end do
   not bring the cost down, in great leaps, to below where it began.
3. `converged` means at the minimum: twice the decrease that the undamped step promises is g' N^-1 g, the square of the
   distance to the minimum in standard deviations: no linear function of the unknowns is farther from its value there
   by more of its own sigmas. The descent ends where the distance is `DESCENT.done_sigma`; where the steps are used up,
   `DESCENT.near_sigma` will do.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from .thresholds import threshold, thresholds


@thresholds
class DESCENT:
    """Damping and convergence of the descent."""

    first_damping: float = threshold(1e-4, "", "damping after the first refused step, relative to the diagonal")
    least_damping: float = threshold(1e-10, "", "smallest damping once there was any")
    most_damping: float = threshold(1e8, "", "damping beyond which the descent is stuck")
    raised: float = threshold(4.0, "", "factor of the damping after a refused step, twice that after each further one")
    lowered: float = threshold(0.1, "", "factor of the damping after a step that did not need it")
    unimportant_share: float = threshold(0.1, "", "share of the damping in a step below which the step did not need it")
    look_ahead: int = threshold(2, "steps", "steps after one that raises the cost, before it is refused")
    great_leap: float = threshold(0.5, "", "share of the cost that such a step may leave at most")
    done_sigma: float = threshold(1e-4, "sigma", "distance to the minimum (sigma0 included) that counts as none")
    near_sigma: float = threshold(1e-2, "sigma", "distance that is small enough after the last step")
    rounding_share: float = threshold(1e-9, "", "relative change of the cost that is no rise", "rounding of sums")


CONVERGED = "converged"  # the status of a minimum


class Place(Protocol):
    """Where a descent stands."""

    @property
    def cost(self) -> float:
        """Half the weighted sum of squares there, infinite or NaN where there is none."""


T = TypeVar("T", bound=Place)


class Step(NamedTuple, Generic[T]):
    """A step: where it leads, the decrease of the cost that it promises, and the damping's part in that.

    With s the step, ``promised = (g' s + damping s' D s) / 2`` is what the undamped normal equations say of it, and
    ``braked = damping s' D s / 2``.
    """

    ahead: T
    promised: float
    braked: float


@dataclass(frozen=True, eq=False)
class Descent(Generic[T]):
    """Where a descent ended.

    at : the best place; converged : whether it is a minimum; status : the same in words, with the reason
    steps : that were computed
    """

    at: T
    converged: bool
    status: str
    steps: int


def descend(
    start: T, step: Callable[[T, float], Step[T]], variance: Callable[[T], float], most: int,
    weighed: Callable[[T], T] | None = None, tolerance: float = 0.0,
) -> Descent[T]:  # fmt: skip
    """Return the minimum next to a place.

    start : where to begin; its cost must be finite
    step : returns the step from a place with a damping; variance : the variance of unit weight at a place, sigma0²
    most : steps to compute
    weighed : gives an accepted place other weights (robust ones); costs are compared with the same weights only. The
    first step, before which residuals judge nothing, is then no reason to stop
    tolerance : a promised decrease of this share of the cost is none either
    """
    best = at = start
    del start  # a place may be large, and where a descent began is not needed again
    damping, needed, growth, astray = 0.0, DESCENT.first_damping, DESCENT.raised, 0
    promised = np.inf
    for number in range(1, most + 1):
        if number == most:  # how far the minimum is only an undamped step tells
            at, damping = best, 0.0
        taken = step(at, damping)
        if at is best:
            promised, braked = taken.promised, taken.braked
        fell = taken.ahead.cost <= best.cost * (1.0 + DESCENT.rounding_share) + 1e-12
        enough = max(0.5 * DESCENT.done_sigma**2 * variance(best), tolerance * best.cost)
        done = at is best and promised <= enough and (number > 1 or weighed is None)
        if done and damping == 0.0:
            return Descent(taken.ahead if fell else best, True, CONVERGED, number)
        if number == most:
            near = promised <= 0.5 * DESCENT.near_sigma**2 * variance(best)
            said = CONVERGED if near else f"stopped at the iteration limit, {_distance_text(promised, variance(best))}"
            return Descent(taken.ahead if fell else best, near, said, most)
        if fell:
            came = (best.cost - taken.ahead.cost) / max(promised - braked, 1e-300)
            best = at = weighed(taken.ahead) if weighed else taken.ahead
            astray, growth = 0, DESCENT.raised
            if damping:
                # a damped step promises little everywhere, so where it is little the next one is not damped
                needed = max(_lower_damping(damping, came, braked / max(promised, 1e-300)), DESCENT.least_damping)
                damping = 0.0 if done else needed
        elif astray < DESCENT.look_ahead and taken.ahead.cost < (DESCENT.great_leap * at.cost if astray else np.inf):
            at, astray = taken.ahead, astray + 1
        else:
            at, astray = best, 0
            damping = needed = growth * damping if damping else needed
            growth *= 2.0
            if damping > DESCENT.most_damping:
                said = f"no step lowers the cost, {_distance_text(promised, variance(best))}"
                return Descent(best, False, said, number)
    raise AssertionError("a descent has one step at least")


def _lower_damping(damping: float, came: float, share: float) -> float:
    """Return the damping after a step that helped.

    ``came`` is the decrease over that of the damped equations, (g' s) / 2, and ``share`` the damping's part in what was
    promised. Where the damping did not matter it goes; where it did, 2 - came is the curvature of the cost along the
    step over that of the damped equations (1: they are just right, as where residuals are large).
    """
    if share < DESCENT.unimportant_share:
        return DESCENT.lowered * damping
    return damping * float(np.clip(2.0 - came, DESCENT.lowered, 1.5))


def _distance_text(promised: float, variance: float) -> str:
    """Say how far away the minimum seems to be."""
    return f"{np.sqrt(2.0 * max(promised, 0.0) / variance):.2g} sigma from the minimum"

"""Levenberg-Marquardt descent with one damping rule for all least-squares loops, of single images and of blocks.

The cost, half a weighted sum of squares, is minimised. The caller solves its normal equations,
``(N + damping diag N) step = g``. Three rules (Marquardt 1963; Nielsen 1999, IMM-REP-1999-05; Chamberlain, Powell,
Lemarechal and Pedersen 1982, "the watchdog technique", Math. Programming Study 16):

1. Damping starts at 0, so that an easy problem is solved by Gauss-Newton with quadratic convergence. A step that does
   not lower the cost raises the damping, by a larger factor each time; one that does lowers it, depending on the gain
   ratio. Once needed, the damping is never reset to 0, except for the last test (3).
2. A step that raises the cost can still be useful: along a curved valley it leaves the floor by the square of its
   length, and the next step returns to it, far ahead. Therefore a step is refused only if none of the next
   `DESCENT.look_ahead` steps reduces the cost to below the cost before it.
3. `converged` means at the minimum: twice the decrease that the undamped step predicts is g' N^-1 g, the squared
   distance to the minimum in standard deviations: no linear function of the unknowns differs from its value there by
   more multiples of its own sigma. The descent ends at a distance of `DESCENT.done_sigma`; after the last permitted
   step, `ITERATIONS.settled` is sufficient.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from .thresholds import EQUALITY, ITERATIONS, threshold, thresholds


@thresholds
class DESCENT:
    """Damping and convergence of the Levenberg-Marquardt iteration."""

    first_damping: float = threshold(1e-4, "", "damping after the first rejected step, relative to the diagonal")
    lowered: float = threshold(0.1, "", "smallest factor of the damping after an accepted step")
    look_ahead: int = threshold(2, "steps", "steps after a rise of the cost, before it is rejected")
    done_sigma: float = threshold(1e-4, "sigma", "distance to the minimum at convergence (sigma0 included)")


CONVERGED = "converged"  # status of a descent that ended at a minimum


class Place(Protocol):
    """Current point of a descent: the unknowns with their cost."""

    @property
    def cost(self) -> float:
        """Half the weighted sum of squares at this point, infinite or NaN if it cannot be computed."""


T = TypeVar("T", bound=Place)


class Step(NamedTuple, Generic[T]):
    """A step: the place it leads to, the predicted decrease of the cost, and the share of the damping in it.

    With the step s and D = diag N, the undamped normal equations predict ``promised = (g' s + damping s' D s) / 2``,
    and ``braked = damping s' D s / 2``.
    """

    ahead: T
    promised: float
    braked: float


@dataclass(frozen=True, eq=False)
class Descent(Generic[T]):
    """Result of a descent.

    at : the best place; converged : whether it is a minimum; status : the same in words, with the reason
    steps : number of computed steps
    """

    at: T
    converged: bool
    status: str
    steps: int


def descend(
    start: T,
    step: Callable[[T, float], Step[T]],
    variance: Callable[[T], float],
    largest: int,
    weighed: Callable[[T], T] | None = None,
    tolerance: float = 0.0,
) -> Descent[T]:
    """Return the local minimum that is reached from a place.

    start : first place; its cost must be finite
    step : returns the step from a place with a damping; variance : the variance of unit weight at a place, sigma0²
    largest : largest number of steps
    weighed : returns an accepted place with new (robust) weights; only costs with equal weights are compared. With
    it, the descent does not end at the first step, before any weights were derived from residuals
    tolerance : the descent also ends if the predicted decrease is below this share of the cost
    """
    best = current = start
    del start  # frees its memory, which can be large
    damping, fallback_damping, growth, ahead_steps = 0.0, DESCENT.first_damping, 1.0 / DESCENT.lowered, 0
    predicted = np.inf
    for number in range(1, largest + 1):
        if number == largest:  # only an undamped step shows the distance to the minimum
            current, damping = best, 0.0
        trial = step(current, damping)
        if current is best:
            predicted, damping_term = trial.promised, trial.braked
        decreased = trial.ahead.cost <= best.cost * (1.0 + EQUALITY.rounding) + 1e-12
        limit = max(0.5 * DESCENT.done_sigma**2 * variance(best), tolerance * best.cost)
        converged = current is best and predicted <= limit and (number > 1 or weighed is None)
        if converged and damping == 0.0:
            return Descent(trial.ahead if decreased else best, True, CONVERGED, number)
        if number == largest:
            is_near = predicted <= 0.5 * ITERATIONS.settled**2 * variance(best)
            sigmas = np.sqrt(2.0 * max(predicted, 0.0) / variance(best))  # estimated distance to the minimum
            status = CONVERGED if is_near else f"stopped at the iteration limit, {sigmas:.2g} sigma from the minimum"
            return Descent(trial.ahead if decreased else best, is_near, status, largest)
        if decreased:
            gain = (best.cost - trial.ahead.cost) / max(predicted - damping_term, 1e-300)
            best = current = weighed(trial.ahead) if weighed else trial.ahead
            ahead_steps, growth = 0, 1.0 / DESCENT.lowered
            if damping:
                # a damped step always predicts little, therefore the next step is undamped if this one predicts little
                fallback_damping = max(
                    _lower_damping(damping, gain, damping_term / max(predicted, 1e-300)), EQUALITY.rounding
                )
                damping = 0.0 if converged else fallback_damping
        elif ahead_steps < DESCENT.look_ahead and np.isfinite(trial.ahead.cost):
            current, ahead_steps = trial.ahead, ahead_steps + 1
        else:
            current, ahead_steps = best, 0
            damping = fallback_damping = growth * damping if damping else fallback_damping
            growth *= 2.0
    raise AssertionError("a descent has one step at least")


def _lower_damping(damping: float, came: float, share: float) -> float:
    """Return the damping after a step that lowered the cost.

    ``came`` is the decrease relative to that of the damped equations, (g' s) / 2, and ``share`` the share of the
    damping in the predicted decrease. If it is small, the damping is reduced by the full factor. Otherwise 2 - came is
    the curvature of the cost along the step relative to the damped equations (1: they fit, as with large residuals).
    """
    if share < EQUALITY.negligible:
        return DESCENT.lowered * damping
    return damping * float(np.clip(2.0 - came, DESCENT.lowered, 1.5))

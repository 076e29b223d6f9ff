"""How much the corrections of a block's images drift, estimated from the block itself (a variance component).

With few GCPs a loose prior lets scale and rotation of every image follow the noise, and a shift alone leaves what
drift there is. The prior is an observation "no drift" of every such parameter: with values v, prior weights p and
cofactors q of the parameters, ``s² = sum(p v²) / sum(1 - p q)`` tells how wrong its sigma was, as for any group of
observations. Repeated until s = 1 this is the estimate by restricted maximum likelihood (Harville 1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..refinement.image_space import ImagePolynomial
from ..refinement.model import RefinementModel
from .gauss_newton import GaussNewton, Solution
from .precision import Precision
from .result import VarianceComponent

LEAST_DRIFT_FREEDOM = 1.0  # the size of a prior matters less than that of an observation's sigma
MOST_CHANGE = 5.0  # in one round


def drifting(model: RefinementModel) -> np.ndarray:
    """Return which parameters change across an image ``(p,)``: those of image-space polynomials but the constants."""
    if not isinstance(model, ImagePolynomial):
        return np.zeros(len(model.parameters), dtype=bool)
    constant = model.powers.sum(axis=1) == 0
    return ~(model.mixing[:, constant] != 0.0).any(axis=(0, 1))


@dataclass(eq=False)
class DriftPrior:
    """The factor of the drifts' prior sigmas found so far; ``sums`` are the last squares, redundancy and number."""

    model: RefinementModel
    given: np.ndarray
    factor: float = 1.0
    sums: tuple[float, float, int] = (0.0, 0.0, 0)

    def update(self, loop: GaussNewton, solution: Solution, precise: Precision) -> float:
        """Correct the factor and hold the loop's drifts with it; return the relative change."""
        free = drifting(self.model) & np.isfinite(loop.prior_weight)
        weight = np.where(free, loop.prior_weight, 0.0)
        squares = float(np.sum(weight * solution.state.values**2))
        freedom = float(np.sum(np.where(free, 1.0 - weight * precise.parameters, 0.0)))
        self.sums = (squares, freedom, int(free.sum()))
        if not freedom >= LEAST_DRIFT_FREEDOM:
            return 0.0
        ratio = float(np.clip(np.sqrt(squares / freedom), 1.0 / MOST_CHANGE, MOST_CHANGE))
        self.factor *= ratio
        loop.hold(np.where(free, self.given / self.factor**2, self.given))
        return abs(ratio - 1.0)

    def summary(self) -> tuple[VarianceComponent, ...]:
        """Return the group, if the model has any drift."""
        _, freedom, count = self.sums
        if not count:
            return ()
        sigma = float(np.median(1.0 / np.sqrt(self.given[:, drifting(self.model)])))
        return (
            VarianceComponent(
                "drift of the images", count, freedom, self.factor, self.factor * sigma, "px/px",
                freedom >= LEAST_DRIFT_FREEDOM,
            ),
        )  # fmt: skip

"""How much the corrections of a block's images drift, estimated from the block itself (a variance component).

With few GCPs a loose prior lets scale and rotation of every image follow the noise, and a shift alone leaves what
drift there is. The prior is an observation "no drift" of every such parameter: with values v, prior weights p and
cofactors q of the parameters, ``s² = sum(p v²) / sum(1 - p q)`` tells how wrong its sigma was, as for any group of
observations. Repeated until s = 1 this is the estimate by restricted maximum likelihood (Harville 1977).

Where no GCPs show them, drifts that move all images alike keep the sensors' sigmas, and the differences between images
are the group that is estimated (`common_drift`).

A block of a few images has few drifts, and what they say of their size is rough. So sizes stand in three levels, each
worth a few observations to the one below (an inverse chi² distribution of the variance; Gelman et al. 2013, section
5.4): what the sensor is believed to do, all drifts of the block, each term (sample by line, say) over the images, and
each term of each image. A line that drifts along the samples in all images is followed though nothing else drifts, and
an image that drifts by itself too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from ..refinement.model import RefinementModel
from .common_drift import CommonDrift
from .gauss_newton import GaussNewton, Solution
from .result import VarianceComponent


@thresholds
class DRIFT:
    """How far the standard deviations of drifts are estimated from the block, and when they are settled."""

    least_redundancy: float = threshold(1.0, "", "of an estimated drift; the size of a prior matters little")
    settled: float = threshold(
        0.05, "",
        "relative change of the sigma of an image's drift that needs no further solution; `of_term` and its few "
        "values determine it to a quarter at best",
    )  # fmt: skip
    settled_within: float = threshold(0.001, "", "the same between two corrections at one solution")
    corrections: int = threshold(25, "corrections", "most corrections at one solution")
    most_change: float = threshold(5.0, "", "largest factor by which one correction changes a sigma")
    of_sensor: float = threshold(1.0, "observations", "weight of the sensor's usual drift in that of the block")
    of_block: float = threshold(
        6.0, "observations",
        "weight of the drift of the block in that of a term (inverse chi² prior, Gelman et al. 2013, section 5.4)",
    )  # fmt: skip
    of_term: float = threshold(6.0, "observations", "weight of the drift of a term in that of an image")


@dataclass(eq=False)
class DriftPrior:
    """The drifts' prior sigmas found so far, as factors of the ``believed`` ones; both ``(cameras, p)``.

    ``given`` are the weights of all parameters' priors, ``per_px`` the believed change across an image, px per px;
    ``common`` are the drifts that ties do not show; ``of_block`` is the factor of all drifts together; ``sums`` are the
    last squares (in believed sigmas), redundancy and number of drifts.
    """

    model: RefinementModel
    given: np.ndarray
    believed: np.ndarray
    per_px: float
    common: tuple[CommonDrift, ...] = ()
    factor: np.ndarray = field(init=False)
    of_block: float = 1.0
    sums: tuple[float, float, int] = (0.0, 0.0, 0)

    def __post_init__(self) -> None:
        # A drift without a prior of its own is one that an earlier adjustment tells of
        self.free = self.model.drifts & np.isfinite(self.given) & (self.given > 0.0) & np.isfinite(self.believed)
        self.alike = np.ones((len(self.given), 1))
        for one in self.common:
            self.alike[one.camera] = one.points_alike
        self.factor = 1.0 / (np.sqrt(np.where(self.free, self.given, 1.0)) * np.where(self.free, self.believed, 1.0))

    def set_initial_drift_prior(self, loop: GaussNewton) -> None:
        """Hold the loop's drifts as the sensors are believed to drift.

        From looser priors the estimate may end where the drifts follow the noise, and leave none to be seen.
        """
        self.factor = np.ones_like(self.factor)
        loop.set_prior_weight(self.alike * np.where(self.free, 1.0 / self.believed**2, self.given), self.common)

    def correct_sigmas(
        self, loop: GaussNewton, solution: Solution, cofactors: np.ndarray, unit_variance: float
    ) -> float:
        """Correct the factors and hold the loop's drifts with them; return by how much, 0 where they stay.

        That is the largest relative change. One below `DRIFT.settled` is not worth another solution: all stays as it
        is. ``cofactors (blocks, p, p)`` are those of the cameras on the pattern. Where all observations are worse than
        they were said to be, by their ``unit_variance``, the drifts' priors weigh as much more: else they would follow
        the noise. For the same reason all priors weigh k times as much where only ties tell of the cameras and k of
        them err alike (`common_drift`).

        Before the block is solved again, corrections are repeated until they settle. Weights of a camera's priors that
        have grown by D make of its cofactors Q and values v, but for what changes in other cameras::

            (I + Q D)^-1 Q    and    (I + Q D)^-1 v
        """
        held, values = np.where(self.free, loop.prior_weight, 0.0), solution.state.values
        own = cofactors[loop.pattern.diagonal]
        known = np.concatenate([own, values[:, :, None]], axis=2)
        of_parts = [one.select_drifts(cofactors, values, loop.pattern) for one in loop.common]

        def look_ahead(weight: np.ndarray, common: Sequence[CommonDrift]) -> np.ndarray:
            """Return the factors that the block asks for with other priors of the drifts, ``weight (cameras, p)``."""
            ahead = np.linalg.solve(np.eye(own.shape[1]) + own * (weight - held)[:, None, :], known)
            variances, drifts = ahead[:, :, :-1].diagonal(axis1=1, axis2=2), ahead[:, :, -1]
            squares = np.where(self.free, (drifts / self.believed) ** 2, 0.0)
            freedom = np.where(self.free, np.clip(1.0 - weight * variances, 0.0, 1.0), 0.0)
            for now, then, of_part in zip(loop.common, common, of_parts, strict=True):
                squares[now.place], freedom[now.place] = now.predict_differences(
                    then, *of_part, held[now.place], weight[now.place]
                )
            return self._estimate_factors(squares, freedom)

        wanted = look_ahead(held, loop.common)
        by_solution = self._find_largest_change(wanted)
        if by_solution < DRIFT.settled:
            return 0.0
        for _ in range(DRIFT.corrections):
            self.factor = self.factor * np.clip(wanted / self.factor, 1.0 / DRIFT.most_change, DRIFT.most_change)
            weight = np.where(self.free, unit_variance * self.alike / (self.factor * self.believed) ** 2, 0.0)
            common = [one.balance_with(self.factor[one.place], unit_variance) for one in loop.common]
            wanted = look_ahead(weight, common)
            if self._find_largest_change(wanted) < DRIFT.settled_within:
                break
        loop.set_prior_weight(np.where(self.free, weight, self.alike * self.given), common)
        return by_solution

    def _estimate_factors(self, squares: np.ndarray, freedom: np.ndarray) -> np.ndarray:
        """Return the factors that squares and redundancies of the drifts ask for, both ``(cameras, p)``."""
        self.sums = float(squares.sum()), float(freedom.sum()), int(self.free.sum())
        if not self.sums[1] > 0.0:
            return self.factor
        block = (DRIFT.of_sensor + self.sums[0]) / (DRIFT.of_sensor + self.sums[1])
        term = (DRIFT.of_block * block + squares.sum(axis=0)) / (DRIFT.of_block + freedom.sum(axis=0))
        own = np.sqrt((DRIFT.of_term * term + squares) / (DRIFT.of_term + freedom))
        self.of_block = float(np.sqrt(block))
        return np.where(self.free, own, self.factor)

    def _find_largest_change(self, wanted: np.ndarray) -> float:
        return float(
            np.abs(np.clip(wanted / self.factor, 1.0 / DRIFT.most_change, DRIFT.most_change) - 1.0).max(initial=0.0)
        )

    def list_components(self) -> tuple[VarianceComponent, ...]:
        """Return the group, if the model has any drift."""
        _, freedom, count = self.sums
        if not count:
            return ()
        return (
            VarianceComponent(
                "drift of the images", count, freedom, self.of_block, self.of_block * self.per_px, "px/px",
                freedom >= DRIFT.least_redundancy,
            ),
        )  # fmt: skip

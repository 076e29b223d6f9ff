"""Standard deviations of the drifts of a block's images, estimated from the block itself (a variance component).

With few GCPs a loose prior lets scale and rotation of every image fit the noise, and a shift alone does not correct an
existing drift. The prior is an observation "no drift" of every such parameter: with values v, prior weights p and
cofactors q of the parameters, ``s² = sum(p v²) / sum(1 - p q)`` is the variance factor of its sigma, as for any group
of observations. Repeated until s = 1 this is the estimate by restricted maximum likelihood (Harville 1977).

If GCPs do not determine them, drifts common to all images keep the sensors' sigmas, and the differences between images
are the group that is estimated (`common_drift`).

A block of a few images has few drifts, which determine their size only roughly. So there are three levels, each with
the weight of a few observations in the level below (an inverse chi² distribution of the variance; Gelman et al. 2013,
section 5.4): the sensor's a priori drift; all drifts of the block; each term (for example sample by line) over the
images; and each term of each image. A drift of all images in one term is estimated even if nothing else drifts, and so
is the drift of a single image.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..foundation.thresholds import ITERATIONS, REDUNDANCY, threshold, thresholds
from ..refinement.model import RefinementModel
from .gauss_newton import GaussNewton, Solution
from .priors.common_drift import CommonDrift, count_points_per_error
from .result import VarianceComponent


@thresholds
class DRIFT:
    """Limits for the estimation of the drifts' standard deviations, and for its convergence."""

    of_sensor: float = threshold(1.0, "observations", "weight of the sensor's usual drift in the block's drift sigma")


@dataclass(eq=False)
class DriftPrior:
    """The drifts' current prior sigmas, as factors of the a priori ones ``prior_sigma``; both ``(cameras, p)``.

    ``given`` are the weights of all parameters' priors, ``per_px`` the a priori change across an image, px per px;
    ``common`` are the drifts that tie points do not determine; ``of_block`` is the factor of all drifts together;
    ``sums`` are the last squares (in a priori sigmas), redundancy and number of drifts.
    """

    model: RefinementModel
    given: np.ndarray
    prior_sigma: np.ndarray
    per_px: float
    common: tuple[CommonDrift, ...] = ()
    factor: np.ndarray = field(init=False)
    of_block: float = 1.0
    sums: tuple[float, float, int] = (0.0, 0.0, 0)

    def __post_init__(self) -> None:
        # A drift without its own prior has that of an earlier adjustment
        self.free = self.model.drifts & np.isfinite(self.given) & (self.given > 0.0) & np.isfinite(self.prior_sigma)
        self.points_per_error = count_points_per_error(len(self.given), self.common)[:, None]
        self.factor = 1.0 / (np.sqrt(np.where(self.free, self.given, 1.0)) * np.where(self.free, self.prior_sigma, 1.0))

    def set_initial_drift_prior(self, loop: GaussNewton) -> None:
        """Set the prior standard deviations of the loop's drifts to those of the sensors.

        With looser initial priors the estimation can converge to drifts that fit the noise, without residuals.
        """
        self.factor = np.ones_like(self.factor)
        loop.set_prior_weight(
            self.points_per_error * np.where(self.free, 1.0 / self.prior_sigma**2, self.given), self.common
        )

    def correct_sigmas(
        self, loop: GaussNewton, solution: Solution, cofactors: np.ndarray, unit_variance: float
    ) -> float:
        """Correct the factors and the drift priors of the loop; return the largest relative change, 0 if they stay.

        A change below `ITERATIONS.coarse` needs no further solution: all stays unchanged. ``cofactors (blocks, p, p)``
        are
        those of the cameras on the pattern. If all observations are worse than stated, by the factor ``unit_variance``,
        the drift priors' weights are multiplied by it: otherwise the drifts would fit the noise. For the same reason
        all priors have k times the weight if only tie points determine the cameras and k of them share their errors
        (`common_drift`).

        Before the block is solved again, corrections are repeated until they converge. If the weights of a camera's
        priors grow by D, its cofactors Q and values v become, except for changes of other cameras::

            (I + Q D)^-1 Q    and    (I + Q D)^-1 v
        """
        prior_weight, values = np.where(self.free, loop.prior_weight, 0.0), solution.state.values
        diagonal = cofactors[loop.pattern.diagonal]
        with_values = np.concatenate([diagonal, values[:, :, None]], axis=2)
        of_parts = [one.select_drifts(cofactors, values, loop.pattern) for one in loop.common]

        def look_ahead(weight: np.ndarray, common: Sequence[CommonDrift]) -> np.ndarray:
            """Return the factors estimated with other prior weights of the drifts, ``weight (cameras, p)``."""
            ahead = np.linalg.solve(
                np.eye(diagonal.shape[1]) + diagonal * (weight - prior_weight)[:, None, :], with_values
            )
            variances, drifts = ahead[:, :, :-1].diagonal(axis1=1, axis2=2), ahead[:, :, -1]
            squares = np.where(self.free, (drifts / self.prior_sigma) ** 2, 0.0)
            freedom = np.where(self.free, np.clip(1.0 - weight * variances, 0.0, 1.0), 0.0)
            for now, next_common, of_part in zip(loop.common, common, of_parts, strict=True):
                squares[now.place], freedom[now.place] = now.predict_differences(
                    next_common, *of_part, prior_weight[now.place], weight[now.place]
                )
            self.sums = float(squares.sum()), float(freedom.sum()), int(self.free.sum())
            if not self.sums[1] > 0.0:
                return self.factor
            block = (DRIFT.of_sensor + self.sums[0]) / (DRIFT.of_sensor + self.sums[1])
            term = (REDUNDANCY.stated * block + squares.sum(axis=0)) / (REDUNDANCY.stated + freedom.sum(axis=0))
            individual = np.sqrt((REDUNDANCY.stated * term + squares) / (REDUNDANCY.stated + freedom))
            self.of_block = float(np.sqrt(block))
            return np.where(self.free, individual, self.factor)

        estimated = look_ahead(prior_weight, loop.common)
        by_solution = self._find_largest_change(estimated)
        if by_solution < ITERATIONS.coarse:
            return 0.0
        for _ in range(ITERATIONS.most):
            self.factor = estimated
            weight = np.where(
                self.free, unit_variance * self.points_per_error / (self.factor * self.prior_sigma) ** 2, 0.0
            )
            common = [one.balance_with(self.factor[one.place], unit_variance) for one in loop.common]
            estimated = look_ahead(weight, common)
            if self._find_largest_change(estimated) < ITERATIONS.fine:
                break
        loop.set_prior_weight(np.where(self.free, weight, self.points_per_error * self.given), common)
        return by_solution

    def _find_largest_change(self, estimated: np.ndarray) -> float:
        """Return the largest relative change of the factors to the ``estimated (cameras, p)`` ones."""
        return float(np.abs(estimated / self.factor - 1.0).max(initial=0.0))

    def list_components(self) -> tuple[VarianceComponent, ...]:
        """Return the variance component of the drifts; empty if the model has none."""
        _, freedom, count = self.sums
        if not count:
            return ()
        return (
            VarianceComponent(
                group="drift of the images",
                observations=count,
                redundancy=freedom,
                factor=self.of_block,
                sigma=self.of_block * self.per_px,
                unit="px/px",
                estimated=freedom >= REDUNDANCY.estimated,
            ),
        )

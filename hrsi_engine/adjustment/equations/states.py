"""Unknowns of a block, priors of its points, and the normal equations and cofactors that are formed with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...foundation.large_arrays import any_of_rows
from ...ground.geodesy import ground_difference_m, metres_per_degree, wrap_degrees
from ..observations import COORDINATE_PAIRS, Observations

FREE_POINT_SIGMA_M = 1e4  # prior of a point without survey at its start (C_G): only keeps V regular


class State(NamedTuple):
    """State of the iteration: parameter values (cameras, p) and ground positions (m, 3)."""

    values: np.ndarray
    ground: np.ndarray


@dataclass(frozen=True, eq=False)
class PointPriors:
    """Observed positions of the points: surveys, DEM heights, and a weak prior at the start for all others.

    target : (m, 3) lon, lat, height
    weight : (m, 3) diagonal of the weight matrices in 1/m² east, north, up, above zero everywhere
    observed : (m, 3) True for observations, False for weak priors, which add no redundancy
    mixed : (m, 3) off-diagonal weights: east-north, east-up, north-up; one row of zeros if no survey has correlations
    """

    target: np.ndarray
    weight: np.ndarray
    observed: np.ndarray
    mixed: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))

    @classmethod
    def from_surveys(
        cls, observations: Observations, start: np.ndarray, weight: np.ndarray | None = None
    ) -> PointPriors:
        """Return the surveys where ``weight (m, 3)`` is above zero, and weak priors at the start elsewhere."""
        weight = observations.survey_weight if weight is None else weight
        is_observed = weight > 0.0
        free = 1.0 / FREE_POINT_SIGMA_M**2
        priors = cls(
            np.where(is_observed, observations.survey, start), np.where(is_observed, weight, free), is_observed
        )
        correlation = observations.survey_correlation
        if correlation is None:
            return priors
        # The covariance without unobserved coordinates is inverted, so that the others keep their sigmas
        row, column = COORDINATE_PAIRS
        is_correlated = is_observed[:, row] & is_observed[:, column]
        points = np.flatnonzero((is_correlated & (correlation != 0.0)).any(axis=1))
        matrix = np.tile(np.eye(3), (len(points), 1, 1))
        matrix[:, row, column] = matrix[:, column, row] = np.where(is_correlated[points], correlation[points], 0.0)
        scale, mixed = np.sqrt(priors.weight[points]), np.zeros_like(priors.weight)
        inverse = scale[:, :, None] * np.linalg.inv(matrix) * scale[:, None, :]
        priors.weight[points], mixed[points] = inverse[:, range(3), range(3)], inverse[:, row, column]
        return cls(priors.target, priors.weight, is_observed, mixed)

    @property
    def correlated(self) -> bool:
        """True if a weight matrix has elements outside its diagonal."""
        return len(self.mixed) == len(self.weight)

    def build_weight_matrices(self, points: np.ndarray | slice = slice(None), observed: bool = False) -> np.ndarray:
        """Return the weight matrices ``(k, 3, 3)`` of some points; with ``observed``, zero for weak priors."""
        diagonal = self.weight[points]
        matrix = np.zeros((len(diagonal), 3, 3))
        matrix[:, range(3), range(3)] = diagonal
        if self.correlated:
            row, column = COORDINATE_PAIRS
            matrix[:, row, column] = matrix[:, column, row] = self.mixed[points]
        is_observed = self.observed[points]
        return matrix * (is_observed[:, :, None] & is_observed[:, None, :]) if observed else matrix

    @property
    def held(self) -> np.ndarray:
        """Mask of the points with an observed coordinate."""
        return any_of_rows(self.observed)

    def compute_misclosures_m(self, ground: np.ndarray, points: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return target - ground in metres east, north, up of some points, for their ``ground (k, 3)``."""
        return ground_difference_m(self.target[points], ground)

    def sum_of_squares(self, ground: np.ndarray, counting: np.ndarray) -> float:
        """Return the weighted sum of squares of the observed coordinates of points in the mask ``counting (m,)``."""
        points = np.flatnonzero(self.held & counting)
        miss = self.compute_misclosures_m(ground[points], points)
        return float(np.einsum("ki,kij,kj->", miss, self.build_weight_matrices(points, observed=True), miss))

    def sum_weak_squares(self, ground: np.ndarray, counting: np.ndarray) -> float:
        """Return the weighted sum of squares of the weak priors: no observations, but part of the cost function."""
        difference = self.target - ground
        difference[:, 0] = wrap_degrees(difference[:, 0])
        squares = np.einsum("ki,ki,ki->k", self._weak_weights, difference, difference)
        if self.correlated:  # a surface observes east and north together, once for many points
            metres = metres_per_degree(self.target) * np.where(self.observed, 0.0, difference)
            squares += 2.0 * self.mixed[:, 0] * metres[:, 0] * metres[:, 1]
        return float(squares[counting].sum())

    @cached_property
    def _weak_weights(self) -> np.ndarray:
        """Weights ``(m, 3)`` of the weak priors' coordinates in degrees and metres, zero for observed ones."""
        return np.where(self.observed, 0.0, self.weight) * metres_per_degree(self.target) ** 2


@dataclass(eq=False)
class Normals:
    """Eliminated normal equations at one state.

    residual : (n, 2) px
    blocks, right : (blocks, p, p) and (cameras, p) of the reduced system, without the cameras' priors
    inverse, point_right : V^-1 (m, 3, 3) and m (m, 3) of the points
    """

    residual: np.ndarray
    blocks: np.ndarray
    right: np.ndarray
    inverse: np.ndarray
    point_right: np.ndarray


class Cofactors(NamedTuple):
    """Cofactors of the adjusted quantities.

    points : (m, 3, 3) of the positions, m²
    computed : (n, 2, 2) of the computed image points, px²; subtracted from the prior cofactor, that of the residual
    """

    points: np.ndarray
    computed: np.ndarray

"""Variance components: the sigmas of groups of observations, from their residuals (Helmert 1907; Förstner 1979).

For a group g with weighted squares W_g and redundancy r_g (the sum of its redundancy numbers), s_g² = W_g / r_g tells
how wrong its sigma was. The adjustment is repeated with corrected sigmas until every s_g is 1. A group that the block
does not control (r_g small) keeps its sigma.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..block import Block
from .gauss_newton import Solution
from .observations import Observations
from .precision import Precision
from .result import VarianceComponent

LEAST_FREEDOM = 4.0  # redundancy below which s_g is known to no better than a third
ROUNDS = 15
SETTLED = 0.01  # relative change of a sigma
SURVEY_GROUPS = ("GCP east, north", "GCP height")


@dataclass(frozen=True, eq=False)
class Groups:
    """Which group each image point belongs to ``(n,)``, and the groups' names; the surveys' two come after them."""

    of_image_point: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def of(cls, block: Block, observations: Observations) -> Groups:
        """Return the groups: image points by kind, GCPs' horizontal coordinates, GCPs' heights."""
        kind = block.measurements.kind[observations.rows]
        kinds, number = kind[:1], np.zeros(len(kind), dtype=np.int64)
        if (kind != kind[0]).any():  # sorting millions of equal texts takes longer than the adjustment
            kinds, number = np.unique(kind, return_inverse=True)
        names = [f"image points: {name}" if name else "image points" for name in kinds.tolist()]
        return cls(number, (*names, *SURVEY_GROUPS))


def components(groups: Groups, observations: Observations, solution: Solution, precise: Precision) -> np.ndarray:
    """Return squares and redundancy of each group, ``(groups, 3)``: weighted squares, redundancy, observations."""
    weighting, weight = solution.weighting, solution.weight
    used = (weight > 0.0) & weighting.contributes[observations.point]
    result = np.zeros((len(groups.names), 3))
    squares = weight * np.einsum("nc,nc->n", solution.normals.residual, solution.normals.residual)
    freedom = weight * np.trace(precise.residuals, axis1=1, axis2=2)
    for column, values in enumerate((squares, freedom, np.full(len(weight), 2.0))):
        sums = np.bincount(groups.of_image_point[used], values[used], minlength=len(groups.names) - 2)
        result[:-2, column] = sums
    points = np.flatnonzero(weighting.contributes & weighting.points.held & observations.surveyed)
    priors = weighting.points
    counted = np.where(priors.observed[points], priors.weight[points], 0.0)
    miss = priors.miss_m(solution.state.ground[points], points)
    share = np.where(counted > 0.0, 1.0 - counted * precise.points[points].diagonal(axis1=1, axis2=2), 0.0)
    for axes, row in (([0, 1], -2), ([2], -1)):
        result[row] = np.sum((counted * miss**2)[:, axes]), np.sum(share[:, axes]), np.sum(counted[:, axes] > 0.0)
    return result


@dataclass(eq=False)
class Sigmas:
    """The factors found so far, one a group."""

    factor: np.ndarray

    def update(self, sums: np.ndarray) -> float:
        """Correct the factors; return the largest relative change."""
        usable = (sums[:, 1] >= LEAST_FREEDOM) & (sums[:, 0] > 0.0)
        ratio = np.ones(len(sums))
        ratio[usable] = np.clip(np.sqrt(sums[usable, 0] / sums[usable, 1]), 0.2, 5.0)
        self.factor *= ratio
        return float(np.abs(ratio - 1.0).max())

    def image_weight(self, groups: Groups, given: np.ndarray) -> np.ndarray:
        """Return the weights of the image points for their ``given`` ones."""
        return given / self.factor[groups.of_image_point] ** 2

    def survey_weight(self, given: np.ndarray) -> np.ndarray:
        """Return the weights of the surveys."""
        return given / self.factor[[-2, -2, -1]] ** 2


def summary(
    groups: Groups, observations: Observations, sigmas: Sigmas, sums: np.ndarray
) -> tuple[VarianceComponent, ...]:
    """Return the groups that occur, with their sigmas as given and as estimated."""
    given = np.full(len(groups.names), np.nan)
    for number in range(len(groups.names) - 2):
        given[number] = np.median(observations.sigma_px[groups.of_image_point == number])
    surveyed = observations.survey_weight > 0.0
    for row, axes in ((-2, [0, 1]), (-1, [2])):
        chosen = observations.survey_weight[:, axes][surveyed[:, axes]]
        given[row] = np.median(1.0 / np.sqrt(chosen)) if chosen.size else np.nan
    return tuple(
        VarianceComponent(
            name, int(sums[k, 2]), float(sums[k, 1]), float(sigmas.factor[k]), float(sigmas.factor[k] * given[k]),
            "m" if name in SURVEY_GROUPS else "px", bool(sums[k, 1] >= LEAST_FREEDOM),
        )
        for k, name in enumerate(groups.names)
        if sums[k, 2] > 0
    )  # fmt: skip

"""Places of a reference orthoimage as observations of points' positions in plan.

A place is a point of the block, measured on one image or more, whose height follows from its rays or a DEM. With the
cofactors Q of the adjusted point, the weights W of its observed plan and the position p in the reference

    plan by rays = x - Q' W (p - x)        with Q' = (Q^-1 - W)^-1, of which the plan is the variance

so the reference differs from the rays by ``(I + Q' W) (p - x)``. East and north are tested separately, as heights are
(`shared_errors`); a place has the lower weight of the two, and a part of the reference with an outlying offset in one
of them is left out in both. Unlike surveyed GCPs, the number of places does not give them more weight than the RPCs:
most of a reference's error is common to all.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ...block.orthoimage import ORTHOIMAGE_ERRORS, ReferencePlaces, divide_area
from ...foundation.thresholds import REDUNDANCY
from ...ground.geodesy import ground_difference_m
from ..equations import FREE_POINT_SIGMA_M, PointPriors
from ..source_results import PlanAgreement, PlanGroup
from .shared_errors import GroupHistory, SourceFit, compare_groups, estimate_sigma_factor

EAST_NORTH = (0, 1)  # east and north among a point's coordinates


class PlaceRows(NamedTuple):
    """Standard deviations and groups of the places."""

    sigma_m: np.ndarray
    group: np.ndarray


@dataclass(frozen=True, eq=False)
class PlanObservations:
    """The places of a reference as observations of points in plan.

    places : the places; points : (k,) indices of their adjusted points
    estimate : True if the sigma is estimated
    """

    places: ReferencePlaces
    points: np.ndarray
    estimate: bool = True
    can_be_biased_as_a_whole: bool = True
    determines_points: bool = False
    memory: tuple[GroupHistory, GroupHistory] = field(default_factory=lambda: (GroupHistory(), GroupHistory()))
    groups: tuple[str, ...] = field(init=False)
    _part: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        part, names = divide_area(self.places.ground)
        object.__setattr__(self, "_part", part)
        object.__setattr__(self, "groups", names)

    @property
    def name(self) -> str:
        return self.places.name

    @property
    def common_m(self) -> float:
        return ORTHOIMAGE_ERRORS.by_part * self.places.sigma_m

    @property
    def overall_m(self) -> float:
        return ORTHOIMAGE_ERRORS.by_all * self.places.sigma_m

    weighting_sigma_m = overall_m

    def enter_start(self, priors: PointPriors) -> None:
        """Enter the places into the initial priors, before they are tested."""
        count = len(self.points)
        weight = 1.0 / ((ORTHOIMAGE_ERRORS.independent * self.places.sigma_m) ** 2 + count * self.overall_m**2)
        for axis in EAST_NORTH:
            priors.target[self.points, axis] = self.places.ground[:, axis]
            priors.weight[self.points, axis] = weight
            priors.observed[self.points, axis] = True

    def add_to_priors(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> PointPriors:
        """Return the priors with the places, weighted by their fit; as `HeightObservations.add_to_priors`."""
        target, weight, observed = priors.target.copy(), priors.weight.copy(), priors.observed.copy()
        for axis, one in zip(EAST_NORTH, self.fit_places(priors, ground, cofactors), strict=True):
            weight[self.points, axis] = np.maximum(one.weights, 1.0 / FREE_POINT_SIGMA_M**2)
            observed[self.points, axis] = is_used = one.factor > 0.0
            target[self.points, axis] = np.where(is_used, self.places.ground[:, axis], ground[self.points, axis])
        return replace(priors, target=target, weight=weight, observed=observed)

    def fit_places(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> list[SourceFit[PlaceRows]]:
        """Return the observations of the places in east and in north, each with the fit of each place."""
        weight = np.zeros((len(self.points), 3, 3))
        weight[:, EAST_NORTH, EAST_NORTH] = np.where(priors.observed[self.points], priors.weight[self.points], 0.0)[
            :, EAST_NORTH
        ]
        # one ray without height has no information along it: a little of the place's own weight keeps it regular
        by_rays = np.linalg.inv(np.linalg.inv(cofactors[self.points]) - (1.0 - REDUNDANCY.tested) * weight)
        offset_m = np.zeros((len(self.points), 3))
        offset_m[:, EAST_NORTH] = self._away_m(ground)
        miss = offset_m + np.einsum("kij,kjl,kl->ki", by_rays, weight, offset_m)
        rows = PlaceRows(np.full(len(self.points), ORTHOIMAGE_ERRORS.independent * self.places.sigma_m), self._part)
        judged = [SourceFit(self, rows, miss[:, axis], np.maximum(by_rays[:, axis, axis], 0.0)) for axis in EAST_NORTH]
        if self.estimate:
            common_factor = float(np.sqrt(np.mean([estimate_sigma_factor(one) ** 2 for one in judged])))
            for one in judged:
                one.sigma_factor = common_factor
        for one, memory in zip(judged, self.memory, strict=True):
            one.weigh_by_fit(np.ones(len(self.points), dtype=bool))
            compare_groups([one], memory)
        factor = np.minimum(*(one.factor for one in judged))
        for one in judged:
            one.factor = factor
            one.reduce_shared_weights()
        return judged

    def summarise_places(
        self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray, precise: np.ndarray, rpcs_m: float
    ) -> PlanAgreement:
        """Return the places' agreement with the adjusted points; ``rpcs_m`` is the sigma of the block by RPCs alone.

        ``precise (m, 3, 3)`` are the cofactors of the positions including those of the cameras.
        """
        judged = self.fit_places(priors, ground, cofactors)
        east, north = judged
        used = east.factor > 0.0
        left = self._away_m(ground)[used]
        own = precise[self.points]
        determines = sum(
            float(np.sum(np.minimum(one.weights * own[:, axis, axis], 1.0)))
            for axis, one in zip(EAST_NORTH, judged, strict=True)
        )
        weight = 0.5 * (east.weight + north.weight)
        # scatter of single places; the other parts are shared
        own_m = ORTHOIMAGE_ERRORS.independent * self.places.sigma_m * east.sigma_factor
        return PlanAgreement(
            source=self.name,
            observations=len(self.points),
            left_out=int((~used).sum()),
            determines=determines,
            rmse_m=float(np.sqrt(np.mean(left**2))) if left.size else float("nan"),
            sigma_m=float(np.linalg.norm([self.overall_m, self.common_m, own_m])),
            sigma_factor=east.sigma_factor,
            share=weight / (weight + rpcs_m**-2) if rpcs_m > 0.0 else 0.0,
            alone_m=(east.offset_m, north.offset_m),
            groups=tuple(
                PlanGroup(
                    name=one.name,
                    observations=one.observations,
                    east_m=one.offset_m,
                    north_m=other.offset_m,
                    sigma_m=max(one.sigma_m, other.sigma_m),
                    wrong=one.wrong or other.wrong,
                    left_out=one.left_out or other.left_out,
                )
                for one, other in zip(east.groups, north.groups, strict=True)
            ),
        )

    def _away_m(self, ground: np.ndarray) -> np.ndarray:
        """Return place - point, metres east and north ``(k, 2)``."""
        return ground_difference_m(self.places.ground, ground[self.points])[:, :2]

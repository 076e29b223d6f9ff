"""A block prepared for adjustment: what does not change in the rounds, and the external observations of positions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...block.block import Block
from ...block.imaging_geometry import compute_view_directions
from ...block.pointing import estimate_pointing
from ...foundation.large_arrays import any_of_rows
from ...refinement.model import RefinementModel
from ...refinement.selection import ModelChoice
from ..equations import FREE_POINT_SIGMA_M, NormalEquations, Pattern, PointPriors, State
from ..external.heights import DemHeights, HeightObservations, HeightSource, RpcHeights
from ..external.laser_heights import LaserHeights
from ..external.reference_plan import PlanObservations
from ..external.surface_plan import SurfacePlan
from ..gauss_newton import GaussNewton, PositionObservations, Weighting
from ..observations import Observations
from ..options import AdjustOptions
from ..priors.common_drift import CommonDrift
from ..priors.earlier_cameras import JointPrior
from .parts import Part


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that does not change while a block is adjusted.

    model : the requested refinement model, that of the final cameras
    camera : the estimated model: the requested one, followed by the drift that it does not contain
    guessed : (p,) True for drifts with nothing but a usual value as a priori standard deviation
    usual_drift : (cameras, p) a priori standard deviations of the drifts, by their sensors
    choice : reason for the model, if a rule chose it
    earlier : prior of the cameras from an earlier adjustment
    common : the drifts common to all images of a part, for parts without GCPs to determine them
    surface_plans : the relief that determines parts without GCPs in plan
    """

    block: Block
    observations: Observations
    model: RefinementModel
    camera: RefinementModel
    options: AdjustOptions
    pattern: Pattern
    equations: NormalEquations
    prior_weight: np.ndarray
    guessed: np.ndarray
    usual_drift: np.ndarray
    parts: tuple[Part, ...]
    start: State
    weighting: Weighting
    warnings: tuple[str, ...]
    choice: ModelChoice | None = None
    earlier: JointPrior | None = None
    common: tuple[CommonDrift, ...] = ()
    surface_plans: tuple[SurfacePlan, ...] = ()

    def loop(self) -> GaussNewton:
        """Return Gauss-Newton iterations for the problem."""
        return GaussNewton(
            equations=self.equations,
            pattern=self.pattern,
            prior_weight=self.prior_weight,
            rows_per_point=np.diff(self.observations.first),
            max_iterations=self.options.max_iterations,
            robust=self.options.robust,
            tolerance=self.options.tolerance,
            external=self.position_observations,
            earlier=self.earlier,
        )

    @property
    def position_observations(self) -> tuple[PositionObservations, ...]:
        """External observations other than surveys, which are tested again in every round.

        The relief comes first: it removes the effect of the heights, by the weights with which they were used so far.
        """
        optional = (self.height_observations, self.plan_observations)
        return (*self.surface_plans, *(one for one in optional if one is not None))

    @cached_property
    def plan_observations(self) -> PlanObservations | None:
        """The places of a reference, None without them."""
        options, observations = self.options, self.observations
        if options.reference is None or observations.referenced is None or not observations.referenced.any():
            return None
        points = np.flatnonzero(observations.referenced)
        return PlanObservations(
            options.reference.select(self.block.points.ids[observations.points[points]]),
            points,
            options.test_sigmas or options.variance_components,
        )

    @cached_property
    def height_observations(self) -> HeightObservations | None:
        """The heights of a DEM and of laser points that are observations of points, None without them."""
        options, observations = self.options, self.observations
        free = observations.survey_weight[:, 2] == 0.0
        sources: list[HeightSource] = []
        if options.dem is not None and options.sigma_dem_m is not None:
            by_dem = np.flatnonzero(self.weighting.points.observed[:, 2] & free)
            sources.append(DemHeights.select_points(options.dem, by_dem, self.start.ground, options.sigma_dem_m))
        if self.laser is not None:
            sources.append(self.laser)
        if not sources:
            return None
        estimate = options.test_sigmas or options.variance_components
        surveyed = np.flatnonzero(observations.surveyed & ~free)
        return HeightObservations(tuple(sources), free, estimate, self._locate_by_rpcs(), surveyed)

    def _locate_by_rpcs(self) -> RpcHeights | None:
        """Return the heights of tie points by the RPCs; None without tie points, or if others determine the block.

        Plan errors of the images are independent: rays with slopes t (east and north over up) determine the heights
        with the cofactor of the normal equations of ``(1, 0, -t_east)`` and ``(0, 1, -t_north)``.
        """
        observations = self.observations
        rays = np.diff(observations.first)
        ties = np.flatnonzero(observations.contributing_points & ~observations.located & (rays > 1))
        if observations.surveyed.any() or not len(ties) or self.options.fixed_images or self.earlier is not None:
            return None
        normal = np.zeros((3, 3))
        for image in observations.images:
            rpc = image.rpc
            up = compute_view_directions(rpc, np.array([[rpc.long_off, rpc.lat_off, rpc.height_off]]))[0]
            lean = np.array([[1.0, 0.0, -up[0] / up[2]], [0.0, 1.0, -up[1] / up[2]]])
            normal += lean.T @ lean / estimate_pointing(image).sigma_m ** 2
        # a point is measured on some of the block's images
        normal *= float(np.median(rays[ties])) / len(observations.images)
        variance = float(np.linalg.inv(normal + np.eye(3) * FREE_POINT_SIGMA_M**-2)[2, 2])
        return RpcHeights(ties, self.start.ground[ties, 2], float(np.sqrt(variance)))

    @cached_property
    def laser(self) -> LaserHeights | None:
        """The laser points, for tie points with two rays or more; None without them."""
        options, observations = self.options, self.observations
        if options.laser is None:
            return None
        ties = observations.contributing_points & ~observations.surveyed & (np.diff(observations.first) > 1)
        usable = np.flatnonzero(options.laser.doubt == "")
        return LaserHeights(options.laser, usable, np.flatnonzero(ties), options.laser_reach_m, options.sigma_laser_m)

    def survey_weighting(self, image: np.ndarray, survey: np.ndarray, previous: PointPriors | None = None) -> Weighting:
        """Return a weighting with other weights of image points ``(n,)`` and of surveys ``(m, 3)``.

        Points with fewer than two measurements and no survey do not contribute. External heights have the weights of
        ``previous``.
        """
        points = self.weighting.points if previous is None else previous
        surveyed = self.observations.survey_weight > 0.0
        fresh = PointPriors.from_surveys(self.observations, self.start.ground, survey)
        priors = PointPriors(
            np.where(surveyed, fresh.target, points.target),
            np.where(surveyed, fresh.weight, points.weight),
            np.where(surveyed, fresh.observed, points.observed),
            np.where(surveyed.any(axis=1)[:, None], fresh.mixed, points.mixed) if points.correlated else fresh.mixed,
        )
        return Weighting(
            image,
            priors,
            self.observations.contributing_points & find_determinable_points(self.observations, image, survey),
        )


def find_determinable_points(
    observations: Observations, image_weight: np.ndarray, survey_weight: np.ndarray
) -> np.ndarray:
    """Return True for points with a survey, or with measurements of any weight on two exposures, ``(m,)``."""
    rays = observations.count_rays(image_weight > 0.0)
    located = any_of_rows(survey_weight > 0.0)
    if observations.referenced is not None:
        located |= observations.referenced
    return (rays >= 2) | (located & (rays >= 1))

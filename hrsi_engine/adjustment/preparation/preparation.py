"""Preparation of a block for its adjustment: parts, a priori weights, starting values, and weak geometry.

`prepare_problem` runs the steps of a `Preparation` in order; each leaves what it determines for those after it:

1. observations, cameras (images with common parameters are one), and parts of the block;
2. weights of the parameters' priors, for parts with and without GCPs;
3. starting values of the cameras, and positions of the points by intersection;
4. position of parts without GCPs by the relief of a DEM, and attitude drift common to their images;
5. the normal equations with their pattern, and the a priori weights of the points.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ...block.block import Block, group_tiles
from ...block.exposures import join_named_bands
from ...foundation.errors import InputError, SolveError, list_ids
from ...foundation.large_arrays import finite_rows
from ...ground.geodesy import move_ground
from ...refinement.image_space import ImagePolynomial, add_drift_parameters
from ...refinement.model import Priors, RefinementModel, estimate_priors, select_priors
from ...refinement.models import MODELS
from ...refinement.selection import RULES, ModelChoice, choose_model
from ..equations import NormalEquations, State, find_pattern
from ..external.surface_plan import SurfacePlan
from ..gauss_newton import Weighting
from ..observations import select_observations
from ..options import AdjustOptions
from ..priors.common_drift import CommonDrift, find_common_drift
from ..priors.earlier_cameras import JointPrior
from ..starting_values.intersection import estimate_start_positions, form_point_equations
from ..starting_values.weak_geometry import set_point_priors
from ..statistics.variance_components import GROUPINGS
from ..weights import WEIGHTS
from .image_alignment import align_images, bound_heights
from .parts import find_parts, require_solvable, warn_of_parts
from .problem import Problem, find_determinable_points


def prepare_problem(block: Block, options: AdjustOptions, values: np.ndarray | None = None) -> Problem:
    """Return the problem; ``values (images, p)`` are initial values. Raises the errors of `solver.adjust`."""
    preparation = Preparation(block, options)
    preparation.set_start_values(values)
    preparation.intersect_points()
    # The initial parameters are extended by the drift; those of an earlier adjustment are entered with their weights
    preparation.start = np.pad(
        preparation.start, ((0, 0), (0, preparation.prior_weight.shape[1] - preparation.start.shape[1]))
    )
    if preparation.earlier is not None:
        preparation.earlier.require_parameters(tuple(preparation.camera.parameters))
        preparation.earlier.enter_start(preparation.start, preparation.prior_weight)
    require_solvable(preparation.observations, preparation.model, preparation.prior_weight, preparation.earlier)
    preparation.match_surfaces(is_warm=values is not None)
    return preparation.form_problem()


class Preparation:
    """A block while it is prepared.

    observations : of the points that can be used, in solver order; options : with the name of the chosen model
    model, camera : the requested model, and the estimated one, with the drift that the requested one does not contain
    guessed : (p,) True for drifts with nothing but a usual value as a priori standard deviation
    prior_weight : (cameras, p) of the parameters of ``camera``, infinite for fixed images
    usual_drift : (cameras, p) a priori standard deviations by the sensors
    start : (cameras, p) initial values; ground : (m, 3) lon, lat, height of the points with these
    lost : ids of points that could not be intersected
    surfaces : the relief under parts without GCPs; displaced : (m, 3) ``ground`` after their shift in plan
    """

    def __init__(self, block: Block, options: AdjustOptions) -> None:
        self.block = replace(block, images=tuple(join_named_bands(block.images, options.shared_images)))
        self.choice: ModelChoice | None = None
        if options.model in RULES:
            estimates_drift = options.test_sigmas or options.variance_components or bool(options.sigma_drift)
            self.choice = choose_model(self.block, options.model, estimates_drift)
            options = replace(options, model=self.choice.model)
        self.options = options
        tables: dict[str, tuple[Collection[str], str]] = {
            "model": (MODELS, options.model),
            "robust weight function": (WEIGHTS, options.robust),
            "grouping of image points": (GROUPINGS, options.variance_groups),
        }
        for option_name, (table, name) in tables.items():
            if name not in table:
                raise InputError(f"unknown {option_name} {name!r}: choose one of {', '.join(table)}")
        for of_sensor in options.sensor_images:
            self._find_images(of_sensor, "a group of images of one sensor")
        self.model = MODELS[options.model]
        observations = select_observations(self.block, options.check_as_ties, options.reference)
        self.observations = replace(observations, camera_of_image=self._number_cameras())
        if not observations.count:
            raise SolveError(
                "no point is measured in two images, and no GCP in any: add image points, tie points or GCPs"
            )
        self.earlier = None if options.earlier is None else JointPrior.select_cameras(options.earlier, observations)
        self.parts = find_parts(self.observations, self.earlier)
        # the model with the drift that it does not contain; the model itself if it can have none
        self.camera: RefinementModel = self.model
        if isinstance(self.model, ImagePolynomial) and self.model.parameters and options.sigma_drift != 0.0:
            with_drift = add_drift_parameters(self.model)
            self.camera = with_drift if len(with_drift.parameters) > len(self.model.parameters) else self.model
        self.guessed = np.arange(len(self.camera.parameters)) >= len(self.model.parameters)
        if self.choice is not None and self.choice.drift_unknown:
            self.guessed |= self.camera.drifts
        self.prior_weight, self.usual_drift = self._weigh_priors(self.model, self.guessed)
        self.surfaces: tuple[SurfacePlan, ...] = ()

    # ---- observations, cameras ---------------------------------------------------------------------------------------

    def _number_cameras(self) -> np.ndarray:
        """Return the index of each image's set of parameters; images of a group, or tiles of a scene, share one."""
        common, representative = self.options.shared_images, np.arange(len(self.block.images))
        for group in (*common, *group_tiles(self.block.images, common)):
            members = self._find_images(group, "a group of images with shared parameters")
            representative[members] = min(members)
        return np.unique(representative, return_inverse=True)[1].astype(np.int32)

    def _find_images(self, ids: Sequence[str], kind: str) -> list[int]:
        """Return the indices of images; raise `InputError`, which names ``kind``, if the block does not have them."""
        index = {image.id: number for number, image in enumerate(self.block.images)}
        unknown = [name for name in ids if name not in index]
        if unknown:
            raise InputError(f"{kind} names image {list_ids(unknown)}, not in the block (images: {list_ids(index)})")
        return [index[name] for name in ids]

    # ---- a priori weights of the parameters --------------------------------------------------------------------------

    def _weigh_priors(self, model: RefinementModel, guessed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the weights ``(cameras, p)`` of the parameters' priors, and standard deviations of their drifts.

        Weights of fixed images are infinite. The standard deviations ``(cameras, p)`` are those of the sensors; the
        estimation of a drift from the block starts with them.
        """
        observations, options, p = self.observations, self.options, len(model.parameters)
        ignores_rpc_priors = options.reference is not None and options.reference.ignores_rpc_priors
        sigma, sensor_sigma = np.empty((2, observations.cameras, len(guessed)))
        for part in self.parts:
            # for images with common parameters, the prior is that of the first one with the smallest pixels
            for index in sorted(part.images[::-1].tolist(), key=lambda k: -observations.images[k].camera_pixel):
                image, camera = observations.images[index], observations.camera_of_image[index]
                usual = estimate_priors(image)
                sensor_sigma[camera, :p], sensor_sigma[camera, p:] = model.prior_sigmas(image, usual), usual.drift
                priors = select_priors(image, part.gcps > 0 or (part.places > 0 and ignores_rpc_priors))
                # without these options, the sensor's own sigmas of position and attitude remain in the priors
                if options.sigma_shift_px is not None or options.sigma_drift is not None:
                    priors = Priors(
                        priors.shift_px if options.sigma_shift_px is None else options.sigma_shift_px,
                        priors.drift if options.sigma_drift is None else options.sigma_drift,
                    )
                sigma[camera, :p] = model.prior_sigmas(image, priors)
                is_given = options.sigma_drift is not None or options.variance_components
                sigma[camera, guessed] = priors.drift if is_given else usual.drift
        with np.errstate(divide="ignore"):
            weight = 1.0 / sigma**2
        index_of = {image.id: index for index, image in enumerate(observations.images)}
        unknown = [name for name in options.fixed_images if name not in index_of]
        if unknown:
            raise InputError(f"fixed image {list_ids(unknown)} is not in the block (images: {list_ids(index_of)})")
        weight[[observations.camera_of_image[index_of[name]] for name in options.fixed_images]] = np.inf
        return weight, sensor_sigma

    def _find_common_drifts(self) -> tuple[CommonDrift, ...]:
        """Return the common drifts of the parts that only their tie points and RPCs determine."""
        observations, options, prior_weight = self.observations, self.options, self.prior_weight
        if options.sigma_drift is not None or not (options.test_sigmas or options.variance_components):
            return ()
        free = self.camera.drifts & np.isfinite(prior_weight) & (prior_weight > 0.0)
        with np.errstate(divide="ignore"):
            sigma = np.where(free, self.usual_drift, 1.0 / np.sqrt(prior_weight))
        only_ties = options.laser is None and options.sigma_dem_m is None
        # A fixed camera, or one of an earlier adjustment (without prior weight here), is a datum for the others
        is_datum = (np.isinf(prior_weight) | (prior_weight == 0.0)).any(axis=1)
        drifts = [
            find_common_drift(observations, self.camera, part.images, free, sigma, only_ties)
            for part in self.parts
            if part.ties
            and not part.gcps
            and not part.places
            and not is_datum[observations.camera_of_image[part.images]].any()
        ]
        return tuple(drift for drift in drifts if drift is not None)

    # ---- starting values ---------------------------------------------------------------------------------------------

    def set_start_values(self, values: np.ndarray | None) -> None:
        """Set initial parameters: ``values (images, p)``, those of earlier cameras, or by alignment of the images."""
        observations, model = self.observations, self.model
        if values is None and self.earlier is None and model.parameters:
            self.start = self._align_images()
            return
        self.start = np.zeros((observations.cameras, len(model.parameters)))
        if values is not None:
            self.start[observations.camera_of_image] = values
        if self.earlier is not None:
            self.start[self.earlier.camera] = self.earlier.known.values[:, : self.start.shape[1]]

    def _align_images(self) -> np.ndarray:
        """Return parameters ``(cameras, p)`` with which the rays of tie points intersect, near the original RPCs."""
        shift_weight, _ = self._weigh_priors(MODELS["shift"], np.zeros(2, dtype=bool))
        weight = self.prior_weight[:, : len(self.model.parameters)]
        return align_images(self.observations, self.model, shift_weight, weight, self.options.threads)

    def intersect_points(self) -> None:
        """Intersect all points with the initial cameras; points that cannot be intersected are dropped."""
        observations, reference = self.observations, self.options.reference
        self._start_equations = form_point_equations(observations, self.model, self.options.threads)
        state = State(self.start, estimate_start_positions(observations))
        weight, priors = 1.0 / observations.sigma_px**2, bound_heights(observations, state.ground)
        self.ground = self._start_equations.intersect(state, weight, priors)
        missing = ~finite_rows(self.ground)
        self.lost = self.block.points.ids[observations.points[missing]]
        if len(self.lost):
            self.observations, self.ground = observations.drop_points(missing), self.ground[~missing]
        if reference is not None and self.observations.referenced is not None:
            places = np.flatnonzero(self.observations.referenced)
            self.ground[places] = reference.select(self.block.points.ids[self.observations.points[places]]).ground

    # ---- position by the relief of a surface -------------------------------------------------------------------------

    def match_surfaces(self, is_warm: bool) -> None:
        """Match parts without GCPs with the relief of the DEM, and widen the priors of images that it contradicts.

        ``is_warm`` : True if initial values were given; the RPCs' own positions are then computed for the matching.
        """
        observations, options = self.observations, self.options
        self.by_rpcs = self.displaced = self.ground
        if options.dem is None or options.sigma_dem_m is None or options.surface_search_m <= 0.0:
            return
        if options.fixed_images or options.earlier is not None:  # these determine the position
            return
        if is_warm and self.model.parameters:
            # the points by the original RPCs; those that cannot be computed stay at `ground`
            equations = form_point_equations(observations, self.model, options.threads)
            state, priors = State(self._align_images(), self.ground), bound_heights(observations, self.ground)
            intersected = equations.intersect(state, 1.0 / observations.sigma_px**2, priors)
            self.by_rpcs = np.where(np.isfinite(intersected), intersected, self.ground)
        first_image, rays = observations.image[observations.first[:-1]], np.diff(observations.first)
        ties = observations.contributing_points & ~observations.located & (rays > 1)
        matches = []
        for part in self.parts:
            points = np.flatnonzero(ties & np.isin(first_image, part.images))
            if part.gcps or not len(points):
                continue
            images = [observations.images[index] for index in part.images]
            matches.append(
                SurfacePlan.match_points(
                    images,
                    options.dem,
                    points,
                    ground=self.by_rpcs,
                    sigma_m=options.sigma_dem_m,
                    kind=options.surface_kind,
                    search_m=options.surface_search_m,
                )
            )
        self.surfaces = tuple(match for match in matches if match is not None)
        # The surfaces move the points in plan, and widen the priors (cameras, p) that contradict this
        self.displaced = self.by_rpcs.copy()
        for surface in self.surfaces:
            cameras = observations.camera_of_image[[image.id in surface.images for image in observations.images]]
            if options.sigma_shift_px is None:
                self.prior_weight[np.ix_(np.unique(cameras), ~self.camera.drifts)] /= surface.widening**2
            if not surface.why_open:
                in_plan = surface.first.displacement_m * [1.0, 1.0, 0.0]
                self.displaced[surface.points] = move_ground(self.by_rpcs[surface.points], in_plan)

    # ---- the problem -------------------------------------------------------------------------------------------------

    def form_problem(self) -> Problem:
        """Return the problem, with its normal equations and the weights of its first iteration."""
        observations, options = self.observations, self.options
        common = self._find_common_drifts()
        joint: list[CommonDrift | JointPrior] = [*common, *([] if self.earlier is None else [self.earlier])]
        pattern = find_pattern(observations, len(self.camera.parameters), [prior.pairs for prior in joint])
        cameras = self._start_equations.cameras if self.camera is self.model and not len(self.lost) else None
        priors, weak = set_point_priors(observations, self.displaced, options.dem, options.sigma_dem_m)
        for surface in self.surfaces:
            priors = surface.enter_start(priors, self.by_rpcs)
        image_weight = 1.0 / observations.sigma_px**2
        contributes = find_determinable_points(observations, image_weight, observations.survey_weight)
        warnings = warn_of_parts(observations, self.parts, options, weak, self.surfaces)
        if len(self.lost):
            text = f"{len(self.lost)} points could not be intersected and are not used: {list_ids(self.lost)}"
            warnings.insert(0, text)
        problem = Problem(
            block=self.block,
            observations=observations,
            model=self.model,
            camera=self.camera,
            options=options,
            pattern=pattern,
            equations=NormalEquations(observations, self.camera, pattern, options.threads, cameras),
            prior_weight=self.prior_weight,
            guessed=self.guessed,
            usual_drift=self.usual_drift,
            parts=self.parts,
            start=State(self.start, self.ground),
            weighting=Weighting(image_weight, priors, contributes & observations.contributing_points),
            warnings=tuple(warnings),
            choice=self.choice,
            earlier=self.earlier,
            common=common,
            surface_plans=self.surfaces,
        )
        if problem.plan_observations is not None:
            problem.plan_observations.enter_start(priors)
        return problem

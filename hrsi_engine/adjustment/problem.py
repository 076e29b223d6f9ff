"""A block prepared for adjustment: observations, priors, and warnings of parts that are not determined.

Cameras that share points belong together. Each such *part* of a block is determined by its GCPs or, without any, by the
priors of its images' RPCs; it has its own priors accordingly, and warnings name parts without GCPs.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ..block.block import Block, group_tiles
from ..block.exposures import join_named_bands
from ..block.imaging_geometry import compute_view_directions
from ..block.pointing import estimate_pointing
from ..foundation.errors import IDS_NAMED, InputError, SolveError, list_ids
from ..foundation.large_arrays import any_of_rows, finite_rows
from ..ground.geodesy import move_ground
from ..refinement.image_space import ImagePolynomial, add_drift_parameters
from ..refinement.model import Priors, RefinementModel, estimate_priors, select_priors
from ..refinement.models import MODELS
from ..refinement.selection import RULES, ModelChoice, choose_model
from .equations import FREE_POINT_SIGMA_M, NormalEquations, Pattern, PointPriors, State, find_pattern
from .external.heights import DemHeights, HeightObservations, HeightSource, RpcHeights
from .external.laser_heights import LaserHeights
from .external.reference_plan import PlanObservations
from .external.surface_plan import SurfacePlan
from .gauss_newton import GaussNewton, PositionObservations, Weighting
from .image_alignment import align_images, bound_heights
from .observations import Observations, select_observations
from .options import AdjustOptions
from .priors.common_drift import CommonDrift, find_common_drift
from .priors.earlier_cameras import JointPrior
from .starting_values.intersection import estimate_start_positions, form_point_equations
from .starting_values.weak_geometry import set_point_priors
from .statistics.variance_components import GROUPINGS
from .weights import WEIGHTS


@dataclass(frozen=True, eq=False)
class Part:
    """Cameras connected by common points: their images, and numbers of GCPs, tie points and places of a reference."""

    images: np.ndarray
    gcps: int
    ties: int
    places: int = 0


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
    held_surfaces : the relief that determines parts without GCPs in plan
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
    held_surfaces: tuple[SurfacePlan, ...] = ()

    def loop(self) -> GaussNewton:
        """Return Gauss-Newton iterations for the problem."""
        return GaussNewton(
            self.equations, self.pattern, self.prior_weight, np.diff(self.observations.first),
            self.options.max_iterations, self.held, self.earlier,
        )  # fmt: skip

    @property
    def held(self) -> tuple[PositionObservations, ...]:
        """External observations other than surveys, which are tested again in every round."""
        others = tuple(held for held in (self.held_heights, self.held_plan) if held is not None)
        return (*others, *self.held_surfaces)

    @cached_property
    def held_plan(self) -> PlanObservations | None:
        """The places of a reference, None without them."""
        options, observations = self.options, self.observations
        if options.reference is None or observations.referenced is None or not observations.referenced.any():
            return None
        points = np.flatnonzero(observations.referenced)
        return PlanObservations(
            options.reference.select(self.block.points.ids[observations.points[points]]), points,
            options.test_sigmas or options.variance_components,
        )  # fmt: skip

    @cached_property
    def held_heights(self) -> HeightObservations | None:
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

    def survey_weighting(self, image: np.ndarray, survey: np.ndarray, before: PointPriors | None = None) -> Weighting:
        """Return a weighting with other weights of image points ``(n,)`` and of surveys ``(m, 3)``.

        Points with fewer than two measurements and no survey do not contribute. External heights have the weights of
        ``before``.
        """
        points = self.weighting.points if before is None else before
        surveyed = self.observations.survey_weight > 0.0
        fresh = PointPriors.from_surveys(self.observations, self.start.ground, survey)
        priors = PointPriors(
            np.where(surveyed, fresh.target, points.target), np.where(surveyed, fresh.weight, points.weight),
            np.where(surveyed, fresh.observed, points.observed),
            np.where(surveyed.any(axis=1)[:, None], fresh.mixed, points.mixed) if points.correlated else fresh.mixed,
        )  # fmt: skip
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


def prepare_problem(block: Block, options: AdjustOptions, values: np.ndarray | None = None) -> Problem:
    """Return the problem; ``values (images, p)`` are initial values. Raises the errors of `solver.adjust`."""
    choice = None
    block = replace(block, images=tuple(join_named_bands(block.images, options.shared_images)))
    if options.model in RULES:
        held = options.test_sigmas or options.variance_components or bool(options.sigma_drift)
        choice = choose_model(block, options.model, held)
        options = replace(options, model=choice.model)
    _require_known_names(block, options)
    model = MODELS[options.model]
    observations = select_observations(block, options.check_as_ties, options.reference)
    observations = replace(observations, camera_of_image=_number_cameras(block, options.shared_images))
    if not observations.count:
        raise SolveError("no point is measured in two images, and no GCP in any: add image points, tie points or GCPs")
    earlier = None if options.earlier is None else JointPrior.select_cameras(options.earlier, observations)
    parts = _find_parts(observations, earlier)
    camera = _add_drift(model, options)
    guessed = np.arange(len(camera.parameters)) >= len(model.parameters)
    if choice is not None and choice.drift_unknown:
        guessed |= camera.drifts
    prior_weight, usual_drift = _weigh_priors(observations, model, guessed, parts, options)
    if values is None and earlier is None and model.parameters:
        start = _align_start(observations, model, parts, prior_weight, options)
    else:
        start = _set_start_values(observations, model, values, earlier)
    fixed = form_point_equations(observations, model, options.threads)
    observations, ground, lost = _intersect_start(observations, fixed, start)
    if options.reference is not None and observations.referenced is not None:
        places = np.flatnonzero(observations.referenced)
        ground[places] = options.reference.select(block.points.ids[observations.points[places]]).ground
    start = np.pad(start, ((0, 0), (0, prior_weight.shape[1] - start.shape[1])))
    if earlier is not None:
        earlier.require_parameters(tuple(camera.parameters))
        earlier.enter_start(start, prior_weight)
    _require_solvable(observations, model, prior_weight, earlier)
    is_cold = values is None or not model.parameters or not _holds_plan(options)
    by_rpcs = ground if is_cold else _locate_by_own_rpcs(observations, model, parts, prior_weight, options, ground)
    surfaces = _match_surfaces(observations, parts, by_rpcs, options)
    lifted = _displace_start(observations, surfaces, by_rpcs, camera, options, prior_weight)
    common = _find_common_drifts(observations, camera, parts, prior_weight, usual_drift, options)
    joint: list[CommonDrift | JointPrior] = [*common, *([] if earlier is None else [earlier])]
    pattern = find_pattern(observations, len(camera.parameters), [prior.pairs for prior in joint])
    equations = NormalEquations(
        observations, camera, pattern, options.threads, fixed.cameras if camera is model and not len(lost) else None
    )
    priors, weak = set_point_priors(observations, lifted, options.dem, options.sigma_dem_m)
    for one in surfaces:
        priors = one.enter_start(priors, by_rpcs)
    image_weight = 1.0 / observations.sigma_px**2
    contributes = find_determinable_points(observations, image_weight, observations.survey_weight)
    contributes &= observations.contributing_points
    problem = Problem(
        block, observations, model, camera, options, pattern, equations, prior_weight, guessed,
        usual_drift, parts, State(start, ground), Weighting(image_weight, priors, contributes),
        (*_collect_warnings(observations, parts, options, block.points.ids[lost], weak, surfaces),),
        choice, earlier, common, surfaces,
    )  # fmt: skip
    if problem.held_plan is not None:
        problem.held_plan.enter_start(priors)
    return problem


def _require_known_names(block: Block, options: AdjustOptions) -> None:
    """Raise `InputError` if options contain unknown names."""
    tables: dict[str, tuple[Collection[str], str]] = {
        "model": (MODELS, options.model), "robust weight function": (WEIGHTS, options.robust),
        "grouping of image points": (GROUPINGS, options.variance_groups),
    }  # fmt: skip
    for what, (table, name) in tables.items():
        if name not in table:
            raise InputError(f"unknown {what} {name!r}: choose one of {', '.join(table)}")
    for group in options.sensor_images:
        _find_images(block, group, "a group of images of one sensor")


def _find_images(block: Block, ids: Sequence[str], what: str) -> list[int]:
    place = {image.id: index for index, image in enumerate(block.images)}
    unknown = [name for name in ids if name not in place]
    if unknown:
        raise InputError(f"{what} names image {list_ids(unknown)}, not in the block (images: {list_ids(place)})")
    return [place[name] for name in ids]


def _number_cameras(block: Block, shared: Sequence[Sequence[str]]) -> np.ndarray:
    """Return the index of each image's set of parameters; images of a group, or tiles of a scene, share one."""
    representative = np.arange(len(block.images))
    for group in (*shared, *group_tiles(block.images, shared)):
        members = _find_images(block, group, "a group of images with shared parameters")
        representative[members] = min(members)
    return np.unique(representative, return_inverse=True)[1].astype(np.int32)


def _find_parts(observations: Observations, earlier: JointPrior | None) -> tuple[Part, ...]:
    """Return the connected parts of the block, those with most images first; every image belongs to one."""
    rows = np.flatnonzero(observations.contributes)
    shape = (len(observations.points), observations.cameras)
    incidence = sparse.csr_matrix(
        (np.ones(len(rows), dtype=np.float32), (observations.point[rows], observations.camera[rows])), shape=shape
    )
    together = incidence.T @ incidence
    if earlier is not None:
        pairs = earlier.pairs
        together += sparse.csr_matrix((np.ones(len(pairs[0]), dtype=np.float32), pairs), shape=together.shape)
    count, label = csgraph.connected_components(together, directed=False)
    heads = np.flatnonzero(observations.contributing_points)
    of_point = label[observations.camera[observations.first[heads]]]
    surveyed, located = observations.surveyed[heads], observations.located[heads]
    gcps = np.bincount(of_point[surveyed], minlength=count)
    ties = np.bincount(of_point[~located], minlength=count)
    places = np.bincount(of_point[located & ~surveyed], minlength=count)
    if earlier is not None:  # each of its images has the number of GCPs of its part
        held = np.zeros(count, dtype=np.int64)
        np.maximum.at(held, label[earlier.camera[earlier.known.camera]], earlier.known.gcps)
        gcps = gcps + held
    of_image = label[observations.camera_of_image]
    order = np.argsort(of_image, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(of_image, minlength=count))[:-1])
    numbers = zip(groups, gcps.tolist(), ties.tolist(), places.tolist(), strict=True)
    parts = [Part(images, *counts) for images, *counts in numbers]
    return tuple(sorted(parts, key=lambda part: -len(part.images)))


def _collect_warnings(
    observations: Observations, parts: Sequence[Part], options: AdjustOptions, lost: np.ndarray, weak: Sequence[str],
    surfaces: Sequence[SurfacePlan],
) -> list[str]:  # fmt: skip
    """Return the warnings about the block before its adjustment, including those of ``weak`` geometry.

    They list points that were ``lost`` (ids), images without common points with others, and parts of the block whose
    plan position follows from their RPCs only.
    """
    located = [part.gcps or part.ties or part.places for part in parts]
    rest = [part for part, any_ in zip(parts, located, strict=True) if any_]
    in_place = {name for one in surfaces if not one.why_open for name in one.images}
    free = [part for part in rest if not part.gcps and not part.places]
    free = [part for part in free if observations.images[part.images[0]].id not in in_place]
    reasons = dict.fromkeys(estimate_pointing(observations.images[i]).reason for part in free for i in part.images)
    names = [image.id for image in observations.images]
    warnings = [f"{len(lost)} points could not be intersected and are not used: {list_ids(lost)}"] if len(lost) else []
    warnings += [
        *weak,
        *(f"the relief of the DEM does not determine {list_ids(one.images)} in plan: {one.why_open}; the RPCs "
          "determine its position" for one in surfaces if one.why_open),
    ]  # fmt: skip
    alone = [names[part.images[0]] for part, ok in zip(parts, located, strict=True) if len(part.images) == 1 and not ok]
    if alone:
        warnings.append(f"no GCP and no tie point on {list_ids(alone)}: the RPC is not changed")
    if len(rest) > 1:
        listed = "; ".join(f"{list_ids(names[i] for i in part.images)} ({part.gcps} GCPs)" for part in rest[:IDS_NAMED])
        warnings.append(f"the block falls into {len(rest)} parts without common points: {listed}")
    if free:
        listed = "; ".join(list_ids(names[i] for i in part.images) for part in free[:IDS_NAMED])
        believed = " | ".join([*reasons][:3])
        held = options.laser is not None or (options.dem is not None and options.sigma_dem_m is not None)
        what = "position in plan" if held else "position"
        warnings.append(
            f"no GCP on {listed}: the {what} follows from the RPCs and their a priori accuracy ({believed})"
        )
    return warnings


def _align_start(
    observations: Observations, model: RefinementModel, parts: Sequence[Part], prior_weight: np.ndarray,
    options: AdjustOptions,
) -> np.ndarray:  # fmt: skip
    """Return the parameters ``(cameras, p)`` with which the rays of tie points intersect, near the original RPCs."""
    shift_weight, _ = _weigh_priors(observations, MODELS["shift"], np.zeros(2, dtype=bool), parts, options)
    weight = prior_weight[:, : len(model.parameters)]
    return align_images(observations, model, shift_weight, weight, options.threads)


def _locate_by_own_rpcs(
    observations: Observations, model: RefinementModel, parts: Sequence[Part], prior_weight: np.ndarray,
    options: AdjustOptions, ground: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the points ``(m, 3)`` by the original RPCs; those that cannot be computed stay at ``ground``."""
    state = State(_align_start(observations, model, parts, prior_weight, options), ground)
    equations = form_point_equations(observations, model, options.threads)
    seen = equations.intersect(state, 1.0 / observations.sigma_px**2, bound_heights(observations, ground))
    return np.where(np.isfinite(seen), seen, ground)


def _set_start_values(
    observations: Observations, model: RefinementModel, values: np.ndarray | None, earlier: JointPrior | None
) -> np.ndarray:
    start = np.zeros((observations.cameras, len(model.parameters)))
    if values is not None:
        start[observations.camera_of_image] = values
    if earlier is not None:
        start[earlier.camera] = earlier.known.values[:, : start.shape[1]]
    return start


def _intersect_start(
    observations: Observations, equations: NormalEquations, values: np.ndarray
) -> tuple[Observations, np.ndarray, np.ndarray]:
    """Intersect all points with the initial cameras.

    Points that cannot be computed are removed: returned are the observations without them, the positions ``(m, 3)``,
    and the indices of the removed points in the block.
    """
    state = State(values, estimate_start_positions(observations))
    weight, priors = 1.0 / observations.sigma_px**2, bound_heights(observations, state.ground)
    ground = equations.intersect(state, weight, priors)
    lost = ~finite_rows(ground)
    if not lost.any():
        return observations, ground, np.zeros(0, dtype=np.int64)
    return observations.drop_points(lost), ground[~lost], observations.points[lost]


def _add_drift(model: RefinementModel, options: AdjustOptions) -> RefinementModel:
    """Return the model with the drift that it does not contain; the model itself without parameters or such drift."""
    if not model.parameters or options.sigma_drift == 0.0 or not isinstance(model, ImagePolynomial):
        return model
    camera = add_drift_parameters(model)
    return camera if len(camera.parameters) > len(model.parameters) else model


def _weigh_priors(
    observations: Observations, model: RefinementModel, guessed: np.ndarray, parts: Sequence[Part],
    options: AdjustOptions,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the weights ``(cameras, p)`` of the parameters' priors, and standard deviations of their drifts.

    Weights of fixed images are infinite. The standard deviations ``(cameras, p)`` are those of the sensors; the
    estimation of a drift from the block starts with them.
    """
    p = len(model.parameters)
    ignores_rpc_priors = options.reference is not None and options.reference.ignores_rpc_priors
    sigma, of_sensor = np.empty((2, observations.cameras, len(guessed)))
    for part in parts:
        # for images with common parameters, the prior is that of the first one with the smallest pixels
        for index in sorted(part.images[::-1].tolist(), key=lambda k: -observations.images[k].camera_pixel):
            image, number = observations.images[index], observations.camera_of_image[index]
            usual = estimate_priors(image)
            of_sensor[number, :p], of_sensor[number, p:] = model.prior_sigmas(image, usual), usual.drift
            priors = select_priors(image, part.gcps > 0 or (part.places > 0 and ignores_rpc_priors))
            # without these options, the sensor's own sigmas of position and attitude remain in the priors
            if options.sigma_shift_px is not None or options.sigma_drift is not None:
                priors = Priors(
                    priors.shift_px if options.sigma_shift_px is None else options.sigma_shift_px,
                    priors.drift if options.sigma_drift is None else options.sigma_drift,
                )
            sigma[number, :p] = model.prior_sigmas(image, priors)
            is_given = options.sigma_drift is not None or options.variance_components
            sigma[number, guessed] = priors.drift if is_given else usual.drift
    with np.errstate(divide="ignore"):
        weight = 1.0 / sigma**2
    place = {image.id: index for index, image in enumerate(observations.images)}
    unknown = [name for name in options.fixed_images if name not in place]
    if unknown:
        raise InputError(f"fixed image {list_ids(unknown)} is not in the block (images: {list_ids(place)})")
    weight[[observations.camera_of_image[place[name]] for name in options.fixed_images]] = np.inf
    return weight, of_sensor


def _find_common_drifts(
    observations: Observations, camera: RefinementModel, parts: Sequence[Part], prior_weight: np.ndarray,
    usual_drift: np.ndarray, options: AdjustOptions,
) -> tuple[CommonDrift, ...]:  # fmt: skip
    """Return the common drifts of the parts that only their tie points and RPCs determine."""
    if options.sigma_drift is not None or not (options.test_sigmas or options.variance_components):
        return ()
    free = camera.drifts & np.isfinite(prior_weight) & (prior_weight > 0.0)
    with np.errstate(divide="ignore"):
        sigma = np.where(free, usual_drift, 1.0 / np.sqrt(prior_weight))
    found = []
    for part in parts:
        cameras = observations.camera_of_image[part.images]
        # A fixed image, or one of an earlier adjustment (without prior weight here), is a datum for the others
        held = (np.isinf(prior_weight) | (prior_weight == 0.0))[cameras].any()
        only_ties = options.laser is None and options.sigma_dem_m is None
        if part.ties and not part.gcps and not part.places and not held:
            found.append(find_common_drift(observations, camera, part.images, free, sigma, only_ties))
    return tuple(one for one in found if one is not None)


def _holds_plan(options: AdjustOptions) -> bool:
    """Return True if the relief of a surface may determine parts of the block in plan."""
    if options.dem is None or options.sigma_dem_m is None or options.fixed_images or options.earlier is not None:
        return False
    return options.surface_search_m > 0.0


def _match_surfaces(
    observations: Observations, parts: Sequence[Part], ground: np.ndarray, options: AdjustOptions
) -> tuple[SurfacePlan, ...]:
    """Return the surface's relief under each part of the block without GCPs; empty if plan is determined otherwise."""
    dem, sigma_m = options.dem, options.sigma_dem_m
    if dem is None or sigma_m is None or not _holds_plan(options):
        return ()
    first_image, rays = observations.image[observations.first[:-1]], np.diff(observations.first)
    ties = observations.contributing_points & ~observations.located & (rays > 1)
    found = []
    for part in parts:
        points = np.flatnonzero(ties & np.isin(first_image, part.images))
        if part.gcps or not len(points):
            continue
        images = [observations.images[index] for index in part.images]
        found.append(SurfacePlan.match_points(
            images, dem, points, ground, sigma_m, options.surface_kind, options.surface_search_m,
        ))  # fmt: skip
    return tuple(one for one in found if one is not None)


def _displace_start(
    observations: Observations, surfaces: Sequence[SurfacePlan], ground: np.ndarray, camera: RefinementModel,
    options: AdjustOptions, prior_weight: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the start ``(m, 3)`` moved in plan by surfaces; widen the priors ``(cameras, p)`` that contradict this."""
    displaced = ground.copy()
    for one in surfaces:
        cameras = observations.camera_of_image[[image.id in one.images for image in observations.images]]
        if options.sigma_shift_px is None:
            prior_weight[np.ix_(np.unique(cameras), ~camera.drifts)] /= one.widening**2
        if not one.why_open:
            displaced[one.points] = move_ground(ground[one.points], one.first.displacement_m * [1.0, 1.0, 0.0])
    return displaced


def _require_solvable(
    observations: Observations, model: RefinementModel, prior_weight: np.ndarray, earlier: JointPrior | None
) -> None:
    """Raise `SolveError` if there are fewer observations than unknowns."""
    p = min(len(model.parameters), 2 * model.least_points)  # parameters that need observations
    per_camera = np.bincount(observations.camera[observations.contributes], minlength=observations.cameras)
    free = np.isfinite(prior_weight).any(axis=1) & (per_camera > 0)
    if earlier is not None:
        free[earlier.camera] = False
    contributes, surveyed = observations.contributing_points, (observations.survey_weight > 0.0).sum(axis=1)
    if observations.referenced is not None:
        surveyed += 3 * observations.referenced  # their height follows from a DEM or rays
    observed = 2 * int(np.diff(observations.first) @ contributes) + int(surveyed @ contributes)
    unknowns = 3 * int(contributes.sum()) + p * int(free.sum())
    if not observations.located.any() or not free.all():
        observed += min(3, unknowns)  # priors or fixed images determine the position
    if observed >= unknowns:
        return
    simpler = "choose a simpler `model`, or " if model.least_points > 1 else ""
    poor = np.flatnonzero(free & (2 * per_camera < p))
    if len(poor):
        image = observations.images[int(np.flatnonzero(observations.camera_of_image == poor[0])[0])]
        raise SolveError(
            f"image {image.id}: {2 * per_camera[poor[0]]} observations for the {p} parameters of model {model.name}: "
            f"{simpler}measure more points on it"
        )
    raise SolveError(f"{observed} observations for {unknowns} unknowns: {simpler}add GCPs or tie points")

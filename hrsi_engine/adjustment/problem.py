"""A block made ready for adjustment: who takes part, what is known beforehand, and what is not determined.

Cameras that share points belong together. Each such *part* of a block is held by its GCPs or, without any, by the
priors of its images' RPCs; a part has its own priors accordingly, and is named where the user should know of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ..block.block import Block, Image, tiles_of_scenes
from ..block.pointing import believed_pointing
from ..foundation.errors import IDS_NAMED, InputError, SolveError, list_ids
from ..refinement.image_space import ImagePolynomial, with_drift
from ..refinement.model import Priors, RefinementModel, believed_priors, priors_of
from ..refinement.models import MODELS
from ..refinement.selection import RULES, Choice, choose_model
from .equations import NormalEquations, Pattern, PointPriors, State, find_pattern
from .gauss_newton import GaussNewton, Weighting
from .held_heights import DemHeights, HeightSource, HeldHeights
from .intersection import fixed_cameras, start_positions
from .laser_heights import LaserHeights
from .observations import Observations, select
from .options import AdjustOptions
from .subtrees.loop import Elsewhere, Shares, WorkersLoop
from .variance_components import GROUPINGS
from .weak_geometry import point_priors
from .weights import WEIGHTS

Entry = TypeVar("Entry")
SENSORS_NAMED = 3  # in a warning


@dataclass(frozen=True, eq=False)
class Part:
    """Cameras connected by common points: their images, and numbers of GCPs and tie points."""

    images: np.ndarray
    gcps: int
    ties: int


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that stays the same while a block is adjusted.

    model : the refinement that is asked for, and delivered
    camera : what is estimated: the model, and the drift that it does not follow behind it
    guessed : (p,) parameters that are drifts of which nothing tells how large they are but what is usual
    believed_drift : (cameras, p) standard deviations of the drifts that the sensors are believed to have
    choice : why the model is what it is, where a rule chose it
    elsewhere : workers that solve it
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
    believed_drift: np.ndarray
    parts: tuple[Part, ...]
    start: State
    weighting: Weighting
    warnings: tuple[str, ...]
    choice: Choice | None = None
    elsewhere: Elsewhere | None = None

    def loop(self) -> GaussNewton:
        """Return a Gauss-Newton loop over the problem."""
        rows = np.diff(self.observations.first)
        given = (self.equations, self.pattern, self.prior_weight, rows, self.options.max_iterations, self.held_heights)
        if self.shares is None:
            return GaussNewton(*given)
        return WorkersLoop(*given, shares=self.shares)

    @cached_property
    def shares(self) -> Shares | None:
        """The block as it lies on workers; None where this process solves it."""
        if self.elsewhere is None:
            return None
        if self.held_heights is not None:
            raise InputError(
                "workers do not know heights that hold points: leave out `sigma_dem_m` and `laser`, or `scheduler`"
            )
        return Shares.of(self.observations, self.camera, self.pattern, self.elsewhere)

    @cached_property
    def held_heights(self) -> HeldHeights | None:
        """The heights of a DEM and of laser points that hold points, None without them."""
        options, observations = self.options, self.observations
        free = observations.survey_weight[:, 2] == 0.0
        sources: list[HeightSource] = []
        if options.dem is not None and options.sigma_dem_m is not None:
            by_dem = np.flatnonzero(self.weighting.points.observed[:, 2] & free)
            sources.append(DemHeights.of(options.dem, by_dem, self.start.ground, options.sigma_dem_m))
        if self.laser is not None:
            sources.append(self.laser)
        if not sources:
            return None
        return HeldHeights(tuple(sources), free, options.test_sigmas or options.variance_components)

    @cached_property
    def laser(self) -> LaserHeights | None:
        """The laser points, for the ties that several rays place; None without them."""
        options, observations = self.options, self.observations
        if options.laser is None:
            return None
        ties = observations.contributing_points & ~observations.surveyed & (np.diff(observations.first) > 1)
        usable = np.flatnonzero(options.laser.doubt == "")
        return LaserHeights(options.laser, usable, np.flatnonzero(ties), options.laser_reach_m, options.sigma_laser_m)

    def survey_weighting(self, image: np.ndarray, survey: np.ndarray, before: PointPriors | None = None) -> Weighting:
        """Return a weighting with other weights of image points ``(n,)`` and of surveys ``(m, 3)``.

        Points that are left with fewer than two measurements and no survey lose their say. Heights that hold points are
        as they were judged ``before``.
        """
        points = self.weighting.points if before is None else before
        surveyed = self.observations.survey_weight > 0.0
        fresh = PointPriors.of(self.observations, self.start.ground, survey)
        priors = PointPriors(
            np.where(surveyed, fresh.target, points.target),
            np.where(surveyed, fresh.weight, points.weight),
            np.where(surveyed, fresh.observed, points.observed),
            fresh.mixed,
        )
        return Weighting(
            image, priors, self.observations.contributing_points & find_determined(self.observations, image, survey)
        )


def find_determined(observations: Observations, image_weight: np.ndarray, survey_weight: np.ndarray) -> np.ndarray:
    """Return which points have a survey or at least two measurements of any weight, ``(m,)``."""
    rays = np.add.reduceat(image_weight > 0.0, observations.first[:-1], dtype=np.int64)
    return (rays >= 2) | ((survey_weight > 0.0).any(axis=1) & (rays >= 1))


def prepare(block: Block, options: AdjustOptions, values: np.ndarray | None = None) -> Problem:
    """Return the problem; ``values (images, p)`` is a warm start. Raises what `solver.adjust` says."""
    choice = None
    if options.model in RULES:
        held = options.test_sigmas or options.variance_components or bool(options.sigma_drift)
        choice = choose_model(block, options.model, held)
        options = replace(options, model=choice.model)
    model = choose_entry(MODELS, options.model, "model")
    choose_entry(WEIGHTS, options.robust, "robust weight function")
    choose_entry(GROUPINGS, options.variance_groups, "grouping of image points")
    for group in options.sensor_images:
        _image_indices(block, group, "a group of images of one sensor")
    observations = select(block, options.check_as_ties)
    camera_of_image = _cameras(block, options.shared_images)
    observations = replace(observations, camera_of_image=camera_of_image)
    if not observations.count:
        raise SolveError("no point is measured on two images and no GCP on any: add image points, tie points or GCPs")
    parts = _parts(observations)
    start = _start_values(observations, model, values)
    fixed = fixed_cameras(observations, model, options.threads)
    observations, ground, lost = _starting_points(block, observations, fixed, start)
    camera = _camera(model, options)
    pattern = find_pattern(observations, len(camera.parameters))
    equations = NormalEquations(
        observations, camera, pattern, options.threads, fixed.cameras if camera is model and not lost else None
    )
    guessed = np.arange(len(camera.parameters)) >= len(model.parameters)
    if choice is not None and choice.drift_unknown:
        guessed |= camera.drifts
    prior_weight = _prior_weight(observations, model, guessed, parts, options)
    _require_solvable(observations, model, prior_weight)
    start = np.pad(start, ((0, 0), (0, prior_weight.shape[1] - start.shape[1])))
    priors, weak = point_priors(observations, ground, options.dem, options.sigma_dem_m)
    image_weight = 1.0 / observations.sigma_px**2
    contributes = observations.contributing_points & find_determined(
        observations, image_weight, observations.survey_weight
    )
    return Problem(
        block, observations, model, camera, options, pattern, equations, prior_weight, guessed,
        _believed_drift(observations, model, camera), parts, State(start, ground),
        Weighting(image_weight, priors, contributes),
        (*lost, *weak, *_part_warnings(observations, parts, options)), choice,
    )  # fmt: skip


def choose_entry(table: Mapping[str, Entry], name: str, what: str) -> Entry:
    """Return an entry by name; raises `InputError` that lists the names."""
    if name not in table:
        raise InputError(f"unknown {what} {name!r}: choose one of {', '.join(table)}")
    return table[name]


def _image_indices(block: Block, ids: Sequence[str], what: str) -> list[int]:
    place = {image.id: index for index, image in enumerate(block.images)}
    unknown = [name for name in ids if name not in place]
    if unknown:
        raise InputError(f"{what} names image {list_ids(unknown)}, not in the block (images: {list_ids(place)})")
    return [place[name] for name in ids]


def _cameras(block: Block, shared: Sequence[Sequence[str]]) -> np.ndarray:
    """Return the set of parameters of each image; the images of a group, or the tiles of a scene, have one."""
    representative = np.arange(len(block.images))
    for group in (*shared, *tiles_of_scenes(block.images, shared)):
        members = _image_indices(block, group, "a group of images with shared parameters")
        representative[members] = min(members)
    return np.unique(representative, return_inverse=True)[1].astype(np.int32)


def _parts(observations: Observations) -> tuple[Part, ...]:
    """Return the connected parts, those with most images first; every image belongs to one."""
    rows = np.flatnonzero(observations.contributes)
    shape = (len(observations.points), observations.cameras)
    incidence = sparse.csr_matrix(
        (np.ones(len(rows), dtype=np.float32), (observations.point[rows], observations.camera[rows])), shape=shape
    )
    count, label = csgraph.connected_components(incidence.T @ incidence, directed=False)
    heads = np.flatnonzero(observations.contributing_points)
    of_point = label[observations.camera[observations.first[heads]]]
    surveyed = observations.surveyed[heads]
    gcps = np.bincount(of_point[surveyed], minlength=count)
    ties = np.bincount(of_point[~surveyed], minlength=count)
    of_image = label[observations.camera_of_image]
    order = np.argsort(of_image, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(of_image, minlength=count))[:-1])
    parts = [Part(images, int(g), int(t)) for images, g, t in zip(groups, gcps, ties, strict=True)]
    return tuple(sorted(parts, key=lambda part: -len(part.images)))


def _part_warnings(observations: Observations, parts: Sequence[Part], options: AdjustOptions) -> list[str]:
    """Name the images that hang together with no others, and those that nothing holds but their RPC."""
    names = [image.id for image in observations.images]
    warnings = []
    alone = [names[part.images[0]] for part in parts if len(part.images) == 1 and not part.gcps and not part.ties]
    if alone:
        warnings.append(f"no GCP and no tie point on image {list_ids(alone)}: its RPC stays as it is")
    rest = [part for part in parts if part.gcps or part.ties]
    if len(rest) > 1:
        listed = "; ".join(f"{list_ids(names[i] for i in part.images)} ({part.gcps} GCPs)" for part in rest[:IDS_NAMED])
        warnings.append(f"the block falls into {len(rest)} parts without common points: {listed}")
    free = [part for part in rest if not part.gcps]
    if free:
        listed = "; ".join(list_ids(names[i] for i in part.images) for part in free[:IDS_NAMED])
        reasons = dict.fromkeys(believed_pointing(observations.images[i]).reason for part in free for i in part.images)
        believed = " | ".join([*reasons][:SENSORS_NAMED])
        held = options.laser is not None or (options.dem is not None and options.sigma_dem_m is not None)
        what = "position in plan" if held else "position"
        warnings.append(
            f"no GCP holds {listed}: its {what} follows from the RPCs' own accuracy (priors; believed: {believed})"
        )
    return warnings


def _start_values(observations: Observations, model: RefinementModel, values: np.ndarray | None) -> np.ndarray:
    if values is None:
        return np.zeros((observations.cameras, len(model.parameters)))
    start = np.zeros((observations.cameras, len(model.parameters)))
    start[observations.camera_of_image] = values
    return start


def _starting_points(
    block: Block, observations: Observations, equations: NormalEquations, values: np.ndarray
) -> tuple[Observations, np.ndarray, list[str]]:
    """Intersect all points with the cameras of the start; points that cannot be computed leave the adjustment."""
    state = State(values, start_positions(observations))
    ground = equations.intersect(state, 1.0 / observations.sigma_px**2, PointPriors.of(observations, state.ground))
    lost = ~np.isfinite(ground).all(axis=1)
    if not lost.any():
        return observations, ground, []
    ids = list_ids(block.points.ids[observations.points[lost]])
    message = f"{lost.sum()} points could not be intersected and are left out: {ids}"
    return observations.without(lost), ground[~lost], [message]


def _camera(model: RefinementModel, options: AdjustOptions) -> RefinementModel:
    """Return the model with the drift that it does not follow; without parameters, or such drift, the model itself."""
    if not model.parameters or options.sigma_drift == 0.0 or not isinstance(model, ImagePolynomial):
        return model
    camera = with_drift(model)
    return camera if len(camera.parameters) > len(model.parameters) else model


def _image_priors(options: AdjustOptions, image: Image, controlled: bool) -> Priors:
    """Return the priors of an image's corrections: those of the options, else what its RPC and control tell."""
    chosen = priors_of(image, controlled)
    if options.sigma_shift_px is None and options.sigma_drift is None:
        return chosen  # its own sigmas of position and attitude too
    return Priors(
        chosen.shift_px if options.sigma_shift_px is None else options.sigma_shift_px,
        chosen.drift if options.sigma_drift is None else options.sigma_drift,
    )


def _guessed_drift(options: AdjustOptions, image: Image, priors: Priors) -> float:
    """Return the usual sigma (px/px) of a drift; estimated in any case, it starts as any drift does."""
    if options.sigma_drift is not None:
        return options.sigma_drift
    return priors.drift if options.variance_components else believed_priors(image).drift


def _prior_weight(
    observations: Observations,
    model: RefinementModel,
    guessed: np.ndarray,
    parts: Sequence[Part],
    options: AdjustOptions,
) -> np.ndarray:
    """Return the weights ``(cameras, p)`` of the parameters' priors, infinite for fixed images."""
    p = len(model.parameters)
    sigma = np.empty((observations.cameras, len(guessed)))
    for part in parts:
        for index in part.images[::-1]:  # of images that share parameters, the first one's prior counts
            image = observations.images[index]
            priors = _image_priors(options, image, part.gcps > 0)
            number = observations.camera_of_image[index]
            sigma[number, :p] = model.prior_sigmas(image, priors)
            sigma[number, guessed] = _guessed_drift(options, image, priors)
            if options.camera_sigmas is not None and image.id in options.camera_sigmas:
                sigma[number, :p] = options.camera_sigmas[image.id]
    with np.errstate(divide="ignore"):
        weight = 1.0 / sigma**2
    place = {image.id: index for index, image in enumerate(observations.images)}
    unknown = [name for name in options.fixed_images if name not in place]
    if unknown:
        raise InputError(f"fixed image {list_ids(unknown)} is not in the block (images: {list_ids(place)})")
    weight[[observations.camera_of_image[place[name]] for name in options.fixed_images]] = np.inf
    return weight


def _believed_drift(observations: Observations, model: RefinementModel, camera: RefinementModel) -> np.ndarray:
    """Return the standard deviations ``(cameras, p)`` of drifts by what is believed of the sensors."""
    p = len(model.parameters)
    sigma = np.empty((observations.cameras, len(camera.parameters)))
    for index, image in reversed(list(enumerate(observations.images))):
        believed = believed_priors(image)
        number = observations.camera_of_image[index]
        sigma[number, :p], sigma[number, p:] = model.prior_sigmas(image, believed), believed.drift
    return sigma


def _require_solvable(observations: Observations, model: RefinementModel, prior_weight: np.ndarray) -> None:
    """Raise `SolveError` where the observations cannot determine the unknowns, whatever their values."""
    p = min(len(model.parameters), 2 * model.least_points)  # what the priors of a model are not made to give
    per_camera = np.bincount(observations.camera[observations.contributes], minlength=observations.cameras)
    free = np.isfinite(prior_weight).any(axis=1) & (per_camera > 0)
    observed, unknowns = count(observations, observations.contributing_points, p * int(free.sum()))
    if not observations.surveyed.any() or not free.all():
        observed += min(3, unknowns)  # the priors, or fixed images, hold the block's position
    if observed >= unknowns:
        return
    poor = np.flatnonzero(free & (2 * per_camera < p))
    if len(poor):
        image = observations.images[int(np.flatnonzero(observations.camera_of_image == poor[0])[0])]
        raise SolveError(
            f"image {image.id}: {2 * per_camera[poor[0]]} observations for the {p} parameters of model {model.name}: "
            "choose a simpler `model` or measure more points on it"
        )
    raise SolveError(
        f"{observed} observations for {unknowns} unknowns: choose a simpler `model`, or add GCPs or tie points"
    )


def count(observations: Observations, contributes: np.ndarray, parameters: int) -> tuple[int, int]:
    """Return the numbers of observations and of unknowns of the points that have a say in the cameras."""
    rows = np.diff(observations.first)
    surveyed = (observations.survey_weight > 0.0).sum(axis=1)
    observed = 2 * int(rows @ contributes) + int(surveyed @ contributes)
    return observed, 3 * int(contributes.sum()) + parameters

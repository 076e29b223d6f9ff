"""Refinement of one image's RPC from GCPs: check the points, choose a model, estimate its parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Protocol

import numpy as np

from ..block.assembly import assemble
from ..block.block import Image
from ..block.default_sigmas import DefaultSigmas
from ..block.points import GroundPoints, ImagePoints, Role
from ..camera.rpc import RPC
from ..foundation.errors import InputError, SolveError, list_ids
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import EQUALITY, threshold, thresholds
from ..ground.geodesy import distances_m, ground_difference_m
from ..plausibility import check_block
from .estimate import CONTROL_ONLY, Control, Estimate, estimate
from .ground_area import compute_ground_area
from .model import RefinementModel, RefitRPC
from .model_table import RefineOptions
from .models import MODELS
from .selection import RULES, ModelChoice, SuspectGcp, find_suspects


@thresholds
class CONTROL:
    """Limits for GCPs that are wrong for an image or do not determine it."""

    farthest_m: float = threshold(300e3, "m", "largest distance of a GCP from its image", "0.1 rad from 800 km: 120 km")
    warned_px: float = threshold(10.0, "px", "standard deviation at the image corners above which a warning is given")
    undetermined_px: float = threshold(1e3, "px", "… and above which the parameters are not determined")


class HasRpc(Protocol):
    """An RPC as read from a file, with the size of its image if that is known."""

    @property
    def rpc(self) -> RPC:
        """The RPC."""

    @property
    def size(self) -> tuple[int, int] | None:
        """Numbers of samples and lines, None if they are not known."""


@dataclass(frozen=True, eq=False)
class Refinement:
    """A refined image.

    control : the GCPs used; left_out : GCPs that contradict them
    choice : selection of the model; None if the caller named it
    """

    image: Image
    model: RefinementModel
    estimate: Estimate
    control: Control
    left_out: tuple[SuspectGcp, ...] = ()
    choice: ModelChoice | None = None
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return (
            f"<Refinement of {self.image.id}, model {self.model.name}: sigma0 {self.estimate.sigma0:.3f} from "
            f"{len(self.control)} GCPs, {len(self.left_out)} left out>"
        )

    @cached_property
    def refined(self) -> RefitRPC:
        """The refined RPC, and its largest difference from the model (px)."""
        return self.model.compute_refined_rpc(self.image, self.estimate.values)

    @property
    def rpc(self) -> RPC:
        """The refined RPC."""
        return self.refined.rpc

    def residuals_px(self, control: Control) -> np.ndarray:
        """Return the residuals (observed - computed) ``(n, 2)`` px of points at their known positions."""
        return np.asarray(control.xy - self.model.project(self.image, self.estimate.values, control.ground))


def refine_rpc(
    image: Image | RPC | HasRpc,
    ground: np.ndarray,
    xy: np.ndarray,
    *,
    ids: np.ndarray | None = None,
    sigma_px: np.ndarray | float = DefaultSigmas.sigma_image_px,
    sigma_m: np.ndarray | tuple[float, float] = (DefaultSigmas.sigma_gcp_xy_m, DefaultSigmas.sigma_gcp_h_m),
    model: str = RefineOptions.model,
    leave_out: bool = RefineOptions.leave_out,
    models: Mapping[str, RefinementModel] = MODELS,
) -> Refinement:
    """Return an image's RPC refined from ground control points.

    Parameters
    ----------
    image : Image, RPC, or what `read_rpc` returns
        The image, or its RPC alone (without its size the image area is taken from OFF and SCALE).
    ground : (n, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres.
    xy : (n, 2) ndarray
        Sample, line in pixels; (0, 0) is the centre of the first pixel.
    ids : (n,) ndarray of str, optional
        Names for messages; 1, 2, … by default.
    sigma_px : (n,) ndarray or float
        Standard deviations of the measurements.
    sigma_m : (n, 2) ndarray or tuple of float
        Standard deviations of the survey, horizontal and height.
    model : str
        A name of ``models``, or ``auto`` (chosen by prediction) or ``generic`` (the thesis's rule).
    leave_out : bool
        Whether GCPs that contradict the others are left out; they are reported in any case.
    models : mapping of str to RefinementModel
        The models by name; with `laboratory.direct_methods.DIRECT` also the thesis's direct methods.

    Returns
    -------
    Refinement
        The refined RPC, its estimate with residuals, and the GCPs left out.

    Raises
    ------
    InputError
        An unknown model, no or too few points, or points that cannot be correct (the message lists them).
    SolveError
        The points do not determine the model.
    """
    if isinstance(image, RPC):
        image = Image("image", image)
    elif not isinstance(image, Image):
        image = Image("image", image.rpc, image.size)
    control = Control(ground, xy, ids, sigma_px, sigma_m)
    result = refine_image(image, control, RefineOptions(model, leave_out), models)
    # Implausible inputs are added as warnings; for a block, its own check covers all images together
    points = GroundPoints(control.ids, control.ground, Role.GCP, control.sigma_m)
    measured = ImagePoints(control.ids, np.full(len(control), image.id), control.xy, control.sigma_px)
    reasons = check_block(assemble([image], [points], [measured]))
    implausible = [f"{image.id}: {reason.message}: {reason.advice}" for reason in reasons]
    return replace(result, warnings=(*implausible, *result.warnings))


def refine_image(
    image: Image, control: Control, options: RefineOptions | None = None, models: Mapping[str, RefinementModel] = MODELS
) -> Refinement:
    """Return an image refined with its GCPs; see `refine_rpc`."""
    options = options or RefineOptions()
    model = options.model
    warnings = check_control(image, control)
    choice = RULES[model]([(image, control)]) if model in RULES else None
    suspects = find_suspects(image, control) if choice is None else list(choice.suspects)
    treatment = "it is left out" if options.leave_out else "it is kept"
    warnings += choice.warnings if choice else ()
    warnings += [
        f"{one.image}: GCP {one.id} contradicts the others by {one.deviation_px:.1f} px: {treatment}; check it"
        for one in suspects
    ]
    keep = ~np.isin(control.ids, [suspect.id for suspect in suspects])
    control_used = control.select(keep) if options.leave_out else control
    name = choice.model if choice else model
    if name not in models:
        raise InputError(f"unknown model {name!r}: choose one of {', '.join([*RULES, *models])}")
    chosen_model = models[name]
    result = solve_refinement(chosen_model, image, control_used)
    if not result.converged:
        warnings.append(f"{image.id}: model {name} {result.status}: its parameters are not reliable")
    edge = edge_sigma_px(chosen_model, image, result)
    if edge > CONTROL.warned_px:
        warnings.append(
            f"{image.id}: the standard deviation of model {name} is {edge:.0f} px at the edges of the image: spread "
            "the GCPs or choose a simpler `model`"
        )
    return Refinement(
        image,
        chosen_model,
        result,
        control=control_used,
        left_out=tuple(suspects),
        choice=choice,
        warnings=tuple(warnings),
    )


def check_control(image: Image, control: Control) -> list[str]:
    """Return warnings about the GCPs of an image; raise `InputError` with their ids if they cannot be used.

    It is an error if no result is possible (no point, missing numbers, longitude and latitude swapped, far from the
    image), a warning if the points do not determine a model (on a line, at one place). Implausible inputs (heights in
    feet, points outside the image) are found by `plausibility`.
    """
    if not len(control):
        raise InputError(f"{image.id}: no GCP is measured on it: measure one, name its image file, or leave it out")
    finite = finite_rows(control.ground) & finite_rows(control.xy)
    sigmas = (control.sigma_px > 0.0) & (control.sigma_m > 0.0).all(axis=1)
    if not finite.all():
        raise InputError(f"{image.id}: a coordinate of GCP {list_ids(control.ids[~finite])} is missing: complete it")
    if not sigmas.all():
        raise InputError(
            f"{image.id}: GCP {list_ids(control.ids[~sigmas])} has a sigma that is not above 0: correct it"
        )
    ids, count = np.unique(control.ids, return_counts=True)
    if (count > 1).any():
        raise InputError(
            f"{image.id}: GCP {list_ids(ids[count > 1])} is given more than once: keep one measurement of it"
        )
    wild = (np.abs(control.ground[:, 0]) > 540.0) | (np.abs(control.ground[:, 1]) > 90.0)
    if wild.any() and not _has_swapped_axes(image, control.ground)[wild].all():
        raise InputError(
            f"{image.id}: GCP {list_ids(control.ids[wild])} has an invalid longitude or latitude ("
            f"{control.ground[wild][0, 0]:g}, {control.ground[wild][0, 1]:g}): give degrees, or the CRS of the layer"
        )
    swapped = _has_swapped_axes(image, control.ground)
    if swapped.any():
        raise InputError(
            f"{image.id}: longitude and latitude of GCP {list_ids(control.ids[swapped])} are swapped: exchange them"
        )
    distance = _compute_distance_m(image, control.ground)
    is_far = distance > CONTROL.farthest_m
    if is_far.any():
        raise InputError(
            f"{image.id}: GCP {list_ids(control.ids[is_far])} lies {distance[is_far].max() / 1e3:.0f} km from the "
            "image: check its coordinates and the CRS"
        )
    first, second = np.triu_indices(len(control), 1)
    is_near = distances_m(control.ground[first], control.ground[second]) < EQUALITY.position_m
    warnings = [
        f"{image.id}: GCPs {control.ids[first]} and {control.ids[second]} are at the same place: they are used as one"
        for first, second in islice(zip(first[is_near], second[is_near], strict=True), 8)
    ]
    if len(control) < 3:
        return warnings
    along, across = np.linalg.svd(control.xy - control.xy.mean(axis=0), compute_uv=False)
    if across <= EQUALITY.negligible * along:
        arrangement = (
            "at one place" if along < EQUALITY.negligible * float(np.hypot(*image.half_size_px)) else "on a line"
        )
        warnings.append(
            f"{image.id}: the GCPs {list_ids(control.ids)} lie {arrangement}: they do not determine corrections of the "
            "rest of the image; spread them, or use a shift only"
        )
    return warnings


def _compute_distance_m(image: Image, ground: np.ndarray) -> np.ndarray:
    middle = np.broadcast_to(compute_ground_area(image).middle, ground.shape)
    return np.linalg.norm(ground_difference_m(ground, middle)[:, :2], axis=1)


def require_axes_in_order(images: Sequence[Image], ground: np.ndarray, ids: np.ndarray | None = None) -> None:
    """Raise `InputError` with the ids of points that are near images only with longitude and latitude exchanged.

    ground : (n, 3) longitude, latitude in degrees, ellipsoidal height in metres
    ids : (n,) names of the points; by default their numbers
    """
    suspects = np.arange(len(ground))
    for image in images:  # as a rule the first image leaves none
        suspects = suspects[_has_swapped_axes(image, ground[suspects])] if len(suspects) else suspects
    if len(suspects):
        names = [f"point {number + 1}" for number in suspects.tolist()] if ids is None else ids[suspects]
        raise InputError(f"longitude and latitude of {list_ids(names)} are swapped: exchange them")


def _has_swapped_axes(image: Image, ground: np.ndarray) -> np.ndarray:
    """Return True for points that are near the image only with longitude and latitude exchanged, ``(n,)`` bool."""
    return (_compute_distance_m(image, ground) > CONTROL.farthest_m) & (
        _compute_distance_m(image, ground[:, [1, 0, 2]]) < CONTROL.farthest_m
    )


def solve_refinement(model: RefinementModel, image: Image, control: Control) -> Estimate:
    """Return the estimate of a model's parameters from GCPs.

    Raises `InputError` for too few points, `SolveError` if they do not determine the model.
    """
    if len(control) < model.least_points:
        raise InputError(
            f"{image.id}: model {model.name} needs {model.least_points} GCPs, there are {len(control)}: choose a "
            "simpler `model` or measure more"
        )
    try:
        result = estimate(model, image, control, CONTROL_ONLY)
    except np.linalg.LinAlgError as error:
        raise SolveError(
            f"{image.id}: the equations of model {model.name} are singular ({error}): the GCPs are outside the "
            "validity range of the RPC: check their coordinates and ids"
        ) from error
    if edge_sigma_px(model, image, result) > CONTROL.undetermined_px:
        raise SolveError(
            f"{image.id}: the {len(control)} GCPs do not determine model {model.name} over the image: spread them, or "
            "choose a simpler `model`"
        )
    return result


def edge_sigma_px(model: RefinementModel, image: Image, result: Estimate) -> float:
    """Return the largest standard deviation of the corrected position at the corners of the image.

    If sigma0 is below 1, the covariance is not reduced by it: a close fit is no evidence for undetermined parameters.
    """
    if not len(result.values):
        return 0.0
    corners = image.centre_px + image.half_size_px * np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
    ground = image.rpc.localize(corners, image.middle_height_m).ground
    by_values = model.equations(image, corners)(result.values, ground).by_values
    variance = np.einsum("ncp,pq,ncq->n", by_values, result.covariance, by_values)
    return float(np.sqrt(np.nanmax(variance, initial=0.0)) * max(1.0, 1.0 / max(result.sigma0, 1e-12)))

"""The adjustment: damped Gauss-Newton on the reduced camera system, reweighted for robustness.

Unknowns are the model's values of each image and a metric step of each point. One pass linearises all image points,
eliminates the points, solves for the images and substitutes back; the residuals at the new state are those of the
next pass, so each pass evaluates the cameras once. A step that raises the cost is repeated with more damping.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ..block import Block, Image, Role
from ..errors import InputError, SolveError
from ..geodesy import ground_difference_m, moved_ground
from ..progress import Progress, advance, silent
from ..refinement import MODELS, Priors, RefinementModel, priors_of
from .camera_system import CameraSystem
from .intersection import intersect, start_positions
from .normals import Linearisation, PointBlocks, back_substitute, linearise, point_blocks, reduce, structure
from .observations import Observations, select
from .precision import parameter_cofactors, point_cofactors
from .result import Adjustment, Iteration
from .weights import WEIGHTS

Entry = TypeVar("Entry")
RAYLEIGH_MEDIAN = 1.1774  # median length of a vector of two standard normal components


@dataclass(frozen=True)
class AdjustOptions:
    """How to adjust.

    sigma_shift_px, sigma_drift : priors of the corrections; None chooses them (`refinement.priors_of`)
    check_as_ties : the check points' image measurements take part like those of tie points (never their survey)
    reject_sigma : tie measurements beyond this many robust sigmas are left out before the final adjustment; 0 keeps
        all. GCPs are never left out.
    """

    model: str = "shift"
    robust: str = "none"
    sigma_shift_px: float | None = None
    sigma_drift: float | None = None
    check_as_ties: bool = False
    reject_sigma: float = 0.0
    reject_rounds: int = 3
    max_iterations: int = 30
    tolerance: float = 1e-9

    def priors(self, image: Image, controlled: bool) -> Priors:
        """Return the priors of an image's corrections."""
        chosen = priors_of(image, controlled)
        return Priors(
            chosen.shift_px if self.sigma_shift_px is None else self.sigma_shift_px,
            chosen.drift if self.sigma_drift is None else self.sigma_drift,
        )


@dataclass(eq=False)
class _State:
    """Where the iteration stands: values (images, p) and ground (m, 3), with the residuals there."""

    values: np.ndarray
    ground: np.ndarray
    linear: Linearisation


def adjust(block: Block, options: AdjustOptions | None = None, progress: Progress = silent) -> Adjustment:
    """Adjust a block; return corrected cameras, points and their precision.

    Raises
    ------
    InputError
        unknown model or weight function
    SolveError
        nothing to adjust, or fewer observations than unknowns (the images are named)
    """
    options = options or AdjustOptions()
    model = _choose(MODELS, options.model, "model")
    _choose(WEIGHTS, options.robust, "robust weight function")
    kept = np.ones(len(block.measurements), dtype=bool)
    if options.reject_sigma > 0.0:
        kept = _without_tie_outliers(block, model, options, progress)
    return _adjust_once(block, kept, model, options, progress)


def _choose(table: Mapping[str, Entry], name: str, what: str) -> Entry:
    if name not in table:
        raise InputError(f"unknown {what} {name!r}: choose one of {', '.join(table)}")
    return table[name]


def _without_tie_outliers(
    block: Block, model: RefinementModel, options: AdjustOptions, progress: Progress
) -> np.ndarray:
    """Return a mask of the measurements without tie measurements far from a robust solution.

    The robust weights keep blunders from dragging the cameras along; sigma is the residuals' own, from their median,
    because sigma0 is inflated by the blunders.
    """
    rows = block.measurements
    tie = (block.points.role == Role.TIE)[rows.point]
    kept = np.ones(len(rows), dtype=bool)
    for _ in range(options.reject_rounds if tie.any() else 0):
        result = _adjust_once(block, kept, model, replace(options, robust="huber"), progress)
        t = np.linalg.norm(result.residual_px, axis=1) / rows.sigma_px
        ties = t[tie & np.isfinite(t)]
        if not len(ties):
            break
        sigma = np.median(ties) / RAYLEIGH_MEDIAN * np.sqrt(result.observations / max(result.redundancy, 1.0))
        outliers = tie & kept & (t > options.reject_sigma * sigma)
        if not outliers.any():
            break
        kept &= ~outliers
    return kept


def _adjust_once(
    block: Block, kept: np.ndarray, model: RefinementModel, options: AdjustOptions, progress: Progress
) -> Adjustment:
    reduced_block = block if kept.all() else block.with_measurements(kept)
    observations = select(reduced_block, options.check_as_ties)
    _require_solvable(observations, model)
    observations, start, warnings = _starting_points(reduced_block, observations, model)
    solution = _Solver(observations, model, options).run(start, progress)
    return _result(block, np.flatnonzero(kept), observations, model, solution, warnings)


def _require_solvable(observations: Observations, model: RefinementModel) -> None:
    """Raise `SolveError` where the observations cannot determine the unknowns, whatever their values."""
    if not observations.count:
        raise SolveError("no point is measured on two images and no GCP on any: add image points, tie points or GCPs")
    p = len(model.parameters)
    per_image = np.bincount(observations.image[observations.contributes], minlength=len(observations.images))
    for image, count in zip(observations.images, per_image, strict=True):
        if 0 < 2 * count < p:
            raise SolveError(
                f"image {image.id}: {2 * count} observations for the {p} parameters of model {model.name}: "
                "choose a simpler --model or measure more points on it"
            )
    observed, unknowns = _counts(observations, p * int((per_image > 0).sum()))
    if not observations.surveyed.any():
        observed += min(3, unknowns)  # the priors hold the block's position
    if observed < unknowns:
        raise SolveError(
            f"{observed} observations for {unknowns} unknowns: choose a simpler --model, or add GCPs or tie points"
        )


def _counts(observations: Observations, parameters: int) -> tuple[int, int]:
    """Return the numbers of observations and of unknowns that have a say in the cameras."""
    observed = 2 * int(observations.contributes.sum()) + 3 * int(observations.surveyed.sum())
    return observed, 3 * int(observations.contributing_points.sum()) + parameters


def _starting_points(
    block: Block, observations: Observations, model: RefinementModel
) -> tuple[Observations, np.ndarray, list[str]]:
    """Intersect all points with the vendor's cameras; points that cannot be computed leave the adjustment."""
    values = np.zeros((len(block.images), len(model.parameters)))
    ground = intersect(observations, model, values, start_positions(observations))
    lost = ~np.isfinite(ground).all(axis=1)
    if not lost.any():
        return observations, ground, []
    names = ", ".join(block.points.ids[observations.points[lost]][:8].tolist())
    message = f"{lost.sum()} points could not be intersected and are left out: {names}"
    return observations.without(lost), ground[~lost], [message]


class _Solver:
    """One run of the Gauss-Newton loop; attributes are what its steps share."""

    def __init__(self, observations: Observations, model: RefinementModel, options: AdjustOptions) -> None:
        self.observations = observations
        self.options = options
        self.linearisers = observations.linearisers(model)
        self.pattern = structure(observations, len(model.parameters))
        controlled = bool(observations.surveyed.any())
        sigmas = np.array(
            [model.prior_sigmas(image, options.priors(image, controlled)) for image in observations.images]
        )
        self.prior_weight = 1.0 / sigmas.reshape(len(observations.images), -1) ** 2
        self.history: list[Iteration] = []

    def run(self, start: np.ndarray, progress: Progress) -> _Solution:
        """Iterate from the vendor's cameras and the ``start`` of the points."""
        self.start = start
        values = np.zeros_like(self.prior_weight)
        state = _State(values, start, linearise(self.observations, self.linearisers, values, start))
        damping, converged = 0.0, False
        for iteration in range(self.options.max_iterations):
            advance(progress, 1.0 - 0.6**iteration, f"adjustment, iteration {iteration + 1}")
            # the first pass brings the cameras near: before it, residuals are the vendor's bias and judge nothing
            factor = self.robust_factors(state) if iteration else np.ones(self.observations.count)
            weight = factor / self.observations.sigma_px**2
            cost = self.cost(state, weight)
            state, decrease, damping = self.step(state, weight, cost, damping)
            self.history.append(Iteration(cost, decrease, damping))
            settled = iteration > 0 or self.options.robust == "none"
            if settled and decrease <= self.options.tolerance * cost + 1e-12:
                converged = True
                break
        return self.finish(state, converged)

    def robust_factors(self, state: _State) -> np.ndarray:
        t = np.linalg.norm(state.linear.residual, axis=1) / self.observations.sigma_px
        return WEIGHTS[self.options.robust](t)

    def cost(self, state: _State, weight: np.ndarray) -> float:
        """Half the weighted sum of squares of image points, surveys and priors."""
        image = np.einsum(
            "n,nc,nc->", weight * self.observations.contributes, state.linear.residual, state.linear.residual
        )
        surveyed = self.observations.surveyed
        miss = ground_difference_m(self.observations.survey[surveyed], state.ground[surveyed])
        survey = np.sum(self.observations.survey_weight[surveyed] * miss**2)
        return 0.5 * float(image + survey + np.sum(self.prior_weight * state.values**2))

    def step(self, state: _State, weight: np.ndarray, cost: float, damping: float) -> tuple[_State, float, float]:
        """Return the next state, the decrease of the cost that was predicted for it, and the damping it took."""
        points = point_blocks(self.observations, state.linear, weight, state.ground, self.start)
        reduced = reduce(self.pattern, self.observations, state.linear, weight, points)
        right = reduced.right - self.prior_weight * state.values
        matrix = self.pattern.matrix(reduced.blocks)
        while True:
            system = CameraSystem(matrix, self.prior_weight.ravel(), damping)
            by_values = system.solve(right.ravel()).reshape(right.shape)
            by_ground = back_substitute(self.observations, state.linear, weight, points, by_values)
            values, ground = state.values + by_values, moved_ground(state.ground, by_ground)
            trial = _State(values, ground, linearise(self.observations, self.linearisers, values, ground))
            decrease = 0.5 * float(np.sum(right * by_values) + self._point_gain(points))
            if self.cost(trial, weight) <= cost * (1.0 + 1e-9) + 1e-12:
                return trial, decrease, 0.0 if damping < 1e-4 else damping / 10.0
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e6:
                return state, 0.0, damping

    def _point_gain(self, points: PointBlocks) -> float:
        right = points.right[self.observations.contributing_points]
        inverse = points.inverse[self.observations.contributing_points]
        return float(np.einsum("mi,mij,mj->", right, inverse, right))

    def finish(self, state: _State, converged: bool) -> _Solution:
        """Compute the precision at the last state."""
        factor = self.robust_factors(state)
        weight = factor / self.observations.sigma_px**2
        points = point_blocks(self.observations, state.linear, weight, state.ground, self.start)
        reduced = reduce(self.pattern, self.observations, state.linear, weight, points)
        system = CameraSystem(self.pattern.matrix(reduced.blocks), self.prior_weight.ravel())
        cofactors = parameter_cofactors(self.pattern, system)
        by_parameter = cofactors[self.pattern.diagonal].diagonal(axis1=1, axis2=2)
        by_point = point_cofactors(self.pattern, state.linear, weight, points, cofactors)
        prior_cost = 0.5 * float(np.sum(self.prior_weight * state.values**2))
        return _Solution(
            state, factor, by_parameter, by_point.diagonal(axis1=1, axis2=2), self.prior_weight * by_parameter,
            2.0 * (self.cost(state, weight) - prior_cost), converged, tuple(self.history),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Solution:
    """What the loop hands over: state, robust factors, cofactors' diagonals and the sum of squares."""

    state: _State
    factor: np.ndarray
    parameter_variance: np.ndarray
    point_variance: np.ndarray
    prior_share: np.ndarray
    sum_of_squares: float
    converged: bool
    history: tuple[Iteration, ...]


def _result(
    block: Block,
    kept: np.ndarray,
    observations: Observations,
    model: RefinementModel,
    solution: _Solution,
    warnings: list[str],
) -> Adjustment:
    observed, unknowns = _counts(observations, solution.state.values.size)
    redundancy = observed - unknowns + float(solution.prior_share.sum())
    sigma0 = float(np.sqrt(solution.sum_of_squares / redundancy)) if redundancy > 0.5 else 1.0
    rows = kept[observations.rows]
    ground = np.full((len(block.points), 3), np.nan)
    ground_sigma = np.full((len(block.points), 3), np.nan)
    residual = np.full((len(block.measurements), 2), np.nan)
    weight = np.zeros(len(block.measurements))
    ground[observations.points] = solution.state.ground
    ground_sigma[observations.points] = sigma0 * np.sqrt(solution.point_variance)
    residual[rows] = solution.state.linear.residual
    weight[rows] = solution.factor
    status = "converged" if solution.converged else "stopped at the iteration limit"
    return Adjustment(
        block=block,
        model=model,
        values=solution.state.values,
        values_sigma=sigma0 * np.sqrt(solution.parameter_variance),
        ground=ground,
        ground_sigma_m=ground_sigma,
        residual_px=residual,
        weight=weight,
        prior_share=solution.prior_share,
        sigma0=sigma0,
        observations=observed,
        unknowns=unknowns,
        redundancy=redundancy,
        converged=solution.converged,
        status=status,
        history=solution.history,
        warnings=tuple(warnings),
    )

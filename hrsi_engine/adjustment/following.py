"""An adjustment that follows its user: what a few points say now changes the whole block at once.

At the minimum the other points' equations stay as they are. The reduced equations S da = n of the cameras therefore
change by nothing but what the edited points j put into them::

    S' = S - sum S_j(before) + sum S_j(now)        n' = n - sum n_j(before) + sum n_j(now)

and da' = S'^-1 n' is a step of Gauss-Newton over the whole block with the measurements as they are now, at the price of
some points: the camera corrections are so nearly linear that no second one is needed. Weights, priors and what was left
out stay as the adjustment found them; nothing is tested anew. It is what recursive least squares does with a batch of
observations that are taken away and added.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..block.block import Block
from ..foundation.errors import SolveError
from ..foundation.large_arrays import finite_rows
from ..foundation.progress import Progress, silent
from ..ground.geodesy import move_ground
from .delivery import absorb_drift, compute_drift_gain, compute_drift_squares
from .equations import CameraSystem, NormalEquations, Normals, Pattern, PointPriors, State, choose_camera_system
from .gauss_newton import Weighting
from .intersection import estimate_start_positions, form_point_equations
from .observations import Observations, select_observations
from .options import AdjustOptions
from .problem import find_determinable_points
from .solver import run_adjuster


class _PointEquations(NamedTuple):
    """What some points put into the equations, weighted as ``weighting`` says, seen from ``ground``."""

    observations: Observations
    weighting: Weighting
    ground: np.ndarray


@dataclass(frozen=True, eq=False)
class BlockUpdate:
    """The block with the edited points as they are now.

    values : (images, p) parameters of the model of the adjustment that is followed
    ground : (points, 3) positions of the watched points of that adjustment's block; NaN for all others, and for those
    edited
    edited_ground : (k, 3) positions of the points of the block of edited points; NaN for what cannot be computed
    """

    values: np.ndarray
    ground: np.ndarray
    edited_ground: np.ndarray


class Follower:
    """Goes on from an adjustment (``result``), however many points are edited, as often as wanted.

    The positions of known points are followed, and those of points with the ids ``watched``.
    """

    def __init__(
        self, block: Block, options: AdjustOptions | None = None, progress: Progress = silent,
        watched: Collection[str] = (),
    ) -> None:  # fmt: skip
        """Adjust a block; raises what `adjust` raises."""
        self.result, adjuster = run_adjuster(block, options, progress)
        self._problem, self._loop, self._last = adjuster.problem, adjuster.loop, adjuster.solution
        squares = compute_drift_squares(self._problem, self._last)
        self._gain = compute_drift_gain(self._problem, self._loop, squares)
        delivered = self.result.values[np.unique(self._problem.observations.camera_of_image, return_index=True)[1]]
        self._kept = delivered - absorb_drift(self._last.state.values, self._gain)  # `given_position`
        self._ids = block.points.ids[self._problem.observations.points]
        self._pattern, self._blocks = self._loop.pattern, self._last.normals.blocks
        self._system: CameraSystem = choose_camera_system(self._pattern)
        self._taken_out: tuple[np.ndarray, Pattern, Normals | None] | None = None
        self._watched = self._prepare_reintersection(watched)

    def follow(self, edited: Collection[str], block: Block) -> BlockUpdate:
        """Return the block with some points as they are now.

        edited : ids of all points that are others than in the adjustment: moved, measured anew, added or removed
        block : the images of the adjustment in their order, and those of the edited points that there are now

        Raises `SolveError` where the equations are singular now.
        """
        is_edited = np.isin(self._ids, list(edited))
        now = self._select_now(block)
        # room in the reduced equations for pairs of cameras that had no common point before
        pattern = self._pattern.extend_by(now.observations)
        if pattern.blocks != self._pattern.blocks:
            wider = np.zeros((pattern.blocks, *self._blocks.shape[1:]))
            wider[pattern.find_blocks(self._pattern.rows, self._pattern.columns)] = self._blocks
            self._pattern, self._blocks, self._system = pattern, wider, choose_camera_system(pattern)
        prior, values = self._loop.prior_weight, self._last.state.values
        blocks, right = self._blocks, self._last.normals.right - np.where(np.isinf(prior), 0.0, prior) * values
        # What the edited points put into the equations before
        same = self._taken_out is not None and np.array_equal(self._taken_out[0], is_edited)
        if not same or self._taken_out is None or self._taken_out[1] is not self._pattern:
            self._taken_out = is_edited, self._pattern, self._form_normals(self._select_before(is_edited))
        for part, sign in ((self._taken_out[2], -1.0), (self._form_normals(now), 1.0)):
            if part is not None:
                blocks, right = blocks + sign * part.blocks, right + sign * part.right
        try:
            step = self._system.solve_nearby(blocks, prior, 0.0, right)
        except np.linalg.LinAlgError as error:
            raise SolveError(f"the equations are singular without what was edited ({error})") from error
        delivered = self._deliver(values + step)
        ground = np.full_like(self.result.ground, np.nan)
        if self._watched is not None:
            equations, state, weight, normals = self._watched
            steps = equations.compute_point_steps(state, weight, normals, delivered - state.values)
            ground[equations.observations.points] = move_ground(state.ground, steps)
            ground[np.isin(self._problem.block.points.ids, list(edited))] = np.nan
        edited_ground = np.full((len(block.points), 3), np.nan)
        if now.observations.count:
            equations = form_point_equations(now.observations, self._problem.model)
            state = State(delivered, now.ground)
            weighting = now.weighting
            edited_ground[now.observations.points] = equations.intersect(state, weighting.image, weighting.points)
        return BlockUpdate(delivered[self._problem.observations.camera_of_image], ground, edited_ground)

    def _deliver(self, values: np.ndarray) -> np.ndarray:
        """Return cameras as the result has them: their drift absorbed, a free block where its RPCs put it."""
        return absorb_drift(values, self._gain) + self._kept

    # ---- equations -------------------------------------------------------------------------------------------------

    def _select_before(self, edited: np.ndarray) -> _PointEquations:
        """Return what the points ``edited (m,)`` said in the adjustment."""
        observations, weighting = self._problem.observations, self._last.weighting
        priors = weighting.points
        mixed = priors.mixed[edited] if priors.correlated else priors.mixed
        of_edited = PointPriors(priors.target[edited], priors.weight[edited], priors.observed[edited], mixed)
        rows = edited[observations.point]
        return _PointEquations(
            observations.drop_points(~edited),
            Weighting(self._last.weight[rows], of_edited, weighting.contributes[edited]),
            self._last.state.ground[edited],
        )

    def _select_now(self, block: Block) -> _PointEquations:
        """Return what the points of a block say; a measurement that is as it was weighs what it weighed."""
        whole = self._problem.observations
        selected = select_observations(block, self._problem.options.check_as_ties)
        observations = replace(selected, camera_of_image=whole.camera_of_image)
        weight = 1.0 / observations.sigma_px**2
        survey = observations.survey_weight.copy()
        names = block.points.ids[observations.points]
        for row, (point, image) in enumerate(
            zip(observations.point.tolist(), observations.image.tolist(), strict=True)
        ):
            same = self._row_of.get((names[point], image))
            if same is not None and (whole.xy[same] == observations.xy[row]).all():
                weight[row] = self._last.weight[same]
        for point, name in enumerate(names.tolist()):
            same = self._place_of.get(name)
            if same is not None and np.array_equal(whole.survey_weight[same], survey[point]):
                priors = self._last.weighting.points
                survey[point] = np.where(priors.observed[same] & (survey[point] > 0.0), priors.weight[same], 0.0)
        # The adjustment's positions, of other points where their rays meet
        start = estimate_start_positions(observations)
        place = np.array([self._place_of.get(name, -1) for name in names.tolist()], dtype=np.int64)
        start[place >= 0] = self._last.state.ground[place[place >= 0]]
        if (place < 0).any():
            state, priors = State(self._last.state.values, start), PointPriors.from_surveys(observations, start, survey)
            ground = form_point_equations(observations, self._problem.camera).intersect(state, weight, priors)
            start = np.where(finite_rows(ground)[:, None], ground, start)
        priors_now = PointPriors.from_surveys(observations, start, survey)
        contributes = observations.contributing_points & find_determinable_points(observations, weight, survey)
        return _PointEquations(observations, Weighting(weight, priors_now, contributes), start)

    def _form_normals(self, share: _PointEquations) -> Normals | None:
        """Return what points put into the reduced equations, None without any."""
        if not share.observations.count:
            return None
        equations = NormalEquations(share.observations, self._problem.camera, self._pattern, threads=1)
        state = State(self._last.state.values, share.ground)
        return equations.form_normals(state, share.weighting.image, share.weighting.points, share.weighting.contributes)

    # ---- positions -------------------------------------------------------------------------------------------------

    def _prepare_reintersection(
        self, others: Collection[str]
    ) -> tuple[NormalEquations, State, np.ndarray, Normals] | None:
        """Return equations of the known points and some others by the delivered cameras; None without any.

        With them come the state, the weights ``(n,)`` of the image points and the normals there.
        """
        problem, points = self._problem, self._problem.observations.points
        wanted = problem.block.known[points] | np.isin(self._ids, list(others))
        wanted &= finite_rows(self.result.ground[points])
        if not wanted.any():
            return None
        before = self._select_before(wanted)
        equations, weighting = form_point_equations(before.observations, problem.model), before.weighting
        delivered = self._deliver(self._last.state.values)
        state = State(delivered, self.result.ground[points[wanted]])
        normals = equations.form_normals(state, weighting.image, weighting.points, weighting.contributes)
        return equations, state, weighting.image, normals

    # ---- looking up ------------------------------------------------------------------------------------------------

    @cached_property
    def _place_of(self) -> dict[str, int]:
        return {name: index for index, name in enumerate(self._ids.tolist())}

    @cached_property
    def _row_of(self) -> dict[tuple[str, int], int]:
        """Where each measurement stands, by the point's id and the image's index."""
        observations = self._problem.observations
        keys = zip(self._ids[observations.point].tolist(), observations.image.tolist(), strict=True)
        return {key: row for row, key in enumerate(keys)}

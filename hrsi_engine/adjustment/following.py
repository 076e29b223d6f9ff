"""Interactive update of an adjustment: the whole block is solved again at once when a few points are edited.

At the minimum the equations of the other points do not change. The reduced equations S da = n of the cameras therefore
change only by the contributions of the edited points j::

    S' = S - sum S_j(before) + sum S_j(now)        n' = n - sum n_j(before) + sum n_j(now)

and da' = S'^-1 n' is a Gauss-Newton step over the whole block with the present measurements, at the cost of a few
points: the camera corrections are so nearly linear that a second step is not needed. Weights, priors and rejected
observations are those of the adjustment; nothing is tested again. This is recursive least squares with a batch of
observations that are removed and added.
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
from .equations import CameraSystem, NormalEquations, Normals, Pattern, PointPriors, State
from .gauss_newton import Weighting
from .observations import Observations, select_observations
from .options import AdjustOptions
from .outcome.final_cameras import absorb_drift, compute_drift_gain, compute_drift_squares
from .preparation.problem import find_determinable_points
from .solver import run_adjuster
from .starting_values.intersection import estimate_start_positions, form_point_equations


class _PointObservations(NamedTuple):
    """Observations of some points with their weights and ground positions, for their part of the normal equations."""

    observations: Observations
    weighting: Weighting
    ground: np.ndarray


@dataclass(frozen=True, eq=False)
class BlockUpdate:
    """Result of an update: the block with the edited points.

    values : (images, p) parameters of the adjustment's model
    ground : (points, 3) positions of the watched points of the adjustment's block; NaN for all others and for edited
        ones
    edited_ground : (k, 3) positions of the edited points; NaN for those that cannot be computed
    """

    values: np.ndarray
    ground: np.ndarray
    edited_ground: np.ndarray


class BlockUpdater:
    """Updates an adjustment (``result``) for any number of edited points, repeatedly.

    Positions are updated for known points, and for points with the ids ``watched``.
    """

    def __init__(
        self,
        block: Block,
        options: AdjustOptions | None = None,
        progress: Progress = silent,
        watched: Collection[str] = (),
    ) -> None:
        """Adjust a block; raises the errors of `adjust`."""
        self.result, adjuster = run_adjuster(block, options, progress)
        self._problem, self._loop, self._last = adjuster.problem, adjuster.loop, adjuster.solution
        self._gain = compute_drift_gain(self._problem, self._loop, compute_drift_squares(self._problem, self._last))
        delivered = self.result.values[np.unique(self._problem.observations.camera_of_image, return_index=True)[1]]
        self._kept = delivered - absorb_drift(self._last.state.values, self._gain)  # `keep_rpc_position`
        self._ids = block.points.ids[self._problem.observations.points]
        self._pattern, self._blocks = self._loop.pattern, self._last.normals.blocks
        self._system = CameraSystem(self._pattern)
        self._taken_out: tuple[np.ndarray, Pattern, Normals | None] | None = None
        # The known and the watched points are intersected again: their equations with the final cameras, the state, the
        # weights (n,) of the image points and the normal equations there; None without any
        self._watched: tuple[NormalEquations, State, np.ndarray, Normals] | None = None
        points = self._problem.observations.points
        is_watched = block.known[points] | np.isin(self._ids, list(watched))
        is_watched &= finite_rows(self.result.ground[points])
        if is_watched.any():
            selection = self._select_before(is_watched)
            equations = form_point_equations(selection.observations, self._problem.model)
            state = State(self._deliver(self._last.state.values), self.result.ground[points[is_watched]])
            weighting = selection.weighting
            normals = equations.form_normals(state, weighting.image, weighting.points, weighting.contributes)
            self._watched = equations, state, weighting.image, normals

    def follow(self, edited: Collection[str], block: Block) -> BlockUpdate:
        """Return the update of the block for its edited points.

        edited : ids of all points that differ from the adjustment: moved, measured again, added or removed
        block : the images of the adjustment in their order, and the edited points that exist now

        Raises `SolveError` if the equations are singular now.
        """
        is_edited = np.isin(self._ids, list(edited))
        now = self._select_now(block)
        # extend the pattern by pairs of cameras that had no common point before
        pattern = self._pattern.extend_by(now.observations)
        if pattern.blocks != self._pattern.blocks:
            wider = np.zeros((pattern.blocks, *self._blocks.shape[1:]))
            wider[pattern.find_blocks(self._pattern.rows, self._pattern.columns)] = self._blocks
            self._pattern, self._blocks, self._system = pattern, wider, CameraSystem(pattern)
        prior, values = self._loop.prior_weight, self._last.state.values
        blocks, right = self._blocks, self._last.normals.right - np.where(np.isinf(prior), 0.0, prior) * values
        # Contributions of the edited points in the adjustment
        is_unchanged = self._taken_out is not None and np.array_equal(self._taken_out[0], is_edited)
        if not is_unchanged or self._taken_out is None or self._taken_out[1] is not self._pattern:
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
        """Return final camera values as in the result: drift absorbed, a free block at the position by its RPCs."""
        return absorb_drift(values, self._gain) + self._kept

    # ---- equations -------------------------------------------------------------------------------------------------

    def _select_before(self, edited: np.ndarray) -> _PointObservations:
        """Return the observations of the points ``edited (m,)`` in the adjustment, before they were edited."""
        observations, weighting = self._problem.observations, self._last.weighting
        priors = weighting.points
        mixed = priors.mixed[edited] if priors.correlated else priors.mixed
        of_edited = PointPriors(priors.target[edited], priors.weight[edited], priors.observed[edited], mixed)
        rows = edited[observations.point]
        return _PointObservations(
            observations.drop_points(~edited),
            Weighting(self._last.weight[rows], of_edited, weighting.contributes[edited]),
            self._last.state.ground[edited],
        )

    def _select_now(self, block: Block) -> _PointObservations:
        """Return the observations of a block's points; unchanged measurements keep their weights of the adjustment."""
        adjusted = self._problem.observations
        selected = select_observations(block, self._problem.options.check_as_ties)
        observations = replace(selected, camera_of_image=adjusted.camera_of_image)
        weight = 1.0 / observations.sigma_px**2
        survey = observations.survey_weight.copy()
        names = block.points.ids[observations.points]
        for row, (point, image) in enumerate(
            zip(observations.point.tolist(), observations.image.tolist(), strict=True)
        ):
            index = self._row_of.get((names[point], image))
            if index is not None and (adjusted.xy[index] == observations.xy[row]).all():
                weight[row] = self._last.weight[index]
        for point, name in enumerate(names.tolist()):
            index = self._place_of.get(name)
            if index is not None and np.array_equal(adjusted.survey_weight[index], survey[point]):
                priors = self._last.weighting.points
                survey[point] = np.where(priors.observed[index] & (survey[point] > 0.0), priors.weight[index], 0.0)
        # Initial positions of the adjustment; those of new points by intersection
        start = estimate_start_positions(observations)
        place = np.array([self._place_of.get(name, -1) for name in names.tolist()], dtype=np.int64)
        start[place >= 0] = self._last.state.ground[place[place >= 0]]
        if (place < 0).any():
            state, priors = State(self._last.state.values, start), PointPriors.from_surveys(observations, start, survey)
            ground = form_point_equations(observations, self._problem.camera).intersect(state, weight, priors)
            start = np.where(finite_rows(ground)[:, None], ground, start)
        priors_now = PointPriors.from_surveys(observations, start, survey)
        contributes = observations.contributing_points & find_determinable_points(observations, weight, survey)
        return _PointObservations(observations, Weighting(weight, priors_now, contributes), start)

    def _form_normals(self, share: _PointObservations) -> Normals | None:
        """Return the points' contributions to the reduced normal equations, None without any."""
        if not share.observations.count:
            return None
        equations = NormalEquations(share.observations, self._problem.camera, self._pattern, threads=1)
        state = State(self._last.state.values, share.ground)
        return equations.form_normals(state, share.weighting.image, share.weighting.points, share.weighting.contributes)

    # ---- look-up tables --------------------------------------------------------------------------------------------

    @cached_property
    def _place_of(self) -> dict[str, int]:
        return {name: index for index, name in enumerate(self._ids.tolist())}

    @cached_property
    def _row_of(self) -> dict[tuple[str, int], int]:
        """Row of each measurement, by the point's id and the image's index."""
        observations = self._problem.observations
        keys = zip(self._ids[observations.point].tolist(), observations.image.tolist(), strict=True)
        return {key: row for row, key in enumerate(keys)}

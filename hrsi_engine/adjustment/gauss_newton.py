"""The damped Gauss-Newton iterations on the reduced camera system, with robust reweighting.

Unknowns are the model's values of each camera and a metric step of each point. One pass eliminates the points, solves
for the cameras and substitutes back; the normal equations at the new state are those of the next pass. Acceptance and
damping of steps are those of `foundation.levenberg_marquardt`, as for single images.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ..foundation.levenberg_marquardt import Step, descend
from ..foundation.progress import Progress, advance, silent
from ..foundation.thresholds import ITERATIONS, threshold, thresholds
from ..ground.geodesy import move_ground
from .equations import CameraSystem, NormalEquations, Normals, Pattern, PointPriors, State
from .priors.common_drift import CommonDrift
from .priors.earlier_cameras import JointPrior
from .result import Iteration
from .weights import WEIGHTS, least_squares


@thresholds
class CONVERGENCE:
    """Decrease of the cost at which iterations before the final one end."""

    robust: float = threshold(1e-4, "", "relative decrease with robust weights: later changes move blunders only")


@dataclass(frozen=True, eq=False)
class Weighting:
    """Current weights of the observations; data snooping and variance components change them.

    image : (n,) 1/px², 0 for a measurement that is left out
    points : priors of the points' positions, including surveys
    contributes : (m,) True for points that are used to determine the cameras
    """

    image: np.ndarray
    points: PointPriors
    contributes: np.ndarray


class PositionObservations(Protocol):
    """External observations of point positions (heights, plan), re-weighted by their fit in each iteration."""

    def add_to_priors(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> PointPriors:
        """Return the priors with these observations, at ``ground (m, 3)``, whose ``cofactors`` are by ``priors``."""


@dataclass(frozen=True, eq=False)
class Solution:
    """State of the iterations or their result: state, equations there, robust factors (n,), cost, and convergence."""

    state: State
    weighting: Weighting
    normals: Normals
    factor: np.ndarray
    cost: float
    converged: bool = False
    status: str = ""

    @property
    def weight(self) -> np.ndarray:
        """Weights of the image points, including robust factors."""
        return self.weighting.image * self.factor


@dataclass(eq=False)
class GaussNewton:
    """The iterations for one set of equations.

    prior_weight : (cameras, p), infinite for a fixed parameter
    rows_per_point : (m,) numbers of image points
    robust, tolerance : weight function of the image points, and relative decrease of the cost at which iterations end
    external : observations of positions, tested in every pass: heights of a DEM or of laser points, reference places
    earlier : prior of the cameras from an earlier adjustment
    common : priors of the drifts common to all images
    """

    equations: NormalEquations
    pattern: Pattern
    prior_weight: np.ndarray
    rows_per_point: np.ndarray
    max_iterations: int = 30
    robust: str = "none"
    tolerance: float = ITERATIONS.fine
    external: Sequence[PositionObservations] = ()
    earlier: JointPrior | None = None
    common: Sequence[CommonDrift] = ()
    history: list[Iteration] = field(default_factory=list)
    solves: int = 0

    def __post_init__(self) -> None:
        self.system = CameraSystem(self.pattern)
        self.set_prior_weight(self.prior_weight, self.common)

    @property
    def joint(self) -> tuple[JointPrior | CommonDrift, ...]:
        """The priors that connect several cameras."""
        return (*self.common, *([] if self.earlier is None else [self.earlier]))

    def set_prior_weight(self, prior_weight: np.ndarray, common: Sequence[CommonDrift] = ()) -> None:
        """Set other weights of the parameters' priors: of single parameters, and of the `common` drifts."""
        self.prior_weight, self.common = prior_weight, common
        self._finite_prior = np.where(np.isinf(prior_weight), 0.0, prior_weight)

    def iterate(
        self,
        state: State,
        weighting: Weighting,
        progress: Progress = silent,
        robust: str | None = None,
        tolerance: float | None = None,
    ) -> Solution:
        """Iterate from a state until the expected decrease of the cost is below ``tolerance`` of the cost.

        The history has one row for every step of all runs.
        """
        unweighed = np.ones(len(weighting.image))
        return self._descend(lambda: self.form_solution(state, weighting, unweighed), progress, robust, tolerance)

    def continue_from(self, last: Solution) -> Solution:
        """Iterate from a solution with its own weights, after a change of the priors (`set_prior_weight`)."""

        def begin() -> Solution:
            if self.common:  # their priors are part of the equations
                return self.form_solution(last.state, last.weighting, last.factor)
            return replace(last, cost=self.compute_cost(last))

        return self._descend(begin)

    def compute_camera_cofactors(self, solution: Solution) -> np.ndarray:
        """Return the cofactors of the cameras on the pattern, ``(blocks, p, p)``."""
        self.system.factorise(solution.normals.blocks, self.prior_weight)
        return self.system.compute_cofactors()

    def _descend(
        self,
        begin: Callable[[], Solution],
        progress: Progress = silent,
        robust: str | None = None,
        tolerance: float | None = None,
    ) -> Solution:
        """Iterate from the solution that ``begin`` makes: a function, so that no reference keeps old equations."""
        robustly, tolerance = WEIGHTS[robust or self.robust], self.tolerance if tolerance is None else tolerance
        tolerance = max(tolerance, CONVERGENCE.robust) if robustly is not least_squares else tolerance
        first = len(self.history)

        def step(at: Solution, damping: float) -> Step[Solution]:
            passed = len(self.history) - first
            advance(progress, 1.0 - 0.6**passed, f"adjustment, iteration {len(self.history) + 1}")
            right = at.normals.right - self._finite_prior * at.state.values
            by_values = self.system.solve_nearby(at.normals.blocks, self.prior_weight, damping, right)
            self.solves += 1
            by_ground = self.equations.compute_point_steps(at.state, at.weight, at.normals, by_values)
            ahead = self.form_solution(
                State(at.state.values + by_values, move_ground(at.state.ground, by_ground)), at.weighting, at.factor
            )
            braked = 0.5 * self.system.compute_damping_cost(by_values)
            # the decrease of the cost by the points with fixed cameras
            of_points = np.einsum("mi,mij,mj->m", at.normals.point_right, at.normals.inverse, at.normals.point_right)
            by_points = float(of_points @ at.weighting.contributes)
            promised = 0.5 * (float(np.sum(right * by_values)) + by_points) + braked
            self.history.append(Iteration(at.cost, promised, damping))
            return Step(ahead, promised, braked)

        # The first pass corrects the cameras: before it, residuals are the vendor's bias and are not used for weights.
        reweighting = robustly is not least_squares or bool(self.external)
        ended = descend(
            begin(),
            step,
            lambda at: max(1.0, 2.0 * at.cost / self.count_redundancy(at.weighting)),
            self.max_iterations,
            (lambda at: self._reweight(at, robustly)) if reweighting else None,
            tolerance,
        )
        return replace(ended.at, converged=ended.converged, status=ended.status)

    def _reweight(self, solution: Solution, robustly: Callable[[np.ndarray], np.ndarray]) -> Solution:
        """Return the same state with new robust factors and new weights of the external observations.

        robustly : weight function of residuals in standard deviations (`weights`)
        """
        weighting = solution.weighting
        for source in self.external:
            # the cofactors belong to the priors of coordinates that no source before it has observed again
            points = source.add_to_priors(weighting.points, solution.state.ground, solution.normals.inverse)
            weighting = replace(weighting, points=points)
        t = np.linalg.norm(solution.normals.residual, axis=1) * np.sqrt(weighting.image)
        return self.form_solution(solution.state, weighting, robustly(t))

    def form_solution(self, state: State, weighting: Weighting, factor: np.ndarray) -> Solution:
        """Return the equations and the cost at a state, with robust factors ``(n,)``; nothing is iterated."""
        normals = self.equations.form_normals(state, weighting.image * factor, weighting.points, weighting.contributes)
        for joint in self.joint:
            joint.add_to(normals, state.values, self.pattern)
        solution = Solution(state, weighting, normals, factor, 0.0)
        return replace(solution, cost=self.compute_cost(solution))

    def compute_cost(self, solution: Solution) -> float:
        """Half the weighted sum of squares of image points, surveys and priors."""
        joint = sum(joint.compute_cost(solution.state.values) for joint in self.joint)
        weak = solution.weighting.points.sum_weak_squares(solution.state.ground, solution.weighting.contributes)
        prior_squares = float(np.sum(self._finite_prior * solution.state.values**2))
        return 0.5 * (self.sum_of_squares(solution) + weak + prior_squares) + joint

    def sum_of_squares(self, solution: Solution) -> float:
        """Return the weighted sum of squares of image points and surveys that are used to determine the cameras."""
        contributes, residual = solution.weighting.contributes, solution.normals.residual
        lengths = np.einsum("nc,nc->n", residual, residual) * solution.weight
        contributing_rows = np.repeat(contributes, self.rows_per_point)
        return float(lengths @ contributing_rows) + solution.weighting.points.sum_of_squares(
            solution.state.ground, contributes
        )

    def count_redundancy(self, weighting: Weighting) -> float:
        """Return the redundancy, at least 1; priors of the cameras are not counted as observations."""
        rows = int(((weighting.image > 0.0) & np.repeat(weighting.contributes, self.rows_per_point)).sum())
        surveyed = int(weighting.points.observed[weighting.contributes].sum())
        unknowns = 3 * int(weighting.contributes.sum()) + int((self._finite_prior > 0.0).sum())
        return float(max(2 * rows + surveyed - unknowns, 1))

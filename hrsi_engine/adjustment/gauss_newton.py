"""The damped Gauss-Newton loop on the reduced camera system, reweighted for robustness.

Unknowns are the model's values of each camera and a metric step of each point. One pass eliminates the points, solves
for the cameras and substitutes back; the normal equations at the new state are those of the next pass. Which steps
count and how they are damped is `foundation.levenberg_marquardt`'s, as for single images.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ..foundation.levenberg_marquardt import Step, descend
from ..foundation.progress import Progress, advance
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import move_ground
from .common_drift import CommonDrift
from .equations import CameraSystem, NormalEquations, Normals, Pattern, PointPriors, State, choose_camera_system
from .joint_prior import JointPrior
from .result import Iteration
from .weights import WEIGHTS, least_squares


@thresholds
class CONVERGENCE:
    """When iterations that are not the last end."""

    before_snooping: float = threshold(0.05, "", "relative decrease of the cost before a round of data snooping")
    robust: float = threshold(1e-4, "", "… of reweighted iterations: what is left moves single blunders only")


@dataclass(frozen=True, eq=False)
class Weighting:
    """What the observations weigh at present; data snooping and variance components change it.

    image : (n,) 1/px², 0 for a measurement that is left out
    points : priors of the points' positions, surveys among them
    contributes : (m,) whether a point has a say in the cameras
    """

    image: np.ndarray
    points: PointPriors
    contributes: np.ndarray


class PositionObservations(Protocol):
    """What holds points beside their surveys, and is weighted by how well it fits."""

    def add_to_priors(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> PointPriors:
        """Return the priors with it at positions ``(m, 3)``, whose ``cofactors (m, 3, 3)`` are under the ``priors``."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the loop stands or ended: state, equations there, robust factors (n,), cost, and how it went."""

    state: State
    weighting: Weighting
    normals: Normals
    factor: np.ndarray
    cost: float
    converged: bool = False
    status: str = ""

    @property
    def weight(self) -> np.ndarray:
        """Weights of the image points, robust factors included."""
        return self.weighting.image * self.factor


@dataclass(eq=False)
class GaussNewton:
    """The loop over one set of equations.

    prior_weight : (cameras, p), infinite for a parameter that stays at its start
    rows_per_point : (m,) numbers of image points
    held : what holds points, judged in every pass: heights of a DEM or of laser points, places of a reference
    earlier : what an earlier adjustment says of cameras
    common : what holds the drifts that move images alike
    """

    equations: NormalEquations
    pattern: Pattern
    prior_weight: np.ndarray
    rows_per_point: np.ndarray
    max_iterations: int = 30
    held: Sequence[PositionObservations] = ()
    earlier: JointPrior | None = None
    common: Sequence[CommonDrift] = ()
    history: list[Iteration] = field(default_factory=list)
    solves: int = 0

    def __post_init__(self) -> None:
        self.system: CameraSystem = choose_camera_system(self.pattern)
        self.set_prior_weight(self.prior_weight, self.common)

    @property
    def joint(self) -> tuple[JointPrior | CommonDrift, ...]:
        """The priors of several cameras together."""
        return (*self.common, *([] if self.earlier is None else [self.earlier]))

    def set_prior_weight(self, prior_weight: np.ndarray, common: Sequence[CommonDrift] = ()) -> None:
        """Take other weights of the parameters' priors, each by itself and those of `common` drifts."""
        self.prior_weight, self.common = prior_weight, common
        self._finite_prior = np.where(np.isinf(prior_weight), 0.0, prior_weight)

    def iterate(
        self, state: State, weighting: Weighting, robust: str, tolerance: float, progress: Progress
    ) -> Solution:
        """Iterate from a state until the decrease of the cost that is left falls below ``tolerance`` of the cost.

        The history grows over all runs, one row for every step.
        """
        unweighed = np.ones(len(weighting.image))
        return self._descend(lambda: self.form_solution(state, weighting, unweighed), robust, tolerance, progress)

    def continue_from(self, last: Solution, robust: str, tolerance: float, progress: Progress) -> Solution:
        """Iterate from a solution with its own weights: what has changed are the priors (`set_prior_weight`)."""

        def begin() -> Solution:
            if self.common:  # they are in the equations
                return self.form_solution(last.state, last.weighting, last.factor)
            return replace(last, cost=self.compute_cost(last))

        return self._descend(begin, robust, tolerance, progress)

    def compute_camera_cofactors(self, solution: Solution) -> np.ndarray | None:
        """Return the cofactors of the cameras on the pattern, None if they are not known."""
        self.system.factorise(solution.normals.blocks, self.prior_weight)
        return self.system.compute_cofactors()

    def _descend(self, begin: Callable[[], Solution], robust: str, tolerance: float, progress: Progress) -> Solution:
        """Descend from the solution that ``begin`` makes: none here holds its equations when it is left behind."""
        robustly = WEIGHTS[robust]
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
            # what the points would bring with the cameras as they are
            of_points = np.einsum("mi,mij,mj->m", at.normals.point_right, at.normals.inverse, at.normals.point_right)
            by_points = float(of_points @ at.weighting.contributes)
            promised = 0.5 * (float(np.sum(right * by_values)) + by_points) + braked
            self.history.append(Iteration(at.cost, promised, damping))
            return Step(ahead, promised, braked)

        # The first pass brings the cameras near: before it, residuals are the vendor's bias and judge nothing.
        reweighting = robustly is not least_squares or bool(self.held)
        ended = descend(
            begin(), step, lambda at: max(1.0, 2.0 * at.cost / self.count_redundancy(at.weighting)),
            self.max_iterations, (lambda at: self._reweight(at, robustly)) if reweighting else None, tolerance,
        )  # fmt: skip
        return replace(ended.at, converged=ended.converged, status=ended.status)

    def _reweight(self, at: Solution, robustly: Callable[[np.ndarray], np.ndarray]) -> Solution:
        """Return the same state with robust factors from its residuals and from what holds points."""
        weighting = at.weighting
        for held in self.held:
            # a coordinate is held by one of them only, so that of another still has the weight of the cofactors
            points = held.add_to_priors(weighting.points, at.state.ground, at.normals.inverse)
            weighting = replace(weighting, points=points)
        t = np.linalg.norm(at.normals.residual, axis=1) * np.sqrt(weighting.image)
        return self.form_solution(at.state, weighting, robustly(t))

    def form_solution(self, state: State, weighting: Weighting, factor: np.ndarray) -> Solution:
        """Return the equations and the cost at a state, with robust factors ``(n,)``; nothing is iterated."""
        normals = self.equations.form_normals(state, weighting.image * factor, weighting.points, weighting.contributes)
        for joint in self.joint:
            joint.add_to(normals, state.values, self.pattern)
        at = Solution(state, weighting, normals, factor, 0.0)
        return replace(at, cost=self.compute_cost(at))

    def compute_cost(self, at: Solution) -> float:
        """Half the weighted sum of squares of image points, surveys and priors."""
        joint = sum(joint.compute_cost(at.state.values) for joint in self.joint)
        weak = at.weighting.points.sum_weak_squares(at.state.ground, at.weighting.contributes)
        own = float(np.sum(self._finite_prior * at.state.values**2))
        return 0.5 * (self.sum_of_squares(at) + weak + own) + joint

    def sum_of_squares(self, at: Solution) -> float:
        """Return the weighted sum of squares of image points and surveys that have a say in the cameras."""
        contributes, residual = at.weighting.contributes, at.normals.residual
        lengths = np.einsum("nc,nc->n", residual, residual) * at.weight
        used = np.repeat(contributes, self.rows_per_point)
        return float(lengths @ used) + at.weighting.points.sum_of_squares(at.state.ground, contributes)

    def count_redundancy(self, weighting: Weighting) -> float:
        """Return the redundancy, 1 where there is none; priors of the cameras are left out of it."""
        rows = int(((weighting.image > 0.0) & np.repeat(weighting.contributes, self.rows_per_point)).sum())
        surveyed = int(weighting.points.observed[weighting.contributes].sum())
        unknowns = 3 * int(weighting.contributes.sum()) + int((self._finite_prior > 0.0).sum())
        return float(max(2 * rows + surveyed - unknowns, 1))

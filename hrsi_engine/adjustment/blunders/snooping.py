"""Rounds of data snooping: blunders are found and left out; each round continues from the last solution.

1. A start without measurements that disagree with the others of their points (`consensus`), also those of GCPs.
   Surveys have a thousandth of their weights here, so that a wrong one does not distort the tie points.
2. Cameras and decisions on measurements (`ties`) alternate to convergence; then the surveys get their own weights.
3. GCPs are tested in groups (`control`) with the cofactors of that solution. After a new solution without the wrong
   ones the measurements are tested again, because wrong GCPs may have distorted the cameras.
"""

from copy import copy
from dataclasses import replace
from weakref import ref

import numpy as np

from ...foundation.errors import list_ids
from ...foundation.large_arrays import any_of_rows, finite_rows
from ...foundation.progress import Progress, stage
from ...foundation.thresholds import ITERATIONS, REDUNDANCY, SIGNIFICANCE, threshold, thresholds
from ..equations import PointPriors, State
from ..gauss_newton import GaussNewton, Solution, Weighting
from ..outcome.assembly import RoundFindings
from ..preparation.problem import Problem, find_determinable_points
from ..result import Decision, Finding
from ..starting_values.consensus import find_agreeing_measurements
from .control import Suspect, find_suspect_gcps
from .discrepancies import IMAGE, Discrepancies, compute_discrepancies
from .ties import check_ties, compute_point_squares, estimate_tie_variance


@thresholds
class SNOOPING:
    """Limit for the rounds of data snooping."""

    rare: float = threshold(2e-4, "", "share of changed decisions on measurements below which the rounds end")


class Snooping:
    """State of data snooping: the observations left out of an adjustment, and the solutions without them.

    image_weight, survey_weight : (n,) and (m, 3) of all observations; 0 for surveys that are left out
    ties : (m,) mask of the points that are tested by their rays
    found : decisions on measurements and findings on GCPs
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.loop: GaussNewton = problem.loop()
        observations = problem.observations
        self.image_weight = problem.weighting.image
        self.survey_weight = observations.survey_weight.copy()
        self.ties = observations.contributing_points & ~observations.located
        self.found = RoundFindings(np.full(observations.count, int(Decision.KEPT), dtype=np.int8))
        self._undecided: list[Finding] = []
        self._control: tuple[ref[Solution], np.ndarray, Discrepancies] | None = None

    def build_weighting(self, last: Solution | None, survey_weight: np.ndarray | None = None) -> Weighting:
        """Return the weights without the observations left out; ``survey_weight`` replaces the surveys' own.

        Weights of external heights and positions are those of the ``last`` solution.
        """
        previous_priors = None if last is None else last.weighting.points
        image = np.where(self.found.decision == int(Decision.KEPT), self.image_weight, 0.0)
        survey = self.survey_weight if survey_weight is None else survey_weight
        return self.problem.survey_weighting(image, survey, previous_priors)

    def solve(self, last: Solution | None, progress: Progress) -> Solution:
        """Run the iterations from the last solution, or from the start."""
        state = self.problem.start if last is None else last.state
        return self.loop.iterate(state, self.build_weighting(last), progress)

    # ---- measurements ----------------------------------------------------------------------------------------------

    def leave_out_wrong_ties(self, progress: Progress) -> Solution:
        """Return the solution without the measurements that do not fit their points."""
        problem, observations = self.problem, self.problem.observations
        if not self.ties.any():
            return self.solve(None, progress)
        robust = "huber" if problem.options.robust == "none" else problem.options.robust
        lenient, everything = self.survey_weight * REDUNDANCY.regularised, observations.contributing_points
        agreeing = find_agreeing_measurements(problem.equations, observations, problem.start, everything)
        start = problem.survey_weighting(np.where(agreeing, self.image_weight, 0.0), lenient)
        solution = self.loop.iterate(problem.start, start, progress, robust, ITERATIONS.coarse)
        for _ in range(ITERATIONS.most):
            solution = self._intersect_unused_points(solution)
            if not self._judge_measurements(solution, everything):
                break
            present = self.build_weighting(solution, lenient)
            solution = self.loop.iterate(solution.state, present, progress, tolerance=ITERATIONS.coarse)
        self.found.decision[observations.located[observations.point]] = int(Decision.KEPT)
        return self.judge_ties_again(self.solve(solution, progress), progress)

    def _intersect_unused_points(self, solution: Solution) -> Solution:
        """Return the solution with points that kept fewer than two measurements intersected again from all of theirs.

        Their positions date from before the cameras changed, where their measurements cannot be tested.
        """
        problem, observations, weight = self.problem, self.problem.observations, solution.weighting.image
        unused = np.flatnonzero(self.ties & ~find_determinable_points(observations, weight, self.survey_weight))
        if not len(unused):
            return solution
        state, priors = solution.state, solution.weighting.points
        ground = problem.equations.intersect(state, self.image_weight, priors, unused)
        failed = ~finite_rows(ground)
        ground[failed] = state.ground[failed]
        state, factor = State(state.values, ground), (solution.factor > 0.0).astype(np.float64)
        # for the test of the measurements alone: points without the cameras' part, and no robust weights
        nobody = np.zeros(len(observations.points), dtype=bool)
        normals = problem.equations.form_normals(state, solution.weighting.image * factor, priors, nobody)
        return replace(solution, state=state, normals=normals, factor=factor)

    def judge_ties_again(self, solution: Solution, progress: Progress) -> Solution:
        """Test the tie points with a solution that has all surveys, and solve again if decisions change."""
        if self.ties.any() and self._judge_measurements(solution, self.ties):
            return self.solve(solution, progress)
        return solution

    def _judge_measurements(self, solution: Solution, points: np.ndarray) -> bool:
        """Decide on the measurements of the ``points (m,)``; return True if more than rare decisions changed."""
        problem, observations = self.problem, self.problem.observations
        present = self.weigh_rays_alone(solution)
        squares, freedom = self.estimate_tie_variance_by_rays(solution, present)
        everything = replace(present, image=self.image_weight)
        if (present.image != self.image_weight).any():
            squares = compute_point_squares(problem, solution, everything)
        variance = self.found.tie_variance, freedom
        decision, failed = check_ties(problem, solution, everything, points, squares, variance)
        judged = points[observations.point]
        previous = self.found.failed if self.found.failed is not None else np.full_like(failed, np.nan)
        decision = np.where(judged, decision, self.found.decision)
        changed = int((decision != self.found.decision).sum())
        self.found.decision, self.found.failed = decision, np.where(judged, failed, previous)
        return changed > SNOOPING.rare * len(decision)

    def estimate_tie_variance_by_rays(self, solution: Solution, present: Weighting) -> tuple[np.ndarray, float]:
        """Set the variance factor of tie points; return their sums of squares ``(m,)`` and its degrees of freedom.

        present : weights without the measurements left out, and priors without external heights (`weigh_rays_alone`)
        """
        observations = self.problem.observations
        squares = compute_point_squares(self.problem, solution, present)
        rays = np.add.reduceat(present.image > 0.0, observations.first[:-1], dtype=np.int64)
        self.found.tie_variance, freedom = estimate_tie_variance(observations, squares, rays, self.ties)
        return squares, freedom

    def weigh_rays_alone(self, solution: Solution) -> Weighting:
        """Return weights by which rays are tested by rays only, not by external heights, which may be wrong there."""
        if not self.problem.position_observations:
            return solution.weighting
        priors = PointPriors.from_surveys(self.problem.observations, solution.state.ground, self.survey_weight)
        return replace(solution.weighting, points=priors)

    # ---- control ---------------------------------------------------------------------------------------------------

    def leave_out_wrong_control(self, solution: Solution, progress: Progress) -> Solution:
        """Return the solution without the GCPs, or parts of them, that disagree with the rest of the block."""
        if self._undecided:  # sigmas estimated with contradicting GCPs permit no decision
            return solution
        problem = self.problem
        for number in range(ITERATIONS.most):
            gcps = self._find_testable_gcps(solution)
            if len(gcps) < 2:
                break
            control = self.compute_control(solution, gcps)
            suspects = find_suspect_gcps(control, problem.options.reject_sigma)
            # whether the cameras have a drift whose standard deviation is only assumed so far
            guessed = problem.options.sigma_drift is None and bool(problem.guessed.any())
            if suspects and guessed and np.array_equal(self.loop.prior_weight, problem.prior_weight):
                # test with a looser drift prior: no GCP is rejected for what a drift can explain
                loop = copy(self.loop)  # shared equations and system, own history
                loop.history, loop.max_iterations = [], 1  # near the minimum the equations are linear
                prior_weight = self.loop.prior_weight.copy()
                prior_weight[:, problem.guessed] /= SIGNIFICANCE.extreme**2
                loop.set_prior_weight(prior_weight, self.loop.common)
                loose = compute_discrepancies(problem, loop, loop.continue_from(solution), gcps)
                drifting = find_suspect_gcps(loose, problem.options.reject_sigma)
                suspected = {gcp for one in drifting for gcp in one.concerned}
                suspects = [one for one in suspects if suspected.intersection(one.concerned)]
            said = [describe_suspect(problem, control, one) for one in suspects]
            self._undecided = [one for one in said if not one.left_out]
            self.found.findings += [one for one in said if one.left_out]
            for one in suspects:
                if one.is_clear:
                    leave_out(problem, control, one, self.survey_weight, self.found)
            if not any(one.is_clear for one in suspects):
                break
            part = stage(progress, number / ITERATIONS.most, (number + 1) / ITERATIONS.most)
            solution = self.judge_ties_again(self.solve(solution, part), part)
        return solution

    def leave_out_each_survey(self, solution: Solution) -> tuple[float, float]:
        """Return the normalised squares of survey - prediction of the GCPs, and their degrees of freedom.

        Each is predicted by all observations except its own survey, without another solution.
        """
        gcps = self._find_testable_gcps(solution)
        if len(gcps) < 2:
            return 0.0, 0.0
        control = self.compute_control(solution, gcps)
        surveys = [np.flatnonzero((control.point == gcp) & (control.kind != IMAGE)) for gcp in range(len(gcps))]
        tests = [control.test_subset(subset) for subset in surveys]
        return sum(test for test, _ in tests), float(sum(dimensions for _, dimensions in tests))

    def compute_control(self, solution: Solution, points: np.ndarray) -> Discrepancies:
        """Return the discrepancies of some GCPs at a solution; the last ones computed are cached."""
        last = self._control
        if last is None or not (
            last[0]() is solution and last[1] is self.loop.prior_weight and np.array_equal(last[2].points, points)
        ):
            self._control = last = None  # frees memory before the next
            control = compute_discrepancies(self.problem, self.loop, solution, points)
            self._control = last = ref(solution), self.loop.prior_weight, control
        return last[2]

    def _find_testable_gcps(self, solution: Solution) -> np.ndarray:
        """Return the GCPs ``(g,)`` that have a survey and a measurement with weight: indices of points."""
        weighting, observations = solution.weighting, self.problem.observations
        measured = np.add.reduceat(solution.weight > 0.0, observations.first[:-1], dtype=np.int64) > 0
        is_fixed = weighting.contributes & weighting.points.held & observations.surveyed
        return np.flatnonzero(is_fixed & measured & any_of_rows(self.survey_weight > 0.0))


def leave_out(
    problem: Problem, control: Discrepancies, suspect: Suspect, survey_weight: np.ndarray, round_findings: RoundFindings
) -> None:
    """Set the weights of a GCP's wrong part to zero: of the survey ``(m, 3)``, or of measurements; in place."""
    point = int(control.points[suspect.gcp])
    rows, kind = np.zeros(0, dtype=np.int64), Decision.DOUBTFUL
    if suspect.what == "height":
        survey_weight[point, 2] = 0.0
    elif suspect.what == "image":
        rows, kind = np.array([suspect.row]), Decision.BLUNDER
    else:
        survey_weight[point] = 0.0
    if suspect.what == "all":
        rows = np.arange(problem.observations.first[point], problem.observations.first[point + 1])
    round_findings.decision[rows] = int(kind)
    if round_findings.failed is None:
        round_findings.failed = np.full(len(round_findings.decision), np.nan, dtype=np.float32)
    round_findings.failed[rows] = suspect.statistic


def describe_suspect(problem: Problem, control: Discrepancies, suspect: Suspect) -> Finding:
    """Return the finding on a GCP, or on two groups of GCPs of which one is wrong."""
    observations = problem.observations
    ids = problem.block.points.ids[observations.points[control.points]]
    name, size = str(ids[suspect.gcp]), float(np.linalg.norm(suspect.error))
    image = observations.images[observations.image[suspect.row]].id if suspect.what == "image" else None
    unit = "m" if image is None else "px"
    sigmas = f"({suspect.statistic:.0f} sigma)"
    if suspect.is_clear:
        east, north, up = suspect.error if image is None else (0.0, 0.0, 0.0)
        descriptions = {
            "height": f"its height is {size:.1f} m too {'high' if up > 0.0 else 'low'} {sigmas}",
            "image": f"its measurement on image {image} has an error of {size:.1f} px {sigmas}",
            "ground": f"its position has an error of {east:+.1f} {north:+.1f} {up:+.1f} m east, north, up {sigmas}",
            "all": f"its ground position (error {size:.1f} m) or its measurements are wrong {sigmas}",
        }[suspect.what]
        message = f"GCP {name}: according to the other observations {descriptions}; it is not used"
    else:
        difference = f"{size:.1f} {unit} {sigmas}"
        group_ids, rival_ids = list_ids(ids[list(suspect.group)]), list_ids(ids[list(suspect.rivals)])
        message = (
            f"GCP {group_ids} and {rival_ids} contradict each other, {name} by {difference}; the wrong ones cannot "
            "be identified, so "
            "all are used: check them, or measure more GCPs"
        )
    return Finding(
        id=name,
        what={"image": image or "", "height": "height"}.get(suspect.what, "ground"),
        statistic=suspect.statistic,
        left_out=suspect.is_clear,
        message=message,
        size=size,
        unit=unit,
        group=tuple(str(one) for one in ids[list(suspect.group)]),
        rivals=tuple(str(one) for one in ids[list(suspect.rivals)]),
    )

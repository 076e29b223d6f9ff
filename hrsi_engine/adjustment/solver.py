"""`adjust`: prepare, leave out blunders, estimate sigmas, solve, and say how good the result is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..block import Block
from ..progress import Progress, silent, stage
from .gauss_newton import LOOSE_TOLERANCE, GaussNewton, Solution, Weighting
from .options import AdjustOptions
from .precision import Precision, deletion_tests, precision
from .problem import Problem, named, prepare
from .result import Adjustment, DatumPart, Finding, VarianceComponent, Verdict
from .snooping import Suspect, control_suspect, point_squares, tie_variance, tie_verdicts
from .variance_components import ROUNDS, SETTLED, Groups, Sigmas, components, summary

SNOOPING_ROUNDS = 6
RARE = 2e-4  # share of the measurements whose change of verdict is not worth another round
HELD_BY_PRIOR = 0.5  # share of a parameter from its prior above which it counts as not determined


def adjust(
    block: Block, options: AdjustOptions | None = None, progress: Progress = silent, start: np.ndarray | None = None
) -> Adjustment:
    """Adjust a block; return corrected cameras, points and their precision.

    ``start (images, p)`` are values to begin with, those of an earlier adjustment with the same model, say.

    Raises
    ------
    InputError
        unknown model, weight function or image id
    SolveError
        nothing to adjust, or fewer observations than unknowns (the images are named)
    """
    return Adjuster(prepare(block, options or AdjustOptions(), start)).run(progress)


class Adjuster:
    """The rounds of one adjustment: each is a run of the loop from where the last one ended."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.loop: GaussNewton = problem.loop()
        observations = problem.observations
        self.image_weight = problem.weighting.image
        self.survey_weight = observations.survey_weight.copy()
        self.verdict = np.full(observations.count, int(Verdict.KEPT), dtype=np.int8)
        self.ties = observations.contributing_points & ~problem.weighting.points.held
        self.tie_variance = 1.0
        self.findings: list[Finding] = []
        self.warnings: list[str] = []
        self.components: tuple[VarianceComponent, ...] = ()

    def run(self, progress: Progress) -> Adjustment:
        """Return the result of all rounds."""
        options = self.problem.options
        solution = self.solve(None, progress)
        if options.reject_sigma > 0.0:
            solution = self.without_blunders(solution, stage(progress, 0.3, 0.7))
        if options.variance_components:
            solution = self.with_estimated_sigmas(solution, stage(progress, 0.7, 0.9))
        precise = precision(self.problem.equations, self.loop, solution)
        if options.reject_sigma > 0.0:
            solution, precise = self.without_bad_control(solution, precise, stage(progress, 0.9, 1.0))
        return self.result(solution, precise)

    # ---- rounds ----------------------------------------------------------------------------------------------------

    def weighting(self) -> Weighting:
        """Return the weights without what was left out."""
        image = np.where(self.verdict == int(Verdict.KEPT), self.image_weight, 0.0)
        return self.problem.survey_weighting(image, self.survey_weight)

    def solve(self, last: Solution | None, progress: Progress, loosely: bool = False) -> Solution:
        """Run the loop from the last solution, or from the start."""
        options = self.problem.options
        state = self.problem.start if last is None else last.state
        first_of_many = last is None and options.reject_sigma > 0.0
        robust = "huber" if first_of_many and options.robust == "none" else options.robust
        tolerance = LOOSE_TOLERANCE if loosely or first_of_many else options.tolerance
        return self.loop.run(state, self.weighting(), robust, tolerance, progress)

    def without_blunders(self, solution: Solution, progress: Progress) -> Solution:
        """Leave out the measurements that do not fit their points; the rounds end when the verdicts settle."""
        if not self.ties.any():
            return self.solve(solution, progress)
        for number in range(SNOOPING_ROUNDS):
            verdict = self._judge(solution)
            changed = int((verdict != self.verdict).sum())
            self.verdict = verdict
            settled = changed <= RARE * len(verdict)
            solution = self.solve(solution, progress, loosely=not settled and number < SNOOPING_ROUNDS - 1)
            if settled:
                break
        return solution

    def _judge(self, solution: Solution) -> np.ndarray:
        """Return the verdicts for the cameras of a solution."""
        observations, equations = self.problem.observations, self.problem.equations
        present = self.weighting()
        squares = point_squares(equations, solution, present, observations)
        rays = np.add.reduceat(present.image > 0.0, observations.first[:-1], dtype=np.int64)
        self.tie_variance = tie_variance(observations, squares, rays, self.ties)
        everything = replace(present, image=self.image_weight)
        return tie_verdicts(
            equations, observations, solution, everything, self.ties, self.problem.options.reject_sigma,
            self.tie_variance,
        )  # fmt: skip

    def without_bad_control(
        self, solution: Solution, precise: Precision, progress: Progress
    ) -> tuple[Solution, Precision]:
        """Test the GCPs with the whole adjustment's cofactors; take out one at a time."""
        sigmas = self.problem.options.reject_sigma
        most = int(self.problem.observations.surveyed.sum()) // 2
        for _ in range(most):
            suspect = control_suspect(self.problem.observations, solution, precise, sigmas)
            if suspect is None or not self._accuse(suspect):
                break
            if self.ties.any():
                self.verdict = np.where(self._control_rows(), self.verdict, self._judge(solution))
            solution = self.solve(solution, progress)
            precise = precision(self.problem.equations, self.loop, solution)
        return solution, precise

    def _control_rows(self) -> np.ndarray:
        return self.problem.observations.surveyed[self.problem.observations.point]

    def _accuse(self, suspect: Suspect) -> bool:
        """Record a finding; take its observation out unless another GCP is as likely. Return whether it was."""
        observations, points = self.problem.observations, self.problem.block.points
        name = str(points.ids[observations.points[suspect.point]])
        image = None if suspect.row is None else observations.images[observations.image[suspect.row]].id
        what = "its ground position" if image is None else f"its measurement on image {image}"
        if suspect.same_point:
            what = "its ground position or its measurements (they cannot be told apart)"
        clear = not suspect.rivals
        if clear and suspect.row is None:
            self.survey_weight[suspect.point] = 0.0
        elif clear:
            self.verdict[suspect.row] = int(Verdict.BLUNDER)
        rivals = named(points.ids[observations.points[list(suspect.rivals)]])
        consequence = "it is left out" if clear else f"but {rivals} may be the wrong one instead: all are kept"
        message = f"GCP {name}: {what} disagrees with the rest by {suspect.statistic:.1f} sigma; {consequence}"
        self.findings.append(Finding(name, image or "ground", suspect.statistic, clear, message))
        self.warnings.append(message)
        return clear

    def with_estimated_sigmas(self, solution: Solution, progress: Progress) -> Solution:
        """Repeat the adjustment with the sigmas that its residuals show."""
        problem, observations = self.problem, self.problem.observations
        groups = Groups.of(problem.block, observations)
        sigmas = Sigmas(np.ones(len(groups.names)))
        given_image, given_survey = self.image_weight, self.survey_weight.copy()
        for _ in range(ROUNDS):
            precise = precision(problem.equations, self.loop, solution)
            sums = components(groups, observations, solution, precise)
            change = sigmas.update(sums)
            self.image_weight = sigmas.image_weight(groups, given_image)
            self.survey_weight = np.where(self.survey_weight > 0.0, sigmas.survey_weight(given_survey), 0.0)
            solution = self.solve(solution, progress)
            if change < SETTLED:
                break
        self.components = summary(groups, observations, sigmas, sums)
        self.warnings += [
            f"{part.group}: the sigma given is {'too small' if part.factor > 1.0 else 'too large'}, residuals show "
            f"{part.sigma:.3g} {part.unit} ({part.factor:.2f} times)"
            for part in self.components
            if part.estimated and not 0.67 < part.factor < 1.5
        ]
        return solution

    # ---- result ----------------------------------------------------------------------------------------------------

    def result(self, solution: Solution, precise: Precision) -> Adjustment:
        """Return the last solution in the order of the block."""
        problem, observations, block = self.problem, self.problem.observations, self.problem.block
        contributes = solution.weighting.contributes
        prior_share = np.where(
            np.isinf(self.loop.prior_weight), 1.0, problem.prior_weight * precise.parameters
        )  # fmt: skip
        observed, unknowns = self._counts(solution)
        redundancy = observed - unknowns + float(np.nan_to_num(prior_share).sum())
        squares = self.loop.sum_of_squares(solution)
        sigma0 = float(np.sqrt(squares / redundancy)) if redundancy > 0.5 else 1.0
        rows, points = observations.rows, observations.points
        placed = contributes | (observations.surveyed & (np.diff(observations.first) > 0))
        placed |= ~observations.contributing_points
        camera = observations.camera_of_image
        covariance = sigma0**2 * precise.points
        covariance[~placed] = np.nan
        kept = (solution.weight > 0.0) & placed[observations.point]
        ground = _spread(len(block.points), points, np.where(placed[:, None], solution.state.ground, np.nan))
        full_covariance = _spread(len(block.points), points, covariance)
        with np.errstate(invalid="ignore"):
            ground_sigma = np.sqrt(full_covariance.diagonal(axis1=1, axis2=2))
        residual = np.where(kept[:, None], solution.normals.residual, np.nan)
        status = "converged" if solution.converged else "stopped at the iteration limit"
        return Adjustment(
            block=block,
            model=problem.model,
            values=solution.state.values[camera],
            values_sigma=sigma0 * np.sqrt(precise.parameters[camera]),
            ground=ground,
            ground_sigma_m=ground_sigma,
            ground_covariance_m2=full_covariance,
            residual_px=_spread(len(block.measurements), rows, residual),
            weight=_spread(len(block.measurements), rows, np.where(kept, solution.factor, 0.0), 0.0),
            redundancy_numbers=_spread(len(block.measurements), rows, self._redundancy(solution, precise)),
            statistic=_spread(len(block.measurements), rows, self._statistic(solution, precise)),
            verdict=_spread(len(block.measurements), rows, self.verdict, int(Verdict.KEPT)),
            prior_share=prior_share[camera],
            sigma0=sigma0,
            observations=observed,
            unknowns=unknowns,
            redundancy=redundancy,
            converged=solution.converged,
            status=status,
            history=tuple(self.loop.history),
            solves=self.loop.solves,
            findings=tuple(self.findings),
            variance_components=self.components,
            parts=self._parts(ground_sigma, prior_share),
            warnings=(*problem.warnings, *self.warnings, *self._undetermined(prior_share)),
        )

    def _counts(self, solution: Solution) -> tuple[int, int]:
        """Return the numbers of observations and unknowns, those left out not counted."""
        observations, weighting = self.problem.observations, solution.weighting
        contributes = weighting.contributes
        rows = int(((weighting.image > 0.0) & contributes[observations.point]).sum())
        observed = 2 * rows + int(weighting.points.observed[contributes].sum())
        return observed, 3 * int(contributes.sum()) + self.loop.prior_weight.size

    def _redundancy(self, solution: Solution, precise: Precision) -> np.ndarray:
        """Return redundancy numbers ``(n, 2)``; NaN where a measurement has no say."""
        share = solution.weight[:, None] * precise.residuals[:, [0, 1], [0, 1]]
        judged = (solution.weight > 0.0) & solution.weighting.contributes[self.problem.observations.point]
        return np.where(judged[:, None], np.clip(share, 0.0, 1.0), np.nan).astype(np.float32)

    def _statistic(self, solution: Solution, precise: Precision) -> np.ndarray:
        """Return each measurement's test value in standard deviations, with the tie points' own variance factor."""
        judged = (solution.weight > 0.0) & solution.weighting.contributes[self.problem.observations.point]
        result = np.full(len(judged), np.nan, dtype=np.float32)
        if precise.cameras is not None:
            tests = deletion_tests(
                solution.normals.residual[judged], precise.residuals[judged], solution.weight[judged]
            )
            result[judged] = np.sqrt(tests / self.tie_variance)
        return result

    def _parts(self, ground_sigma: np.ndarray, prior_share: np.ndarray) -> tuple[DatumPart, ...]:
        """Return what holds each part of the block, and the mean sigmas of its points."""
        observations = self.problem.observations
        head = observations.image[observations.first[:-1]]
        sigma = ground_sigma[observations.points]
        part_of_image = np.empty(len(observations.images), dtype=np.int64)
        for number, part in enumerate(self.problem.parts):
            part_of_image[part.images] = number
        result = []
        for number, part in enumerate(self.problem.parts):
            here = sigma[(part_of_image[head] == number) & np.isfinite(sigma).all(axis=1)]
            east, north, height = np.sqrt(np.mean(here**2, axis=0)).tolist() if len(here) else (np.nan,) * 3
            share = prior_share[np.unique(observations.camera_of_image[part.images])]
            result.append(
                DatumPart(
                    tuple(observations.images[k].id for k in part.images), part.gcps, part.ties,
                    float(np.nan_to_num(share).sum()), (east, north, height),
                )
            )  # fmt: skip
        return tuple(result)

    def _undetermined(self, prior_share: np.ndarray) -> list[str]:
        """Name parameters of images with control that nevertheless come from their priors."""
        names, observations = self.problem.model.parameters, self.problem.observations
        fixed = np.isinf(self.loop.prior_weight)
        poor = (prior_share > HELD_BY_PRIOR) & ~fixed
        by_set: dict[tuple[str, ...], list[str]] = {}
        for part in self.problem.parts:
            for index in part.images if part.gcps else ():
                which = poor[observations.camera_of_image[index]]
                if which.any():
                    key = tuple(name for name, bad in zip(names, which, strict=True) if bad)
                    by_set.setdefault(key, []).append(observations.images[index].id)
        return [
            f"{', '.join(key)} of image {named(ids)} follow from their priors: the GCPs and tie points do not "
            "determine them"
            for key, ids in by_set.items()
        ]


def _spread(length: int, where: np.ndarray, values: np.ndarray, empty: float = np.nan) -> np.ndarray:
    """Return an array of ``length`` rows with ``values`` at ``where``."""
    result = np.full((length, *values.shape[1:]), empty, dtype=values.dtype)
    result[where] = values
    return result

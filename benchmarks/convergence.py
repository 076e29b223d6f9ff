"""Does every model reach its minimum, and in how many steps? `convergence.py [--docs] [NAME …]`.

All models of single images and of blocks on the real sets (HRSI_TEST_DATA, see CONTRIBUTING.md). The judge is SciPy's
``least_squares`` (trust region reflective, tolerances 1e-13), which starts at the vendor's RPCs and once more where the
engine ended: its residuals are made of `project`, the corrected camera itself, and not of the linearised equations
that the engine iterates, of which it takes the derivatives. What is printed:

steps : of all kinds, linear starts and repeated weights included; at most 30
status : what the engine says of the end
away : sqrt(2 (cost - reference)), the distance from the reference's minimum in standard deviations of one unknown;
    a model that ends lower than the reference has 0
check RMSE : px in sample and line (images), m east, north, height (blocks)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from hrsi.benchmarks import real_blocks
from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections
from hrsi.benchmarks.real_blocks import TEN, ZY3_CONTROL, check_rmse
from hrsi.benchmarks.spot5 import read_spot5
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.preparation.preparation import prepare_problem
from hrsi.hrsi_engine.adjustment.preparation.problem import Problem
from hrsi.hrsi_engine.block.block import Block, Image, Role
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.foundation.progress import silent
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.laboratory.direct_methods import DIRECT
from hrsi.hrsi_engine.refinement import MODELS
from hrsi.hrsi_engine.refinement.estimate import CONTROL_ONLY, Control, estimate
from hrsi.processing_algorithms.laboratory.direct_methods import SINGLE_IMAGE_MODELS

PAGE = DOCS / "protocols/convergence.md"
TIGHT = {"xtol": 1e-13, "ftol": 1e-13, "gtol": 1e-13, "x_scale": "jac", "max_nfev": 80}  # of the reference
PLAIN = AdjustOptions(reject_sigma=0.0, test_sigmas=False)  # one descent with the sigmas as given
AT_THE_MINIMUM = 0.1  # standard deviations of one unknown: nothing that one would see in a coordinate
ONE_PASS = ("idkf", "slss")  # pass over the points once by definition
STOPPED = "stopped at the iteration limit"
#: Where the 78 coefficients have several minima and these end in one that is not the lowest; any other is a fault.
LOCAL_MINIMA = {"SPOT 5, errors of 1000 m and 0.1 rad, 7 GCPs": ("bils", "upoe")}
TIES_OF_SPOT7 = 300  # of 115 109 for the reference, which knows nothing of sparse equations


@dataclass(frozen=True, eq=False)
class Run:
    """How one model ended: steps, status, cost and that of the reference, RMSE of the check points."""

    model: str
    steps: int
    status: str
    cost: float
    reference: float
    check: tuple[float, ...]

    @property
    def converged(self) -> bool:
        """Whether the engine says that it is at the minimum."""
        return self.status == "converged"

    @property
    def away(self) -> float:
        """Distance from the reference's minimum in sigmas, NaN without a reference."""
        return float(np.sqrt(2.0 * max(self.cost - self.reference, 0.0)))

    @property
    def is_at_minimum(self) -> bool:
        """Whether the reference has no lower place; without a reference, what the engine says."""
        return self.away <= AT_THE_MINIMUM if np.isfinite(self.reference) else self.converged

    @property
    def is_lost(self) -> bool:
        """Whether a direct method was stopped far from any minimum: how far is decided by the machine's arithmetic."""
        return self.model in DIRECT and not self.converged and self.model not in ONE_PASS and not self.is_at_minimum

    def row(self) -> list[str]:
        """Return the cells of the table."""
        if self.is_lost:
            return [self.model, str(self.steps), STOPPED, "", f"> {AT_THE_MINIMUM}", ""]
        numbers = " ".join(f"{value:.3f}" for value in self.check)
        known = np.isfinite(self.reference)
        return [
            self.model, str(self.steps), self.status, f"{self.cost:.6g}",
            f"{self.away:.3f}" if known else "", numbers,
        ]  # fmt: skip


# ---- single images -------------------------------------------------------------------------------------------------


def run_image(image: Image, control: Control, check: Control, name: str) -> Run:
    """Return how a model of one image ends, and where SciPy does."""
    model = SINGLE_IMAGE_MODELS[name]
    found = estimate(model, image, control)
    sigmas = model.prior_sigmas(image, CONTROL_ONLY)
    usable = sigmas > 0.0

    def residuals(scaled: np.ndarray) -> np.ndarray:
        missed = control.xy - model.project(image, sigmas * scaled, control.ground)
        missed = np.where(np.isfinite(missed), missed, 1e6)  # where the model has no answer
        return np.concatenate([np.einsum("nij,nj->ni", found.roots, missed).ravel(), scaled])

    linearise = model.equations(image, control.xy)

    def jacobian(scaled: np.ndarray) -> np.ndarray:
        by_values = linearise(sigmas * scaled, control.ground).by_values * sigmas
        slopes = -(found.roots @ by_values).reshape(2 * len(control), -1)
        return np.vstack([np.where(np.isfinite(slopes), slopes, 0.0), np.eye(len(sigmas))])

    ours = np.divide(found.values, sigmas, out=np.zeros(len(sigmas)), where=usable)
    cost = 0.5 * float(np.sum(residuals(ours) ** 2))
    reference = cost
    if len(sigmas):
        starts = (np.zeros(len(sigmas)), ours)
        reference = min(float(least_squares(residuals, start, jac=jacobian, **TIGHT).cost) for start in starts)
    missed = check.xy - model.project(image, found.values, check.ground)
    rmse = np.sqrt(np.mean(missed**2, axis=0)) if len(check) else np.zeros(0)
    return Run(name, found.iterations, found.status, cost, reference, tuple(rmse.tolist()))


def control_of(block: Block, image: int, role: Role) -> Control:
    """Return the points of a role that are measured on an image."""
    measured = block.measurements
    rows = np.flatnonzero((measured.image == image) & (block.points.role[measured.point] == role))
    points = measured.point[rows]
    return Control(block.points.ground[points], measured.xy[rows], block.points.ids[points], measured.sigma_px[rows])


def images() -> Iterator[tuple[str, Image, Control, Control]]:
    """Yield the images with their control and check points."""
    for title, make in (("Hobart", real_blocks.hobart), ("ZY-3", real_blocks.zy3), ("QuickBird-2", quickbird)):
        block = make()
        for number, image in enumerate(block.images):
            control, check = (control_of(block, number, role) for role in (Role.GCP, Role.CHECK))
            yield f"{title}, image {image.id}, {len(control)} GCPs", image, control, check
    spot5 = read_spot5(real_blocks.DATA / "thesis")
    for case, title in ((0, "SPOT 5"), (1, "SPOT 5, errors of 1000 m and 0.1 rad")):
        for count in (3, 7, 37):
            yield f"{title}, {count} GCPs", spot5.image(case), *spot5.control(count)


def quickbird() -> Block:
    """Return the QuickBird-2 image."""
    return real_blocks.quickbird()


# ---- blocks --------------------------------------------------------------------------------------------------------


def run_block(block: Block, options: AdjustOptions, name: str, judged: bool = True) -> Run:
    """Return how a model of a block ends, and where SciPy does."""
    options = replace(options, model=name)
    problem = prepare_problem(block, options)
    loop = problem.loop()
    ended = loop.iterate(problem.start, problem.weighting, options.robust, options.tolerance, silent)
    reference = np.nan
    if judged:
        from_vendor, from_ours = (_reference(problem, *state) for state in (problem.start, ended.state))
        reference = min(from_vendor, from_ours)
    check = check_rmse(adjust(block, options)) if (block.points.role == Role.CHECK).any() else np.zeros(0)
    return Run(name, len(loop.history), ended.status, ended.cost, reference, tuple(check.tolist()))


def _reference(problem: Problem, values: np.ndarray, ground: np.ndarray) -> float:
    """Return the cost at the minimum that SciPy finds from a state; the Jacobian is the engine's, the cost is not."""
    observations, camera = problem.observations, problem.camera
    sees = problem.weighting.contributes
    rows = np.flatnonzero(sees[observations.point])
    number = np.cumsum(sees) - 1  # of a point among those that count
    root = np.sqrt(problem.weighting.image[rows])
    prior = np.sqrt(np.where(np.isinf(problem.prior_weight), 0.0, problem.prior_weight))
    free = np.isfinite(problem.prior_weight).ravel()
    held = problem.weighting.points
    held_root = np.sqrt(np.where(held.observed, held.weight, 0.0))[sees]
    count, p = prior.shape

    def state(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moved = ground.copy()
        moved[sees] = move_ground(ground[sees], x[count * p :].reshape(-1, 3))
        return values + np.where(free, x[: count * p], 0.0).reshape(count, p), moved

    def residuals(x: np.ndarray) -> np.ndarray:
        at, moved = state(x)
        missed = np.empty((len(rows), 2))
        for index, image in enumerate(observations.images):
            here = observations.image[rows] == index
            computed = camera.project(
                image, at[observations.camera_of_image[index]], moved[observations.point[rows[here]]]
            )
            missed[here] = observations.xy[rows[here]] - computed
        missed = np.where(np.isfinite(missed), missed, 1e6)
        points = held.compute_misclosures_m(moved[sees], np.flatnonzero(sees))
        return np.concatenate([(root[:, None] * missed).ravel(), (prior * at).ravel(), (held_root * points).ravel()])

    def jacobian(x: np.ndarray) -> np.ndarray:
        at, moved = state(x)
        table = np.zeros((2 * len(rows), len(x)))
        for index, image in enumerate(observations.images):
            here = np.flatnonzero(observations.image[rows] == index)
            if not len(here):
                continue
            unknown = observations.camera_of_image[index]
            of = observations.point[rows[here]]
            equations = camera.equations(image, observations.xy[rows[here]])(at[unknown], moved[of])
            for axis in range(2):
                table[(2 * here + axis)[:, None], unknown * p + np.arange(p)] = -equations.by_values[:, axis]
                place = count * p + 3 * number[of][:, None] + np.arange(3)
                table[(2 * here + axis)[:, None], place] = -equations.by_ground[:, axis]
        table *= np.repeat(root, 2)[:, None]
        table[:, : count * p][:, ~free] = 0.0
        own = np.hstack([np.diag(prior.ravel()), np.zeros((count * p, len(x) - count * p))])
        points = np.hstack([np.zeros((held_root.size, count * p)), -np.diag(held_root.ravel())])
        return np.vstack([table, own, points])

    start = np.zeros(count * p + 3 * int(sees.sum()))
    return float(least_squares(residuals, start, jac=jacobian, method="trf", **TIGHT).cost)


def blocks() -> Iterator[tuple[str, Block, AdjustOptions, bool]]:
    """Yield the blocks, how they are adjusted, and whether the reference is for them."""
    ties = replace(PLAIN, check_as_ties=True)
    for count in (1, 3, 10):
        yield f"Hobart, IKONOS triplet, {count} GCPs", real_blocks.hobart(TEN[:count]), ties, True
    for count in (1, 3, 7):
        yield f"ZY-3 pair, {count} GCPs", real_blocks.zy3(ZY3_CONTROL[:count]), ties, True
    yield "QuickBird-2, one image, 5 GCPs", quickbird(), PLAIN, True
    spot7 = real_blocks.spot7()
    some = spot7.measurements.point < np.unique(spot7.measurements.point)[TIES_OF_SPOT7]
    yield f"SPOT 7 pair, {TIES_OF_SPOT7} tie points", spot7.with_measurements(some), PLAIN, True
    yield "SPOT 7 pair, 115 109 tie points", spot7, PLAIN, False


# ---- output --------------------------------------------------------------------------------------------------------


def runs(names: Sequence[str]) -> Iterator[tuple[str, list[Run], list[str]]]:
    """Yield each set's title with the runs of all models, and what models say that do not begin."""
    chosen: Callable[[str], bool] = lambda title: not names or any(name in title for name in names)  # noqa: E731
    for title, image, control, check in images():
        if chosen(title):
            yield (title, *_each(SINGLE_IMAGE_MODELS, partial(run_image, image, control, check), len(control)))
    for title, block, options, judged in blocks():
        if chosen(title):
            yield (title, *_each(MODELS, partial(run_block, block, options, judged=judged), None))


def _each(models: dict, run: Callable[[str], Run], points: int | None) -> tuple[list[Run], list[str]]:
    """Return the runs of the models that the points are enough for, and what the others say."""
    done, refused = [], []
    for name, model in models.items():
        if points is not None and points < model.least_points:
            refused.append(f"{name}: needs {model.least_points} GCPs")
            continue
        try:
            done.append(run(name))
        except HrsiError as error:
            refused.append(f"{name}: {error}")
    return done, refused


HEAD = ("model", "iterations", "status", "cost", "away, sigma", "check RMSE")


def summary(found: Sequence[Run]) -> list[str]:
    """Return the row of a set in the overview."""
    ended = [run for run in found if run.model not in ONE_PASS]
    steps = [run.steps for run in ended]
    missed = [
        f"{run.model} ({STOPPED})" if run.is_lost else f"{run.model} ({run.away:.2g} sigma, {run.status})"
        for run in ended if not run.is_at_minimum
    ]  # fmt: skip
    away = max((run.away for run in ended if run.is_at_minimum and np.isfinite(run.reference)), default=float("nan"))
    return [str(len(found)), f"{np.median(steps):.0f}", str(max(steps)), ", ".join(missed) or "none", f"{away:.3f}"]


def main() -> int:
    """Print the tables, ``--docs`` writes the page; return 1 where a model misses its minimum."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("names", nargs="*", help="parts of titles; default: all sets")
    words = parser.parse_args()
    if words.docs and words.names:
        parser.error("--docs writes all tables: leave the names out")
    overview, sections, wrong = [], {}, []
    for title, found, refused in runs(words.names):
        known = (*ONE_PASS, *LOCAL_MINIMA.get(title, ()))
        wrong += [f"{title}: {run.model}" for run in found if not run.is_at_minimum and run.model not in known]
        overview.append([title, *summary(found)])
        lines = [render(HEAD, [run.row() for run in found])]
        lines += ["", "Not estimated:", "", *(f"* {text}" for text in refused)] if refused else []
        sections[title] = "\n".join(lines)
        print(f"## {title}\n\n{sections[title]}\n", flush=True)
    head = (
        "set", "models", "iterations, median", "most", "not at the minimum", "largest distance of the others, sigma",
    )  # fmt: skip
    table = render(head, overview)
    print(table)
    if words.docs:
        write_sections(PAGE, {"": table} | sections)
    print("\n".join(f"not at the minimum, and it should be: {one}" for one in wrong))
    return int(bool(wrong))


if __name__ == "__main__":
    raise SystemExit(main())

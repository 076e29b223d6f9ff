"""Does the model that is chosen predict as well as a shift? `accuracy.py models [NAME …] [--seeds N] [--docs]`.

Every real block is adjusted with the models of `MODELS_COMPARED`, with several numbers of GCPs and several draws of
them. Judges are points that took no part: surveyed check points (those on one image by where their ray meets the known
height) or, in blocks without any survey, tie points held apart, by how well their rays meet. Blocks of
`sigma_coverage`, of which the truth is known, are added.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import stats

from hrsi.benchmarks import real_blocks, sigma_coverage, spot5
from hrsi.benchmarks.clean_verdicts import REAL
from hrsi.benchmarks.pages import DOCS, make_parser, read_rows, render, write_sections
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, ImagePoints, Role
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.refinement.selection import RULES
from hrsi.hrsi_engine.results.residuals import compute_residuals

PAGE = DOCS / "protocols/accuracy_models.md"
MODELS_COMPARED = ("shift", "affine", "auto")
DRAWS = 6
SIGNIFICANCE = 0.01  # one-sided, of a difference to the shift that is called worse
MATERIAL = 0.02  # … and this share of the shift's error at least


@dataclass(frozen=True)
class Outcome:
    """One adjustment: RMSE of the judges and what was predicted (m, or px of ties), the model and how it ended."""

    found: np.ndarray
    predicted: np.ndarray
    model: str
    sigma0: float
    solves: int
    converged: bool
    cpu_s: float


def adjusted(block: Block, model: str) -> tuple[Adjustment, float]:
    """Return an adjustment with the command's other defaults, and its processor seconds."""
    began = time.process_time()
    result = adjust(block, AdjustOptions(model=model))
    return result, time.process_time() - began


def judge_by_survey(block: Block, model: str) -> Outcome:
    """Adjust a block; its check points judge, east, north and height."""
    result, seconds = adjusted(block, model)
    left, check = compute_residuals(result), block.points.role == Role.CHECK
    return Outcome(_rms(left.ground_m[check]), _rms(left.ground_sigma_m[check]), *_how(result), seconds)


def judge_by_ties(block: Block, apart: np.ndarray, model: str) -> Outcome:
    """Adjust a block without some tie points ``apart (points,)``; these judge, by how well their rays meet."""
    result, seconds = adjusted(block.with_measurements(~apart[block.measurements.point]), model)
    refined = [
        replace(image, rpc=result.model.compute_refined_rpc(image, values).rpc)
        for image, values in zip(block.images, result.values, strict=True)
    ]
    held = replace(block.with_measurements(apart[block.measurements.point]), images=refined)
    meeting = adjust(held, AdjustOptions(model="none", reject_sigma=0.0))
    nothing = np.full(1, np.nan)
    return Outcome(np.array([real_blocks.tie_rmse(meeting)]), nothing, *_how(result), seconds)


def _rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean squares of columns, NaN where nothing was compared."""
    known = np.isfinite(values)
    squares = np.where(known, values, 0.0) ** 2
    return np.sqrt(np.where(known.any(axis=0), squares.sum(axis=0) / np.maximum(known.sum(axis=0), 1), np.nan))


def _how(result: Adjustment) -> tuple[str, float, int, bool]:
    return result.model.name, result.sigma0, result.solves, result.converged


# ---- blocks --------------------------------------------------------------------------------------------------------


def with_control(block: Block, ids: Sequence[str]) -> Block:
    """Return a surveyed block in which only the named points are GCPs, and all others check points."""
    known = block.points.role != Role.TIE
    role = np.where(known, np.where(np.isin(block.points.ids, ids), Role.GCP, Role.CHECK), block.points.role)
    return replace(block, points=replace(block.points, role=role.astype(block.points.role.dtype)))


def draws_of_control(block: Block, count: int) -> Iterator[Block]:
    """Yield the block with GCPs drawn at random, far from each other, from the points that all images show."""
    surveyed = np.flatnonzero(block.points.role != Role.TIE)
    rays = block.rays_per_point()[surveyed]
    candidates = surveyed[rays >= min(len(block.images), 2)]
    place = block.points.ground[candidates, :2]
    for draw in range(DRAWS if count else 1):
        rng = np.random.default_rng([draw, count])
        chosen = [int(rng.integers(len(candidates)))] if count else []
        while len(chosen) < count:
            drawn = np.setdiff1d(rng.permutation(len(candidates))[:12], chosen)
            if len(drawn):
                apart = np.linalg.norm(place[drawn][:, None] - place[chosen][None], axis=2).min(axis=1)
                chosen.append(int(drawn[np.argmax(apart)]))
        yield with_control(block, block.points.ids[candidates[chosen]].tolist())


def spot5_block() -> Block:
    """Return the SPOT 5 image of the thesis, simulated with its 37 GCPs and their printed residuals."""
    found = spot5.read_spot5(real_blocks.DATA / "thesis")
    image = found.image(0)
    ground = GroundPoints(found.ids, found.ground, np.full(len(found.ids), int(Role.GCP)))
    measured = ImagePoints(found.ids, [image.id] * len(found.ids), found.observed_px, spot5.SIGMA_PX)
    return assemble([image], [ground], [measured])


#: Blocks with surveyed points, and the numbers of GCPs.
SURVEYED: dict[str, tuple[Callable[[], Block], tuple[int, ...]]] = {
    "Hobart, IKONOS triplet": (real_blocks.hobart, (0, 1, 2, 3, 4, 6, 10, 20)),
    "ZY-3 pair": (real_blocks.zy3, (0, 1, 2, 3, 4, 6, 7, 10, 20)),
    "QuickBird-2, 1 image": (real_blocks.quickbird, (1, 2, 3, 4)),
    "SPOT 5, 1 image": (spot5_block, (1, 2, 3, 4, 6, 7, 10, 20)),
}
#: Blocks with tie points only.
TIED = tuple(name for name in REAL if name not in ("Hobart, IKONOS, 10 GCPs", "ZY-3, 7 GCPs", "QuickBird-2, 5 GCPs"))


def surveyed(name: str) -> Iterator[tuple[str, list[dict[str, Outcome]]]]:
    """Yield a label and the outcomes of each draw, for each number of GCPs."""
    make, counts = SURVEYED[name]
    block = make()
    for count in counts:
        label = f"{name}, {count} GCP{'s' if count != 1 else ''}"
        yield label, [compared(judge_by_survey, one) for one in draws_of_control(block, count)]


def tied(name: str) -> Iterator[tuple[str, list[dict[str, Outcome]]]]:
    """Yield a label and the outcomes of draws of half of the tie points, without those that snooping leaves out."""
    block = REAL[name]()
    block = block.with_measurements(adjust(block, AdjustOptions(model="affine")).decision == 0)
    block = block.with_measurements((block.rays_per_point() >= 2)[block.measurements.point])
    drawn = [np.random.default_rng(draw).random(len(block.points)) < 0.5 for draw in range(DRAWS)]
    yield f"{name}, no GCP", [compared(judge_by_ties, block, apart) for apart in drawn]


def simulated(name: str, seeds: range) -> Iterator[tuple[str, list[dict[str, Outcome]]]]:
    """Yield a label and the outcomes of simulated blocks of a kind."""
    kind = sigma_coverage.CONFIGURATIONS[name]
    yield name, [compared(judge_by_survey, sigma_coverage.simulate(kind, seed)[0]) for seed in seeds]


def compared(judge: Callable[..., Outcome], *block: object) -> dict[str, Outcome]:
    """Return the outcomes of one block by model; those that have too few points for a model are missing."""
    found = {}
    for model in MODELS_COMPARED:
        try:
            found[model] = judge(*block, model)
        except HrsiError:
            continue
    return found


# ---- tables --------------------------------------------------------------------------------------------------------

HEAD = (
    "block", "model", "RMSE E N H, m (tie points: px)", "predicted", "chosen", "sigma0", "systems", "CPU s",
    "relative to shift",
)  # fmt: skip


def rows_of(label: str, draws: Sequence[dict[str, Outcome]]) -> list[list[str]]:
    """Return the rows of one block and number of GCPs, root mean squares over the draws."""
    rows = []
    for model in MODELS_COMPARED:
        found = [one[model] for one in draws if model in one]
        if not found:
            continue
        chosen = Counter(one.model for one in found)
        names = ", ".join(f"{name} {times}" for name, times in chosen.most_common()) if model in RULES else ""
        lost = sum(not one.converged for one in found)
        rows.append([
            f"{label}, {len(found)} x" if not rows else "", model, _numbers([one.found for one in found]),
            _numbers([one.predicted for one in found]), names, f"{np.median([one.sigma0 for one in found]):.2f}",
            f"{np.mean([one.solves for one in found]):.1f}" + (f", {lost} not converged" if lost else ""),
            f"{np.mean([one.cpu_s for one in found]):.2f}", _against_shift(model, draws),
        ])  # fmt: skip
    return rows


def _numbers(values: Sequence[np.ndarray]) -> str:
    rms = np.sqrt(np.mean(np.square(values), axis=0))
    return " ".join("" if np.isnan(value) else f"{value:.3f}" for value in rms)


def _against_shift(model: str, draws: Sequence[dict[str, Outcome]]) -> str:
    """Return by how many per cent a model's errors differ from the shift's, and whether that is beyond chance."""
    both = [(one[model].found, one["shift"].found) for one in draws if model in one and "shift" in one]
    if model == "shift" or not both:
        return ""
    own, shift = (np.array(side) for side in zip(*both, strict=True))
    said = []
    for axis in range(own.shape[1]):
        if np.isnan(shift[:, axis]).any():
            continue
        ratio = np.sqrt(np.mean(own[:, axis] ** 2) / np.mean(shift[:, axis] ** 2))
        sure = ""
        if len(own) > 2 and np.ptp(own[:, axis] - shift[:, axis]) > 0.0:
            test = stats.ttest_rel(own[:, axis], shift[:, axis])
            low = stats.t.sf(abs(test.statistic), len(own) - 1) < SIGNIFICANCE and abs(ratio - 1.0) > MATERIAL
            sure = ("!" if ratio > 1.0 else "*") if low else ""
        said.append(f"{100.0 * (ratio - 1.0):+.1f}{sure}")
    return " ".join(said)


@cache
def subjects(seeds: int) -> dict[str, Callable[[], Iterator[tuple[str, list[dict[str, Outcome]]]]]]:
    """Return what can be asked for by name."""
    return {
        **{name: (lambda name=name: surveyed(name)) for name in SURVEYED},
        **{name: (lambda name=name: tied(name)) for name in TIED},
        **{
            name: (lambda name=name: simulated(name, range(seeds))) for name in sigma_coverage.CONFIGURATIONS if seeds
        },
    }  # fmt: skip


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)  # which keeps the rows of other blocks
    parser.add_argument("names", nargs="*", help="words of the blocks' names; default: all")
    parser.add_argument("--seeds", type=int, default=12, help="of simulated blocks")
    options = parser.parse_args(words)
    made: dict[str, list[list[str]]] = {}  # by block and number of GCPs
    for name, make in subjects(options.seeds).items():
        if options.names and not any(word.lower() in name.lower() for word in options.names):
            continue
        for label, draws in make():
            own = rows_of(label, draws)
            print(render(HEAD, own), flush=True)
            made[own[0][0]] = own
    if options.docs:
        shown = read_page() | made if options.names else made
        rows = [row for own in shown.values() for row in own]
        write_sections(PAGE, {"": render(HEAD, rows)})


def read_page() -> dict[str, list[list[str]]]:
    """Return the rows that the page shows, by block and number of GCPs."""
    found: dict[str, list[list[str]]] = {}
    label = ""
    for row in read_rows(PAGE):
        label = row[0] or label
        found.setdefault(label, []).append(row)
    return found


if __name__ == "__main__":
    main()

"""How many blunders are found, their effect on accuracy, and false reports: `blunders.py [PART …] [--docs]`.

Parts: ``ties`` (5 to 40 % wrong tie measurements), ``control`` (wrong GCPs), ``sigmas`` (wrong GCPs whose sigmas are
unequal, or serve for height or plan only), ``clean`` (nothing wrong). Simulated blocks with known truth, the command
line's defaults (`--reject 4`). Seeds from 2000 on were never looked at while
thresholds were chosen; ``--seeds 0 20`` takes others. ``--docs`` writes
docs/protocols/accuracy_blunders.md.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import special, stats

from hrsi.benchmarks.adjust_speed import visible_sigmas
from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Adjustment, Decision
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    Noise,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)

PAGE = DOCS / "protocols/accuracy_blunders.md"
TESTED = AdjustOptions(reject_sigma=4.0)  # as the command line does
SHOWN = 10.0  # sigmas in its own residual from which a blunder must be found
Section = tuple[str, Sequence[str], list[list[str]]]  # title, head, rows


@cache
def simulated(sensor: str, images: int, ties: int, checks: int, seed: int) -> tuple[Block, np.ndarray]:
    """Return a clean block with 10 GCPs, and its true ground points."""
    views = make_along_track_views(SENSORS[sensor], images, (12000, 12000))
    made = simulate_block(SceneSpec(seed=seed), views, PointCounts(10, checks, ties), Noise())
    return made.block, made.truth.ground


def with_gcps(block: Block, count: int) -> Block:
    """Return the block with its first GCPs only; the others become check points."""
    role = block.points.role.copy()
    role[np.flatnonzero(role == Role.GCP)[count:]] = Role.CHECK
    return replace(block, points=replace(block.points, role=role))


def check_squares(result: Adjustment, truth: np.ndarray) -> np.ndarray:
    """Return the mean squared errors of the check points, east, north, height (m²)."""
    check = result.block.points.role == Role.CHECK
    return np.nanmean(ground_difference_m(truth[check], result.ground[check]) ** 2, axis=0)


# ---- ties ----------------------------------------------------------------------------------------------------------


def with_wrong_ties(block: Block, share: float, size_px: float, seed: int) -> tuple[Block, np.ndarray, np.ndarray]:
    """Return the block with a share of its tie measurements moved in any direction, their rows and errors."""
    rng = np.random.default_rng([seed, 77])
    ties = np.flatnonzero(block.points.role[block.measurements.point] == Role.TIE)
    rows = np.sort(rng.choice(ties, round(share * len(ties)), replace=False))
    angle = rng.uniform(0.0, 2.0 * np.pi, len(rows))
    error = size_px * np.column_stack([np.cos(angle), np.sin(angle)])
    xy = block.measurements.xy.copy()
    xy[rows] += error
    return replace(block, measurements=replace(block.measurements, xy=xy)), rows, error


def detectable(block: Block, clean: Adjustment, rows: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return the probability that a test of its point alone notices each wrong measurement ``(k,)``, cameras known.

    All wrong measurements of a point count together: on two rays two errors across the epipolar line may cancel, and
    then nothing shows. The sum of squares of k rays is chi² with 2 k - 3 degrees of freedom, non-central by the errors.
    """
    measured = block.measurements
    by_ground = np.empty((len(measured), 2, 3))
    for index, image in enumerate(block.images):
        here = np.flatnonzero(measured.image == index)
        by_ground[here] = image.rpc.project_with_metric_jacobian(clean.ground[measured.point[here]])[1]
    normal, pulled = np.zeros((len(block.points), 3, 3)), np.zeros((len(block.points), 3))
    np.add.at(normal, measured.point, by_ground.swapaxes(1, 2) @ by_ground)
    np.add.at(pulled, measured.point[rows], np.einsum("nci,nc->ni", by_ground[rows], error))
    squares = np.bincount(measured.point[rows], (error**2).sum(axis=1), minlength=len(normal))
    points = np.unique(measured.point[rows])
    seen = np.einsum("ni,nij,nj->n", pulled[points], np.linalg.inv(normal[points]), pulled[points])
    shown = np.zeros(len(normal))
    shown[points] = np.maximum(squares[points] - seen, 0.0)
    freedom = 2 * block.rays_per_point()[measured.point[rows]] - 3
    limit = special.chdtri(freedom, np.exp(-0.5 * TESTED.reject_sigma**2))
    return np.asarray(stats.ncx2.sf(limit, freedom, shown[measured.point[rows]] / measured.sigma_px[rows] ** 2))


@dataclass
class TieScore:
    """Counts over blocks.

    Wrong measurements that show, those left out, and how many a test of each point by itself would notice; good ones of
    points without any wrong one, and alarms among them; good ones, those left out, and those called blunders.
    """

    shown: int = 0
    found: int = 0
    noticed: float = 0.0
    right: int = 0
    alarms: int = 0
    good: int = 0
    lost: int = 0
    named: int = 0

    def add(self, block: Block, clean: Adjustment, result: Adjustment, rows: np.ndarray, error: np.ndarray) -> None:
        """Count one block."""
        shown = visible_sigmas(block, clean, rows, error) > SHOWN
        out = result.decision != Decision.KEPT
        wrong = np.zeros(len(out), dtype=bool)
        wrong[rows] = True
        touched = np.zeros(len(block.points), dtype=bool)
        touched[block.measurements.point[rows]] = True
        role = block.points.role[block.measurements.point]
        untouched = ~touched[block.measurements.point] & (role == Role.TIE)
        self.shown += int(shown.sum())
        self.found += int(out[rows][shown].sum())
        self.noticed += float(detectable(block, clean, rows, error)[shown].sum())
        self.good += int((~wrong & (role == Role.TIE)).sum())
        self.lost += int((out & ~wrong & (role == Role.TIE)).sum())
        self.right += int(untouched.sum())
        self.alarms += int((out & untouched).sum())
        self.named += int(((result.decision == Decision.BLUNDER) & ~wrong).sum())


def wrong_ties(seeds: Sequence[int]) -> Section:
    """Return what becomes of wrong tie measurements."""
    rows = []
    for rays in (2, 3, 5):
        blocks = [simulated("ikonos", rays, 400, 60, seed) for seed in seeds]
        cleans = [adjust(block, TESTED) for block, _ in blocks]
        base = np.mean([check_squares(clean, truth) for clean, (_, truth) in zip(cleans, blocks, strict=True)], axis=0)
        for size in (10.0, 30.0):
            for share in (0.05, 0.1, 0.2, 0.3, 0.4):
                score, squares, findings = TieScore(), [], 0
                for seed, (block, truth), clean in zip(seeds, blocks, cleans, strict=True):
                    bad, wrong, error = with_wrong_ties(block, share, size, seed)
                    result = adjust(bad, TESTED)
                    score.add(bad, clean, result, wrong, error)
                    squares.append(check_squares(result, truth))
                    findings += len(result.findings)
                change = 100.0 * (np.sqrt(np.mean(squares, axis=0) / base) - 1.0)
                rows.append([
                    str(rays), f"{size:g}", f"{share:.0%}", f"{score.found / max(score.shown, 1):.2%}",
                    f"{score.noticed / max(score.shown, 1):.2%}",
                    " ".join(f"{value:+.1f}" for value in change), f"{score.alarms / max(score.right, 1):.3%}",
                    f"{score.lost / score.good:.1%}", str(score.named), str(findings),
                ])  # fmt: skip
    head = (
        "rays", "px", "wrong", "rejected", "noticeable", "check RMSE, %", "false alarms", "lost", "reported",
        "GCPs reported",
    )  # fmt: skip
    return "Wrong tie measurements", head, rows


# ---- control -------------------------------------------------------------------------------------------------------


def wrong_heights(block: Block, rows: np.ndarray, rng: np.random.Generator) -> Block:
    """Return the block with heights of GCPs wrong by 25 m, all in one direction."""
    return _moved(block, rows, np.tile([0.0, 0.0, 25.0 * rng.choice([-1.0, 1.0])], (len(rows), 1)))


def mixed_heights(block: Block, rows: np.ndarray, rng: np.random.Generator) -> Block:
    """Return the block with heights of GCPs wrong by 10 to 30 m, up or down."""
    height = rng.uniform(10.0, 30.0, len(rows)) * rng.choice([-1.0, 1.0], len(rows))
    return _moved(block, rows, np.column_stack([np.zeros((len(rows), 2)), height]))


def wrong_plan(block: Block, rows: np.ndarray, rng: np.random.Generator) -> Block:
    """Return the block with GCPs 20 m away in any direction."""
    angle = rng.uniform(0.0, 2.0 * np.pi, len(rows))
    return _moved(block, rows, 20.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(rows))]))


def wrong_measurement(block: Block, rows: np.ndarray, rng: np.random.Generator) -> Block:
    """Return the block with one measurement of each of some GCPs 30 px away in any direction."""
    xy = block.measurements.xy.copy()
    for row in rows:
        one = rng.choice(np.flatnonzero(block.measurements.point == row))
        angle = rng.uniform(0.0, 2.0 * np.pi)
        xy[one] += 30.0 * np.array([np.cos(angle), np.sin(angle)])
    return replace(block, measurements=replace(block.measurements, xy=xy))


def _moved(block: Block, rows: np.ndarray, metres: np.ndarray) -> Block:
    ground = block.points.ground.copy()
    ground[rows] = move_ground(ground[rows], metres)
    return replace(block, points=replace(block.points, ground=ground))


MISTAKES: dict[str, Callable[[Block, np.ndarray, np.random.Generator], Block]] = {
    "heights, all 25 m": wrong_heights,
    "heights, 10 to 30 m": mixed_heights,
    "plan, 20 m": wrong_plan,
    "a measurement, 30 px": wrong_measurement,
}


def wrong_control(seeds: Sequence[int]) -> Section:
    """Return how many of the wrong GCPs are named, and how many others."""
    rows = []
    for sensor, images in (("ikonos", 3), ("pleiades", 2), ("quickbird", 3)):
        for gcps, wrong in ((6, 1), (6, 2), (10, 2), (10, 3)):
            for what, spoil in MISTAKES.items():
                named, right_kind, falsely, undecided = 0, 0, 0, 0
                for seed in seeds:
                    block = with_gcps(simulated(sensor, images, 200, 20, seed)[0], gcps)
                    rng = np.random.default_rng([seed, 78])
                    control = np.flatnonzero(block.points.role == Role.GCP)
                    chosen = np.sort(rng.choice(control, wrong, replace=False))
                    result = adjust(spoil(block, chosen, rng), TESTED)
                    ids = set(block.points.ids[chosen].tolist())
                    found = {finding.id: finding for finding in result.findings if finding.left_out}
                    named += len(ids & set(found))
                    falsely += bool(set(found) - ids)
                    undecided += bool([finding for finding in result.findings if not finding.left_out])
                    right_kind += sum(_right_kind(what, found[name].what) for name in ids & set(found))
                rows.append([
                    f"{sensor}, {images}", f"{wrong} of {gcps}", what, f"{named / (wrong * len(seeds)):.1%}",
                    f"{right_kind / max(named, 1):.0%}", str(falsely), str(undecided),
                ])  # fmt: skip
    head = ("sensor, images", "wrong GCPs", "error", "reported", "kind", "false reports", "undecided")
    return "Wrong GCPs", head, rows


def masked_control(seeds: Sequence[int]) -> Section:
    """Return how many wrong GCPs are named where not all coordinates of all GCPs weigh alike."""
    rows = []
    for sensor, images in (("ikonos", 3), ("pleiades", 2)):
        for gcps, wrong in ((6, 1), (10, 2)):
            for stated, state, what in MASKED:
                named, falsely, undecided = 0, 0, 0
                for seed in seeds:
                    block = state(with_gcps(simulated(sensor, images, 200, 20, seed)[0], gcps))
                    rng = np.random.default_rng([seed, 79])
                    control = np.flatnonzero(block.points.role == Role.GCP)
                    sharp = control[block.points.sigma_m[control].min(axis=1) < 1.0]  # the others' errors hide in 20 m
                    chosen = np.sort(rng.choice(sharp, wrong, replace=False))
                    result = adjust(MISTAKES[what](block, chosen, rng), TESTED)
                    ids = set(block.points.ids[chosen].tolist())
                    found = {finding.id for finding in result.findings if finding.left_out}
                    named += len(ids & found)
                    falsely += bool(found - ids)
                    undecided += any(not finding.left_out for finding in result.findings)
                rows.append([
                    f"{sensor}, {images}", f"{wrong} of {gcps}", stated, what, f"{named / (wrong * len(seeds)):.1%}",
                    str(falsely), str(undecided),
                ])  # fmt: skip
    head = ("sensor, images", "wrong GCPs", "sigmas", "error", "reported", "false reports", "undecided")
    return "Wrong GCPs of unequal sigmas", head, rows


def _right_kind(mistake: str, what: str) -> bool:
    kind = what if what in ("height", "ground") else "measurement"
    return kind == {"h": "height", "p": "ground", "a": "measurement"}[mistake[0]]


# ---- clean blocks --------------------------------------------------------------------------------------------------


def height_control(block: Block) -> Block:
    """Return the block whose GCPs are height control: 1000 m in plan."""
    return _with_sigmas(block, 1000.0, 0.3)


def unequal_control(block: Block) -> Block:
    """Return the block with GCPs of 0.2 m and of 20 m in turn, their errors as large."""
    control = np.flatnonzero(block.points.role == Role.GCP)[1::2]
    rng = np.random.default_rng(int(1e4 * abs(block.points.ground[control[0], 0])))
    far = _moved(block, control, rng.normal(0.0, 20.0, (len(control), 3)))
    sigma = far.points.sigma_m.copy()
    sigma[control] = 20.0
    return replace(far, points=replace(far.points, sigma_m=sigma))


def flattered_control(block: Block) -> Block:
    """Return the block whose GCPs' sigmas are stated five times too small."""
    return _with_sigmas(block, 0.02, 0.03)


def _with_sigmas(block: Block, plan_m: float, height_m: float) -> Block:
    sigma = block.points.sigma_m.copy()
    sigma[block.points.role == Role.GCP] = plan_m, height_m
    return replace(block, points=replace(block.points, sigma_m=sigma))


def plan_control(block: Block) -> Block:
    """Return the block whose GCPs are plan control: 1000 m in height."""
    return _with_sigmas(block, 0.2, 1000.0)


CLEAN = (("ikonos", 3), ("pleiades", 3), ("quickbird", 3), ("worldview-2", 2), ("spot5", 2))
AS_STATED: dict[str, Callable[[Block], Block]] = {
    "as simulated": lambda block: block,
    "1000 m in plan": height_control,
    "1000 m in height": plan_control,
    "0.2 and 20 m": unequal_control,
    "stated 5 x too small": flattered_control,
}


#: Sigmas that hide something, and the mistake that they must not hide.
MASKED: tuple[tuple[str, Callable[[Block], Block], str], ...] = (
    ("1000 m in plan", height_control, "heights, all 25 m"),
    ("1000 m in height", plan_control, "plan, 20 m"),
    ("0.2 and 20 m", unequal_control, "heights, all 25 m"),
    ("0.2 and 20 m", unequal_control, "plan, 20 m"),
    ("stated 5 x too small", flattered_control, "heights, all 25 m"),
    ("stated 5 x too small", flattered_control, "plan, 20 m"),
)


def clean_blocks(seeds: Sequence[int]) -> Section:
    """Return who is accused in blocks where nothing is wrong."""
    rows = []
    for what, state in AS_STATED.items():
        accused, tied = 0, 0
        for seed in seeds:
            sensor, images = CLEAN[seed % len(CLEAN)]
            block = with_gcps(simulated(sensor, images, 200, 20, seed)[0], (6, 10)[seed // len(CLEAN) % 2])
            result = adjust(state(block), TESTED)
            accused += bool(result.findings)
            tied += bool((result.decision != Decision.KEPT).any())
        rows.append([what, str(len(seeds)), str(accused), str(tied)])
    return "Error-free blocks", ("sigmas of the GCPs", "blocks", "GCP reported", "measurement rejected"), rows


# ---- output --------------------------------------------------------------------------------------------------------

#: Parts, and how many seeds judge each.
PARTS: dict[str, tuple[Callable[[Sequence[int]], Section], int]] = {
    "ties": (wrong_ties, 10),
    "control": (wrong_control, 10),
    "sigmas": (masked_control, 10),
    "clean": (clean_blocks, 100),
}
FIRST_SEED = 2000


def main() -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("names", nargs="*", choices=[*PARTS, []], metavar="PART", help="parts; default: all")
    parser.add_argument(
        "--seeds", nargs=2, type=int, metavar=("FIRST", "END"), help="other seeds than the judging ones"
    )
    options = parser.parse_args()
    if options.docs and options.seeds:
        parser.error("--docs takes the judging seeds: leave --seeds out")
    tables: dict[str, str] = {}
    for name in options.names or PARTS:
        make, count = PARTS[name]
        seeds = range(*options.seeds) if options.seeds else range(FIRST_SEED, FIRST_SEED + count)
        title, head, rows = make(seeds)
        tables[title] = render(head, rows)
        print(f"\n{title}\n\n{tables[title]}", flush=True)
    if options.docs:
        write_sections(PAGE, tables)


if __name__ == "__main__":
    main()

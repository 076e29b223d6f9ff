"""Are right blocks accused, and do predictions cover? `false_reasons.py [--families NAME …] [--seeds FIRST COUNT]`.

Each family is a kind of simulated block without an input error: few GCPs with a free DEM, drifting images, jitter that
is removed, a free DEM as the only control, and narrow pairs. Printed are the verdicts and their reasons, and the
shares of true errors inside their predictions (with the standard error over blocks, whose points err together):

    CE90, LE90      check points inside the headline (`parts` of the report: positions of the block, no survey errors)
    ellipse, sigma  check points inside their own error ellipses (90 %) and height limits (90 %)

Errors are those of the adjusted positions from the simulated ones. Seeds below 70 000 were looked at while the code was
written.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hrsi.benchmarks.pages import DOCS, put_between, render
from hrsi.benchmarks.wrong_inputs import PLACES
from hrsi.hrsi_engine import AdjustOptions, adjust, check_block, judge
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.adjustment.statistics.precision import LINE_90
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    BlockSimulation,
    Noise,
    OrientationError,
    PointCounts,
    SceneSpec,
    SceneView,
    Vibration,
    simulate_block,
)
from hrsi.hrsi_engine.laboratory.simulation.free_dem import simulate_free_dem
from hrsi.hrsi_engine.laboratory.simulation.options import LANDFORMS, FreeDemSpec
from hrsi.hrsi_engine.surface.grid_surface import GridSurface

TWO, THREE = (12.0, -12.0), (15.0, 2.0, -16.0)
PAGE = DOCS / "protocols/right_blocks.md"
HEAD = ("blocks", "number", "ok", "doubtful", "unusable", "reasons", "CE90 %", "LE90 %", "ellipse %", "sigma %",
        "CE90 found / predicted", "LE90", "CPU s")  # fmt: skip
#: Wave amplitudes (px) and periods (lines) of jitter, of which the seed chooses.
WAVES = ((0.3, 1000.0), (1.0, 3000.0), (1.8, 900.0), (3.0, 500.0), (1.0, 5000.0))
#: Side of a scene on a free DEM, and its share of trees as by `surface.py`.
SIDE_M, WIDE_M, TREE_M = 5000.0, 16000.0, 5.0
TREES = {"mountains": 0.1, "hills": 0.1, "farmland": 0.05, "city": 0.05, "flat": 0.05}


@dataclass(frozen=True)
class Family:
    """A kind of block: sensors and landforms of which the seed chooses, images, points, errors, and how to adjust.

    lines : of each image; 0: of a scene of `SIDE_M`
    cells_m : of a free DEM, 0 without; of a terrain model of 0.3 m if negative
    """

    sensors: tuple[str, ...]
    angles_deg: tuple[float, ...]
    points: PointCounts
    samples: int = 6000
    lines: int = 6000
    noise: Noise = field(default_factory=Noise)
    landforms: tuple[str, ...] = ("farmland",)
    has_jitter: bool = False
    cells_m: float = 0.0
    trees_m: float = 10.0
    options: AdjustOptions = field(default_factory=AdjustOptions)


ON_DEM = Family(
    ("quickbird", "worldview-2", "pleiades", "spot5", "wide-field"), TWO, PointCounts(0, 60, 1500), 0, 0,
    Noise(blunders=0.01), ("farmland", "city", "flat", "hills"), cells_m=30.0, trees_m=TREE_M,
    options=AdjustOptions(sigma_dem_m=2.4),
)  # fmt: skip
SHAKEN = Family(
    ("pleiades", "worldview-2"), TWO, PointCounts(8, 60, 1500), 4000, 20000, Noise(0.2), has_jitter=True,
    options=AdjustOptions(jitter="auto"),
)  # fmt: skip
ON_SURFACE = {"cells_m": -10.0, "options": AdjustOptions(jitter="auto", sigma_dem_m=0.3)}
FEW = Family(("pleiades",), TWO, PointCounts(2, 25, 80), cells_m=30.0)
ONE = Family(("ikonos",), TWO, PointCounts(1, 60, 200))
NARROW = Family(("pleiades",), (-3.2, 3.2), PointCounts(0, 25, 80))
#: Reasons that are right for some of these families: of jitter, and of narrow pairs without GCPs.
RIGHT = ("jitter", "not-determined")
FAMILIES = {
    "two GCPs, free DEM of 2 m": replace(FEW, options=AdjustOptions(sigma_dem_m=2.0)),
    "two GCPs, free DEM of 2.4 m": replace(FEW, options=AdjustOptions(sigma_dem_m=2.4)),
    "six GCPs, three images": Family(("quickbird",), (-15.0, 0.0, 15.0), PointCounts(6, 25, 80)),
    "jitter, two images": SHAKEN,
    "jitter, two images, surface": replace(SHAKEN, **ON_SURFACE),
    "jitter, three images": replace(SHAKEN, angles_deg=THREE),
    "jitter, three images, surface": replace(SHAKEN, angles_deg=THREE, **ON_SURFACE),
    "free DEM alone": ON_DEM,
    "free DEM alone, mountains": replace(ON_DEM, landforms=("mountains",)),
    "free DEM alone, IKONOS": replace(ON_DEM, sensors=("ikonos",), landforms=tuple(LANDFORMS)),
    "one GCP, IKONOS": ONE,
    "one GCP, other sensors": replace(ONE, sensors=ON_DEM.sensors),
    "six degrees, no GCPs": NARROW,
    "six degrees, six GCPs": replace(NARROW, points=PointCounts(6, 25, 80)),
    "three degrees, six GCPs": Family(("pleiades", "quickbird"), (-1.5, 1.5), PointCounts(6, 25, 200)),
}  # fmt: skip
#: Blocks of which the seed draws everything (`mix`).
MIXED = "everything drawn"
MIXED_ANGLES = ((12.0, -12.0), (3.2, -3.2), (1.5, -1.5), (25.0, -5.0), (15.0, 2.0, -16.0), (20.0, 0.0),
                (10.0, 4.0, -4.0, -12.0), (0.5, -14.0), (30.0, -30.0), (-8.0, -20.0))  # fmt: skip


def mix(seed: int) -> Family:
    """Return a kind of block of which a seed draws sensor, images, GCPs, tie points, noise, ground, DEM and jitter."""
    rng = np.random.default_rng([seed, 77])
    sensor, angles = str(rng.choice([*SENSORS])), MIXED_ANGLES[int(rng.integers(len(MIXED_ANGLES)))]
    gcps, ties = int(rng.choice([0, 0, 1, 2, 3, 4, 6, 8, 12, 25])), int(rng.choice([20, 60, 200, 600, 1500]))
    has_dem, has_jitter = rng.random() < 0.5, rng.random() < 0.15
    landform, blunders = str(rng.choice([*LANDFORMS])), float(rng.choice([0.0, 0.01, 0.03])) if ties >= 60 else 0.0
    noise = Noise(float(rng.choice([0.15, 0.3, 0.5])), blunders=blunders)
    sigma_dem_m = float(rng.choice([2.0, 2.4])) if has_dem else None
    size = (0, 0) if sensor == "wide-field" else (4000, 12_000) if has_jitter else (6000, 6000)
    return Family(
        (sensor,), angles, PointCounts(gcps, 30, ties), *size, noise, (landform,), has_jitter and bool(size[0]),
        30.0 if has_dem else 0.0, float(rng.choice([5.0, 10.0])),
        AdjustOptions(sigma_dem_m=sigma_dem_m, jitter="auto" if has_jitter else "none"),
    )  # fmt: skip


def simulate(family: Family, seed: int) -> tuple[BlockSimulation, AdjustOptions]:
    """Return a block of a family, and the options with its surface."""
    rng = np.random.default_rng([seed, 9])
    sensor, landform = (str(rng.choice(kinds)) for kinds in (family.sensors, family.landforms))
    wide = sensor == "wide-field"
    side = int((WIDE_M if wide else SIDE_M) / SENSORS[sensor].gsd_m)
    size = family.samples or side, family.lines or side
    heading = float(rng.choice([190.0, 350.0]))
    views = [
        SceneView(f"image_{k}", SENSORS[sensor], size, angle, 0.0, heading)
        for k, angle in enumerate(family.angles_deg, 1)
    ]
    if family.has_jitter:
        amplitude, period = WAVES[int(rng.integers(len(WAVES)))]
        angle = amplitude * SENSORS[sensor].detector_angle_rad
        phases = rng.uniform(0.0, 6.28, len(views)).tolist()
        shaken = [OrientationError(vibration=Vibration(((period, angle, phase),))) for phase in phases]
        views = [replace(view, jitter=jitter) for view, jitter in zip(views, shaken, strict=True)]
    lon, lat = PLACES[int(rng.integers(len(PLACES)))]
    scene = SceneSpec(
        lon, lat, float(rng.integers(50, 900)), landform, LANDFORMS[landform].relief_m * (2.0 if wide else 1.0),
        seed=seed,
    )  # fmt: skip
    simulated = simulate_block(scene, views, family.points, family.noise)
    if not family.cells_m:
        return simulated, family.options
    spec = FreeDemSpec(family.cells_m, TREES[landform] if family.trees_m == TREE_M else 0.2, family.trees_m)
    if family.cells_m < 0.0:
        spec = FreeDemSpec(-family.cells_m, 0.0, 0.0, noise_m=0.15, common_m=0.24, place_m=0.0)  # together 0.3 m
    ground = simulated.truth.ground
    away_m = ground_difference_m(ground, np.broadcast_to([lon, lat, 0.0], ground.shape))
    reach = 1.2 * float(np.abs(away_m[:, :2]).max())
    dem = simulate_free_dem(simulated.scene.terrain, reach, spec, [seed, 60])
    return simulated, replace(family.options, dem=GridSurface.from_array(dem.heights_m, dem.first_deg, dem.cell_deg))


class Outcome(NamedTuple):
    """Level and codes of a verdict, and shares of check points inside CE90, LE90, own ellipses and height sigmas."""

    level: str
    codes: list[str]
    inside: list[float]
    ratios: list[float]
    seconds: float


def run_block(family: Family, seed: int) -> Outcome:
    """Simulate, adjust and judge a block."""
    simulated, options = simulate(family, seed)
    block, begin = simulated.block, time.process_time()
    before = check_block(block, surface=options.dem)
    result = adjust(block, options)
    verdict = judge(result, before)
    inside, ratios = compare_with_truth(result, simulated)
    return Outcome(
        verdict.level.label, [reason.code for reason in verdict.reasons if reason.level.value], inside, ratios,
        time.process_time() - begin,
    )  # fmt: skip


def compare_with_truth(result: Adjustment, simulated: BlockSimulation) -> tuple[list[float], list[float]]:
    """Return shares of check points inside CE90, LE90, ellipses and sigmas, and errors (90 %) over CE90 and LE90."""
    points, place = result.block.points, {name: k for k, name in enumerate(simulated.truth.ids.tolist())}
    check = np.flatnonzero((points.role == Role.CHECK) & np.isfinite(result.ground_sigma_m).all(axis=1))
    truth = simulated.truth.ground[[place[name] for name in points.ids[check].tolist()]]
    error = ground_difference_m(truth, result.ground[check])
    plan_m, height_m, covariance = np.hypot(*error[:, :2].T), np.abs(error[:, 2]), result.ground_covariance_m2[check]
    shifts = None if result.shared_shifts_m is None else result.shared_shifts_m[check]
    if shifts is not None:
        covariance = covariance + shifts @ shifts.swapaxes(1, 2)
    squares = np.einsum("ki,kij,kj->k", error[:, :2], np.linalg.inv(covariance[:, :2, :2]), error[:, :2])
    part = result.parts[0]
    ce90, le90 = (np.nan if one is None else one for one in (part.ce90_m, part.le90_m))
    inside = [plan_m <= ce90, height_m <= le90, squares <= -2.0 * np.log(0.1),
              height_m <= LINE_90 * np.sqrt(covariance[:, 2, 2])]  # fmt: skip
    ratios = [np.quantile(plan_m, 0.9) / ce90, np.quantile(height_m, 0.9) / le90]
    return np.mean(inside, axis=1).tolist(), np.array(ratios).tolist()


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; ``--docs`` writes its rows into the page."""
    parser = argparse.ArgumentParser(prog="false_reasons.py", description=__doc__)
    parser.add_argument("--families", nargs="+", choices=[*FAMILIES, MIXED], default=[*FAMILIES, MIXED])
    parser.add_argument("--seeds", nargs=2, type=int, default=(70_000, 20), metavar=("FIRST", "COUNT"))
    parser.add_argument(
        "--record", type=Path, metavar="FILE", help="keep each block as a line of JSON; blocks in it are not run"
    )
    parser.add_argument("--docs", action="store_true", help=f"write the rows into {PAGE.name}; the others stay")
    options = parser.parse_args(words)
    rows = {}
    for name in options.families:
        seeds = range(options.seeds[0], sum(options.seeds))
        rows[name] = summarise(name, run_seeds(name, seeds, options.record))
        print(rows[name], flush=True)
    print(render(HEAD, list(rows.values())))
    if options.docs:
        table = PAGE.read_text(encoding="utf-8").split("<!-- right blocks:")[1].split("<!-- end of")[0]
        cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if "|" in line]
        rows = {cell[0]: cell for cell in cells} | rows
        ordered = [rows[name] for name in (*FAMILIES, MIXED) if name in rows]
        put_between(PAGE, "right blocks", f"{render(HEAD, ordered)}\n\n{count_false_causes(ordered)}")


def count_false_causes(rows: Sequence[Sequence[str]]) -> str:
    """Return in how many blocks of a table a reason names an error that none of them has."""
    false: Counter[str] = Counter()
    for code, number in (reason.rsplit(" ", 1) for row in rows for reason in row[5].split(", ") if reason):
        false[code] += int(number) * (code not in RIGHT)
    named = ", ".join(f"{code} {number}" for code, number in (+false).items())
    return (
        f"Of these {sum(int(row[1]) for row in rows)} blocks, {false.total()} have a reason other "
        f"than {' and '.join(RIGHT)}{f' ({named})' if named else ''}."
    )


def run_seeds(name: str, seeds: Sequence[int], record: Path | None) -> list[Outcome]:
    """Return the outcomes of a family's blocks; a record has one line for each, so that a stopped run goes on."""
    recorded = {}
    if record is not None and record.exists():
        for line in record.read_text(encoding="utf-8").splitlines():
            family, seed, *values = json.loads(line)
            recorded[family, seed] = Outcome(*values)
    outcomes = []
    for seed in seeds:
        outcome = recorded.get((name, seed)) or run_block(FAMILIES[name] if name in FAMILIES else mix(seed), seed)
        outcomes.append(outcome)
        if record is not None and (name, seed) not in recorded:
            with record.open("a", encoding="utf-8") as file:
                file.write(json.dumps([name, seed, *outcome]) + "\n")
    return outcomes


def summarise(name: str, outcomes: Sequence[Outcome]) -> list[str]:
    """Return the row of a family."""
    levels = Counter(one.level for one in outcomes)
    codes = Counter(code for one in outcomes for code in one.codes)
    inside = 100.0 * np.array([one.inside for one in outcomes])
    ratios = np.median([one.ratios for one in outcomes], axis=0)
    return [
        name, str(len(outcomes)), *(str(levels[level]) for level in ("ok", "doubtful", "unusable")),
        ", ".join(f"{code} {number}" for code, number in codes.most_common()),
        *(f"{mean:.1f} ± {error:.1f}" for mean, error in zip(
            inside.mean(axis=0), inside.std(axis=0) / np.sqrt(len(outcomes)), strict=True
        )),
        *(f"{ratio:.2f}" for ratio in ratios), f"{np.mean([one.seconds for one in outcomes]):.1f}",
    ]  # fmt: skip


if __name__ == "__main__":
    main()

"""Blocks without GCPs on a free DEM: true errors against predicted ones: `surface.py [--docs] [--seeds A:B] [PART …]`.

Every block is simulated (`simulate`) and adjusted (`adjust`) by the command line: images of a sensor whose orbit and
attitude err as their vendor states, tie points only, and a DEM with the errors of Copernicus GLO-30. The refined RPCs
are then judged by GDAL: points are intersected from the pixels in which the simulated cameras (which are no RPCs)
really see them, and compared with where they really lie. Parts:

    blocks   six sensors on five kinds of ground: true against predicted errors
    wrong    DEMs with another datum, mirrored, 1 km off, of another place: are they named?
    control  GCPs, laser points or a reference orthoimage with and without the DEM: does anything get worse?

Seeds below 100 served to develop; the documented tables are of those from 7200 on.
"""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import json
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from osgeo import gdal

from hrsi.benchmarks.pages import DOCS, make_parser, put_between, render
from hrsi.benchmarks.true_errors import intersect_pixels, read_rpc_text
from hrsi.benchmarks.wrong_inputs import PLACES, TruePoints
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory.simulated_files import write_dem
from hrsi.hrsi_engine.laboratory.simulation import SENSORS
from hrsi.hrsi_engine.laboratory.simulation.free_dem import simulate_free_dem
from hrsi.hrsi_engine.laboratory.simulation.options import LANDFORMS, FreeDemSpec
from hrsi.hrsi_engine.surface.grid_surface import GridSurface
from hrsi.processing_algorithms.command_line.cli import main as command
from hrsi.tests.laser_scenes import placed_scene

PAGE = DOCS / "protocols/surface.md"
#: Side of a scene; pixels of 16 m see a wider one, with twice the relief.
SIDE_M, WIDE_M, WIDE_RELIEF = 5000.0, 16000.0, 2.0
#: Share of the DEM's cells with trees: images see crowns, radar looks into them, which differs by 5 m or so. More of
#: them would be beyond the 4 m LE90 that GLO-30 is stated to.
TREE_M = 5.0
TREES = {"mountains": 0.1, "hills": 0.1, "farmland": 0.05, "city": 0.05, "flat": 0.05}
#: Standard deviation of heights as GLO-30 is stated to: 4 m LE90.
SIGMA_DEM_M = 2.4
DEM = ("--dem", "free_dem.tif", "--height-datum", "ellipsoidal", "--sigma-dem", str(SIGMA_DEM_M))


class Place(NamedTuple):
    """What a block is of; its seed draws the rest."""

    sensor: str
    landform: str
    seed: int

    def write(self, folder: Path, *more: str) -> Path:
        """Simulate the block into a folder by the command line, and return its place there."""
        rng = np.random.default_rng([self.seed, 3])
        lon, lat = PLACES[int(rng.integers(len(PLACES)))]
        wide = self.sensor == "wide-field"
        number = list(itertools.product(SENSORS, LANDFORMS)).index((self.sensor, self.landform))
        out = folder / f"{self.sensor}_{self.landform}_{self.seed}"
        words: dict[str, object] = {
            "sensor": self.sensor, "landform": self.landform, "seed": 100 * self.seed + number, "output-dir": out,
            "relief": LANDFORMS[self.landform].relief_m * (WIDE_RELIEF if wide else 1.0),
            "size": int((WIDE_M if wide else SIDE_M) / SENSORS[self.sensor].gsd_m), "images": 2 + self.seed % 2,
            "lon": lon, "lat": lat, "height": int(rng.integers(50, 900)), "heading": int(rng.choice([190, 350])),
            "gcps": 6, "checks": 60, "ties": 1500, "blunders": 0.01,
            "free-dem": 30, "free-dem-trees": TREES[self.landform], "free-dem-tree-height": TREE_M,
        }  # fmt: skip
        call("simulate", "--no-pixels", *(f"--{name}={value}" for name, value in words.items()), *more)
        return out


def call(*words: object) -> tuple[int, str]:
    """Run the command line quietly; return its exit code and what it says."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = command([str(word) for word in words])
    return code, said.getvalue()


class Outcome(NamedTuple):
    """What came of an adjustment: true errors of check points (k, 3) m, what was predicted, and what was said."""

    error_m: np.ndarray
    ce90_m: float
    le90_m: float
    surface: dict[str, Any]
    level: str
    codes: tuple[str, ...]
    said: str

    @property
    def plan_90_m(self) -> float:
        """The distance in plan that nine of ten errors stay within."""
        return float(np.quantile(np.hypot(*self.error_m[:, :2].T), 0.9)) if len(self.error_m) else np.nan

    @property
    def height_90_m(self) -> float:
        """The same in height."""
        return float(np.quantile(np.abs(self.error_m[:, 2]), 0.9)) if len(self.error_m) else np.nan

    @property
    def inside(self) -> tuple[float, float]:
        """Shares of the points inside the predicted CE90 and LE90."""
        plan, height = np.hypot(*self.error_m[:, :2].T), np.abs(self.error_m[:, 2])
        return float(np.mean(plan <= self.ce90_m)), float(np.mean(height <= self.le90_m))


def read_truth(block: Path) -> TruePoints:
    """Return the check points of a simulated block: where they are, and the pixels that show them."""
    truth = json.loads((block / "truth.json").read_text(encoding="utf-8"))
    names = [name for name, point in truth["ground_points"].items() if point["role"] == "check"]
    rows = {name: row for row, name in enumerate(names)}
    images = {name: row for row, name in enumerate(truth["images"])}
    seen = [(rows[p], images[i], x, y) for p, i, x, y in truth["image_points"] if p in rows]
    point, image, sample, line = (np.array(column) for column in zip(*seen, strict=True))
    ground = np.array([truth["ground_points"][name]["ground"] for name in names])
    return TruePoints(ground, point, image, np.column_stack([sample, line]))


def measure_block(block: Path, truth: TruePoints, out: Path) -> np.ndarray:
    """Return true errors (k, 3) m of check points by the RPCs in a folder."""
    names = sorted(path.name for path in block.glob("image_*_RPC.TXT"))
    return intersect_pixels([read_rpc_text(out / name) for name in names], truth)


def adjust_block(block: Path, truth: TruePoints, *words: object) -> Outcome:
    """Adjust a block by the command line, and measure what its RPCs are worth."""
    out = block / "out"
    shutil.rmtree(out, ignore_errors=True)
    with contextlib.chdir(block):
        images = sorted(path.name for path in block.glob("image_*_RPC.TXT"))
        code, said = call(
            "adjust", *images, "--image-points", "image_points.csv", "--output-dir", "out", "--no-report", *words
        )
    if not (out / "report.json").exists():
        return Outcome(np.empty((0, 3)), np.nan, np.nan, {}, f"refused ({code})", (), said)
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    verdict = report["verdict"]
    part = report["parts"][0]
    predicted = (float(part[name] or np.nan) for name in ("ce90_m", "le90_m"))
    codes = tuple(reason["code"] for reason in verdict["reasons"])
    surface = (report.get("surface") or [{}])[0]
    errors = measure_block(block, truth, out)
    return Outcome(errors, *predicted, surface, verdict["level"], codes, said)


# ---- blocks --------------------------------------------------------------------------------------------------------


class Row(NamedTuple):
    """A block: errors (k, 3) m by its RPCs as delivered, and the outcome on the free DEM."""

    place: Place
    given_m: np.ndarray
    outcome: Outcome

    @property
    def holds(self) -> bool:
        """Whether the relief holds the block in plan, by the report."""
        return bool(self.outcome.surface.get("holds_plan"))

    def cells(self) -> list[str]:
        """Return the row as text."""
        one = self.outcome
        plan, height = one.inside
        return [
            self.place.sensor, self.place.landform, str(self.place.seed),
            f"{np.quantile(np.hypot(*self.given_m[:, :2].T), 0.9):.1f}",
            f"{np.quantile(np.abs(self.given_m[:, 2]), 0.9):.1f}", "yes" if self.holds else "no",
            f"{one.plan_90_m:.2f}", f"{one.ce90_m:.2f}", f"{100.0 * plan:.0f}", f"{one.height_90_m:.2f}",
            f"{one.le90_m:.2f}", f"{100.0 * height:.0f}", one.level, ", ".join(one.codes),
        ]  # fmt: skip


HEAD = ["sensor", "ground", "seed", "RPCs: plan m", "height m", "plan from the DEM", "plan m", "CE90 m", "inside %",
        "height m", "LE90 m", "inside %", "verdict", "reasons"]  # fmt: skip
GROUP_HEAD = ["blocks of", "number", "RPCs: plan m", "plan m", "CE90 m", "inside %", "RPCs: height m", "height m",
              "LE90 m", "inside %", "ok", "reasons"]  # fmt: skip
WORST_TEXT = "The blocks with the largest errors relative to the predicted ones, in plan and then in height:"
#: Number of blocks that the page shows singly, by plan and by height.
WORST = 5


def run_blocks(seeds: Sequence[int], sensors: Sequence[str], landforms: Sequence[str]) -> Iterator[Row]:
    """Yield the rows of all blocks."""
    for seed, sensor, landform in itertools.product(seeds, sensors, landforms):
        with tempfile.TemporaryDirectory() as name:
            block = Place(sensor, landform, seed).write(Path(name))
            truth = read_truth(block)
            given = measure_block(block, truth, block)
            yield Row(Place(sensor, landform, seed), given, adjust_block(block, truth, *DEM))


def _percent(shares: Sequence[float]) -> str:
    """Return a mean share and its standard error over blocks, in percent."""
    return f"{100.0 * np.mean(shares):.1f} ± {100.0 * np.std(shares) / np.sqrt(len(shares)):.1f}"


def summarise_rows(rows: Sequence[Row]) -> list[list[str]]:
    """Return for groups of blocks: number, median errors and predictions, shares inside, verdicts and reasons."""
    names = [(row.place.landform, row.place.sensor, f"plan from the {'DEM' if row.holds else 'RPCs'}", "all")
             for row in rows]  # fmt: skip
    table = []
    for name in dict.fromkeys(name for kind in zip(*names, strict=True) for name in kind):
        chosen = [row for row, of_row in zip(rows, names, strict=True) if name in of_row]
        found = [row.outcome for row in chosen]
        plan, height = np.transpose([one.inside for one in found])
        given = np.median([np.quantile((np.hypot(*row.given_m[:, :2].T), np.abs(row.given_m[:, 2])), 0.9, axis=1)
                           for row in chosen], axis=0)  # fmt: skip
        plan_m, ce90_m, height_m, le90_m = np.median(
            [(one.plan_90_m, one.ce90_m, one.height_90_m, one.le90_m) for one in found], axis=0
        )
        reasons = Counter(code for one in found for code in one.codes)
        table.append([
            name, str(len(chosen)), f"{given[0]:.1f}", f"{plan_m:.1f}", f"{ce90_m:.1f}", _percent(plan),
            f"{given[1]:.1f}", f"{height_m:.1f}", f"{le90_m:.1f}", _percent(height),
            str(sum(one.level == "ok" for one in found)), ", ".join(f"{code} {n}" for code, n in reasons.items()),
        ])  # fmt: skip
    return table


def find_worst(rows: Sequence[Row]) -> list[Row]:
    """Return the blocks with the largest errors relative to the predicted ones, in plan and then in height."""
    by_plan = sorted(rows, key=lambda row: row.outcome.plan_90_m / row.outcome.ce90_m)[-WORST:]
    by_height = sorted(rows, key=lambda row: row.outcome.height_90_m / row.outcome.le90_m)[-WORST:]
    return [*by_plan[::-1], *by_height[::-1]]


# ---- wrong surfaces ------------------------------------------------------------------------------------------------


def rewrite_dem(block: Path, change: Callable[[np.ndarray, list[float]], np.ndarray]) -> None:
    """Change the heights of the free DEM, or its geotransform in place."""
    path = str(block / "free_dem.tif")
    dataset = gdal.Open(path)
    transform = list(dataset.GetGeoTransform())
    heights = change(dataset.ReadAsArray(), transform)
    del dataset
    west, east, _, top, _, south = transform
    write_dem(path, heights, (west, east, 0.0, top, 0.0, south))


def _move_by_km(heights: np.ndarray, transform: list[float]) -> np.ndarray:
    transform[3] += 1000.0 / 111_000.0
    return heights


#: What is wrong with a DEM.
WRONG: dict[str, Callable[[np.ndarray, list[float]], np.ndarray]] = {
    "right": lambda heights, _: heights,
    "heights above a geoid 48 m higher": lambda heights, _: heights - 48.0,
    "mirrored, left to right": lambda heights, _: heights[:, ::-1].copy(),
    "1 km too far north": _move_by_km,
}
WRONG_PLACES = tuple(itertools.product(("worldview-2", "spot5"), ("mountains", "hills", "farmland")))
WRONG_HEAD = ["surface", "ground", "sensor", "plan m", "CE90 m", "height m", "LE90 m", "not seen below m",
              "plan from the DEM", "verdict", "reasons"]  # fmt: skip


def run_wrong(seed: int, sensors: Sequence[str], landforms: Sequence[str]) -> Iterator[list[str]]:
    """Yield rows of wrong DEMs under blocks."""
    for sensor, landform in _choose_places(WRONG_PLACES, sensors, landforms):
        with tempfile.TemporaryDirectory() as name:
            block = Place(sensor, landform, seed).write(Path(name))
            other = Place(sensor, landform, seed + 50).write(Path(name))
            truth, right = read_truth(block), (block / "free_dem.tif").read_bytes()
            others = partial(_fit, gdal.Open(str(other / "free_dem.tif")).ReadAsArray())
            for title, change in (WRONG | {"of another place": others}).items():
                (block / "free_dem.tif").write_bytes(right)
                rewrite_dem(block, change)
                one = adjust_block(block, truth, *DEM)
                unseen_m = "".join(re.findall(r"datum below (\S+) m does not show", one.said)[:1])
                yield [
                    title, landform, sensor, f"{one.plan_90_m:.1f}", f"{one.ce90_m:.1f}", f"{one.height_90_m:.1f}",
                    f"{one.le90_m:.1f}", unseen_m, "yes" if one.surface.get("holds_plan") else "no", one.level,
                    ", ".join(one.codes) or _first_line(one.said),
                ]  # fmt: skip


def _choose_places(
    places: Iterable[tuple[str, str]], sensors: Sequence[str], landforms: Sequence[str]
) -> list[tuple[str, str]]:
    """Return the places with one of these sensors and one of these landforms."""
    return [(sensor, landform) for sensor, landform in places if sensor in sensors and landform in landforms]


def _fit(heights: np.ndarray, like: np.ndarray, _: list[float]) -> np.ndarray:
    """Return heights of another DEM in the shape and at the mean height of this one."""
    rows, columns = like.shape
    repeated = np.pad(heights, [(0, max(rows - heights.shape[0], 0)), (0, max(columns - heights.shape[1], 0))], "wrap")
    cut = repeated[:rows, :columns]
    return cut - cut.mean() + like.mean()


def _first_line(said: str) -> str:
    return next((line for line in said.splitlines() if line.startswith("ERROR")), "")[:80]


# ---- beside other control ------------------------------------------------------------------------------------------


BESIDE_PLACES = (("worldview-2", "mountains"), ("spot5", "hills"), ("pleiades", "farmland"), ("quickbird", "city"))
REFERENCE_GROUND = "150 m of relief"
BESIDE_HEAD = ["with", "ground", "sensor", "plan m", "with the DEM m", "CE90 m", "with the DEM m", "height m",
               "with the DEM m", "LE90 m", "with the DEM m", "reasons with the DEM"]  # fmt: skip


def run_beside(seed: int, sensors: Sequence[str], landforms: Sequence[str]) -> Iterator[list[str]]:
    """Yield rows of blocks with GCPs, laser points or a reference, without and with the DEM; a reference: if asked."""
    for sensor, landform in _choose_places(BESIDE_PLACES, sensors, landforms):
        with tempfile.TemporaryDirectory() as name:
            block = Place(sensor, landform, seed).write(Path(name), "--laser-passes", 3)
            truth = read_truth(block)
            _keep_gcps(block / "ground_points.csv")
            for title, words in (
                ("6 GCPs", ("--gcps", "ground_points.csv", "--height-datum", "ellipsoidal")),
                ("laser", ("--laser", "laser.csv")),
            ):
                without, with_dem = (adjust_block(block, truth, *words, *more) for more in ((), _beside_words(words)))
                yield [title, landform, sensor, *_compare(without, with_dem), ", ".join(with_dem.codes)]
    for number in (0, 1) if REFERENCE_GROUND in landforms else ():
        yield _run_reference(seed + number)


def _beside_words(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return the words of the DEM, without those that are given."""
    return tuple(word for word in DEM if word not in words)


def _keep_gcps(path: Path) -> None:
    """Leave the GCPs in a file of ground points."""
    rows = list(csv.reader(path.open(encoding="utf-8", newline="")))
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([rows[0], *(row for row in rows[1:] if row[1] == "gcp")])


def _compare(without: Outcome, with_dem: Outcome) -> list[str]:
    names = ("plan_90_m", "ce90_m", "height_90_m", "le90_m")
    return [f"{getattr(one, name):.2f}" for name in names for one in (without, with_dem)]


def _run_reference(seed: int) -> list[str]:
    """Return the row of a block with 150 places of an orthoimage of 10 m; no pixels, so by the Python interface."""
    sensor = ("worldview-2", "pleiades")[seed % 2]
    size = int(SIDE_M / SENSORS[sensor].gsd_m)
    made = placed_scene(seed, sensor=sensor, size=size, places=150, match_m=1.5, looked_up=200, checks=60)
    scene = made.laser.simulated.scene
    dem = simulate_free_dem(scene.terrain, scene.half_extent_m, FreeDemSpec(30.0), [seed, 60])
    surface = GridSurface.from_array(dem.heights_m, dem.first_deg, dem.cell_deg)
    found = []
    for options in (
        AdjustOptions(reference=made.places), AdjustOptions(reference=made.places, dem=surface, sigma_dem_m=SIGMA_DEM_M)
    ):  # fmt: skip
        result = adjust(made.block, options)
        checks = result.block.points.role == Role.CHECK
        error = ground_difference_m(result.ground[checks], result.block.points.ground[checks])
        predicted = result.parts[0]
        found.append(Outcome(error, float(predicted.ce90_m), float(predicted.le90_m), {}, "", (), ""))
    return ["reference of 10 m", REFERENCE_GROUND, sensor, *_compare(*found), ""]


# ---- the whole -----------------------------------------------------------------------------------------------------


PARTS = ("blocks", "wrong", "control")


def run_part(part: str, seeds: range, sensors: Sequence[str], landforms: Sequence[str]) -> str:
    """Run a part, print its rows, and return its text for the page."""
    rows = []
    if part == "blocks":
        found = []
        for row in run_blocks(seeds, sensors, [one for one in landforms if one in LANDFORMS]):
            found.append(row)
            print(" | ".join(row.cells()), flush=True)
        worst = render(HEAD, [row.cells() for row in find_worst(found)])
        text = f"{render(GROUP_HEAD, summarise_rows(found))}\n\n{WORST_TEXT}\n\n{worst}"
        print(text)
    else:
        made, head = (run_wrong, WRONG_HEAD) if part == "wrong" else (run_beside, BESIDE_HEAD)
        for cells in made(seeds[0], sensors, landforms):
            rows.append(cells)
            print(" | ".join(cells), flush=True)
        text = render(head, rows)
    return text


def main(words: Sequence[str] | None = None) -> None:
    """Print the tables; ``--docs`` writes them into the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("parts", nargs="*", default=PARTS, metavar="PART")
    parser.add_argument("--seeds", default="7200:7204", metavar="A:B")
    parser.add_argument("--sensors", nargs="+", default=list(SENSORS), metavar="NAME")
    parser.add_argument("--landforms", nargs="+", default=[*LANDFORMS, REFERENCE_GROUND], metavar="NAME")
    options = parser.parse_args(words)
    first, last = (int(text) for text in options.seeds.split(":"))
    for part in options.parts:
        text = run_part(part, range(first, last), options.sensors, options.landforms)
        if options.docs:
            put_between(PAGE, f"surface {part}", text)


if __name__ == "__main__":
    main()

"""Has a command become slower? Each row is its processor time over that of a fixed piece of work of the same kind.

    speed_guard.py [ROW …]           measure, and end with 1 if a ratio is more than 15 % above the recorded one
    speed_guard.py --record [ROW …]  measure on a quiet machine and write benchmarks/speed_guard.csv

`make test-all` begins with it. Where CI is set, and on a machine that is busy already, it only prints.

The fixed work runs right before and after the command, on the same machine, and no code of HRSI takes part in it. Of up
to four runs the fastest counts, because other load only ever adds time. A slower row names the part of the command
(read, tie points, check, adjust, judge, write) whose share of the wall-clock time has grown most.
"""

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hrsi.benchmarks.adjust_speed import simulated
from hrsi.benchmarks.command_speed import write_folder
from hrsi.benchmarks.pages import ROOT

RECORD = ROOT / "benchmarks" / "speed_guard.csv"
#: Largest ratio to the recorded one. Fastest runs of one state differ by 5 % on a quiet machine.
LIMIT = 1.15
MOST_RUNS = 4
HRSI = (sys.executable, "-m", "hrsi")

START = "import numpy; from osgeo import gdal; gdal.UseExceptions()"
SOLVE = """
import numpy as np
from scipy.linalg import solveh_banded
random = np.random.default_rng(1)
bands = random.random((60, 40000)); bands[-1] += 60.0
for _ in range(3):
    solveh_banded(bands, random.random(40000))
    np.sort(random.random(3_000_000)); np.argsort(random.random(500_000), kind="stable")
"""
FEATURES = """
import cv2, numpy as np
cv2.setNumThreads(1)
pixels = np.random.default_rng(2).random((700, 700))
image = cv2.normalize(cv2.GaussianBlur(pixels, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
for _ in range(3):
    cv2.SIFT_create(8000).detectAndCompute(image, None)
"""


@dataclass(frozen=True)
class Row:
    """A command, the fixed work that it is compared with, and the folder of its report, if it writes one."""

    command: tuple[str, ...]
    anchor: tuple[str, ...]
    report: Path | None = None


def measure_cpu(command: tuple[str, ...]) -> float:
    """Return the processor time of a process and its children, s."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT.parent, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def prepare_rows(folder: Path) -> dict[str, Callable[[], Row]]:
    """Return the rows by name; their inputs are made when a row is called."""

    def run_script(text: str) -> tuple[str, ...]:
        return sys.executable, "-c", text

    def simulate(name: str, *options: str) -> Path:
        block = folder / name
        if not block.exists():
            arguments = (*HRSI, "simulate", "-q", "--output-dir", str(block), *options)
            subprocess.run(arguments, check=True, capture_output=True, cwd=ROOT.parent)
        return block

    def render() -> Path:
        shape = "--images 3 --along=-12,0,12 --size 700 --gcps 4 --ties 0 --relief 40"
        return simulate("rendered", *shape.split())

    def read_inputs(block: Path) -> tuple[str, ...]:
        points = ("--gcps", f"{block}/ground_points.csv", "--image-points", f"{block}/image_points.csv")
        return *points, "--height-datum", "ellipsoidal"

    def adjust_block() -> Row:
        block = folder / "adjust"
        block.mkdir(exist_ok=True)
        write_folder(simulated(60, per_image=1500), block)
        images = [str(path) for path in sorted((block / "rpcs").iterdir())]
        output = folder / "adjusted"
        command = (*HRSI, "adjust", "-q", *images, *read_inputs(block), "--output-dir", str(output), "--overwrite")
        return Row(command, run_script(SOLVE), output)

    def remove_jitter() -> Row:
        shape = "--no-pixels --images 3 --along=-15,2,16 --size 8000 --gcps 10 --ties 3000 --jitter 1.0"
        block = simulate("jitter", *shape.split())
        images = [str(path) for path in sorted(block.glob("*_RPC.TXT"))]
        output = folder / "without-jitter"
        options = (*read_inputs(block), "--jitter", "auto", "--output-dir", str(output), "--overwrite")
        return Row((*HRSI, "adjust", "-q", *images, *options), run_script(SOLVE), output)

    def triangulate() -> Row:
        block, output = render(), folder / "triangulated"
        images = [str(path) for path in sorted(block.glob("image_*.tif"))]
        options = (*read_inputs(block), "--output-dir", str(output), "--overwrite")
        return Row((*HRSI, "triangulate", "-q", *images, *options), run_script(FEATURES), output)

    def orthorectify() -> Row:
        block, output = render(), folder / "ortho"
        image, dem = block / "image_1.tif", block / "dem.tif"
        options = ("--dem", str(dem), "--height-datum", "ellipsoidal", "--output-dir", str(output), "--overwrite")
        warp = ("gdalwarp", "-q", "-overwrite", "-rpc", "-et", "0", "-r", "cubic", "-to", f"RPC_DEM={dem}")
        return Row((*HRSI, "orthorectify", "-q", str(image), *options), (*warp, str(image), str(folder / "warp.tif")))

    return {
        "help": lambda: Row((*HRSI, "--help"), run_script(START)),
        "rpc-info": lambda: Row((*HRSI, "rpc-info", str(render() / "image_1.tif")), run_script(START)),
        "adjust": adjust_block,
        "jitter": remove_jitter,
        "triangulate": triangulate,
        "orthorectify": orthorectify,
    }


def measure_ratio(row: Row, enough: float) -> tuple[float, dict[str, float]]:
    """Return the smallest ratio of up to four runs, ended early below ``enough``, and the parts of that run, s."""
    smallest, parts = np.inf, dict[str, float]()
    for _ in range(MOST_RUNS):
        before, command, after = (measure_cpu(words) for words in (row.anchor, row.command, row.anchor))
        ratio = command / min(before, after)
        if ratio < smallest:
            smallest = ratio
            if row.report:
                parts = json.loads((row.report / "report.json").read_text(encoding="utf-8"))["seconds"]
        if smallest <= enough:
            break
    return float(smallest), parts


def is_machine_shared() -> bool:
    """Return whether other work makes ratios uncertain: on a machine for CI, or by more processes than cores."""
    return bool(os.environ.get("CI")) or os.getloadavg()[0] > (os.cpu_count() or 1)


def name_slower_part(parts: Mapping[str, float], recorded: Mapping[str, float]) -> str:
    """Return the part whose share of the total time has grown most."""
    growth = {
        name: seconds / parts["total"] - recorded.get(name, 0.0) / recorded["total"]
        for name, seconds in parts.items()
        if name != "total" and recorded.get("total")
    }
    return max(growth, key=lambda name: growth[name]) if growth else "the command"


def main() -> int:
    """Measure the rows; return 1 if one is slower than recorded, on a machine without other work."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*")
    parser.add_argument("--record", action="store_true")
    arguments = parser.parse_args()
    with open(RECORD, encoding="utf-8", newline="") as file:
        record = {row["row"]: row for row in csv.DictReader(file)}
    slower, is_shared = 0, is_machine_shared()
    with tempfile.TemporaryDirectory(prefix="hrsi-speed-") as folder:
        rows = prepare_rows(Path(folder))
        for name in arguments.rows or rows:
            old = record.get(name, {"ratio": "inf", "parts": "{}"})
            limit = LIMIT * float(old["ratio"])
            ratio, parts = measure_ratio(rows[name](), 0.0 if arguments.record else limit)
            text = f"{name}: {ratio:.2f} times the fixed work, recorded {float(old['ratio']):.2f}"
            if arguments.record:
                record[name] = {"row": name, "ratio": f"{ratio:.3f}", "parts": json.dumps(parts)}
            elif ratio > limit:
                slower += 1
                text += f": SLOWER, most in {name_slower_part(parts, json.loads(old['parts']))}"
            print(text, flush=True)
    if arguments.record:
        with open(RECORD, "w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, ["row", "ratio", "parts"], lineterminator="\n")
            writer.writeheader()
            writer.writerows(record.values())
    if slower and is_shared:
        print(f"{slower} slower on a machine with other work: no failure")
    return int(slower > 0 and not is_shared)


if __name__ == "__main__":
    sys.exit(main())

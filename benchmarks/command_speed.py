"""Time and memory of the whole command `hrsi adjust`, reading and writing included: `command_speed.py [FOLDER …]`.

    command_speed.py FOLDER…                      blocks of the generator that comes with the Ceres program
    command_speed.py --images [1000 3000 10000]   simulated blocks with about 100 tie points an image and one GCP in
                                                  thirty images: as they are, and with 5 % of the GCPs and 1 % of the
                                                  tie measurements wrong

    command_speed.py --docs --ceres build/ba FOLDER… --images …     into docs/protocols/large_blocks.md, with the growth

With ``--ceres`` that program adjusts each folder of its generator right after the command, parsing included.
The defaults of the command line (plausibility checks, data snooping, sigmas, verdict, layers, report), but for the
sigma of the image points. Each run is a process of its own; its seconds of processor and clock and its peak memory are
the operating system's, the parts those of the report.
"""

import argparse
import compileall
import csv
import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hrsi.benchmarks.adjust_speed import simulated, with_blunders
from hrsi.benchmarks.pages import DOCS, render
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text

WRONG_GCPS, WRONG_TIES = 0.05, 0.01
PARTS = ("read", "check", "adjust", "residuals", "judge", "write", "draw")
HEAD = (
    "block",
    "images",
    "image points",
    *(f"{part} s" for part in PARTS),
    "command s",
    "CPU s",
    "peak MB",
    "solves",
    "GCPs out",
    "verdict",
    "Ceres s",
    "Ceres CPU s",
    "Ceres MB",
)
PAGE = DOCS / "protocols/large_blocks.md"
#: Modules are compiled once, as where HRSI is installed, whatever the environment says of bytecode.
INSTALLED = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
MANY = 1_000_000  # images of the estimate
KIB = 1024  # bytes, the unit of `ru_maxrss`
BEGIN, END = "<!-- command: made by benchmarks/command_speed.py -->", "<!-- end of command -->"
INTRODUCTION = """## The whole command

Made by `python benchmarks/command_speed.py --docs --ceres BA FOLDER… --images N…`. Each row is `hrsi adjust` from files
to files, with the defaults. It reads RPCs, GCPs and image points as CSV, checks the input, and adjusts with data
snooping and tests of GCPs and sigmas. It writes refined RPCs, the five layers of `block.gpkg` with spatial index and
styles, and both reports. The time of each part is wall-clock time; *CPU s* is the processor time of the complete
process, which depends less on other load of the machine. Ceres is a program in C++ that adjusts the same folder, right
after the command: it parses the text, solves once (`SPARSE_SCHUR`) and writes nothing. All runs are on two cores.

The first blocks have 2000 tie points per image, each on 3.4 images. The others have about 100 tie points per image and
one GCP per thirty images. These are adjusted without errors (*correct*), and with errors in 5 % of the GCPs and 1 % of
the measurements of tie points.

"""


def write_folder(block: Block, folder: Path) -> None:
    """Write a block as the files a user has: RPCs, a table of GCPs and one of image points."""
    (folder / "rpcs").mkdir(parents=True)
    for image in block.images:
        write_rpc_text(str(folder / "rpcs" / f"{image.id}_RPC.TXT"), image.rpc)
    points, rows = block.points, block.measurements
    with (folder / "ground_points.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("id", "role", "lon", "lat", "height", "sigma_xy", "sigma_h"))
        for row in np.flatnonzero(points.role == Role.GCP).tolist():
            table.writerow((points.ids[row], "gcp", *map(repr, points.ground[row].tolist()), 0.1, 0.1))
    names = np.array([image.id for image in block.images])
    with (folder / "image_points.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("id", "image", "sample", "line"))
        columns = (points.ids[rows.point], names[rows.image], *rows.xy.round(4).T)
        table.writerows(zip(*(column.tolist() for column in columns), strict=True))


def spoilt(block: Block, seed: int = 6) -> Block:
    """Return the block with some GCPs 20 m away in height or plan, and some tie measurements wrong."""
    bad, _, _ = with_blunders(block, WRONG_TIES)
    rng = np.random.default_rng(seed)
    control = np.flatnonzero(block.points.role == Role.GCP)
    chosen = np.sort(rng.choice(control, max(1, round(WRONG_GCPS * len(control))), replace=False))
    ground = bad.points.ground.copy()
    ground[chosen] = move_ground(ground[chosen], 20.0 * np.eye(3)[rng.integers(0, 3, len(chosen))])
    return replace(bad, points=replace(bad.points, ground=ground))


def run_command(folder: Path, output: Path) -> dict[str, Any]:
    """Run `hrsi adjust` on a folder; return its report with ``clock_s``, ``cpu_s`` and ``peak_mb``."""
    images = sorted(path.name for path in (folder / "rpcs").iterdir())  # short names: a command line has its limits
    command = [
        sys.executable, "-m", "hrsi.processing_algorithms.command_line.cli", "adjust", *images,
        "--gcps", "../ground_points.csv", "--image-points", "../image_points.csv",
        "--height-datum", "ellipsoidal", "--sigma-image", "0.3", "--output-dir", str(output.resolve()), "--quiet",
    ]  # fmt: skip
    began = time.monotonic()
    process = subprocess.Popen(command, cwd=folder / "rpcs", env=INSTALLED)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 3):  # 3: the verdict is unusable
        raise SystemExit(f"{folder}: hrsi adjust ended with {process.returncode}")
    report = json.loads((output / "report.json").read_text(encoding="utf-8"))
    return report | {
        "clock_s": seconds, "cpu_s": usage.ru_utime + usage.ru_stime, "peak_mb": usage.ru_maxrss * KIB / 1e6,
    }  # fmt: skip


def run_ceres(program: Path | None, folder: Path) -> tuple[float, float, float]:
    """Run the Ceres program on a folder; return its seconds, those of processor and its peak in MB, NaN without."""
    if program is None or not (folder / "truth.csv").exists():
        return math.nan, math.nan, math.nan
    began = time.monotonic()
    process = subprocess.Popen([str(program), str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{folder}: {program} ended with {process.returncode}")
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * KIB / 1e6


def growth(rows: list[list[str]]) -> str:
    """Return how time and memory grow from each block to the next larger one of its kind, and what that comes to.

    Between two blocks the growth is the exponent of the number of image points: 1 is linear.
    """
    kinds: dict[str, list[list[str]]] = {}
    for row in rows:
        kind = row[0] if row[0] in ("correct", "wrong GCPs and tie points") else "2000 tie points per image"
        kinds.setdefault(kind, []).append(row)
    table, estimates, slopes = [], [], [1.0, 1.0]
    cpu, peak = HEAD.index("CPU s"), HEAD.index("peak MB")
    for kind, own in kinds.items():
        for small, large in itertools.pairwise(own):
            times = math.log(float(large[2]) / float(small[2]))
            slopes = [math.log(float(large[at]) / float(small[at])) / times for at in (cpu, peak)]
            table.append([kind, f"{small[1]} to {large[1]}", *(f"{slope:.2f}" for slope in slopes)])
        if len(own) > 1:
            share = MANY / float(own[-1][1])
            seconds, memory = (
                float(own[-1][at]) * share ** max(1.0, slope) for at, slope in zip((cpu, peak), slopes, strict=True)
            )
            estimates.append(
                f"- {kind}: {seconds / 3600:.0f} CPU h and {memory / 1e6:.1f} TB in one process"
                f" ({float(own[-1][2]) * share / 1e6:.0f} million image points)."
            )
    text = render(("kind", "images", "exponent of CPU s", "exponent of peak MB"), table)
    return f"""
### Growth

The exponents are those of the number of image points, from each block to the next: 1 is linear. The time of small
blocks is mostly the start of the program.

{text}

### Estimate for a million images

From the last row of each kind and its last exponents (at least 1):

{os.linesep.join(estimates)}
"""


def measure(name: str, folder: Path, work: Path, ceres: Path | None = None) -> list[str]:
    """Run the command on a folder; return the row of the table. What it wrote stays in a folder of ``work``.

    ext4 passes over the files that were deleted in the last minutes, one by one, to make a new one: with results of
    10 000 images just deleted, the next ones took twice the time to write.
    """
    report = run_command(folder, Path(tempfile.mkdtemp(dir=work)) / "result")
    rows = sum(image["observations"] for image in report["images"].values())
    others = run_ceres(ceres, folder)
    return [
        name, str(len(report["images"])), str(rows), *(f"{report['seconds'].get(part, 0.0):.1f}" for part in PARTS),
        f"{report['clock_s']:.1f}", f"{report['cpu_s']:.1f}", f"{report['peak_mb']:.0f}",
        str(report["solves"]), str(sum(finding["left_out"] for finding in report["findings"])),
        report["verdict"]["level"], *("" if math.isnan(figure) else f"{figure:.1f}" for figure in others),
    ]  # fmt: skip


def write_page(rows: list[list[str]]) -> None:
    """Put the table and what follows from it into the page."""
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    text = f"{before}{BEGIN}\n\n{INTRODUCTION}{render(HEAD, rows)}\n{growth(rows)}\n{END}{after}"
    PAGE.write_text(text, encoding="utf-8")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--images", nargs="*", type=int, metavar="N")
    parser.add_argument("--ceres", type=Path, help="the program of the Ceres benchmark")
    parser.add_argument("--docs", action="store_true", help=f"write {PAGE.name}")
    given = parser.parse_args()
    counts = [] if given.folders and given.images is None else given.images or [1000, 3000, 10_000]
    compileall.compile_dir(PAGE.parents[1] / "hrsi_engine", quiet=2)
    compileall.compile_dir(PAGE.parents[1] / "processing_algorithms", quiet=2)
    with tempfile.TemporaryDirectory() as work:
        rows = measure_all(given.folders, counts, Path(work), given.ceres and given.ceres.resolve())
    print(render(HEAD, rows))
    if given.docs:
        write_page(rows)


def measure_all(folders: Sequence[Path], counts: Sequence[int], work: Path, ceres: Path | None) -> list[list[str]]:
    """Return the rows of folders, then those of right and of wrong simulated blocks; all is written into ``work``."""
    rows = []
    for folder in folders:
        rows.append(measure(folder.name, folder.resolve(), work, ceres))
        print(rows[-1], flush=True)
    simulated_rows: dict[str, list[list[str]]] = {"correct": [], "wrong GCPs and tie points": []}
    for count in counts:
        block = simulated(count)
        for name, one in (("correct", block), ("wrong GCPs and tie points", spoilt(block))):
            folder = work / f"{name.split()[0]}_{count}"
            write_folder(one, folder)
            simulated_rows[name].append(measure(name, folder, work))
            print(simulated_rows[name][-1], flush=True)
    return [*rows, *itertools.chain(*simulated_rows.values())]


if __name__ == "__main__":
    main()

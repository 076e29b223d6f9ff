"""Time and memory of the whole command `hrsi adjust`, reading and writing included: `command_speed.py [FOLDER …]`.

    command_speed.py FOLDER…                      blocks of the generator that comes with the Ceres program
    command_speed.py --images [1000 3000 10000]   simulated blocks with about 100 tie points an image and one GCP in
                                                  thirty images: as they are, and with 5 % of the GCPs and 1 % of the
                                                  tie measurements wrong

The defaults of the command line (plausibility checks, data snooping, sigmas, verdict, layers, report), but for the
sigma of the image points. Each run is a process of its own; its seconds of processor and clock and its peak memory are
the operating system's, the parts those of the report.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hrsi.benchmarks.adjust_speed import simulated, with_blunders
from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.ground.geodesy import moved_ground
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text

WRONG_GCPS, WRONG_TIES = 0.05, 0.01
PARTS = ("read", "check", "adjust", "residuals", "judge", "write")
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
)


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
    ground[chosen] = moved_ground(ground[chosen], 20.0 * np.eye(3)[rng.integers(0, 3, len(chosen))])
    return replace(bad, points=replace(bad.points, ground=ground))


def run_command(folder: Path, output: Path) -> dict[str, Any]:
    """Run `hrsi adjust` on a folder; return its report with ``clock_s``, ``cpu_s`` and ``peak_mb``."""
    images = sorted(path.name for path in (folder / "rpcs").iterdir())  # short names: a command line has its limits
    command = [
        sys.executable, "-m", "hrsi.processing_algorithms.interface.cli", "adjust", *images,
        "--gcps", "../ground_points.csv", "--image-points", "../image_points.csv",
        "--height-datum", "ellipsoidal", "--sigma-image", "0.3", "--output-dir", str(output.resolve()), "--quiet",
    ]  # fmt: skip
    began = time.monotonic()
    process = subprocess.Popen(command, cwd=folder / "rpcs")
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 3):  # 3: the verdict is unusable
        raise SystemExit(f"{folder}: hrsi adjust ended with {process.returncode}")
    report = json.loads((output / "report.json").read_text(encoding="utf-8"))
    return report | {
        "clock_s": seconds, "cpu_s": usage.ru_utime + usage.ru_stime, "peak_mb": usage.ru_maxrss / 1000.0,
    }  # fmt: skip


def measure(name: str, folder: Path) -> list[str]:
    """Run the command on a folder; return the row of the table."""
    with tempfile.TemporaryDirectory() as output:
        report = run_command(folder, Path(output) / "result")
    rows = sum(image["observations"] for image in report["images"].values())
    return [
        name, str(len(report["images"])), str(rows), *(f"{report['seconds'].get(part, 0.0):.1f}" for part in PARTS),
        f"{report['clock_s']:.1f}", f"{report['cpu_s']:.1f}", f"{report['peak_mb']:.0f}",
        str(report["solves"]), str(sum(finding["left_out"] for finding in report["findings"])),
        report["verdict"]["level"],
    ]  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--images", nargs="*", type=int, metavar="N")
    given = parser.parse_args()
    rows = [measure(folder.name, folder) for folder in given.folders]
    counts = [] if given.folders and given.images is None else given.images or [1000, 3000, 10_000]
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            block = simulated(count)
            for name, one in (("right", block), ("wrong GCPs and ties", spoilt(block))):
                write_folder(one, Path(folder) / name.split()[0])
                rows.append(measure(name, Path(folder) / name.split()[0]))
                print(rows[-1], flush=True)
    print(render(HEAD, rows))


if __name__ == "__main__":
    main()

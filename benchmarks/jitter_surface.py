"""Waves of surface models before and after jitter is removed.

`jitter_surface.py [cars s2p] [--bin s2p=DIR …] [--work DIR] [--docs]`

A pair of 1000 x 6000 px is rendered whose attitude vibrates by 3 px with a period of 1500 lines. `triangulate` adjusts
it by 8 GCPs, its own tie points and a DEM of 10 m as free ones are, without and with `jitter` auto; with it, images
without jitter are written. Both are handed over, and the printed commands run as they stand. The wave is the amplitude
of a sine with that period, along the lines of the first image, in the surface model minus the true terrain, beside a
cubic. What is finished in --work is not run again; without --work all is run, in a temporary folder. With --docs the
table goes into docs/jitter.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from osgeo import gdal

from hrsi.benchmarks.hand_over import WILD_M, heights_of, installed, nmad, open_work_folder, read_end, typed
from hrsi.benchmarks.jitter_found import PAGE, SIZE
from hrsi.benchmarks.jitter_removed import fit_wave
from hrsi.benchmarks.pages import make_parser, put_between, render
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import run

SAMPLES, LINES, AMPLITUDE_PX, PERIOD, SEED = 1000, 6000, 3.0, 1500.0, 8
HEADER = ("program", "jitter", "wave m", "spread m", "complete")


def simulate(work: Path) -> Path:
    """Return the folder of the shaken pair."""
    folder = work / "block"
    shaken = f"{AMPLITUDE_PX:g},{PERIOD:g}"
    if not folder.exists():
        run("simulate", images=2, size=SAMPLES, lines=LINES, along="-10,10", gcps=8, checks=20, ties=0, seed=SEED,
            jitter=shaken, free_dem=10.0, free_dem_trees=0.05, output_dir=str(folder))  # fmt: skip
    return folder


def adjust(block: Path, work: Path, jitter: str) -> Path:
    """Return the result of one way of the adjustment."""
    folder = work / f"jitter_{jitter}"
    if not folder.exists():
        run("triangulate", images=[str(block / f"image_{number}.tif") for number in (1, 2)], sigma_dem=2.0,
            gcps=str(block / "ground_points.csv"), image_points=str(block / "image_points.csv"), jitter=jitter,
            dem=str(block / "free_dem.tif"), height_datum="ellipsoidal", output_dir=str(folder),
            write="copy" if jitter == "none" else "resampled")  # fmt: skip
    return folder


def measure(surface: Path, block: Path) -> tuple[float, float, float]:
    """Return the amplitude of the wave (m), the spread (NMAD, m) and the share of cells in both images with heights."""
    like = gdal.Open(str(block / "dem.tif"))
    terrain = like.ReadAsArray().astype(np.float64)
    error = heights_of(surface, like) - terrain
    left, dx, _, top, _, dy = like.GetGeoTransform()
    rows, columns = np.nonzero(np.isfinite(terrain))
    ground = np.column_stack([left + dx * (columns + 0.5), top + dy * (rows + 0.5), terrain[rows, columns]])
    seen = [read_rpc(str(block / f"image_{number}.tif")).rpc.project(ground) for number in (1, 2)]
    inside = np.all([(xy >= 0.0) & (xy <= [SAMPLES - 1.0, LINES - 1.0]) for xy in seen], axis=(0, 2))
    known = inside & (np.abs(error[rows, columns]) < WILD_M)
    line, error = seen[0][known, 1], error[rows, columns][known]
    scale = SIZE[1] / LINES
    near = np.abs(error - np.median(error)) < 4.0 * nmad(error)
    wave, _ = fit_wave(scale * line[near], error[near], scale * PERIOD)
    return wave, nmad(error), len(error) / inside.sum()


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("programs", nargs="*", default=["cars", "s2p"])
    parser.add_argument("--bin", action="append", default=[], metavar="PROGRAM=DIR", help="where a program lies")
    parser.add_argument("--work", type=Path, help="folder of projects and results that are kept")
    options = parser.parse_args(words)
    with open_work_folder(options.work) as work:
        compare(work, options)


def compare(work: Path, options: argparse.Namespace) -> None:
    """Print the table of the command line's options, and write it into the page if it says so."""
    block, given, rows = simulate(work), dict(entry.split("=", 1) for entry in options.bin), []
    for program in options.programs:
        commands = given.get(program) or installed(program)
        for jitter in ("none", "auto"):
            project = work / f"{program}_{jitter}"
            if not project.exists():
                run("hand-over", result=str(adjust(block, work, jitter)), to=program, output_dir=str(project))
            report = json.loads((project / "report.json").read_text(encoding="utf-8"))
            surface = Path(report["expected"])
            try:
                typed(project, [f"cd {project}", *report["commands"][1:]], surface, commands)
            except subprocess.CalledProcessError:
                print(f"{program} failed: {read_end(project)}")
                continue
            wave, spread, share = measure(surface, block)
            rows.append([program, jitter, f"{wave:.2f}", f"{spread:.2f}", f"{share:.0%}"])
            print(" | ".join(rows[-1]), flush=True)
    print(render(HEADER, rows))
    if options.docs:
        put_between(PAGE, "surface", render(HEADER, rows).strip())


if __name__ == "__main__":
    main()

"""Matching with what a stock QGIS brings, beside OpenCV and numba: `stock_python.py [--docs] [PART OF A NAME …]`.

Every algorithm that looks at pixels runs twice in a process of its own, the second time with OpenCV, numba, Dask and
rasterio out of reach: the real blocks, and a simulated one. `--docs` puts the table into docs/matching.md, where rows
of tasks that were not chosen stay. The real data lie in HRSI_TEST_DATA (see CONTRIBUTING.md); the two runs follow one
another, and their processor time counts. Tie points that `triangulate` holds out of its adjustment are found, too.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tie_points_accuracy import SAMPLES, paths, sift_rmse

from hrsi.benchmarks.pages import DOCS, put_between
from hrsi.hrsi_engine import open_image

PAGE = DOCS / "matching.md"
#: What Python runs first: its finder of packages then sees none of those that a stock QGIS lacks.
HIDE_PACKAGES = """
from importlib.machinery import PathFinder

absent = {"cv2", "numba", "llvmlite", "dask", "distributed", "rasterio"}
seen = PathFinder.find_spec
PathFinder.find_spec = lambda name, *place: None if name.split(".")[0] in absent else seen(name, *place)
"""
LINE = "|---|" + "---:|" * 10
RMSE, POINTS, TIES = ("ties", "rmse_px"), ("images", "img_01", "points"), ("ties", "points")
WINDOWS, MEDIAN = ("all", "after", "windows"), ("all", "after", "median_px")
SIMULATED = ("--images", "3", "--along=-12,0,12", "--size", "700", "--gcps", "6", "--checks", "20", "--ties", "0",
             "--relief", "60", "--seed", "41", "--ortho")  # fmt: skip


class Task(NamedTuple):
    """A command line, what of the report counts as found, and the sample whose SIFT tracks judge the refined RPCs."""

    name: str
    words: tuple[str, ...]
    found: tuple[str, ...]
    fit: tuple[str, ...] = ()
    sample: str = ""


def main(arguments: Sequence[str]) -> None:
    """Print the table; write it into the page where asked."""
    head = "| | found | stock | share | CPU s | stock | ratio | fit (px) | stock | SIFT tracks (px) | stock |"
    rows = dict[str, str]()
    print(f"{head}\n{LINE}", flush=True)
    chosen = [word for word in arguments if word != "--docs"] or [""]
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        (folder / "sitecustomize.py").write_text(HIDE_PACKAGES)
        run_words(("simulate", *SIMULATED, "--output-dir", str(folder / "block")), folder, stock=False)
        images, dem = simulated(folder / "block")
        run_words(("orthorectify", *images, *dem, "--extent", "overlap", "--output-dir", str(folder / "ortho")), folder,
                  stock=False)  # fmt: skip
        for task in tasks(folder / "block"):
            if not any(word in task.name for word in chosen):
                continue
            rows[task.name] = compare(task, folder)
            print(rows[task.name], flush=True)
        if "--docs" in arguments:
            shown = PAGE.read_text(encoding="utf-8").splitlines()
            names = [task.name for task in tasks(folder / "block")]
            for name in names:
                old = [one for one in shown if one.startswith(f"| {name} |") and one.count("|") == head.count("|")]
                rows.setdefault(name, "".join(old))
            order = [rows[name] for name in names if rows[name]]
            put_between(PAGE, "stock python", "\n".join([head, LINE, *order]))


def simulated(block: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the images of the simulated block, and the options that name its DEM."""
    images = tuple(str(path) for path in sorted(block.glob("image_*.tif")))
    return images, ("--dem", str(block / "dem.tif"), "--height-datum", "ellipsoidal")


def tasks(block: Path) -> list[Task]:
    """Return what is run: every algorithm that looks at pixels."""
    images, dem = simulated(block)
    measured = str(block / "image_points.csv")
    points = ("--gcps", str(block / "ground_points.csv"), "--image-points", measured)
    orthos = tuple(str(block.parent / "ortho" / f"{Path(image).stem}_ortho.tif") for image in images)
    ventoux, triplet = paths(SAMPLES["Ventoux"]), paths(SAMPLES["triplet"])
    real = [
        Task(f"triangulate, {name}", ("triangulate", *paths(sample)), TIES, RMSE, name)
        for name, sample in SAMPLES.items()
    ]
    return [
        *real,
        Task("triangulate, simulated", ("triangulate", *images, *points, *dem), TIES, RMSE),
        Task("tie-points, simulated", ("tie-points", *images, *dem), TIES),
        Task("evaluate, triplet", ("evaluate", *triplet), ("tracks", "points")),
        Task("gcps-from-reference, simulated",
             ("gcps-from-reference", *images, "--reference", str(block / "orthophoto.tif"), *dem), ("measurements",)),
        Task("measure-targets, simulated", ("measure-targets", *images, "--points", measured), ("measured",)),
        Task("ortho-check, simulated", ("ortho-check", *orthos), WINDOWS, MEDIAN),
        Task("match, Ventoux", ("match", *ventoux), ("correspondences",)),
        Task("interest-points harris, triplet", ("interest-points", triplet[0], "--detector", "harris"), POINTS),
        Task("interest-points centres, triplet", ("interest-points", triplet[0], "--detector", "centres"), POINTS),
    ]  # fmt: skip


def compare(task: Task, folder: Path) -> str:
    """Return the row of a task: both ways, and their ratios."""
    found, seconds, fit, tracks = [], [], [], []
    for stock in (False, True):
        out = folder / f"{task.name}-{stock}".replace(" ", "-")
        seconds.append(run_words((*task.words, "--output-dir", str(out)), folder, stock))
        report = json.loads((out / "report.json").read_text(encoding="utf-8"))
        held_out = (report.get("held_out") or {}).get("points", 0) if task.found == TIES else 0
        found.append((value(report, task.found) or 0) + held_out)
        fit.append(f"{value(report, task.fit):.3f}" if task.fit else "")
        tracks.append(judged(report, task.sample))
    share, ratio = found[1] / max(found[0], 1), seconds[1] / seconds[0]
    return (
        f"| {task.name} | {found[0]} | {found[1]} | {share:.3f} | {seconds[0]:.1f} | {seconds[1]:.1f} | {ratio:.2f} | "
        f"{fit[0]} | {fit[1]} | {tracks[0]} | {tracks[1]} |"
    )


def run_words(words: Sequence[str], folder: Path, stock: bool) -> float:
    """Run a command; return its processor time in seconds."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    if stock:
        environment["PYTHONPATH"] = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "hrsi", *words, "--quiet", "--threads", "1"]
    done = subprocess.run(command, env=environment, cwd="/", capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"{' '.join(words)}: {done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def value(report: dict, names: Sequence[str]) -> float:
    """Return an entry of a report."""
    for name in names:
        report = report[name]
    return report  # type: ignore[return-value]


def judged(report: dict, sample: str) -> str:
    """Return the RMSE of the sample's independent SIFT tracks by the refined RPCs."""
    if not sample:
        return ""
    images = [open_image(path) for path in paths(SAMPLES[sample])]
    refined = [open_image(report["images"][image.id]["output"]).rpc for image in images]
    return sift_rmse(images, refined).partition(" ")[2].partition(" ")[0]


if __name__ == "__main__":
    main(sys.argv[1:])

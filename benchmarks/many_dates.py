"""Many dates over one place: are all images held, at what cost? `many_dates.py [--dates N] [--hopeless SHARE] …`.

A simulated year (`simulate --dates N`), an image of 1000 x 1000 px on each date. HRSI's tie points and adjustment are
compared with what is usual: OpenCV's SIFT between all pairs (4000 keypoints, as HRSI's probes have, ratio 0.75, mutual,
MAGSAC fundamental matrix of 1 px), joined into tracks and adjusted in the same way. ``--hopeless`` puts that share of
the images under clouds or moves their RPCs by 200 px. Errors are true ones: points of the ground are projected by the
true cameras, and each image is predicted from the point that all other adjusted images intersect.

``--every K`` takes each Kth date only: the same year with fewer views. ``--no-sift`` leaves the rival out, ``--folder``
keeps the images (a folder of each seed in it), ``--docs`` adds the lines to docs/many_dates.md, in the place of those
of the same name, and says there how many of the years that both methods were run on each of them holds: whether all
pairs do depends on the year. HRSI's row is that of the command `hrsi triangulate` with two threads, as users have it:
seconds by the clock and of the processors, and the most memory that it had.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from osgeo import gdal
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from hrsi.benchmarks.pages import DOCS, make_parser, put_between
from hrsi.hrsi_engine import AdjustOptions, adjust, open_image
from hrsi.hrsi_engine.adjustment.evaluation import fit_tracks
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Image, ImagePoints, Role
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import SolveError
from hrsi.hrsi_engine.measurement.block_matching.joining import build_tracks

SIDE_PX, RELIEF_M, OFF_NADIR_DEG = 1000, 60.0, 20.0
HELD_PX = 0.5  # true relative error below which an image is held
WRONG_RPC_PX = 200.0
THREADS = 2
KEYPOINTS, RATIO = 4000, 0.75  # of the rival
END = "<!-- end of the table -->"
PAGE = DOCS / "many_dates.md"


def simulated(folder: Path, dates: int, seed: int, side: int) -> list[str]:
    """Return the images of a year, made where they are not there yet."""
    if not (folder / "report.json").exists():
        words = {"output-dir": folder, "dates": dates, "images": 1, "size": side, "gcps": 0, "checks": 0, "ties": 400,
                 "relief": RELIEF_M, "off-nadir": OFF_NADIR_DEG, "seed": seed, "threads": THREADS}  # fmt: skip
        options = [text for name, value in words.items() for text in (f"--{name}", str(value))]
        subprocess.run([sys.executable, "-m", "hrsi", "simulate", "--quiet", *options], check=True)
    return sorted(str(path) for path in folder.glob("d*_1.tif"))


def true_cameras(folder: Path) -> dict[str, RPC]:
    """Return the RPCs fitted to the true cameras (to 1e-6 px), by image."""
    images = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["images"]
    return {
        name: RPC(**{key: np.array(value) if isinstance(value, list) else value
                     for key, value in image["true_rpc"]["rpc"].items()})
        for name, image in images.items()
    }  # fmt: skip


def spoil(images: Sequence[Image], share: float, seed: int) -> tuple[list[Image], list[str]]:
    """Return the images with a share of them made hopeless, by turns clouds and a wrong RPC; also their ids.

    These are files of their own, in a folder ``hopeless`` beside the others.
    """
    rng = np.random.default_rng([seed, 7])
    chosen = rng.permutation(len(images))[: round(share * len(images))]
    spoilt, driver = list(images), gdal.GetDriverByName("GTiff")
    for turn, number in enumerate(chosen.tolist()):
        image = images[number]
        path = Path(image.path).parent / "hopeless" / Path(image.path).name
        path.parent.mkdir(exist_ok=True)
        source = gdal.Open(image.path)
        rpc = source.GetMetadata("RPC")
        if turn % 2:
            direction = rng.uniform(0.0, 2.0 * np.pi)
            for key, off in (("SAMP_OFF", np.cos(direction)), ("LINE_OFF", np.sin(direction))):
                rpc[key] = repr(float(rpc[key]) + WRONG_RPC_PX * float(off))
            dataset = driver.CreateCopy(str(path), source)
            dataset.SetMetadata(rpc, "RPC")
            del dataset
            spoilt[number] = open_image(str(path))
            continue
        grey = np.zeros((image.size[1], image.size[0]), np.float32)
        for octave in range(4, 9):  # clouds: smooth, bright, with the noise of the sensor
            coarse = rng.standard_normal((image.size[1] // 2**octave + 2, image.size[0] // 2**octave + 2))
            grey += 2.0**octave * cv2.resize(coarse.astype(np.float32), image.size, interpolation=cv2.INTER_CUBIC)
        grey = 1500.0 + grey + rng.normal(0.0, 6.0, grey.shape)
        dataset = driver.Create(str(path), *image.size, 1, gdal.GDT_UInt16)
        dataset.GetRasterBand(1).WriteArray(np.clip(grey, 0, 2047).astype(np.uint16))
        dataset.SetMetadata(rpc, "RPC")
        del dataset
        spoilt[number] = open_image(str(path))
    return spoilt, sorted(images[number].id for number in chosen.tolist())


def adjusted_cameras(images: Sequence[Image], ties: ImagePoints) -> dict[str, RPC]:
    """Return the RPCs that the tie points lead to, of the images that have any."""
    tied = [image for image in images if np.any(ties.image_ids == image.id)]
    if len(tied) < 2:
        return {}
    try:
        result = adjust(assemble(tied, [], [ties]), AdjustOptions(threads=THREADS))
    except SolveError as error:
        print(f"  the adjustment fails: {error}")
        return {}
    return {
        image.id: result.model.compute_refined_rpc(image, values).rpc
        for image, values in zip(result.block.images, result.values, strict=True)
    }


def true_errors_px(cameras: dict[str, RPC], truth: dict[str, RPC], images: Sequence[Image], folder: Path) -> Any:
    """Return each adjusted image's true relative error, RMS length in px, by id."""
    if len(cameras) < 3:
        return {}
    points = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["ground_points"]
    ground = np.array([point["ground"] for point in points.values()])
    seen = [image for image in images if image.id in cameras]
    tables = []
    for image in seen:
        xy = truth[image.id].project(ground)
        inside = ((xy > 0.0) & (xy < np.array(image.size) - 1.0)).all(axis=1)
        ids = np.array([f"P{k:05d}" for k in np.flatnonzero(inside)])
        tables.append(ImagePoints(ids, [image.id] * len(ids), xy[inside], 0.1))
    block = assemble([replace(image, rpc=cameras[image.id]) for image in seen], [], tables)
    observations, fit = fit_tracks(block, (block.points.role == Role.TIE) & (block.rays_per_point() >= 3))
    error = {}
    for index, image in enumerate(seen):
        rows = observations.by_image[index]
        miss = fit.predicted_px[rows]
        miss = miss[np.isfinite(miss).all(axis=1)]
        error[image.id] = float(np.sqrt(np.mean(np.sum(miss**2, axis=1)))) if len(miss) else float("nan")
    return error


def sift_of_all_pairs(images: Sequence[Image]) -> ImagePoints:
    """Return tracks of SIFT between all pairs: ratio test, mutual, MAGSAC; tracks twice on an image are dropped."""
    features = []
    for image in images:
        grey = image.raster.read(0, 0, *image.size)[0].astype(np.float64)
        low, high = np.percentile(grey, (1, 99))
        eight_bit = np.clip((grey - low) / max(high - low, 1.0) * 255.0, 0, 255).astype(np.uint8)
        keypoints, descriptors = cv2.SIFT_create(KEYPOINTS, contrastThreshold=0.01).detectAndCompute(eight_bit, None)
        unit = descriptors[:KEYPOINTS] / np.linalg.norm(descriptors[:KEYPOINTS], axis=1, keepdims=True)
        features.append((np.array([k.pt for k in keypoints[:KEYPOINTS]]), unit.astype(np.float32)))
    base = np.cumsum([0, *(len(xy) for xy, _ in features)])
    edges = []
    for i, j in itertools.combinations(range(len(images)), 2):
        pairs = _mutual(features[i][1] @ features[j][1].T)
        if len(pairs) < 8:
            continue
        try:
            _, inlier = cv2.findFundamentalMat(
                features[i][0][pairs[:, 0]], features[j][0][pairs[:, 1]], cv2.USAC_MAGSAC, 1.0, 0.9999, 10000
            )
        except cv2.error:  # OpenCV's own assertion, where no sample of the pair makes a model
            continue
        if inlier is not None:
            edges.append(pairs[inlier.ravel() > 0] + (base[i], base[j]))
    first, second = np.concatenate(edges).T
    image = np.repeat(np.arange(len(images)), np.diff(base))
    track = build_tracks(first, second, image)
    node = np.flatnonzero(track >= 0)
    xy = np.concatenate([xy for xy, _ in features])[node]
    ids = np.char.add("S", np.char.zfill(track[node].astype(str), 7))
    return ImagePoints(ids, np.array([image.id for image in images])[image[node]], xy)


def _mutual(likeness: np.ndarray) -> np.ndarray:
    """Return index pairs that are each other's nearest and pass the ratio test both ways."""
    nearest, passes = [], []
    for table in (likeness, likeness.T):
        best = table.argmax(axis=1)
        first = table[np.arange(len(table)), best]
        second = np.partition(table, -2, axis=1)[:, -2]
        nearest.append(best)
        passes.append(1.0 - first < RATIO**2 * (1.0 - second))  # squared distances of unit vectors are 2 (1 - cosine)
    index = np.flatnonzero(passes[0] & (nearest[1][nearest[0]] == np.arange(len(likeness))) & passes[1][nearest[0]])
    return np.column_stack([index, nearest[0][index]])


def components(ties: ImagePoints) -> int:
    """Return how many parts the images that have tie points fall into."""
    names, image = np.unique(ties.image_ids, return_inverse=True)
    tracks, track = np.unique(ties.ids, return_inverse=True)
    graph = coo_matrix((np.ones(len(image)), (image, len(names) + track)), shape=(len(names) + len(tracks),) * 2)
    return int(connected_components(graph, directed=False)[0])


class Outcome(NamedTuple):
    """What came out of one method: errors of the adjusted images (px), and the last columns of the table.

    elapsed_s : by the clock, of HRSI's command
    """

    errors: dict[str, float]
    tried: int
    parts: int
    cpu_s: float
    elapsed_s: str = "–"
    mib: str = "–"
    named: frozenset[str] = frozenset()


def hrsi(images: Sequence[Image], truth: dict[str, RPC], folder: Path) -> Outcome:
    """Return what HRSI makes of the images, and say what it says of them."""
    with tempfile.TemporaryDirectory() as out:
        options = ["--output-dir", out, "--write", "sidecar", "--force-write", "--no-report", "--threads", str(THREADS)]
        command = [sys.executable, "-m", "hrsi", "triangulate", "--quiet", *options, *(image.path for image in images)]
        start = time.perf_counter()
        process = subprocess.Popen(command)
        _, status, usage = os.wait4(process.pid, 0)
        elapsed = time.perf_counter() - start
        if os.waitstatus_to_exitcode(status) not in (0, 3):
            raise SystemExit(f"exit code {os.waitstatus_to_exitcode(status)}: {' '.join(command)}")
        report = json.loads((Path(out) / "report.json").read_text(encoding="utf-8"))
        cameras = {
            name: open_image(image["output"]).rpc
            for name, image in report["images"].items()
            if image["observations"] and image["output"]
        }
    errors = true_errors_px(cameras, truth, images, folder)
    held = report["held"]
    links = [hold["links"] for hold in held.values() if hold["links"]]
    print(f"  search {report['seconds']['tie_points']:.0f} s; links an image {min(links)} to {max(links)}")
    for name, hold in held.items():
        if hold["links"] < 2:
            print(f"  {name}: {hold}; true error {errors.get(name, float('nan')):.2f} px")
    for warning in report["warnings"]:
        print(f"  {warning}")
    tried = sum(hold["pairs_tried"] for hold in held.values()) // 2
    named = frozenset(name for name, hold in held.items() if not hold["links"])
    parts = len({tuple(part["images"]) for part in report["parts"] if len(part["images"]) > 1})
    cpu = usage.ru_utime + usage.ru_stime
    return Outcome(errors, tried, parts, cpu, f"{elapsed:.0f}", f"{usage.ru_maxrss / 1024:.0f}", named)


def rival(images: Sequence[Image], truth: dict[str, RPC], folder: Path) -> Outcome:
    """Return what SIFT between all pairs makes of the images."""
    start = time.process_time()
    ties = sift_of_all_pairs(images)
    cameras = adjusted_cameras(images, ties)
    seconds = time.process_time() - start
    errors = true_errors_px(cameras, truth, images, folder)
    return Outcome(errors, len(images) * (len(images) - 1) // 2, components(ties), seconds)


def told(scene: str, method: str, hopeless: Sequence[str], number: int, outcome: Outcome) -> str:
    """Print one method's outcome and return it as a line of the table."""
    sound = {name: error for name, error in outcome.errors.items() if name not in hopeless and np.isfinite(error)}
    good = sum(error < HELD_PX for error in sound.values())
    unseen = sum(not error < HELD_PX for error in outcome.errors.values())
    cells = (
        scene, method, f"{good} of {number - len(hopeless)}", len(outcome.named), unseen,
        f"{np.median(list(sound.values())):.3f}" if sound else "–", f"{max(sound.values()):.2f}" if sound else "–",
        outcome.tried, outcome.parts, f"{outcome.cpu_s:.0f}", outcome.elapsed_s, outcome.mib,
    )  # fmt: skip
    line = f"| {' | '.join(map(str, cells))} |"
    print(line, flush=True)
    wrong = {name: round(error, 2) for name, error in outcome.errors.items() if not error < HELD_PX}
    print(f"  not named, beyond {HELD_PX} px: {wrong}", flush=True)
    return line


def enter(lines: Sequence[str]) -> None:
    """Write lines into the page's table, in the place of those of the same scene and method."""
    before, after = PAGE.read_text(encoding="utf-8").split(END)
    for line in lines:
        head = "|".join(line.split("|")[:3])
        rows = before.splitlines()
        same = [place for place, row in enumerate(rows) if row.startswith(head + "|")]
        rows[same[0] if same else len(rows) : same[0] + 1 if same else len(rows)] = [line]
        before = "\n".join(rows) + "\n"
    PAGE.write_text(before + END + after, encoding="utf-8")
    put_between(PAGE, "both methods", compared(before.splitlines()))


def compared(rows: Sequence[str]) -> str:
    """Return what both methods make of the years that both were run on, in words."""
    told: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        scene, *cells = (cell.strip() for cell in row.strip("|").split("|"))
        if len(cells) > 1 and cells[0] in METHODS:
            told.setdefault(scene, {})[cells[0]] = cells[1:]
    both = [of_scene for of_scene in told.values() if len(of_scene) == len(METHODS)]
    lines = []
    for method in METHODS:
        held = [tuple(map(int, of_scene[method][0].split(" of "))) for of_scene in both]
        whole = sum(good == all_ for good, all_ in held)
        median = [float(of_scene[method][3]) for of_scene in both]
        seconds = [of_scene[method][7] for of_scene in both]
        lines.append(
            f"{method}: all images below {HELD_PX} px in {whole} of {len(both)} years, "
            f"{sum(good for good, _ in held)} of {sum(all_ for _, all_ in held)} images together; median error "
            f"{min(median):.3f} to {max(median):.3f} px; {', '.join(seconds)} CPU s."
        )
    return "\n".join(f"- {line}" for line in lines)


METHODS = {"HRSI": hrsi, "SIFT, all pairs": rival}


def main() -> None:
    """Print the table of each year."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--dates", type=int, default=40)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--seed", default="41,42,43", help="of each year, by commas")
    parser.add_argument("--side", type=int, default=SIDE_PX)
    parser.add_argument("--hopeless", type=float, default=0.0)
    parser.add_argument("--folder")
    parser.add_argument("--no-sift", action="store_true")
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        for seed in map(int, words.seed.split(",")):
            lines = of_year(words, Path(words.folder or scratch) / f"seed_{seed}", seed)
            if words.docs:
                enter(lines)


def of_year(words: argparse.Namespace, folder: Path, seed: int) -> list[str]:
    """Print and return the lines of a year."""
    paths = simulated(folder, words.dates, seed, words.side)[:: words.every]
    images, hopeless = spoil([open_image(path) for path in paths], words.hopeless, seed)
    truth = true_cameras(folder)
    print(f"{len(images)} images of {words.side} px, seed {seed}, hopeless: {', '.join(hopeless) or 'none'}")
    scene = f"{len(images)} of {words.side} px, seed {seed}"
    scene += f", {len(hopeless)} unusable" if hopeless else ""
    methods = {"HRSI": hrsi} if words.no_sift else METHODS
    return [told(scene, name, hopeless, len(images), method(images, truth, folder)) for name, method in methods.items()]


if __name__ == "__main__":
    main()

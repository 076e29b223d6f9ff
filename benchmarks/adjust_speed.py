"""Speed, memory and growth of the block adjustment; with --ceres, beside a Ceres solver of the same problem.

    adjust_speed.py FOLDER… [--ceres PROGRAM]     blocks of the generator that comes with the Ceres program
    adjust_speed.py --blunders FOLDER             the block with 1 % and 10 % blunders
    adjust_speed.py --models FOLDER [--docs]      every model on one block; with --docs into docs/adjustment.md
    adjust_speed.py --defaults FOLDER             as the command line adjusts: blunders, drift and all sigmas, and what
                                                  of that is the solution
    adjust_speed.py --growth [10 100 1000 10000]  simulated blocks with about 100 tie points an image

A folder holds rpcs/, image_points.csv, ground_points.csv and truth.csv. Every measurement runs in a process of its
own, which also tells its peak memory; the peak of the solve is counted from the moment the block is assembled
(Linux: the high-water mark is reset there).
"""

import argparse
import glob
import json
import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hrsi.benchmarks.pages import DOCS
from hrsi.hrsi_engine import AdjustOptions, adjust, open_image
from hrsi.hrsi_engine.adjustment import Decision
from hrsi.hrsi_engine.adjustment.outcome.assembly import assemble_adjustment
from hrsi.hrsi_engine.adjustment.preparation.preparation import prepare_problem
from hrsi.hrsi_engine.adjustment.solver import Adjuster
from hrsi.hrsi_engine.adjustment.statistics.precision import compute_precision
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from hrsi.hrsi_engine.block.default_sigmas import DefaultSigmas
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.progress import silent
from hrsi.hrsi_engine.foundation.workers.threads import one_thread_calls
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.refinement import MODELS

#: The competitor's priors, and its rules that the measurements of check points are ties and nothing is left out.
OPTIONS = AdjustOptions(model="affine", sigma_shift_px=20.0, sigma_drift=1e-3, check_as_ties=True, reject_sigma=0.0)


#: Where docs/adjustment.md has the table of the models.
MODELS_BEGIN, MODELS_END = "<!-- models: begin -->", "<!-- models: end -->"


def high_water_mb() -> float:
    """Return the peak memory of this process since the last reset, MB."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(re.search(r"VmHWM:\s+(\d+)", status)[1]) / 1000.0


def reset_high_water() -> None:
    """Let the peak count from now on."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def read_folder(folder: str) -> Block:
    """Return the block of a folder."""
    images = [open_image(path) for path in sorted(glob.glob(f"{folder}/rpcs/*"))]
    ground = read_points(f"{folder}/ground_points.csv", height_datum="ellipsoidal").ground
    measured = read_points(f"{folder}/image_points.csv", image_ids=[image.id for image in images]).image
    return assemble(images, [ground], [measured], defaults=DefaultSigmas(0.3))


def timed(block: Block, options: AdjustOptions) -> dict[str, Any]:
    """Adjust a block; return seconds and peak memory of its parts, and what came out.

    ``solve`` is everything up to the solution, from observations in memory: intersection of all points, pattern,
    iterations. ``compute_precision`` adds all sigmas, redundancy numbers and tests.
    """
    reset_high_water()
    began, cpu = time.perf_counter(), time.process_time()
    with one_thread_calls():  # as `adjust` does
        problem = prepare_problem(block, options)
        rounds = Adjuster(problem)
        solution = rounds.solve(None, silent)
        solved, solve_mb = time.perf_counter(), high_water_mb()
        precise = compute_precision(rounds.loop, solution)
        result = assemble_adjustment(problem, rounds.loop, rounds.found, solution, precise)
    return {
        "solve_s": solved - began, "precision_s": time.perf_counter() - solved, "solve_mb": solve_mb,
        "cpu_s": time.process_time() - cpu, "all_mb": high_water_mb(), "solves": result.solves,
        "cost": solution.cost, "sigma0": result.sigma0, "observations": len(block.measurements),
        "images": len(block.images), "result": result,
    }  # fmt: skip


def check_rmse(result: Any) -> np.ndarray:
    """Return the RMSE east, north, height of the check points, m."""
    points = result.block.points
    check = points.role == Role.CHECK
    return np.sqrt(np.mean(ground_difference_m(points.ground[check], result.ground[check]) ** 2, axis=0))


def measure_folder(folder: str) -> dict[str, Any]:
    """Read and adjust the block of a folder in this process."""
    began = time.perf_counter()
    block = read_folder(folder)
    read_s = time.perf_counter() - began
    numbers = timed(block, OPTIONS)
    result = numbers.pop("result")
    return numbers | {"read_s": read_s, "check_m": check_rmse(result).tolist(), "correction_px": corrections(result)}


def print_models(folder: str, to_docs: bool) -> None:
    """Print processor seconds and memory of every model on one block: solve, all sigmas and tests, the faster of two.

    The models follow each other in one process, so that other work on the machine slows all of them alike.
    """
    block, best = read_folder(folder), {}
    for _ in range(2):
        for name in MODELS:
            numbers = timed(block, replace(OPTIONS, model=name))
            numbers.pop("result")
            before = best.get(name, numbers)
            least_mb = min(before["all_mb"], numbers["all_mb"])  # without what the models before leave behind
            best[name] = min(before, numbers, key=lambda one: one["cpu_s"]) | {"all_mb": least_mb}
        rows = models_table(best)
        print("\n".join(rows), flush=True)
    if to_docs:
        page = DOCS / "adjustment.md"
        text = page.read_text(encoding="utf-8")
        begin, end = text.index(MODELS_BEGIN) + len(MODELS_BEGIN), text.index(MODELS_END)
        page.write_text(text[:begin] + "\n" + "\n".join(rows) + "\n" + text[end:], encoding="utf-8")


def models_table(best: dict[str, dict[str, Any]]) -> list[str]:
    """Return the rows of the table of models."""
    affine = best["affine"]["cpu_s"]
    head = "| model | parameters | CPU s | relative to affine | peak MB | systems | cost |"
    return [head, "|---|---|---|---|---|---|---|"] + [
        f"| {name} | {len(MODELS[name].parameters)} | {n['cpu_s']:.1f} | {n['cpu_s'] / affine:.2f} | "
        f"{n['all_mb']:.0f} | {n['solves']} | {n['cost']:.2f} |"
        for name, n in best.items()
    ]


def corrections(result: Any) -> list[float]:
    """Return the corrections at nine points of every image, px: what two solutions are compared by."""
    values = []
    for image, parameters in zip(result.block.images, result.values, strict=True):
        grid = image.grid_px(3, 3) - image.centre_px
        terms = np.column_stack([np.ones(9), grid])
        values.append(np.column_stack([terms @ parameters[:3], terms @ parameters[3:]]))
    return np.concatenate(values).ravel().round(6).tolist()


def ceres(program: str, folder: str) -> dict[str, float]:
    """Run the competitor; return its figures."""
    text = subprocess.run([program, folder, "--lib", "cx"], capture_output=True, text=True, check=True).stdout
    patterns = {
        "solve_s": r"solve ([\d.]+) s", "peak_mb": r"peak RSS (\d+)", "solves": r"linear solves (\d+)",
        "cost": r"final cost ([\d.]+)", "east_m": r"RMSE E ([\d.]+)", "north_m": r"E [\d.]+ N ([\d.]+)",
        "height_m": r"N [\d.]+ H ([\d.]+)", "truth_px": r"correction over the image ([\d.]+)",
    }  # fmt: skip
    return {key: float(re.search(pattern, text)[1]) for key, pattern in patterns.items()}


def against_truth(folder: str, corrections_px: list[float], images: int) -> float:
    """Return the RMS difference of our corrections from the true ones at the nine points, px."""
    truth = np.loadtxt(f"{folder}/truth.csv", delimiter=",", skiprows=1, max_rows=images, usecols=range(2, 8))
    ours = np.array(corrections_px).reshape(images, 9, 2)
    offset = np.linspace(-1.0, 1.0, 3) * 6000.0
    grid = np.stack(np.meshgrid(offset, offset), axis=-1).reshape(-1, 2)
    terms = np.column_stack([np.ones(9), grid])
    true = np.stack([terms @ truth[:, :3].T, terms @ truth[:, 3:].T], axis=-1).transpose(1, 0, 2)
    return float(np.sqrt(np.mean((ours - true) ** 2)))


def in_own_process(*arguments: str) -> dict[str, Any]:
    """Run this script with other arguments; return what it prints as JSON."""
    command = [sys.executable, __file__, *arguments]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return json.loads(text.splitlines()[-1])


def print_folder(folder: str, program: str | None) -> None:
    """Print one block, ours and the competitor's, back to back: ours, theirs, ours, theirs."""
    rounds = [(in_own_process("--one", folder), ceres(program, folder) if program else None) for _ in range(2)]
    for ours, theirs in rounds:
        total = ours["read_s"] + ours["solve_s"] + ours["precision_s"]
        check = " ".join(f"{value:.4f}" for value in ours["check_m"])
        print(
            f"{Path(folder).name}: {ours['images']} images, {ours['observations']} image points\n"
            f"  ours : solve {ours['solve_s']:.2f} s ({ours['solves']} systems), {ours['solve_mb']:.0f} MB; all sigmas "
            f"and tests {ours['precision_s']:.2f} s, {ours['all_mb']:.0f} MB; with reading {total:.1f} s\n"
            f"         cost {ours['cost']:.4f}, check {check} m, correction - truth "
            f"{against_truth(folder, ours['correction_px'], ours['images']):.4f} px"
        )
        if theirs:
            print(
                f"  Ceres: solve {theirs['solve_s']:.2f} s ({theirs['solves']:.0f} systems), "
                f"{theirs['peak_mb']:.0f} MB\n"
                f"         cost {theirs['cost']:.4f}, check {theirs['east_m']:.4f} {theirs['north_m']:.4f} "
                f"{theirs['height_m']:.4f} m, correction - truth {theirs['truth_px']:.4f} px\n"
                f"  ratio ours / Ceres: time {ours['solve_s'] / theirs['solve_s']:.2f}, memory "
                f"{ours['solve_mb'] / theirs['peak_mb']:.2f}"
            )


# ---- blunders ------------------------------------------------------------------------------------------------------


def with_blunders(block: Block, share: float, seed: int = 5) -> tuple[Block, np.ndarray, np.ndarray]:
    """Return the block with blunders of 5 to 50 px in a share of its tie measurements, their rows and vectors."""
    rng = np.random.default_rng(seed)
    ties = np.flatnonzero(block.points.role[block.measurements.point] == Role.TIE)
    rows = ties[rng.random(len(ties)) < share]
    size, angle = rng.uniform(5, 50, len(rows)), rng.uniform(0, 2 * np.pi, len(rows))
    error = np.column_stack([size * np.cos(angle), size * np.sin(angle)])
    xy = block.measurements.xy.copy()
    xy[rows] += error
    return replace(block, measurements=replace(block.measurements, xy=xy)), rows, error


def visible_sigmas(block: Block, clean: Any, rows: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return how many sigmas of each blunder show in its residual (redundancy of its point alone), ``(k,)``.

    On two rays an error along the epipolar line is part of the point's position: no test can see it.
    """
    all_rows = block.measurements
    by_ground = np.empty((len(all_rows), 2, 3))
    for index, image in enumerate(block.images):
        here = np.flatnonzero(all_rows.image == index)
        by_ground[here] = image.rpc.project_with_metric_jacobian(clean.ground[all_rows.point[here]])[1]
    normal = np.zeros((len(block.points), 3, 3))
    np.add.at(normal, all_rows.point, by_ground.swapaxes(1, 2) @ by_ground)
    own = by_ground[rows]
    seen = np.einsum(
        "nci,nij,nj->nc", own, np.linalg.inv(normal[all_rows.point[rows]]), np.einsum("nci,nc->ni", own, error)
    )
    return np.sqrt(np.maximum(np.sum(error * (error - seen), axis=1), 0.0)) / all_rows.sigma_px[rows]


def print_blunders(folder: str) -> None:
    """Print what Huber's weights and data snooping do with blunders."""
    block = read_folder(folder)
    clean = adjust(block, OPTIONS)
    base = check_rmse(clean)
    print(f"{Path(folder).name}, clean: check RMSE {base.round(4)} m, {clean.solves} systems")
    for share in (0.01, 0.1):
        bad, rows, error = with_blunders(block, share)
        shown = visible_sigmas(block, clean, rows, error)
        wrong = np.zeros(len(bad.measurements), dtype=bool)
        wrong[rows] = True
        touched = np.zeros(len(bad.points), dtype=bool)
        touched[bad.measurements.point[rows]] = True
        untouched = ~touched[bad.measurements.point]
        for options in (replace(OPTIONS, robust="huber"), replace(OPTIONS, reject_sigma=4.0)):
            began = time.perf_counter()
            result = adjust(bad, options)
            seconds = time.perf_counter() - began
            change = 100.0 * (check_rmse(result) / base - 1.0)
            what = "snooping" if options.reject_sigma else options.robust
            print(
                f"  {share:.0%} blunders, {what}: check RMSE {check_rmse(result).round(4)} m "
                f"({change.round(1)} %), {result.solves} systems, {seconds:.1f} s"
            )
            if options.reject_sigma:
                out = result.decision != int(Decision.KEPT)
                named = result.decision == int(Decision.BLUNDER)
                print(
                    f"    left out: {out[rows].mean():.2%} of all blunders, {out[rows][shown > 10].mean():.2%} of "
                    f"those that show more than 10 sigma; false alarms: {out[untouched].mean():.3%} of the "
                    f"measurements of clean points, {named[~wrong].mean():.3%} of all good ones named as blunders, "
                    f"{(out & ~wrong).mean():.2%} lost as doubtful beside a blunder"
                )


# ---- growth --------------------------------------------------------------------------------------------------------


def simulated(count: int, per_image: int = 100, seed: int = 1) -> Block:
    """Return a block of ``count`` images in triplets over a square of scenes with 13 % overlap.

    Parallel-ray cameras of 0.8 m; ties are spread evenly so that an image gets about ``per_image``; one scene in
    thirty has a GCP. Noise 0.3 px, shifts of 10 px and drifts of 1 px.
    """
    rng = np.random.default_rng(seed)
    scenes = max(1, round(count / 3))
    width = int(np.ceil(np.sqrt(scenes)))
    step, half_px, gsd = 0.87 * 12000 * 0.8, 6000.0, 0.8
    centre = np.column_stack(np.divmod(np.arange(scenes), width)).astype(float) * step
    centre -= centre.mean(axis=0)
    origin = np.array([[15.0, 5.0, 500.0]])
    images = []
    for index in range(count):
        scene, view = index % scenes, index // scenes
        lon, lat, _ = move_ground(origin, np.array([[*centre[scene], 0.0]]))[0]
        images.append(Image(f"I{index:06d}", _camera(lon, lat, (0.25 * (view - 1), 0.02 * rng.normal()), half_px, gsd)))
    total = round(per_image * count / 3.3)
    place = rng.uniform(-0.5, 0.5, (total, 2)) * (np.ptp(centre, axis=0) + 12000 * gsd)
    place = place[np.argsort(place[:, 0])]
    truth = move_ground(np.repeat(origin, total, axis=0), np.column_stack([place, rng.uniform(-200, 200, total)]))
    ids = np.array([f"P{k:07d}" for k in range(total)])
    tables = []
    for index, image in enumerate(images):
        middle, reach = centre[index % scenes], 6500 * gsd
        west, east = np.searchsorted(place[:, 0], [middle[0] - reach, middle[0] + reach])
        near = west + np.flatnonzero(np.abs(place[west:east, 1] - middle[1]) < reach)
        xy = image.rpc.project(truth[near]) if len(near) else np.empty((0, 2))
        inside = (np.abs(xy - half_px) < half_px).all(axis=1) & (rng.random(len(near)) < 0.88)
        offset = xy[inside] - half_px
        error = rng.normal(0, 10.0, 2) + offset @ rng.normal(0, 1.0 / 12000, (2, 2))
        tables.append((near[inside], index, xy[inside] + error + rng.normal(0, 0.3, offset.shape)))
    rows = np.concatenate([points for points, _, _ in tables])
    names = np.concatenate([np.full(len(points), images[index].id) for points, index, _ in tables])
    measured = ImagePoints(ids[rows], names, np.concatenate([xy for _, _, xy in tables]), 0.3)
    control = np.unique(rng.choice(total, max(6, count // 30)))
    survey = move_ground(truth[control], rng.normal(0, 0.1, (len(control), 3)))
    return assemble(images, [GroundPoints(ids[control], survey, Role.GCP, 0.1)], [measured])


def _camera(lon: float, lat: float, tilt: tuple[float, float], half_px: float, gsd: float) -> RPC:
    """Return a parallel-ray camera over a place; ``tilt`` is metres on the ground per metre of height."""
    metres_lat, metres_lon = 110_574.0, 111_320.0 * np.cos(np.radians(lat))
    scale_m, height_scale = half_px * gsd, 500.0
    sample, line, one = np.zeros(20), np.zeros(20), np.zeros(20)
    sample[1], sample[3] = 1.0, tilt[1] * height_scale / scale_m
    line[2], line[3] = -1.0, -tilt[0] * height_scale / scale_m
    one[0] = 1.0
    return RPC(
        half_px, half_px, lat, lon, 500.0, half_px, half_px, scale_m / metres_lat, scale_m / metres_lon, height_scale,
        line, one, sample, one,
    )  # fmt: skip


def print_defaults(folder: str) -> None:
    """Print processor seconds of the whole adjustment with the defaults and with a shift, and of its solution alone.

    The solution alone is that of the same model with the same drift, from observations in memory, nothing left out and
    no sigma; what comes on top is data snooping, the tests of GCPs and sigmas, all sigmas, and what is delivered. Both
    are the faster of three, one after the other.
    """
    block = read_folder(folder)
    for model in (AdjustOptions().model, "shift"):
        whole, alone = [], []
        for _ in range(3):
            began = time.process_time()
            result = adjust(block, AdjustOptions(model=model))
            whole.append(time.process_time() - began)
            began = time.process_time()
            Adjuster(prepare_problem(block, AdjustOptions(model=model, reject_sigma=0.0))).solve(None, silent)
            alone.append(time.process_time() - began)
        check = " ".join(f"{value:.3f}" for value in check_rmse(result))
        solution, rest = min(alone), min(whole) - min(alone)
        print(
            f"{model} ({result.model.name}): {min(whole):.1f} CPU s, {result.solves} systems, check {check} m; "
            f"solution alone {solution:.1f} CPU s, snooping, tests and sigmas {rest:.1f}: "
            f"{rest / solution:.2f} times the solution"
        )


def print_growth(counts: list[int]) -> None:
    """Print time and memory per image as the block grows; the growth is what comes on top of the process itself."""
    print("growth: images, image points, solve s, all sigmas s, peak MB | processor ms and MB per image")
    for count in counts:
        numbers = in_own_process("--grown", str(count))
        per_image = 1000.0 * numbers["cpu_s"] / count
        grown = (numbers["all_mb"] - numbers["base_mb"]) / count
        print(
            f"  {count:6d} {numbers['observations']:8d} {numbers['solve_s']:7.2f} {numbers['precision_s']:7.2f} "
            f"{numbers['all_mb']:8.0f} {per_image:7.2f} {grown:7.3f}   sigma0 {numbers['sigma0']:.4f}"
        )


def main() -> None:
    """Read the arguments and print what they ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*")
    parser.add_argument("--ceres", metavar="PROGRAM")
    parser.add_argument("--blunders", metavar="FOLDER")
    parser.add_argument("--defaults", metavar="FOLDER")
    parser.add_argument("--growth", nargs="*", type=int)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--grown", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--models", metavar="FOLDER")
    parser.add_argument("--docs", action="store_true", help="put the table of --models into the documentation")
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure_folder(given.one)))
    elif given.grown:
        os.environ["HRSI_COMPILED"] = "1"  # also for the small ones, so that all sizes run the same code
        block = simulated(given.grown)
        timed(simulated(10), OPTIONS)  # loads the compiled code
        reset_high_water()
        base_mb = high_water_mb()
        numbers = timed(block, OPTIONS)
        numbers.pop("result")
        print(json.dumps(numbers | {"base_mb": base_mb}))
    elif given.models:
        print_models(given.models, given.docs)
    elif given.blunders:
        print_blunders(given.blunders)
    if given.defaults:
        print_defaults(given.defaults)
    for folder in given.folders:
        print_folder(folder, given.ceres)
    if given.growth is not None:
        print_growth(given.growth or [10, 100, 1000, 10_000])
    if len(sys.argv) == 1:
        print_growth([10, 100, 1000])


if __name__ == "__main__":
    main()

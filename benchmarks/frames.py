"""Images that share an exposure or a pass: strips of frames that point badly, SkySat, a thousand frames, PAN and MS.

    frames.py strips COUNT        strips of 4 to 40 frames whose RPCs point to 5, 15, 50 and 100 px
    frames.py bands COUNT         so many stereo pairs of PAN images, alone and with their MS images
    frames.py FOLDER|COUNT …      the whole command on real RPCs (*.rpc) and tie points (image_points.csv.gz) of a
                                  folder, or on so many simulated frames of 2560 x 1080 px with 300 ties each

With ``--docs`` a table goes to docs/protocols/large_blocks.md as it grows.

A strip is seen by two looks of one orbit; neighbours overlap by 40 %, their rays are parallel to a few thousandths of a
degree. *Relative* is the RMS distance of exact image points from those of the refined cameras after intersection;
*lost* is the share of the right tie measurements that were left out, of points without a blunder.

PAN and MS of an exposure are taken by one physical camera with pixels of two sizes, disturbed by one error; their RPCs
are fitted by themselves. *Inside* are the shares of the true errors of tie points inside the CE90 and LE90 of the area.
"""

from __future__ import annotations

import gzip
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pages import put_between

from hrsi.benchmarks.pages import DOCS
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Adjustment, Decision
from hrsi.hrsi_engine.adjustment.observations import select_points
from hrsi.hrsi_engine.adjustment.starting_values.intersection import compute_intersection_residuals
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import GroundPoints, Image, ImagePoints, Role
from hrsi.hrsi_engine.block.exposures import join_exposures
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import SolveError
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.io.rpc_files.write import write_rpc_text
from hrsi.hrsi_engine.laboratory.simulation import PushbroomCamera, aim_camera, fit_camera
from hrsi.hrsi_engine.laboratory.simulation.options import Noise, PointCounts, SceneSpec
from hrsi.hrsi_engine.laboratory.simulation.sensors import SENSORS, OrientationError
from hrsi.hrsi_engine.laboratory.simulation.synthesis import BlockSimulation, simulate_block
from hrsi.hrsi_engine.laboratory.simulation.vendor import make_accuracy_statement
from hrsi.hrsi_engine.laboratory.simulation.views import make_strip_views

PAGE = DOCS / "protocols/large_blocks.md"
POINTING_PX = (5.0, 15.0, 50.0, 100.0)
FRAME_PX, OVERLAP, LOOKS = (800, 600), 0.4, 2


def simulate_strip(frames: int, pointing_px: float, seed: int, blunders: float = 0.02) -> BlockSimulation:
    """Return a strip of frames, each of which points by itself to ``pointing_px`` (a coordinate)."""
    sensor = SENSORS["worldview-2"]
    rng = np.random.default_rng([seed, frames])
    pixel_rad = sensor.gsd_m / sensor.altitude_m
    views = make_strip_views(sensor, 1, max(frames // LOOKS, 1), LOOKS, FRAME_PX, OVERLAP)
    errors = rng.normal(0.0, pointing_px * pixel_rad, (len(views), 2))
    drifts = rng.normal(0.0, 0.1 * pixel_rad, (len(views), 2))
    views = tuple(
        replace(view, vendor_error=OrientationError(attitude_rad=(*error, 0.0), attitude_drift_rad=(*drift, 0.0)))
        for view, error, drift in zip(views, errors.tolist(), drifts.tolist(), strict=True)
    )
    noise = Noise(image_px=0.1, blunders=blunders, vendor=1.0)
    return simulate_block(SceneSpec(seed=seed), views, PointCounts(0, 10, 60 * len(views)), noise)


def judge_strip(simulated: BlockSimulation, model: str) -> dict[str, Any]:
    """Adjust a strip; return what came out."""
    block, began = simulated.block, time.process_time()
    try:
        result = adjust(block, AdjustOptions(model=model))
    except SolveError as error:
        return {"error": str(error)}
    seconds = time.process_time() - began
    wrong, tie = simulated.truth.blunder, (block.points.role == Role.TIE)[block.measurements.point]
    spoilt = np.bincount(block.measurements.point, weights=wrong, minlength=len(block.points)) > 0
    right = ~spoilt[block.measurements.point]
    exact = replace(block, measurements=replace(block.measurements, xy=simulated.truth.image_points.xy))
    observations = select_points(exact, (exact.points.role == Role.TIE) & (exact.rays_per_point() >= 2))
    start = result.ground[observations.points]
    apart = compute_intersection_residuals(observations, result.model, result.values, start)
    return {
        "images": len(block.images),
        "relative_px": float(np.sqrt(np.nanmean((apart**2).sum(axis=1)))),
        "lost": float((result.decision != Decision.KEPT)[right & tie].mean()),
        "found": float((result.decision != Decision.KEPT)[wrong & tie].mean()),
        "iterations": len(result.history),
        "converged": result.converged,
        "seconds": seconds,
    }


class Table:
    """Lines that are printed, and with ``--docs`` stand in the page between the marks of a name."""

    def __init__(self, name: str, columns: str) -> None:
        self.name, self.lines = name, [columns, "|" + "---|" * (columns.count("|") - 1)]
        print("\n".join(self.lines), flush=True)

    def add_row(self, row: str) -> None:
        """Print a row, and write the table so far."""
        self.lines.append(row)
        print(row, flush=True)
        if "--docs" in sys.argv:
            put_between(PAGE, self.name, "\n".join(self.lines))


def print_strips(count: int) -> None:
    """Print a row for each pointing error and model: the worst of its strips."""
    table = Table(
        "strips",
        "| pointing px, model | strips | worst relative px | correct tie points lost, most | not converged | singular "
        "| CPU s per frame |",
    )
    sizes = np.linspace(4, 40, count).astype(int) // LOOKS * LOOKS
    for pointing in POINTING_PX:
        strips = [simulate_strip(int(frames), pointing, 100 + k) for k, frames in enumerate(sizes)]
        for model in ("auto", "shift"):
            rows = [judge_strip(strip, model) for strip in strips]
            good = [row for row in rows if "error" not in row]
            table.add_row(
                f"| {pointing:.0f}, {model} | {len(rows)} | {max(row['relative_px'] for row in good):.3f} | "
                f"{max(row['lost'] for row in good):.2%} | {sum(not row['converged'] for row in good)} | "
                f"{len(rows) - len(good)} | {sum(r['seconds'] for r in good) / sum(r['images'] for r in good):.3f} |"
            )


PAN_PX, MS_PIXEL, CENTRE, RELIEF_M = 8000, 4, np.array([5.45, 43.53, 250.0]), 200.0
#: Points measured on both PANs, on both MS, on one exposure's PAN and MS only; the first are also on the MS, by halves.
ON_PANS, ON_BANDS, ON_ONE_EXPOSURE, CHECKS = 200, 150, 30, 60


@cache
def make_exposures() -> list[tuple[PushbroomCamera, Image]]:
    """Return cameras and images: both PANs, then both MS."""
    pan = SENSORS["pleiades"]
    found = []
    for band, pixel in (("PAN", 1), ("MS", MS_PIXEL)):
        sensor = replace(pan, gsd_m=pan.gsd_m * pixel, line_rate_hz=pan.line_rate_hz / pixel)
        size = (PAN_PX // pixel, PAN_PX // pixel)
        for number, angle in enumerate((12.0, -12.0)):
            camera = aim_camera(sensor, size, CENTRE, angle)
            rpc = fit_camera(camera, (CENTRE[2] - RELIEF_M, CENTRE[2] + RELIEF_M)).rpc
            found.append((camera, Image(f"{band}_{number}", make_accuracy_statement(rpc, camera, pan.accuracy, 1.0))))
    return [(camera, replace(image, size=camera.size)) for camera, image in found]


def judge_bands(seed: int, gcps: int) -> dict[str, list[float]]:
    """Adjust a pair's PANs alone, with MS that have points, and with MS that have none; return figures of each."""
    rng, exposures = np.random.default_rng([seed, gcps]), make_exposures()
    counts = [gcps, CHECKS, ON_PANS, ON_BANDS, ON_ONE_EXPOSURE]
    kind = np.repeat(np.arange(5), counts)
    reach = 0.46 * PAN_PX * SENSORS["pleiades"].gsd_m
    offset = np.column_stack([rng.uniform(-reach, reach, (len(kind), 2)), rng.uniform(-0.5, 0.5, len(kind)) * RELIEF_M])
    truth = move_ground(np.tile(CENTRE, (len(kind), 1)), offset)
    ids = np.array([f"{name}{number:04d}" for number, name in enumerate(np.array([*"GCPBQ"])[kind])])
    errors = [SENSORS["pleiades"].accuracy.draw(rng) for _ in range(2)]
    cameras = [camera.disturb(errors[index % 2]) for index, (camera, _) in enumerate(exposures)]
    tables = []
    for index, (camera, (_, image)) in enumerate(zip(cameras, exposures, strict=True)):
        of_pan = index < 2
        seen = (kind < 3) | ((kind == 4) & (index % 2 == 0)) if of_pan else (kind > 2) | (np.arange(len(kind)) % 2 == 0)
        seen &= (kind != 4) | (index % 2 == 0)
        xy = camera.ground_to_image(truth[seen]) + rng.normal(0.0, 0.3, (int(seen.sum()), 2))
        tables.append(ImagePoints(ids[seen], np.full(int(seen.sum()), image.id), xy, 0.3))
    known, sigma = kind < 2, np.array([0.1, 0.1, 0.15])
    role = np.where(kind[known] == 0, int(Role.GCP), int(Role.CHECK))
    surveyed = move_ground(truth[known], rng.normal(0.0, 1.0, (int(known.sum()), 3)) * sigma)
    given = [GroundPoints(ids[known], surveyed, role, np.tile(sigma[[0, 2]], (len(surveyed), 1)))]
    images = [image for _, image in exposures]
    place = dict(zip(ids.tolist(), truth, strict=True))
    found = {}
    for title, chosen, rows in (
        ("PAN alone", images[:2], tables[:2]), ("PAN + MS", images, tables), ("MS without points", images, tables[:2]),
    ):  # fmt: skip
        result = adjust(assemble(join_exposures(chosen), given, rows))
        ties = np.char.startswith(result.block.points.ids.astype(str), "P")  # on both PANs
        true = np.array([place[name] for name in result.block.points.ids[ties].tolist()])
        error = ground_difference_m(true, result.ground[ties])
        ce90, le90 = result.parts[0].ce90_m or np.nan, result.parts[0].le90_m or np.nan
        inside = np.mean(np.hypot(*error[:, :2].T) <= ce90), np.mean(np.abs(error[:, 2]) <= le90)
        apart = [off_camera_px(result, cameras, true[:50])[k] for k in range(2)]
        found[title] = [ce90, le90, *np.sqrt(np.mean(error**2, axis=0)), *inside, *apart]
    return found


def off_camera_px(result: Adjustment, cameras: list[PushbroomCamera], ground: np.ndarray) -> tuple[float, float]:
    """Return how far refined MS are from refined PANs (largest), and from their sensors (RMS), px of the MS.

    The second is without what the block's position has in common: exact image points of both MS are intersected.
    """
    images = result.block.images
    if len(images) < len(cameras):
        return np.nan, np.nan
    seen = [
        result.model.compute_refined_rpc(image, values).rpc.project(ground)
        for image, values in zip(images, result.values, strict=True)
    ]
    edge = (MS_PIXEL - 1) / 2.0
    of_pan = max(float(np.hypot(*((seen[k] - edge) / MS_PIXEL - seen[k + 2]).T).max()) for k in range(2))
    ids, exact = np.array([f"E{k:03d}" for k in range(len(ground))]), [one.ground_to_image(ground) for one in cameras]
    rows = [
        ImagePoints(ids, np.full(len(ids), image.id), xy, 1.0) for image, xy in zip(images[2:], exact[2:], strict=True)
    ]
    block = assemble(images, [], rows)
    observations = select_points(block, np.ones(len(ids), dtype=bool))
    apart = compute_intersection_residuals(observations, result.model, result.values, ground)
    return of_pan, float(np.sqrt((apart**2).sum(axis=1).mean()))


def print_bands(count: int) -> None:
    """Print a row for each number of GCPs and choice of images."""
    print(
        "| GCPs, images | pairs | CE90 m | LE90 m | RMSE east, north, height m | inside CE90, LE90 | MS off PAN px",
        end="",
    )
    print(" | MS off MS px |\n|---|---|---|---|---|---|---|---|")
    for gcps in (0, 6):
        rows = [judge_bands(seed, gcps) for seed in range(count)]
        for title in rows[0]:
            every = np.array([row[title] for row in rows])
            ce90, le90 = every[:, :2].mean(axis=0)
            rmse, inside = np.sqrt(np.mean(every[:, 2:5] ** 2, axis=0)), every[:, 5:7]
            share, error = inside.mean(axis=0), inside.std(axis=0) / np.sqrt(count)
            print(
                f"| {gcps}, {title} | {count} | {ce90:.3f} | {le90:.3f} | "
                f"{', '.join(f'{value:.3f}' for value in rmse)} | "
                f"{share[0]:.1%} ± {error[0]:.1%}, {share[1]:.1%} ± {error[1]:.1%} | "
                f"{every[:, 7].max():.1e} | {np.sqrt(np.mean(every[:, 8] ** 2)):.3f} |",
                flush=True,
            )


def write_frames(folder: Path, count: int, per_frame: int = 300, pointing_px: float = 20.0, seed: int = 1) -> None:
    """Write RPC files of frames of 2560 x 1080 px in two looks, ten strips side by side, and their tie points."""
    rng, gsd, half_px = np.random.default_rng(seed), 0.8, np.array([1280.0, 540.0])
    place = np.column_stack(np.divmod(np.arange(count // LOOKS), 10))[:, ::-1] * 2.0 * half_px * gsd * [0.9, 0.8]
    area = np.ptp(place, axis=0) + 2.0 * half_px * gsd
    total = round(count * per_frame * 0.9 * 0.8 / LOOKS)
    origin = np.array([[15.0, 5.0, 500.0]])
    metres = np.column_stack(
        [rng.uniform(-half_px * gsd, area - half_px * gsd, (total, 2)), rng.uniform(-80, 80, total)]
    )
    truth, middle = (
        move_ground(np.repeat(origin, total, axis=0), metres),
        np.column_stack([place, np.zeros(len(place))]),
    )
    centre = move_ground(np.repeat(origin, len(place), axis=0), middle)
    with open(folder / "ties.csv", "w", encoding="ascii") as table:
        table.write("id,image,sample,line\n")
        for look, tilt in enumerate((0.25, -0.25)):
            for number, (lon, lat, _) in enumerate(centre.tolist()):
                name, rpc = f"f{look}_{number:04d}", make_frame(lon, lat, tilt, half_px, gsd)
                near = np.flatnonzero((np.abs(metres[:, :2] - place[number]) < 1.2 * half_px * gsd).all(axis=1))
                xy = rpc.project(truth[near])
                inside = (np.abs(xy - half_px) < half_px).all(axis=1)
                offset = (xy[inside] - half_px) / half_px
                xy = xy[inside] + rng.normal(0, pointing_px, 2) + offset @ rng.normal(0, 0.05, (2, 2))
                xy += rng.normal(0, 0.1, xy.shape)
                write_rpc_text(str(folder / f"{name}_RPC.TXT"), rpc)
                rows = zip(near[inside].tolist(), *xy.T.tolist(), strict=True)
                table.writelines(f"t{point},{name},{sample:.3f},{line:.3f}\n" for point, sample, line in rows)


def make_frame(lon: float, lat: float, tilt: float, half_px: np.ndarray, gsd: float) -> RPC:
    """Return a parallel-ray camera over a place; ``tilt`` is metres along the flight per metre of height."""
    sample, line, one = np.zeros(20), np.zeros(20), np.zeros(20)
    sample[1], line[2], line[3], one[0] = 1.0, -1.0, -tilt * 500.0 / (half_px[1] * gsd), 1.0
    reach = half_px * gsd / [111_320.0 * np.cos(np.radians(lat)), 110_574.0]
    return RPC(
        half_px[1], half_px[0], lat, lon, 500.0, half_px[1], half_px[0], reach[1], reach[0], 500.0,
        line, one, sample, one,
    )  # fmt: skip


def print_runs(folders: list[str]) -> None:
    """Print what the whole command makes of the blocks of folders, or of numbers of frames."""
    columns = "| block, model | observations | px before | px after | iterations | converged | verdict | CPU s | s |"
    printed = Table("frames", columns)
    with tempfile.TemporaryDirectory() as name:
        for source in folders:
            folder = Path(name) / Path(source).name
            folder.mkdir()
            if source.isdigit():
                write_frames(folder, int(source))
            for path in sorted(Path(source).glob("*.rpc")):
                shutil.copyfile(path, folder / path.name)
            if (table := Path(source) / "image_points.csv.gz").exists():
                (folder / "ties.csv").write_bytes(gzip.decompress(table.read_bytes()))
            for model in ("shift", "affine", "auto"):
                rpcs = sorted([*folder.glob("*_RPC.TXT"), *folder.glob("*.rpc")])
                title = f"{len(rpcs)} simulated frames" if source.isdigit() else folder.name.replace("_", " ")
                printed.add_row(f"| {title}, {model} | {describe_run(folder, rpcs, model)}")


def describe_run(folder: Path, rpcs: list[Path], model: str) -> str:
    """Adjust RPC files by the command line; return the cells of a table."""
    spent, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    out = folder / f"result_{model}"
    command = [sys.executable, "-m", "hrsi", "adjust", *map(str, rpcs), "--tie-points", str(folder / "ties.csv")]
    done = subprocess.run([*command, "--model", model, "--output-dir", str(out)], capture_output=True, text=True)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - began
    if not (out / "report.json").exists():
        return done.stderr.strip().splitlines()[-1] + " |"
    report = json.loads((out / "report.json").read_text())
    ties = report["ties"]
    cpu = after.ru_utime - spent.ru_utime + after.ru_stime - spent.ru_stime
    return (
        f"{ties['observations']} | {ties['before_rmse_px']:.3f} | {ties['rmse_px']:.3f} | {report['iterations']} | "
        f"{'yes' if report['converged'] else 'no'} | {report['verdict']['level']} | {cpu:.1f} | {wall:.1f} |"
    )


if __name__ == "__main__":
    if sys.argv[1] in ("strips", "bands"):
        {"strips": print_strips, "bands": print_bands}[sys.argv[1]](int(sys.argv[2]))
    else:
        print_runs([word for word in sys.argv[1:] if word != "--docs"])

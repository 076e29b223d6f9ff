"""Blocks without GCPs held by what is free: laser heights, a DEM: `free_control.py [--docs] [--seeds N] [PART …]`."""

import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from osgeo import gdal
from scipy import ndimage

from hrsi.benchmarks import pages
from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import metres_per_degree
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.laboratory.simulated_files import write_laser_points
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    SceneSpec,
)
from hrsi.hrsi_engine.laboratory.simulation.free_dem import simulate_free_dem
from hrsi.hrsi_engine.laboratory.simulation.laser import simulate_laser
from hrsi.hrsi_engine.laboratory.simulation.options import FreeDemSpec, FreeOrthoSpec, LaserSpec
from hrsi.hrsi_engine.laboratory.simulation.terrain import Chart, TerrainSurface
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.hrsi_engine.surface.grid_surface import GridSurface
from hrsi.processing_algorithms import run
from hrsi.tests.laser_scenes import LaserScene, PlacedScene, placed_scene

DATA = pages.DATA / "real" / "s2p_triplet_phr"
DSM = DATA / "s2p_reference_dsm.tif"
PAGE = DOCS / "protocols/free_control.md"
START_OFF_M = 20.0
EXTENT_M, EDGE_DEG = 7000.0, 0.003
EVEN_M, STEEPEST_EVEN = 3.0, 0.4  # at trees and walls ties stand on edges that a DSM of 0.5 m rounds off
AROUND = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (0.5, 0.5), (-0.5, 0.5), (0.5, -0.5), (-0.5, -0.5))
AREA_HALF_M, POST_M, FILLED_M = 230.0, 0.5, 5.0


def dsm_terrain() -> TerrainSurface:
    """Return the triplet's DSM as a surface that a simulated laser flies over."""
    dsm = open_dem(str(DSM), "ellipsoidal")
    chart = Chart(5.4429, 43.2617)
    axis = np.arange(-AREA_HALF_M, AREA_HALF_M + POST_M, POST_M)
    east, north = np.meshgrid(axis, axis[::-1])
    place = chart.to_ground(np.column_stack([east.ravel(), north.ravel()]), np.zeros(east.size))
    height = surface_heights(dsm, place[:, :2]).reshape(east.shape)
    away, nearest = ndimage.distance_transform_edt(np.isnan(height), return_indices=True)
    height = np.where(away * POST_M <= FILLED_M, height[tuple(nearest)], np.nan)  # stereo has holes at every wall
    return TerrainSurface(chart, height.astype(np.float32), -AREA_HALF_M, AREA_HALF_M, POST_M)


def moved_images(folder: Path, by_m: float) -> list[str]:
    """Write the triplet with RPCs that put all ground higher."""
    paths = []
    for number in (1, 2, 3):
        name = f"img_0{number}.tif"
        copy = gdal.GetDriverByName("GTiff").CreateCopy(str(folder / name), gdal.Open(str(DATA / name)))
        rpc = copy.GetMetadata("RPC")
        rpc["HEIGHT_OFF"] = repr(float(rpc["HEIGHT_OFF"]) + by_m)
        copy.SetMetadata(rpc, "RPC")
        paths.append(str(folder / name))
    return paths


def height_offset_m(layers: str) -> tuple[float, float, float, int]:
    """Return medians of adjusted tie points over the DSM: where it is even (and how many), all, and beyond its heights.

    The last is by how much they lie above the highest or below the lowest height of the DSM within 3 m.
    """
    dataset = gdal.OpenEx(layers, gdal.OF_VECTOR)
    rows = [feature.GetGeometryRef().GetPoint() for feature in dataset.GetLayerByName("ground_points")]
    ground = np.array(rows)
    dsm = open_dem(str(DSM), "ellipsoidal")
    step = EVEN_M / metres_per_degree(ground)[:, :2]
    around = [surface_heights(dsm, ground[:, :2] + step * place) for place in AROUND]
    even = np.ptp(around, axis=0) < EVEN_M * STEEPEST_EVEN
    over = ground[:, 2] - around[0]
    low, high = np.min(around, axis=0), np.max(around, axis=0)
    beyond = ground[:, 2] - np.clip(ground[:, 2], low, high)
    known = np.isfinite(beyond)
    return float(np.median(over[even])), float(np.median(over[known])), float(np.median(beyond[known])), int(even.sum())


def triplet(seed: int) -> list[list[str]]:
    """Return rows of what holds the triplet and how high it lies over its DSM, from a start 20 m away."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        laser = simulate_laser(
            dsm_terrain(), AREA_HALF_M, LaserSpec(30, canopy=0.0, segment_m=12.0, clouds=0.03), seed
        ).points
        file = str(folder / "laser.csv")
        write_laser_points(file, laser.select(np.isfinite(laser.ground[:, 2])))
        dem = str(folder / "dem30.tif")
        gdal.Warp(dem, str(DSM), xRes=30.0, yRes=30.0, resampleAlg="average", srcNodata="nan", dstNodata=-9999)
        images = moved_images(folder, START_OFF_M)
        run("tie-points", images=images, output_dir=str(folder / "ties"), csv=True)
        ties = str(folder / "ties" / "tie_points.csv")
        for title, more in (
            ("nothing", {}),
            ("laser", {"laser": file}),
            ("DEM", {"dem": dem, "height_datum": "ellipsoidal", "sigma_dem": 3.0}),
            ("laser and DEM", {"laser": file, "dem": dem, "height_datum": "ellipsoidal"}),
        ):
            start = time.process_time()
            out = folder / title.replace(" ", "_")
            report = run(
                "triangulate", images=images, output_dir=str(out), tie_points=ties, write="none", report=False, **more
            )
            offset, every, beyond, count = height_offset_m(str(out / "block.gpkg"))
            used = report.get("laser", {}).get("used", 0)
            reasons = ", ".join(reason["code"] for reason in report["verdict"]["reasons"])
            verdict = report["verdict"]["level"] + (f" ({reasons})" if reasons else "")
            rows.append([title, f"{offset:+.3f}", str(count), f"{every:+.3f}", f"{beyond:+.3f}", str(used), verdict,
                         f"{time.process_time() - start:.1f}"])  # fmt: skip
            print(rows[-1], flush=True)
    return rows


@dataclass(frozen=True)
class Case:
    """A block of the simulation: sensor, number of images, and what holds it."""

    title: str
    laser: LaserSpec | None = None
    dem: FreeDemSpec | None = None
    ortho: FreeOrthoSpec | None = None
    wrong_pass_m: float = 0.0
    wrong_part_m: float = 0.0


CLEAN, USUAL = LaserSpec(3, canopy=0.0, clouds=0.0), LaserSpec(3, canopy=0.1, clouds=0.03)
IN_PLACE = FreeDemSpec(30.0, trees=0.0, noise_m=1.5, correlation_m=0.0, common_m=1.0, place_m=0.0)
OPEN_LAND, ORTHO = IN_PLACE, FreeOrthoSpec(10.0)
CASES = (
    Case("laser", USUAL),
    Case("laser, no canopy, no clouds", CLEAN),
    Case("laser, 30 % on canopy or clouds", LaserSpec(3, canopy=0.25, clouds=0.05)),
    Case("laser and DEM", USUAL, OPEN_LAND),
    Case("laser and DEM, 10 m of trees on half of it", USUAL, replace(IN_PLACE, trees=0.5)),
    Case("laser, DEM and reference", USUAL, OPEN_LAND, ORTHO),
    Case("the same, a corner of the reference moved by 15 m", USUAL, OPEN_LAND, replace(ORTHO, corner_m=15.0)),
    Case("laser and DEM, a pass 48 m too high (other datum)", USUAL, OPEN_LAND, wrong_pass_m=48.0),
    Case("laser and DEM, a quarter of the DEM 8 m too high", USUAL, OPEN_LAND, wrong_part_m=8.0),
)
BLOCKS = (("worldview-2", 2), ("worldview-2", 3), ("pleiades", 2), ("pleiades", 3))  # 0.5 and 0.7 m; by seed
IMAGE_PX, SIGMA_DEM_M = 0.2, 3.0
LOOKED_UP, CHECKS = 200, 50
PLACES, MATCH_M = 150, 1.5  # of a reference of 10 m, and how well one is matched: see the part on matching


class Outcome(NamedTuple):
    """Errors of the check points (k, 3) m, their sigmas (k, 3), and whether a fault was named, and nothing else."""

    error_m: np.ndarray
    sigma_m: np.ndarray
    named: bool
    accused: int


def dem_of(case: Case, scene: LaserScene, seed: int) -> GridSurface | None:
    """Return the DEM of a case, its north-eastern quarter off where that is wanted."""
    if case.dem is None:
        return None
    half_m = 0.5 * EXTENT_M
    made = simulate_free_dem(scene.simulated.scene.terrain, half_m, case.dem, [seed, 60])
    heights = made.heights_m.copy()
    rows, columns = heights.shape
    heights[: rows // 2, columns // 2 :] += case.wrong_part_m
    return GridSurface.from_array(heights, made.first_deg, made.cell_deg)


def outcomes_of(seed: int) -> list[Outcome]:
    """Return what the block of a seed comes to in each case."""
    sensor, images = BLOCKS[seed % len(BLOCKS)]
    size = int(EXTENT_M / SENSORS[sensor].gsd_m)
    made: dict[tuple[LaserSpec, FreeOrthoSpec | None], PlacedScene] = {}
    found = []
    for case in CASES:
        key = case.laser or USUAL, case.ortho
        if key not in made:
            made[key] = placed_scene(
                seed, *key, places=PLACES if case.ortho else 0, match_m=MATCH_M, sensor=sensor, images=images,
                size=size, image_px=IMAGE_PX, looked_up=LOOKED_UP, checks=CHECKS,
            )  # fmt: skip
        found.append(outcome_of(case, made[key], seed))
    return found


def outcome_of(case: Case, placed: PlacedScene, seed: int) -> Outcome:
    """Return what one block of a case comes to."""
    scene, block = placed.laser, placed.block if case.ortho else placed.laser.block
    points, dem = scene.points, dem_of(case, scene, seed)
    if case.wrong_pass_m:
        ground = points.ground.copy()
        ground[points.track == "pass 1", 2] += case.wrong_pass_m
        points = replace(points, ground=ground)
    result = adjust(block, AdjustOptions(
        laser=points if case.laser else None, dem=dem, sigma_dem_m=None if dem is None else SIGMA_DEM_M,
        reference=placed.places if case.ortho else None,
    ))  # fmt: skip
    checks = block.points.role == Role.CHECK
    wrong = [(one.source, group) for one in result.heights for group in one.groups if group.wrong]
    wrong += [("reference", group) for group in (result.plan.groups if result.plan else ()) if group.wrong]
    if case.ortho:
        right = [source == "reference" and _north_east(group.name, scene.simulated.spec) for source, group in wrong]
        right = right if case.ortho.corner_m else [False] * len(wrong)
    elif case.wrong_pass_m:
        right = [group.name == "track pass 1" for _, group in wrong]
    else:
        right = [source == "DEM" and _north_east(group.name, scene.simulated.spec) for source, group in wrong]
    return Outcome(scene.height_errors_m(result), result.ground_sigma_m[checks], any(right), len(right) - sum(right))


def _rms(values: np.ndarray) -> str:
    return f"{np.sqrt(np.mean(values**2)):.2f}"


def _north_east(name: str, spec: SceneSpec) -> bool:
    lon, lat = (float(text) for text in name.removeprefix("part about ").split(","))
    return lon > spec.lon_deg - EDGE_DEG and lat > spec.lat_deg - EDGE_DEG


def simulated(seeds: range, workers: int, minutes: float) -> list[list[str]]:
    """Return a row for each case over many blocks, as many as there is time for."""
    until, blocks = time.monotonic() + 60.0 * minutes, []
    with ProcessPoolExecutor(workers) as pool:
        waiting = [pool.submit(outcomes_of, seed) for seed in seeds]
        for number, block in enumerate(waiting):
            if time.monotonic() > until:
                for rest in waiting[number:]:
                    rest.cancel()
                break
            blocks.append(block.result())
    rows = []
    for case, found in zip(CASES, zip(*blocks, strict=True), strict=True):
        error, sigma = (np.concatenate([getattr(one, name) for one in found]) for name in ("error_m", "sigma_m"))
        height, plan = error[:, 2], np.hypot(error[:, 0], error[:, 1])
        within = np.abs(height) <= 1.6449 * sigma[:, 2]
        inside = plan <= 1.5175 * np.hypot(sigma[:, 0], sigma[:, 1])
        offsets = np.array([one.error_m[:, 2].mean() for one in found])
        moved = np.array([one.error_m[:, :2].mean(axis=0) / one.sigma_m[:, :2].mean(axis=0) for one in found])
        faulty = case.wrong_pass_m or case.wrong_part_m or (case.ortho and case.ortho.corner_m)
        rows.append([
            case.title, str(len(found)), _rms(height), _rms(offsets), _rms(plan), _rms(moved),
            f"{100.0 * within.mean():.0f}", f"{100.0 * inside.mean():.0f}",
            f"{sum(one.named for one in found)}" if faulty else "", str(sum(one.accused for one in found)),
        ])  # fmt: skip
        print(" | ".join(rows[-1]), flush=True)
    return rows


HEAD = (
    "constrained by", "blocks", "height RMSE m", "of it the block's offset m", "plan RMSE m", "of its sigma",
    "within LE90 %",
    "within CE90 %", "fault named", "other groups left out",
)  # fmt: skip
PARTS = {
    "simulated": "Simulated blocks",
    "triplet": "A real triplet",
}
TRIPLET_HEAD = (
    "constrained by", "median over the DSM, where even m", "tie points", "all m", "beyond its heights m",
    "laser points used",
    "verdict", "CPU s",
)  # fmt: skip


def main() -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1001, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=600.0, help="stop after this time")
    parser.add_argument("--only", choices=PARTS, help="this part of the page, the others stay")
    words = parser.parse_args()
    seeds = range(words.first, words.first + words.seeds)
    makers = {
        "simulated": lambda: render(HEAD, simulated(seeds, words.workers, words.minutes)),
        "triplet": lambda: render(TRIPLET_HEAD, triplet(1)),
    }  # fmt: skip
    tables = {PARTS[name]: make() for name, make in makers.items() if words.only in (None, name)}
    print(*tables.values(), sep="\n\n")
    if words.docs:
        write_sections(PAGE, tables)


if __name__ == "__main__":
    gdal.UseExceptions()
    main()

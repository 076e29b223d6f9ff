"""Blocks without GCPs held by what is free: laser heights, a DEM: `free_control.py [--docs] [--seeds N] [PART …]`."""

from __future__ import annotations

import argparse
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
from hrsi.benchmarks.pages import DOCS
from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.block import ArrayRaster, Raster, Role
from hrsi.hrsi_engine.foundation.progress import silent
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, metres_per_degree
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.laboratory.simulated_files import write_laser_points
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    Noise,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)
from hrsi.hrsi_engine.laboratory.simulation.free_dem import simulate_free_dem
from hrsi.hrsi_engine.laboratory.simulation.free_ortho import draw_ortho_errors, simulate_free_orthoimage
from hrsi.hrsi_engine.laboratory.simulation.laser import simulate_laser
from hrsi.hrsi_engine.laboratory.simulation.options import FreeDemSpec, FreeOrthoSpec, LaserSpec
from hrsi.hrsi_engine.laboratory.simulation.render import add_pixels
from hrsi.hrsi_engine.laboratory.simulation.surface import locate_on_surface
from hrsi.hrsi_engine.laboratory.simulation.terrain import Chart, TerrainSurface
from hrsi.hrsi_engine.measurement.reference.matching import match_reference
from hrsi.hrsi_engine.plausibility.laser_quality import find_laser_reasons
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.hrsi_engine.surface.grid_surface import GridSurface
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.block_steps.laser_points import adjust_at_laser_points
from hrsi.processing_algorithms.interface.declare import Context
from hrsi.tests.laser_scenes import LaserScene, PlacedScene, placed_scene
from hrsi.tests.reference_scenes import place_on_degrees

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


MATCHED_PX, ORTHO_SEEDS, CHANGES = 4096, 4, (0.0, 0.4, 0.8)
BAND_SETS = {"mean of four": slice(0, 4), "blue": slice(0, 1), "near infrared": slice(3, 4)}


def matching(first: int) -> list[list[str]]:
    """Return how well images of 0.5 m are matched with a reference of 10 m, by season and bands."""
    found: dict[tuple[float, str], list[tuple[np.ndarray, float]]] = {}
    for seed in range(first, first + ORTHO_SEEDS):
        views = make_along_track_views(SENSORS["worldview-2"], 2, (MATCHED_PX, MATCHED_PX))
        simulated = simulate_block(SceneSpec(seed=seed), views, PointCounts(0, 5, 5), Noise())
        scene = simulated.scene
        images = [
            replace(image, raster=ArrayRaster(image.pixels.read(0, 0, *image.known_size)[0]))
            for image in add_pixels(simulated).images
        ]
        made = simulate_free_dem(scene.terrain, scene.half_extent_m, replace(IN_PLACE, trees=0.2), [seed, 60])
        dem = GridSurface.from_array(made.heights_m, made.first_deg, made.cell_deg)
        for change in CHANGES:
            spec = replace(ORTHO, change=change)
            errors = draw_ortho_errors(0.25 * MATCHED_PX, spec, [seed, 61])
            bands = simulate_free_orthoimage(scene, spec, errors)
            grey = np.array([band.read(0, 0, *band.size)[0] for band in bands], dtype=np.float32)
            for name, chosen in BAND_SETS.items():
                raster = ArrayRaster(grey[chosen].mean(axis=0))
                control = match_reference(images, place_on_degrees(raster, bands[0].geotransform), dem)
                for number, one in enumerate(control.images):
                    stated = control.ground[one.places[one.used]]
                    shown = locate_on_surface(simulated.truth.cameras[number], scene.terrain, one.xy[one.used])
                    off = errors.errors_at(*scene.chart.from_ground(stated).T[:2]).T
                    share = float(one.used.mean()) if len(one.used) else 0.0
                    error = ground_difference_m(stated, shown)[:, :2] - off
                    found.setdefault((change, name), []).append((error, share))
    rows = []
    for (change, name), parts in found.items():
        every = np.concatenate([error for error, _ in parts])
        means = np.array([error.mean(axis=0) for error, _ in parts if len(error)])
        rows.append([
            f"{100 * change:.0f} %", name, str(len(parts)), str(len(every)),
            f"{100.0 * np.mean([share for _, share in parts]):.0f}",
            *(f"{np.sqrt(np.mean(values**2)) / ORTHO.pixel_m:.2f}" for values in (every, means)),
        ])  # fmt: skip
        print(" | ".join(rows[-1]), flush=True)
    return rows


LARGE_PX, LARGE_PASSES = 40_000, 4


class CountedRaster:
    """Pixels rendered when they are read, and the CPU time that took."""

    def __init__(self, raster: Raster) -> None:
        self.raster, self.size, self.seconds, self.pixels = raster, raster.size, 0.0, 0

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """As `Raster.read`."""
        start = time.thread_time()
        found = self.raster.read(sample, line, samples, lines)
        self.seconds += time.thread_time() - start
        self.pixels += samples * lines
        return found


def cost(seed: int) -> list[list[str]]:
    """Return the CPU time of thousands of laser points on a pair of the largest images."""
    views = make_along_track_views(SENSORS["worldview-2"], 2, (LARGE_PX, LARGE_PX))
    simulated = simulate_block(SceneSpec(seed=seed), views, PointCounts(0, 50, 500), Noise(image_px=IMAGE_PX))
    block = add_pixels(simulated)
    rasters = [CountedRaster(image.pixels) for image in block.images]
    images = tuple(replace(image, raster=raster) for image, raster in zip(block.images, rasters, strict=True))
    half_m = 0.5 * LARGE_PX * views[0].sensor.gsd_m
    laser = simulate_laser(simulated.scene.terrain, half_m, LaserSpec(LARGE_PASSES), [seed, 50]).points
    laser = replace(laser, doubt=find_laser_reasons(laser))
    start = time.process_time()
    context = Context(silent, lambda text: None)
    result, _ = adjust_at_laser_points(replace(block, images=images), AdjustOptions(laser=laser), 1, context)
    rendered = sum(raster.seconds for raster in rasters)
    used = int((result.laser.reason == "").sum())
    ties = len(np.unique(result.block.measurements.point))
    return [[
        str(len(laser)), str(int((laser.doubt == "").sum())), str(used), str(ties),
        f"{sum(raster.pixels for raster in rasters) / 1e6:.0f}", f"{time.process_time() - start - rendered:.0f}",
    ]]  # fmt: skip


HEAD = (
    "constrained by", "blocks", "height RMSE m", "of it the block's offset m", "plan RMSE m", "of its sigma",
    "within LE90 %",
    "within CE90 %", "fault named", "other groups left out",
)  # fmt: skip
PARTS = {
    "simulated": "Simulated blocks",
    "matching": "A reference of 10 m for images of 0.5 m",
    "cost": "Cost",
    "triplet": "A real triplet",
}
MATCHING_HEAD = (
    "changed", "bands", "images", "places", "of those searched for %", "RMSE of a coordinate px",
    "of an image's mean px",
)  # fmt: skip
COST_HEAD = ("laser points", "usable", "that determine heights", "points of the adjustment", "Mpx read", "CPU s")
TRIPLET_HEAD = (
    "constrained by", "median over the DSM, where even m", "tie points", "all m", "beyond its heights m",
    "laser points used",
    "verdict", "CPU s",
)  # fmt: skip
INTRODUCTION = """# Free control: laser heights and free DEMs instead of GCPs

Printed by `python benchmarks/free_control.py --docs`.
"""
SIMULATED = """
## Simulated blocks

Pairs and triplets of WorldView-2 (0.5 m) and Pleiades (0.7 m) alternate. The scenes are 7 km wide, with a relief of
150 m. There is no GCP. The errors of the RPCs are those of the sensors. Three passes of ICESat-2
(`simulate --laser-passes 3`) have the errors of real segments. 200 laser points have three tie points each within 10 m,
as matching finds them. Image points have a noise of 0.2 px. The DEM of 30 m has 1.5 m noise in each cell and 1 m common
error, with sigma 3 m. The reference of 10 m has 150 places, matched with an accuracy of 1.5 m. Its root mean square
distance error is 5 m, stated as 3.5 m in each coordinate: 64 % of the variance is one shift, 16 % differs between nine
parts, 20 % from place to place. A block has 50 independent check points. The options are the default ones. In the case
with trees in the DEM, the other groups are parts of the DEM that are 10 m too high.

All check points of a block share its error in plan, which is one draw. So the share of n blocks within CE90 has a
standard error of at least 30 % / √n, 3 % with 100 blocks. The ratio of the root mean square of the shifts of the blocks
(east and north) to their sigmas should be 1. Its standard error is 0.5 / √n: 0.05. 199 other blocks, seeds from 20001
on, had 91.6 ± 2.1 % within CE90 and 0.97 ± 0.04 of their sigma with the reference, 92.2 % and 0.99 with the laser
alone.
"""
MATCHING = """
## A reference of 10 m for images of 0.5 m

Pairs of WorldView-2 of 4096 pixels are rendered. The free orthoimages have four bands (`simulate --free-ortho 10`) and
are from another time of the year: a share of the soil, plants and parcels has another appearance. The free DEM has
trees. The position of each match in the image is compared with that in the orthoimage, which has simulated errors. The
unit is its pixels of 10 m, which are 20 x 20 image pixels. The required accuracy of a coordinate is 0.3 px.
"""
COST = """
## Cost

A pair of WorldView-2 of 40 000 x 40 000 pixels has 500 tie points. Its laser points are looked up, measured (at most
2000) and adjusted, again where the block moved. The images are rendered when they are read; that time is not included.
"""
TRIPLET = """
## A real triplet

The Pleiades triplet of s2p has RPCs that put all ground 20 m too high. Its own DSM, resampled to 30 m, is the DEM. The
laser points are drawn from the DSM, 12 m long, with simulated errors. Most of this scene (walls, trees, terraces) is
too rough for a laser, as it would be for real laser points. The heights of the tie points above the DSM are compared
where it is even (3 m).

Over all tie points the median is about 0.1 m higher. It increases with the range of the DSM's heights within 2 m:
+0.02 m below 0.5 m, +0.04 m to 1 m, +0.10 m to 2 m, +0.46 m to 5 m, +0.67 m above. Corners are on the upper edges of
roofs, walls and crowns, at 0.68 of the range. The DSM, in cells of 0.5 m, has an intermediate height there, at 0.53. So
the block is not too high. If only the part above the highest or below the lowest height within 3 m is counted, the
median is 0. With the DEM the verdict is doubtful because the DEM covers 39 % of the images' ground, not because of its
heights.

With nothing, the block keeps the mean position of its RPCs, which are 0.17 m too high besides the 20 m. The relief of
the DEM also determines the position in plan. The tie points fit the DSM best 0.5 m away from their positions, where the
median over all is -0.05 m. When the heights of the DEM were used without its relief, these values were 1.4 m and
-0.80 m, and the median in the table was -0.50 m.
"""


def main() -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1001, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=600.0, help="stop after this time")
    parser.add_argument("--only", choices=PARTS, help="this part of the page, the others stay")
    words = parser.parse_args()
    old = PAGE.read_text(encoding="utf-8").split("\n## ") if PAGE.exists() else []
    page = {name: next((f"\n## {part}" for part in old if part.startswith(title)), "") for name, title in PARTS.items()}
    if words.only in (None, "simulated"):
        seeds = range(words.first, words.first + words.seeds)
        page["simulated"] = f"{SIMULATED}\n{render(HEAD, simulated(seeds, words.workers, words.minutes))}\n"
    if words.only in (None, "matching"):
        page["matching"] = f"{MATCHING}\n{render(MATCHING_HEAD, matching(words.first))}\n"
    if words.only in (None, "cost"):
        page["cost"] = f"{COST}\n{render(COST_HEAD, cost(words.first))}\n"
    if words.only in (None, "triplet"):
        page["triplet"] = f"{TRIPLET}\n{render(TRIPLET_HEAD, triplet(1))}\n"
    if words.docs:
        PAGE.write_text(INTRODUCTION + "".join(part.rstrip("\n") + "\n" for part in page.values()), encoding="utf-8")


if __name__ == "__main__":
    gdal.UseExceptions()
    main()

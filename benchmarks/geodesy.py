"""Where a point really is: coordinate operations against cs2cs, and what their errors do.

`geodesy.py [PART …] [--docs]`

Prints 60 CRS on all continents against ``cs2cs`` (package proj-bin), a file with points of two areas, DEM against
points, what is told where no grid is installed, two jobs through the command line, the coverage of CE90 and LE90, and
the speed. ``--docs`` writes the tables into `docs/geodesy.md`, where parts that were not chosen stay.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyproj
from osgeo import gdal
from pyproj.transformer import TransformerGroup

from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections
from hrsi.hrsi_engine.adjustment import adjust
from hrsi.hrsi_engine.adjustment.options import AdjustOptions
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.adjustment.statistics.precision import CIRCLE_90, LINE_90
from hrsi.hrsi_engine.block.block import Block, GroundPoints, Role
from hrsi.hrsi_engine.ground.crs_operations import CrsOperations, operations_of
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.ground.operation_uses import OperationUse, describe_missing_grid
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.tests.laser_scenes import laser_scene
from hrsi.tests.simulated_blocks import block as simulated_block

PAGE = DOCS / "geodesy.md"

#: EPSG codes of CRS, and three places in the area of use of each: longitude and latitude.
PLACES: dict[int, tuple[tuple[float, float], ...]] = {
    # Europe
    23030: ((-3.7, 40.4), (-2.0, 37.5), (-5.5, 43.3)), 4230: ((33.0, 39.0), (12.5, 42.0), (24.0, 38.5)),
    25832: ((9.0, 50.0), (11.5, 48.1), (10.0, 56.0)), 27700: ((-0.1, 51.5), (-3.2, 55.9), (-4.1, 50.4)),
    4277: ((-1.5, 53.0), (-2.2, 57.1), (-5.0, 52.0)), 29902: ((-6.3, 53.3), (-8.5, 51.9), (-9.0, 53.3)),
    31467: ((9.2, 48.8), (9.7, 52.4), (9.0, 50.0)), 31370: ((4.35, 50.85), (5.6, 50.6), (3.2, 51.2)),
    28992: ((4.9, 52.4), (5.7, 51.0), (6.6, 53.2)), 27572: ((2.35, 48.85), (3.0, 46.0), (1.0, 47.0)),
    21781: ((7.45, 46.95), (8.5, 47.4), (9.8, 46.5)), 31256: ((16.4, 48.2), (16.0, 47.5), (15.6, 48.5)),
    5514: ((14.4, 50.1), (16.6, 49.2), (18.2, 49.8)), 3003: ((9.2, 45.5), (7.7, 45.1), (8.9, 44.4)),
    2100: ((23.7, 38.0), (22.9, 40.6), (25.1, 35.3)), 3844: ((26.1, 44.4), (23.6, 46.8), (27.6, 47.2)),
    28408: ((44.0, 56.3), (45.0, 53.2), (43.0, 48.0)), 3794: ((14.5, 46.05), (15.6, 46.55), (13.7, 45.9)),
    # Africa
    20935: ((28.3, -15.4), (26.0, -13.0), (25.0, -17.0)), 21037: ((36.8, -1.3), (39.6, -4.0), (36.0, 0.5)),
    22234: ((28.0, -26.2), (25.5, -29.0), (30.0, -24.0)), 2736: ((34.8, -19.8), (35.0, -16.0), (33.0, -24.0)),
    26191: ((-7.6, 33.6), (-6.8, 34.0), (-5.0, 34.0)), 30731: ((3.0, 36.7), (5.0, 36.0), (2.0, 35.0)),
    22992: ((31.2, 30.0), (30.0, 31.2), (32.9, 24.1)), 26331: ((3.4, 6.5), (4.0, 8.0), (5.5, 7.0)),
    4232: ((56.0, 22.5), (58.4, 23.6), (54.1, 17.0)), 20137: ((38.8, 9.0), (37.5, 11.6), (40.0, 8.5)),
    # North and Central America
    4267: ((-149.9, 61.2), (-100.0, 40.0), (-114.1, 51.0)), 26715: ((-81.0, 36.0), (-79.4, 43.7), (-82.0, 40.0)),
    4269: ((-120.0, 40.0), (-95.0, 30.0), (-75.7, 45.4)), 6339: ((-122.4, 37.8), (-123.0, 45.0), (-121.0, 47.0)),
    2955: ((-114.1, 51.0), (-113.5, 53.5), (-115.0, 55.0)), 6371: ((-99.1, 19.4), (-101.0, 21.0), (-100.3, 25.7)),
    26714: ((-99.1, 19.4), (-100.0, 22.0), (-101.5, 25.0)), 32061: ((-90.5, 15.0), (-89.9, 15.8), (-91.5, 15.5)),
    # South America
    24879: ((-70.6, -33.5), (-70.0, -27.0), (-69.0, -20.0)), 24878: ((-76.0, -12.0), (-75.0, -10.0), (-77.0, -13.0)),
    29193: ((-47.9, -15.8), (-46.6, -23.5), (-43.9, -19.9)), 4618: ((-60.0, -3.1), (-43.2, -22.9), (-74.0, 4.6)),
    31983: ((-43.2, -22.9), (-44.0, -20.0), (-46.6, -23.5)), 22185: ((-60.0, -31.6), (-59.0, -34.6), (-61.0, -37.0)),
    21897: ((-74.1, 4.6), (-75.6, 6.2), (-73.1, 7.1)), 5361: ((-70.6, -33.5), (-71.0, -30.0), (-70.5, -25.0)),
    # Asia
    4301: ((139.7, 35.7), (135.5, 34.7), (127.0, 37.5)), 30169: ((139.7, 35.7), (139.0, 36.5), (140.1, 36.0)),
    24378: ((77.2, 28.6), (75.8, 26.9), (74.5, 31.5)), 24047: ((100.5, 13.8), (99.0, 18.8), (98.4, 8.0)),
    3148: ((106.7, 10.8), (105.8, 21.0), (104.9, 11.6)), 3168: ((101.7, 3.1), (103.4, 3.8), (100.4, 5.4)),
    23830: ((98.7, 3.6), (97.0, 5.0), (98.5, 2.0)), 3123: ((121.0, 14.6), (120.6, 16.4), (121.0, 13.0)),
    2333: ((116.4, 40.0), (118.0, 36.0), (115.0, 30.0)), 3826: ((121.5, 25.0), (120.3, 22.6), (121.0, 24.0)),
    5179: ((127.0, 37.5), (129.0, 35.2), (126.5, 33.5)), 28191: ((35.2, 31.8), (34.8, 32.1), (35.0, 31.0)),
    # Australia and the Pacific, Antarctica
    7855: ((147.3, -42.9), (145.0, -37.8), (148.0, -33.0)), 28355: ((147.3, -42.9), (145.0, -37.8), (149.1, -35.3)),
    20255: ((147.3, -42.9), (145.0, -37.8), (149.1, -35.3)), 27200: ((174.8, -41.3), (172.6, -43.5), (174.8, -36.9)),
    2193: ((174.8, -41.3), (170.5, -45.9), (174.8, -36.9)), 3031: ((166.7, -77.8), (-68.0, -67.6), (0.0, -75.0)),
}  # fmt: skip

SEEDS = 40
LASER_SEEDS = 24  # blocks with laser heights
POINTS = 1_000_000
AXIS_PX = 9  # columns and rows of a small DEM
CELL_M = 10.0
COVERED = (86.0, 94.0)


class Row(NamedTuple):
    """One CRS against cs2cs: the operations taken, the largest difference where both agree, and where cs2cs differs."""

    code: int
    name: str
    operations: str
    accuracy: str
    same: int
    largest_mm: float
    other: str


def convert_by_cs2cs(xy: np.ndarray, crs: pyproj.CRS) -> np.ndarray:
    """Return lon, lat ``(n, 2)`` of x (east), y points by the program."""
    north_first = crs.axis_info[0].direction.lower() in ("north", "south") and "Polar" not in crs.name
    lines = "\n".join(" ".join(map(repr, (row[::-1] if north_first else row).tolist())) for row in xy)
    done = subprocess.run(
        ["cs2cs", "-f", "%.12f", f"EPSG:{crs.to_epsg()}", "EPSG:4326"],
        input=lines, capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = [[float(word) if word != "*" else np.inf for word in line.split()[:2]] for line in done.stdout.splitlines()]
    return np.array(found)[:, ::-1]


def horizontal_m(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the horizontal distances of lon, lat points."""
    both = (np.column_stack([lonlat[:, :2], np.zeros(len(lonlat))]) for lonlat in (first, second))
    return np.linalg.norm(ground_difference_m(*both)[:, :2], axis=1)


def compare_with_cs2cs() -> list[Row]:
    """Return a row a CRS."""
    rows = []
    for code, places in PLACES.items():
        operations, lonlat = operations_of(f"EPSG:{code}"), np.array(places)
        xy = operations.from_wgs84(lonlat)
        ground, number = operations.convert(np.pad(xy, ((0, 0), (0, 1))))
        apart = horizontal_m(ground, convert_by_cs2cs(xy, operations.crs))
        same = apart < 1e-3
        made = [operations.operations[one] for one in dict.fromkeys(number.tolist())]
        accuracy = ", ".join("?" if one.accuracy_m is None else f"{one.accuracy_m:g}" for one in made)
        other = "" if same.all() else f"ballpark there, {apart[~same].max():.1f} m apart"
        rows.append(Row(
            code, operations.crs.name, ", ".join(dict.fromkeys(one.name for one in made)), accuracy, int(same.sum()),
            1e3 * float(apart[same].max(initial=0.0)), other,
        ))  # fmt: skip
    return rows


def compare_two_areas(folder: Path) -> list[tuple[str, str, float]]:
    """Return operation, points and largest difference from cs2cs (mm) in a file of ED50 points in Spain and Turkey."""
    lonlat = np.array([(-3.7, 40.4), (-2.0, 37.5), (33.0, 39.0), (35.0, 38.0), (28.0, 41.0)])
    crs = operations_of("EPSG:4230")
    xy, file = crs.from_wgs84(lonlat), folder / "two_areas.csv"
    with file.open("w") as out:
        writer = csv.writer(out)
        writer.writerow(["id", "x", "y", "z"])
        writer.writerows([f"P{k}", repr(float(x)), repr(float(y)), 100.0] for k, (x, y) in enumerate(xy))
    tables = read_points(str(file), ground_crs="EPSG:4230", height_datum="ellipsoidal")
    points = tables.ground or GroundPoints([], np.empty((0, 3)))
    apart = 1e3 * horizontal_m(points.ground, convert_by_cs2cs(xy, crs.crs))
    return [
        (use.operation.name, str(use.points), float(apart[points.operation == number].max()))
        for number, use in enumerate(points.operations)
    ]


def compare_dem_with_points(folder: Path) -> float:
    """Return the largest distance (mm) between a DEM's cell and the point with its map coordinates, of all CRS."""
    largest = 0.0
    for code, places in PLACES.items():
        operations = operations_of(f"EPSG:{code}")
        cell = CELL_M / 111_320.0 if operations.crs.is_geographic else CELL_M
        for lonlat in places:
            x, y = operations.from_wgs84(np.array([lonlat]))[0]
            file = str(folder / f"dem_{code}.tif")
            dataset = gdal.GetDriverByName("GTiff").Create(file, AXIS_PX, AXIS_PX, 1, gdal.GDT_Float32)
            dataset.SetGeoTransform((x - 4.5 * cell, cell, 0.0, y + 4.5 * cell, 0.0, -cell))
            dataset.SetProjection(operations.crs.to_wkt("WKT1_GDAL"))
            dataset.GetRasterBand(1).Fill(100.0)
            del dataset
            point = operations.to_wgs84(np.array([[x, y, 100.0]]))
            at = open_dem(file, "ellipsoidal").grid_coordinates(point[:, :2])[0]
            largest = max(largest, 1e3 * CELL_M * float(np.abs(at - 4.0).max()))
    return largest


def list_losses() -> list[tuple[int, str, float, bool]]:
    """Return code, missing operation, loss (m; NaN: not known) and whether it is told, of every CRS here and now."""
    found = []
    for code, places in PLACES.items():
        operations, lonlat = operations_of(f"EPSG:{code}"), np.array(places)
        for place in lonlat:
            best = _best_without_grids(operations.crs, place)
            (use,) = operations.uses_at("points", place[None])
            used = use.operation.accuracy_m
            loss = float("nan") if used is None else used - best[0] if best is not None else 0.0
            if best is not None and not loss <= 0.1:
                found.append((code, best[1], loss, bool(describe_missing_grid(use))))
    return found


def _best_without_grids(crs: pyproj.CRS, place: np.ndarray) -> tuple[float, str] | None:
    """Return accuracy and name of the best operation at a place that lacks a grid, by PROJ alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        group = TransformerGroup(crs, 4326, always_xy=True)
    known = []
    for one in group.unavailable_operations:
        if "allpark" in one.name or one.accuracy is None or one.accuracy < 0.0 or one.area_of_use is None:
            continue
        west, south, east, north = one.area_of_use.bounds
        if (place[0] - west) % 360.0 <= (east - west) % 360.0 and south <= place[1] <= north:
            known.append((float(one.accuracy), str(one.name)))
    return min(known, default=None)


def run_without_grids(folder: Path) -> list[tuple[int, str, float, bool]]:
    """Return `list_losses` where PROJ's folder holds its database alone."""
    bare = folder / "proj"
    bare.mkdir()
    shutil.copy(Path(pyproj.datadir.get_data_dir()) / "proj.db", bare)
    folders = ("PROJ_DATA", "PROJ_LIB", "PROJ_USER_WRITABLE_DIRECTORY")
    environment = {**os.environ, **dict.fromkeys(folders, str(bare))}
    code = "import json; from hrsi.benchmarks.geodesy import list_losses; print(json.dumps(list_losses()))"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return [tuple(row) for row in json.loads(done.stdout.splitlines()[-1].replace("NaN", "null"))]


def run_jobs(folder: Path) -> Iterator[tuple[str, ...]]:
    """Yield, for a job in Spain and one in Chile, how it compares with the one whose GCPs are on WGS84."""
    for name, (lon, lat), code in (("Spain", (-3.7, 40.4), 23030), ("Chile", (-70.6, -33.5), 24879)):
        block = folder / name
        _hrsi("simulate", f"--lon={lon}", f"--lat={lat}", "--size", "400", "--gcps", "12", "--checks", "20", "--ties",
              "60", "--images", "2", "--output-dir", str(block))  # fmt: skip
        with (block / "ground_points.csv").open() as file:
            rows = list(csv.DictReader(file))
        lonlat = np.array([[float(row["lon"]), float(row["lat"])] for row in rows])
        xy = np.column_stack(pyproj.Transformer.from_crs(4326, code, always_xy=True).transform(*lonlat.T))
        with (block / "map_points.csv").open("w") as file:
            writer = csv.DictWriter(file, ["id", "role", "x", "y", "z", "sigma_xy", "sigma_h"])
            writer.writeheader()
            for row, (x, y) in zip(rows, xy.tolist(), strict=True):
                kept = {key: row[key] for key in ("id", "role", "sigma_xy", "sigma_h")}
                writer.writerow({**kept, "x": repr(x), "y": repr(y), "z": row["height"]})
        reports = []
        for points, more in (("ground_points.csv", []), ("map_points.csv", ["--ground-crs", f"EPSG:{code}"])):
            images = (str(block / "image_1.tif"), str(block / "image_2.tif"))
            _hrsi("adjust", *images, "--gcps", str(block / points), *more, "--image-points",
                  str(block / "image_points.csv"), "--height-datum", "ellipsoidal", "--model", "affine",
                  "--output-dir", str(block / points[:3]))  # fmt: skip
            reports.append(json.loads((block / points[:3] / "report.json").read_text()))
        apart = max(
            _rpcs_apart_px(*(str(block / points / image) for points in ("gro", "map")))
            for image in ("image_1.tif", "image_2.tif")
        )
        plain, mapped = reports
        untested, check = mapped["untested_by_check_points"], mapped["check"]
        reasons = ", ".join(reason["code"] for reason in mapped["verdict"]["reasons"])
        yield (
            name, mapped["crs_operations"][0]["name"], f"{apart:.4f}", mapped["verdict"]["level"], reasons or "-",
            f"{plain['parts'][0]['ce90_m']:.2f}", f"{mapped['parts'][0]['ce90_m']:.2f}", f"{check['ce90_m']:.2f}",
            f"{untested['ce90_m']:.2f}", f"{mapped['images']['image_1']['err_bias_m']:.2f}",
        )  # fmt: skip


def _hrsi(*words: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "hrsi", *words, "--quiet"], capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 3):
        raise RuntimeError(f"hrsi {' '.join(words)}: {done.stderr}")


def _rpcs_apart_px(first: str, second: str) -> float:
    """Return how far two RPCs put the same ground points apart, at most."""
    one, two = (read_rpc(path).rpc for path in (first, second))
    steps = np.linspace(-150.0, 150.0, 5)
    east, north = np.meshgrid(steps, steps)
    middle = np.tile([one.long_off, one.lat_off, one.height_off], (25, 1))
    ground = move_ground(middle, np.column_stack([east.ravel(), north.ravel(), np.zeros(25)]))
    return float(np.abs(one.project(ground) - two.project(ground)).max())


def cover(use: OperationUse) -> tuple[float, float]:
    """Return the shares (%) of points within CE90 and LE90 over `SEEDS` blocks whose GCPs came by an operation.

    Its error is drawn from its stated accuracy, by quantiles in random order (Latin hypercube), so that the shares of
    so few blocks tell of the method and not of the draw.
    """
    from scipy.stats import norm

    rng = np.random.default_rng(36)
    quantile = norm.ppf((np.arange(SEEDS) + 0.5) / SEEDS)
    draws = np.column_stack([rng.permutation(quantile) for _ in range(3)])
    plan_m, height_m = use.operation.sigma_m
    inside = []
    for seed in range(SEEDS):
        block, truth, _ = simulated_block(gcps=12, checks=0, ties=40, seed=1000 + seed, noise_m=0.05)
        shift = draws[seed] * [plan_m, plan_m, height_m]
        inside.append(_inside(adjust(_shifted(block, shift, use), AdjustOptions(model="affine")), truth))
    return tuple(100.0 * np.mean(inside, axis=0))  # type: ignore[return-value]


def cover_with_laser(use: OperationUse) -> tuple[float, float]:
    """Return the share (%) of check points within LE90 over blocks that laser heights hold, which came by an operation.

    Its error is drawn as in `cover`; the second share is of the same blocks when nothing is said of the operation.
    """
    from scipy.stats import norm

    rng = np.random.default_rng(36)
    draws = rng.permutation(norm.ppf((np.arange(LASER_SEEDS) + 0.5) / LASER_SEEDS)) * use.operation.sigma_m[1]
    inside = np.zeros((LASER_SEEDS, 2))
    for seed, draw in enumerate(draws.tolist()):
        scene = laser_scene(500 + seed, size=6000, checks=60)
        shifted = replace(scene.points, ground=scene.points.ground + [0.0, 0.0, draw])
        for column, operations in enumerate(((use,), ())):
            laser = replace(shifted, operations=operations)
            result = adjust(scene.block, AdjustOptions(model="shift", laser=laser))
            sigma = result.ground_sigma_m[result.block.points.role == Role.CHECK, 2]
            inside[seed, column] = (np.abs(scene.height_errors_m(result)[:, 2]) <= LINE_90 * sigma).mean()
    return tuple(100.0 * inside.mean(axis=0))  # type: ignore[return-value]


def name_operation(block: Block, use: OperationUse, checks: bool = True) -> Block:
    """Return a block whose GCPs, and check points unless not, came by an operation."""
    came = (block.points.role == Role.GCP) | (checks & (block.points.role == Role.CHECK))
    return replace(block, points=replace(block.points, operation=np.where(came, 0, -1), operations=(use,)))


def _shifted(block: Block, shift_m: np.ndarray, use: OperationUse) -> Block:
    """Return a block whose GCPs are shifted as a whole, by an operation that is named."""
    gcps, ground = block.points.role == Role.GCP, block.points.ground.copy()
    ground[gcps] = move_ground(ground[gcps], np.tile(shift_m, (gcps.sum(), 1)))
    return name_operation(replace(block, points=replace(block.points, ground=ground)), use)


def _inside(result: Adjustment, truth: np.ndarray) -> tuple[float, float]:
    """Return the shares of tie points whose errors are within the CE90 and the LE90 that each states."""
    ties = np.flatnonzero((result.block.points.role == Role.TIE) & np.isfinite(result.ground).all(axis=1))
    error, sigma = ground_difference_m(result.ground[ties], truth[ties]), result.ground_sigma_m[ties]
    circle = np.linalg.norm(error[:, :2], axis=1) <= CIRCLE_90 * np.linalg.norm(sigma[:, :2], axis=1)
    return float(circle.mean()), float((np.abs(error[:, 2]) <= LINE_90 * sigma[:, 2]).mean())


def take_operation(code: str, place: tuple[float, float]) -> OperationUse:
    """Return what converts points of a CRS at a place."""
    return operations_of(code).uses_at("points", np.array([place]))[0]


def measure_speed(code: int, place: tuple[float, float]) -> tuple[float, float]:
    """Return CPU seconds of `POINTS` points as it was before, by the first operation that PROJ lists, and now."""
    operations = CrsOperations(pyproj.CRS.from_epsg(code))
    xy = operations.from_wgs84(np.array([place]))[0]
    xyz = np.column_stack([xy + np.random.default_rng(1).uniform(-1e4, 1e4, (POINTS, 2)), np.full(POINTS, 100.0)])
    before, after = [], []
    for _ in range(5):
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            group = TransformerGroup(pyproj.CRS.from_epsg(code), 4979, always_xy=True)
        first = next(one for one in group.transformers if "allpark" not in one.description)
        np.column_stack(first.transform(xyz[:, 0], xyz[:, 1], xyz[:, 2]))
        middle = time.process_time()
        operations_of(f"EPSG:{code}").to_wgs84(xyz)
        before.append(middle - start)
        after.append(time.process_time() - middle)
    return min(before), min(after)


#: Points of which the coverage is asked, and what converts them.
CONTROL: dict[str, tuple[str, tuple[float, float]]] = {
    "ETRS89 / UTM 32N": ("EPSG:25832", (9.0, 50.0)),
    "ED50 / UTM 30N, Spain": ("EPSG:23030", (-3.7, 40.4)),
    "PSAD56 / UTM 19S, Chile": ("EPSG:24879", (-70.6, -33.5)),
    "ETRS89 / UTM 32N + DHHN92": ("EPSG:25832+5783", (9.0, 50.0)),
}


def describe_crs(folder: Path) -> str:
    """Return the table of the CRS beside cs2cs, and its sums."""
    rows = compare_with_cs2cs()
    head = ("code", "CRS", "operation", "accuracy m", "as cs2cs", "largest difference mm", "where cs2cs differs")
    table = [
        (f"EPSG:{row.code}", row.name, row.operations, row.accuracy, f"{row.same} of 3", f"{row.largest_mm:.4f}",
         row.other)
        for row in rows
    ]  # fmt: skip
    largest = max(row.largest_mm for row in rows)
    return (
        f"{render(head, table)}\n\n{sum(row.same for row in rows)} of {3 * len(rows)} places agree within 1 mm "
        f"(largest {largest:.4f} mm). PROJ {pyproj.proj_version_str}."
    )


def describe_areas(folder: Path) -> str:
    """Return the table of the file with points of two areas."""
    areas = compare_two_areas(folder)
    return render(
        ("operation", "points", "from cs2cs mm"), [(one, count, f"{apart:.3f}") for one, count, apart in areas]
    )


def describe_dem(folder: Path) -> str:
    """Return what a DEM beside points comes to."""
    return (
        "A DEM cell and a point with the same map coordinates differ by at most "
        f"{compare_dem_with_points(folder):.4f} mm, at three places in each of the {len(PLACES)} CRS."
    )


def describe_losses(folder: Path) -> str:
    """Return the largest losses where no grid is installed, and how many are told."""
    losses = run_without_grids(folder)
    told = sum(1 for *_, is_told in losses if is_told)
    worst = sorted(losses, key=lambda row: -(row[2] or 0.0))[:12]
    table = [(f"EPSG:{code}", one, "not known" if loss is None else f"{loss:.2f}") for code, one, loss, _ in worst]
    return (
        f"{render(('CRS', 'missing operation', 'loss m'), table)}\n\nA grid is missing at {len(losses)} of "
        f"{3 * len(PLACES)} places. HRSI reports {told} of {len(losses)}."
    )


def describe_jobs(folder: Path) -> str:
    """Return the table of the jobs through the command line."""
    heads = ("job", "operation", "RPCs apart px", "verdict", "reasons", "CE90 on WGS84 m", "CE90 predicted m",
             "CE90 of check points m", "CE90 they cannot test m", "ERR_BIAS m")  # fmt: skip
    return render(heads, list(run_jobs(folder)))


def describe_coverage(folder: Path) -> str:
    """Return the table of the coverage of CE90 and LE90."""
    cases = {name: take_operation(*of) for name, of in CONTROL.items()}
    covered = [
        (name, *(f"{sigma:.2f}" for sigma in use.operation.sigma_m), *(f"{share:.1f}" for share in cover(use)))
        for name, use in cases.items()
    ]
    return render(("GCPs", "sigma plan m", "sigma height m", "CE90 covers %", "LE90 covers %"), covered)


def describe_laser(folder: Path) -> str:
    """Return the coverage of blocks that laser heights hold."""
    held, silent = cover_with_laser(take_operation(*CONTROL["ETRS89 / UTM 32N + DHHN92"]))
    return (
        "The blocks have two images, no GCPs and three passes of a laser. The laser heights are in DHHN92, with EGM96 "
        f"in place of its geoid. LE90 covers {held:.1f} % of the check point errors, and {silent:.1f} % if the error "
        "of the geoid is not included."
    )


def describe_speed(folder: Path) -> str:
    """Return the table of the speed."""
    speeds = [(code, *measure_speed(code, place)) for code, place in ((25832, (9.0, 50.0)), (23030, (-3.7, 40.4)))]
    times = [
        (f"EPSG:{code}", f"{before:.2f}", f"{after:.2f}", f"{after / before:.2f}") for code, before, after in speeds
    ]
    return render(("CRS", "before CPU s", "service CPU s", "ratio"), times)


#: Parts: the heading of each on the page, and what makes it.
PARTS: dict[str, tuple[str, Callable[[Path], str]]] = {
    "crs": (f"{len(PLACES)} CRS against cs2cs", describe_crs),
    "areas": ("A file with points of two areas", describe_areas),
    "dem": ("DEM and GCPs", describe_dem),
    "losses": ("Without any grid", describe_losses),
    "jobs": ("Two jobs through the command line", describe_jobs),
    "coverage": (f"Coverage over {SEEDS} blocks", describe_coverage),
    "laser": (f"Coverage over {LASER_SEEDS} blocks with laser heights", describe_laser),
    "speed": ("Speed", describe_speed),
}


def main() -> None:
    """Print the parts; ``--docs`` writes them into the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], metavar="PART", help=f"of {', '.join(PARTS)}")
    words: Any = parser.parse_args()
    sections = {}
    for title, describe in (PARTS[name] for name in words.parts or PARTS):
        with tempfile.TemporaryDirectory() as folder:
            sections[title] = describe(Path(folder))
        print(f"## {title}\n\n{sections[title]}\n", flush=True)
    if words.docs:
        write_sections(PAGE, sections)


if __name__ == "__main__":
    main()

"""Surface models of HRSI, s2p and CARS from the same refined RPCs, against true surfaces: ``surface_model.py``.

Parts: ``city``, ``hills``, ``mountains``, ``farmland`` (simulated, with their true surfaces), ``real`` (the s2p triplet
with the DSM of its authors, and Ventoux with SRTM), ``sizes`` (time and memory of pairs of four sizes); all by
default. ``--images 2|3`` and ``--size PX`` set the simulated blocks, with the 0.7 m pixels of Pleiades.

The blocks are adjusted with GCPs, handed over by `hand-over`, and each program makes a surface of the same cell size.
Compared are the cells in a circle that all images of a block show:

* complete: share of cells with a height; bias: median error; NMAD; LE90: 90 % of the errors are smaller
* walls: LE90 in the cells within a metre of a height difference of 2 m in the true surface
* within: share of the errors below 1.645 sigma (HRSI alone states sigmas); s, MB: processor time and peak memory

s2p and CARS are found by the environment variables ``S2P`` and ``CARS`` or the path, else left out. To install:
``python3 -m venv s2p; s2p/bin/pip install s2p`` (needs compilers and headers of GDAL, TIFF, FFTW) and
``python3 -m venv cars; cars/bin/pip install cars``, in environments of their own.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyproj
from osgeo import gdal
from scipy import ndimage

from hrsi.benchmarks import pages
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run

KINDS = ("city", "hills", "mountains", "farmland")
CELL_M = 0.7
WALL_M, STEP_M = 1.0, 2.0  # distance from a wall, and height difference that is one
HRSI = (sys.executable, "-m", "hrsi.processing_algorithms.command_line.cli")


class Cost(NamedTuple):
    """Processor time (s) and peak memory (MB) of a program; ``ok`` is whether it ended without error."""

    seconds: float
    megabytes: float
    ok: bool


def call(command: list[str], folder: Path, log: Path) -> Cost:
    """Run a program with all its processes and return what it took."""
    with log.open("wb") as output:
        pid = os.posix_spawn(
            shutil.which(command[0]) or command[0],
            ["sh", *command[1:]] if command[0] == "sh" else command,
            {**os.environ, "PYTHONWARNINGS": "ignore", "PWD": str(folder)},
            file_actions=[(os.POSIX_SPAWN_DUP2, output.fileno(), 1), (os.POSIX_SPAWN_DUP2, output.fileno(), 2)],
        )
        _, status, usage = os.wait4(pid, 0)
    return Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0, status == 0)


def make_block(kind: str, folder: Path, images: int, size: int, seed: int) -> Path:
    """Simulate and adjust a block; return the folder of the adjustment."""
    along = {2: "-8,8", 3: "-8,0,8"}[images]
    relief = {"relief": 0.4 * size * CELL_M} if kind == "mountains" else {}  # slopes up to 60 degrees at any size
    run(
        "simulate", images=images, along=along, size=size, landform=kind, **relief, gcps=25, checks=0, ties=200, noise_image=0.02,
        noise_gcp_xy=0.02, noise_gcp_h=0.02, seed=seed, output_dir=str(folder / "made"),
    )  # fmt: skip
    run(
        "adjust", images=[str(folder / "made" / f"image_{k + 1}.tif") for k in range(images)],
        gcps=str(folder / "made" / "ground_points.csv"), image_points=str(folder / "made" / "image_points.csv"),
        sigma_gcp_xy=0.02, sigma_gcp_h=0.02, sigma_image=0.02, height_datum="ellipsoidal", report=False,
        output_dir=str(folder / "adjusted"),
    )  # fmt: skip
    return folder / "adjusted"


def find_peer(name: str) -> str | None:
    """Return the path of a program, None if it is not installed."""
    return os.environ.get(name.upper()) or shutil.which(name)


def make_surfaces(adjusted: Path, folder: Path, cell_m: float) -> dict[str, tuple[Path, Cost]]:
    """Return the surface and the cost of each program that is installed."""
    ours = folder / "hrsi"
    cost = call(
        [*HRSI, "surface-model", str(adjusted), "--resolution", str(cell_m), "--threads", "1", "--no-report", "-q",
         "--output-dir", str(ours)], folder, folder / "hrsi.log",
    )  # fmt: skip
    found = {"HRSI": (ours / "surface.tif", cost)}
    for name, result in (("s2p", "out/dsm.tif"), ("cars", "out/dsm/dsm.tif")):
        program = find_peer(name)
        if program is None:
            print(f"{name} is not installed (pip install {name} in an environment of its own): left out")
            continue
        project = folder / name
        run("hand-over", result=str(adjusted), to=name, output_dir=str(project))
        path = project / f"{name}.json"
        settings = json.loads(path.read_text())
        if name == "s2p":
            settings |= {"dsm_resolution": cell_m, "max_processes": 1}
        else:
            settings["output"]["resolution"] = cell_m
            settings |= {"orchestrator": {"mode": "sequential"}, "subsampling": {"advanced": {"resolutions": [1]}}}
        path.write_text(json.dumps(settings))
        script = f"cd '{project}' && exec '{program}' {name}.json"
        cost = call(["sh", "-c", script], folder, folder / f"{name}.log")
        if cost.ok and (project / result).exists():
            found[name] = (project / result, cost)
        else:
            print(f"{name} failed: {(folder / f'{name}.log').read_text()[-300:]}")
    return found


def read_surface(path: Path) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Return heights (NaN for nodata) and sigmas (None if the file has none), and lon, lat (rows, columns, 2)."""
    dataset = gdal.Open(str(path))
    band = dataset.GetRasterBand(1)
    height = band.ReadAsArray().astype(float)
    height[~(height > -1000.0)] = np.nan
    is_ours = dataset.RasterCount > 1 and dataset.GetRasterBand(2).GetDescription() == "standard deviation"
    west, step, _, north, _, down = dataset.GetGeoTransform()
    row, column = np.indices(height.shape)
    crs = pyproj.CRS.from_wkt(dataset.GetProjection())
    to_wgs84 = pyproj.Transformer.from_crs(crs.sub_crs_list[0] if crs.sub_crs_list else crs, 4326, always_xy=True)
    lonlat = np.stack(to_wgs84.transform(west + (column + 0.5) * step, north + (row + 0.5) * down), axis=-1)
    return height, dataset.GetRasterBand(2).ReadAsArray() if is_ours else None, lonlat


def compare(path: Path, dem: Path, centre: np.ndarray, radius_m: float) -> list[str]:
    """Return the cells of a row: complete, bias, NMAD, LE90, LE90 near walls, and the share within 1.645 sigma."""
    height, sigma, lonlat = read_surface(path)
    truth = surface_heights(open_dem(str(dem)), lonlat.reshape(-1, 2)).reshape(height.shape)
    metres = (lonlat - centre) * [111_320.0 * np.cos(np.radians(centre[1])), 110_574.0]
    inside = (np.hypot(*np.moveaxis(metres, -1, 0)) < radius_m) & np.isfinite(truth)
    cell_m = abs(gdal.Open(str(path)).GetGeoTransform()[1])
    side = 2 * max(1, round(WALL_M / cell_m)) + 1
    walls = ndimage.maximum_filter(truth, side) - ndimage.minimum_filter(truth, side) > STEP_M
    walls = ndimage.binary_dilation(walls & inside) & inside
    error = height - truth
    exists = inside & np.isfinite(error)
    area = np.pi * radius_m**2 / cell_m**2
    values, at_walls = error[exists], np.abs(error[exists & walls])
    bias = float(np.median(values))
    figures = [bias, 1.4826 * float(np.median(np.abs(values - bias))), float(np.percentile(np.abs(values), 90.0))]
    within = "" if sigma is None else f"{np.mean(np.abs(values) < 1.645 * sigma[exists]):.1%}"
    wall = f"{np.percentile(at_walls, 90.0):.2f}" if len(at_walls) > 100 else ""
    return [f"{min(len(values) / area, 1.0):.1%}", *(f"{one:.3f}" for one in figures), wall, within]


HEAD = (
    "| block | program | complete | bias m | NMAD m | LE90 m | walls LE90 m | within | s | MB |\n" + "|---" * 10 + "|"
)


def compare_all(
    name: str, surfaces: dict[str, tuple[Path, Cost]], dem: Path, centre: np.ndarray, radius_m: float
) -> None:
    """Print a row for each program."""
    for program, (path, cost) in surfaces.items():
        cells = compare(path, dem, centre, radius_m)
        print(f"| {name} | {program} | {' | '.join(cells)} | {cost.seconds:.0f} | {cost.megabytes:.0f} |", flush=True)


def simulated(kind: str, folder: Path, options: argparse.Namespace) -> None:
    """Print the rows of a simulated block."""
    adjusted = make_block(kind, folder, options.images, options.size, options.seed)
    surfaces = make_surfaces(adjusted, folder, CELL_M)
    truth = json.loads((folder / "made" / "report.json").read_text())["options"]
    centre = np.array([truth.get("lon", 5.45), truth.get("lat", 43.53)])
    compare_all(
        f"{kind}, {options.images} images", surfaces, folder / "made" / "dem.tif", centre, 0.4 * options.size * CELL_M
    )


def real(folder: Path) -> None:
    """Print the rows of the real blocks, adjusted without control: biases are those of the RPCs."""
    data = pages.DATA / "real"
    triplet, ventoux = data / "s2p_triplet_phr", data / "ventoux_phr_pair"
    views = [triplet / f"img_0{k}.tif" for k in (1, 2, 3)], [ventoux / f"{k}_image.tif" for k in ("left", "right")]
    blocks = {
        "triplet, against s2p's DSM": (views[0], triplet / "s2p_reference_dsm.tif", "ellipsoidal"),
        "Ventoux, against SRTM": (views[1], ventoux / "dem" / "N44E005.hgt", "egm96"),
    }
    for number, (name, (images, dem, datum)) in enumerate(blocks.items()):
        place = folder / str(number)
        place.mkdir()
        run("triangulate", images=[str(one) for one in images], report=False, output_dir=str(place / "adjusted"))
        for program, (path, cost) in make_surfaces(place / "adjusted", place, 0.5).items():
            height, _, lonlat = read_surface(path)
            exists = np.isfinite(height)
            difference = height[exists] - surface_heights(open_dem(str(dem), datum), lonlat[exists])
            difference = difference[np.isfinite(difference)]
            bias = float(np.median(difference))
            cells = [
                bias,
                1.4826 * np.median(np.abs(difference - bias)),
                np.percentile(np.abs(difference - bias), 90.0),
            ]
            numbers = " | ".join(f"{one:.2f}" for one in cells)
            print(f"| {name} | {program} | {len(difference)} cells | {numbers} | | | {cost.seconds:.0f} | "
                  f"{cost.megabytes:.0f} |", flush=True)  # fmt: skip


def sizes(folder: Path, options: argparse.Namespace) -> None:
    """Print time and memory of HRSI for pairs of four sizes."""
    print("\n| pixels of an image | s | s for a megapixel | MB |\n|---|---|---|---|")
    for size in options.sizes:
        place = folder / str(size)
        adjusted = make_block("hills", place, 2, size, options.seed)
        words = ["--resolution", str(CELL_M), "--no-report", "-q", "--output-dir", str(place / "surface")]
        cost = call([*HRSI, "surface-model", str(adjusted), *words], place, place / "log")
        print(f"| {size} x {size} | {cost.seconds:.0f} | {cost.seconds / size**2 * 1e6:.2f} | {cost.megabytes:.0f} |",
              flush=True)  # fmt: skip
        shutil.rmtree(place)


def main() -> None:
    """Run the parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=[*KINDS, "real", "sizes"])
    parser.add_argument("--images", type=int, default=2, choices=(2, 3))
    parser.add_argument("--size", type=int, default=700)
    parser.add_argument("--sizes", type=int, nargs="*", default=[1250, 2500, 5000, 10000])
    parser.add_argument("--seed", type=int, default=61)
    options = parser.parse_args()
    begin = time.monotonic()
    if set(options.parts) - {"sizes"}:
        print(HEAD)
    for part in options.parts:
        with tempfile.TemporaryDirectory() as folder:
            if part == "sizes":
                sizes(Path(folder), options)
            elif part == "real":
                real(Path(folder))
            else:
                simulated(part, Path(folder), options)
    print(f"\n{time.monotonic() - begin:.0f} s")


if __name__ == "__main__":
    main()

"""Surface models of HRSI, s2p and CARS from the same refined RPCs, against true surfaces: ``surface_model.py``.

Parts: ``city``, ``hills``, ``mountains``, ``farmland`` (simulated, with their true surfaces), ``real`` (the s2p triplet
with the DSM of its authors, and Ventoux with SRTM), ``sizes`` (time and memory of pairs of four sizes); all by
default. ``--images``, ``--pixels`` (m, from the orbit of Pleiades) and ``--size PX`` set the simulated blocks.

The blocks are adjusted with GCPs, handed over by `hand-over`, and each program makes a surface with cells of the size
of a pixel. Compared are the cells in a circle that all images of a block show:

* complete: share of cells with a height; bias: median error; NMAD; LE90: 90 % of the errors are smaller
* walls: LE90 in the cells within a metre of a height difference of 2 m in the true surface
* within: share of the errors below 1.645 sigma (HRSI alone states sigmas); s, MB: processor time and peak memory

The real blocks have no truth: the differences between the surfaces of the programs are printed too, and their shaded
surfaces are drawn side by side into ``build/``.

The pairs of ``sizes`` show a random texture on hills, projected by the RPCs. ``--peers N``: s2p and CARS run at the N
smallest sizes too, for five minutes at most.

s2p and CARS are found by the environment variables ``S2P`` and ``CARS`` or the path, else left out. To install:
``python3 -m venv s2p; s2p/bin/pip install s2p`` (needs compilers and headers of GDAL, TIFF, FFTW) and
``python3 -m venv cars; cars/bin/pip install cars``, in environments of their own.
"""

import argparse
import itertools
import json
import os
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pyproj
from osgeo import gdal
from scipy import ndimage

from hrsi.benchmarks import pages
from hrsi.hrsi_engine.drawing.target_chips import stretch_grey
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rasters.surface_models import ShadedSurface
from hrsi.hrsi_engine.laboratory.simulation.sensors import SENSORS
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run

KINDS = ("city", "hills", "mountains", "farmland")
PIXEL_M, REAL_CELL_M = 0.7, 0.5
LONGEST_S = 300  # of a peer
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


def adjust_block(folder: Path, images: int) -> Path:
    """Adjust a simulated block; return the folder of the adjustment."""
    run(
        "adjust", images=[str(folder / "made" / f"image_{k + 1}.tif") for k in range(images)],
        gcps=str(folder / "made" / "ground_points.csv"), image_points=str(folder / "made" / "image_points.csv"),
        sigma_gcp_xy=0.02, sigma_gcp_h=0.02, sigma_image=0.02, height_datum="ellipsoidal", report=False,
        output_dir=str(folder / "adjusted"),
    )  # fmt: skip
    return folder / "adjusted"


def make_block(kind: str, folder: Path, images: int, size: int, seed: int, pixel_m: float) -> Path:
    """Simulate and adjust a block; return the folder of the adjustment."""
    along = {2: "-8,8", 3: "-8,0,8"}[images]
    SENSORS["pleiades"] = replace(SENSORS["pleiades"], gsd_m=pixel_m)
    share = {"hills": 0.12, "mountains": 0.4}.get(kind)  # of the width of the scene: slopes are those of any size
    relief = {} if share is None else {"relief": share * size * pixel_m}
    run(
        "simulate", images=images, along=along, size=size, landform=kind, gcps=25, checks=0, ties=200, seed=seed,
        noise_image=0.02, noise_gcp_xy=0.02, noise_gcp_h=0.02, output_dir=str(folder / "made"), **relief,
    )  # fmt: skip
    return adjust_block(folder, images)


def paint_pair(folder: Path, size: int, seed: int) -> Path:
    """Simulate a pair of any size cheaply: a random texture on smooth hills, seen through its RPCs; adjust it."""
    made = folder / "made"
    run(
        "simulate", images=2, along="-8,8", size=size, landform="hills", gcps=25, checks=0, ties=200, seed=seed,
        pixels=False, vendor_error=0.0, noise_image=0.02, noise_gcp_xy=0.02, noise_gcp_h=0.02, output_dir=str(made),
    )  # fmt: skip
    grey = np.random.default_rng(seed).normal(0.0, 1.0, (4096, 4096)).astype(np.float32)
    texture = 400.0 + 60.0 * cv2.GaussianBlur(grey, (0, 0), 1.0) / 0.28
    dem = open_dem(str(made / "dem.tif"))
    lines = cells = np.arange(0.0, size + 16.0, 16.0)
    nodes = np.stack(np.meshgrid(cells, lines), axis=-1).reshape(-1, 2)
    for k in (1, 2):
        rpc = open_image(str(made / f"image_{k}_RPC.TXT")).rpc
        height = np.full(len(nodes), 250.0)
        for _ in range(8):
            ground = rpc.localize(nodes, height).ground
            height = surface_heights(dem, ground[:, :2])
            height[np.isnan(height)] = 250.0
        metres = (ground[:, :2] - [rpc.long_off, rpc.lat_off]) * [80_700.0, 111_100.0] / 0.7
        place = metres.reshape(len(lines), len(cells), 2).astype(np.float32)
        image = gdal.GetDriverByName("GTiff").Create(str(made / f"image_{k}.tif"), size, size, 1, gdal.GDT_UInt16)
        for line in range(0, size, 256):
            x = np.arange(size, dtype=np.float32)[None] / 16.0
            y = np.arange(line, min(line + 256, size), dtype=np.float32)[:, None] / 16.0
            x, y = np.broadcast_arrays(x, y)
            east, north = cv2.split(cv2.remap(place, x.copy(), y.copy(), cv2.INTER_LINEAR))
            values = cv2.remap(texture, east % 4096.0, north % 4096.0, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
            image.GetRasterBand(1).WriteArray(np.clip(values, 0.0, 2000.0).astype(np.uint16), 0, line)
        del image
    return adjust_block(folder, 2)


def find_peer(name: str) -> str | None:
    """Return the path of a program, None if it is not installed."""
    return os.environ.get(name.upper()) or shutil.which(name)


def make_surfaces(adjusted: Path, folder: Path, cell_m: float, peers: bool = True) -> dict[str, tuple[Path, Cost]]:
    """Return the surface and the cost of each program that is installed, ``peers`` included."""
    ours = folder / "hrsi"
    cost = call(
        [*HRSI, "surface-model", str(adjusted), "--resolution", str(cell_m), "--threads", "1", "--no-report", "-q",
         "--output-dir", str(ours)], folder, folder / "hrsi.log",
    )  # fmt: skip
    found = {"HRSI": (ours / "surface.tif", cost)}
    for name, result in (("s2p", "out/dsm.tif"), ("cars", "out/dsm/dsm.tif")) if peers else ():
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
        script = f"cd '{project}' && exec timeout {LONGEST_S} '{program}' {name}.json"
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


def simulated(kind: str, images: int, pixel_m: float, folder: Path, options: argparse.Namespace) -> None:
    """Print the rows of a simulated block."""
    adjusted = make_block(kind, folder, images, options.size, options.seed, pixel_m)
    surfaces = make_surfaces(adjusted, folder, pixel_m)
    truth = json.loads((folder / "made" / "report.json").read_text())["options"]
    centre = np.array([truth.get("lon", 5.45), truth.get("lat", 43.53)])
    name = f"{kind}, {images} images of {pixel_m} m"
    compare_all(name, surfaces, folder / "made" / "dem.tif", centre, 0.4 * options.size * pixel_m)


def describe_differences(difference: np.ndarray) -> str:
    """Return count, median, NMAD and LE90 about the median of differences as cells of a row."""
    difference = difference[np.isfinite(difference)]
    if not len(difference):
        return "0 | | | "
    centred = difference - np.median(difference)
    spread = 1.4826 * np.median(np.abs(centred)), np.percentile(np.abs(centred), 90.0)
    return " | ".join([str(len(difference)), *(f"{one:.2f}" for one in (np.median(difference), *spread))])


def draw_shaded(surfaces: dict[str, tuple[Path, Cost]], path: Path) -> None:
    """Draw the shaded surfaces side by side, on the grid of the first one."""
    first = gdal.Open(str(next(iter(surfaces.values()))[0]))
    west, step, _, north, _, down = first.GetGeoTransform()
    box = west, north + down * first.RasterYSize, west + step * first.RasterXSize, north
    parts = []
    for name, (surface, _) in surfaces.items():
        same = str(surface.with_suffix(".same.tif"))
        heights = gdal.Translate("", str(surface), format="VRT", bandList=[1])
        gdal.Warp(same, heights, dstSRS=first.GetProjection(), outputBounds=box, xRes=step, yRes=-down,
                  resampleAlg="bilinear", dstNodata=-9999.0)  # fmt: skip
        shade, valid = ShadedSurface(same).read_means(1)
        picture = np.where(valid, stretch_grey(shade, valid), 0).astype(np.uint8)
        parts.append(cv2.putText(picture, name, (20, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.2, 255, 2))
    cv2.imwrite(str(path), np.hstack(parts))


def real(folder: Path) -> None:
    """Print the differences of the real blocks, adjusted without control: biases to a DEM are those of the RPCs."""
    data = pages.DATA / "real"
    triplet, ventoux = data / "s2p_triplet_phr", data / "ventoux_phr_pair"
    views = [triplet / f"img_0{k}.tif" for k in (1, 2, 3)], [ventoux / f"{k}_image.tif" for k in ("left", "right")]
    blocks = {
        "triplet": (views[0], "DSM of s2p's authors", triplet / "s2p_reference_dsm.tif", "ellipsoidal"),
        "Ventoux": (views[1], "SRTM", ventoux / "dem" / "N44E005.hgt", "egm96"),
    }
    print("| block | surfaces | common cells | median m | NMAD m | LE90 m | s | MB |\n" + "|---" * 8 + "|")
    for name, (images, reference, dem, datum) in blocks.items():
        place = folder / name
        place.mkdir()
        run("triangulate", images=[str(one) for one in images], report=False, output_dir=str(place / "adjusted"))
        surfaces = make_surfaces(place / "adjusted", place, REAL_CELL_M)
        height, _, lonlat = read_surface(surfaces["HRSI"][0])
        exists = np.isfinite(height)
        for program, (path, cost) in surfaces.items():
            own, _, places = read_surface(path)
            has_height = np.isfinite(own)
            beyond = own[has_height] - surface_heights(open_dem(str(dem), datum), places[has_height])
            print(f"| {name} | {program} - {reference} | {describe_differences(beyond)} | {cost.seconds:.0f} | "
                  f"{cost.megabytes:.0f} |", flush=True)  # fmt: skip
            if program != "HRSI":
                other = surface_heights(open_dem(str(path), "ellipsoidal"), lonlat[exists])
                print(f"| {name} | HRSI - {program} | {describe_differences(height[exists] - other)} | | |", flush=True)
        (pages.DOCS.parent / "build").mkdir(exist_ok=True)
        draw_shaded(surfaces, pages.DOCS.parent / "build" / f"surface_model_{name.lower()}.png")


def sizes(folder: Path, options: argparse.Namespace) -> None:
    """Print time and memory for pairs of four sizes, with one thread."""
    print("\n| pixels of an image | program | s | s for a megapixel | MB |\n|---|---|---|---|---|")
    for number, size in enumerate(options.sizes):
        place = folder / str(size)
        adjusted = paint_pair(place, size, options.seed)
        for program, (_, cost) in make_surfaces(adjusted, place, PIXEL_M, peers=number < options.peers).items():
            print(f"| {size} x {size} | {program} | {cost.seconds:.0f} | {cost.seconds / size**2 * 1e6:.2f} | "
                  f"{cost.megabytes:.0f} |", flush=True)  # fmt: skip
        shutil.rmtree(place)


def main() -> None:
    """Run the parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=[*KINDS, "real", "sizes"])
    parser.add_argument("--images", type=int, nargs="*", default=[2, 3])
    parser.add_argument("--pixels", type=float, nargs="*", default=[0.7, 0.5, 0.3])
    parser.add_argument("--size", type=int, default=600)
    parser.add_argument("--sizes", type=int, nargs="*", default=[1250, 2500, 5000, 10000])
    parser.add_argument("--peers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=61)
    options = parser.parse_args()
    begin = time.monotonic()
    if set(options.parts) & set(KINDS):
        print(HEAD)
    for kind, images, pixel_m in itertools.product(KINDS, options.images, options.pixels):
        if kind in options.parts:
            with tempfile.TemporaryDirectory() as folder:
                simulated(kind, images, pixel_m, Path(folder), options)
    for part, measure in (("real", lambda folder: real(folder)), ("sizes", lambda folder: sizes(folder, options))):
        if part in options.parts:
            with tempfile.TemporaryDirectory() as folder:
                measure(Path(folder))
    print(f"\n{time.monotonic() - begin:.0f} s")


if __name__ == "__main__":
    main()

"""Tie points of large images: time, memory and growth beside OpenCV's SIFT on the same pixels, and errors by truth.

    python benchmarks/tie_points_speed.py [FOLDER]                              # all of it: some minutes
    python benchmarks/tie_points_speed.py --sizes 5000 40000 --layouts          # pairs of growing size
    python benchmarks/tie_points_speed.py --sizes --layouts 5x2                 # five views of each of 2 x 2 places

The images are virtual: each repeats one tile of ground (4000 px) as a camera of parallel rays sees it, so that they
take little room; the images of a layout have 12 000 x 12 000 px. Every measurement runs in a process of its own. Peak
memory is its maximum resident set: Python, NumPy, OpenCV and GDAL's block cache (whose limit is printed) included. SIFT
finds the 8000 strongest features of a tile of 2048 x 2048 px, with descriptors. Tie points are intersected with the
true RPCs: what is left over are the errors of the positions (with two images, those across the epipolar lines), and the
heights are compared with the true ones.
"""

import argparse
import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from osgeo import gdal

from hrsi.hrsi_engine.block.points import ImagePoints
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.ground.geodesy import metres_per_degree
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files.fields import gdal_metadata
from hrsi.processing_algorithms import run

SIFT_TILE = 2048
SIFT_FEATURES = 8000  # of a tile: without a limit simulated texture gives 100 000, and SIFT takes many times as long
PERIOD = 4000  # of the ground: it repeats
GSD_M, TILT = 0.5, 0.35


def measured(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what some work returns, with its wall and processor time and the peak memory of the process (MiB)."""
    wall, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
    result = work()
    after = resource.getrusage(resource.RUSAGE_SELF)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return result | {"wall_s": time.monotonic() - wall, "cpu_s": cpu, "peak_mib": after.ru_maxrss / 1024.0}


def in_own_process(*arguments: str) -> dict[str, Any]:
    """Run this script with other arguments; return what it prints as JSON."""
    command = [sys.executable, __file__, "--one", *arguments]
    text = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    return json.loads(text.splitlines()[-1])


# ---- ours ----------------------------------------------------------------------------------------------------------


def tie_points(paths: list[str], threads: int, output: str) -> dict[str, Any]:
    """Run `tie-points` and return the figures of its report."""
    report = run("tie-points", images=paths, output_dir=output, overwrite=True, threads=threads, csv=True)
    return {
        "points": report["ties"]["points"], "observations": report["ties"]["observations"],
        "views": report["ties"]["by_views"], "warnings": report["warnings"], "pairs": len(report["pairs"]),
        "cells": [image["cells"] for image in report["images"].values()],
    }  # fmt: skip


def read_points(folder: str) -> ImagePoints:
    """Read the measurements of a run."""
    rows = np.genfromtxt(f"{folder}/tie_points.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    return ImagePoints(
        rows["id"], rows["image"], np.column_stack([rows["sample"], rows["line"]]), rows["sigma"], rows["kind"],
        rows["quality"],
    )  # fmt: skip


def true_residuals(points: ImagePoints, cameras: dict[str, RPC]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return each row's residual ``(n, 2)`` px after intersecting its track with the true cameras, views and ground."""
    _, track = np.unique(points.ids, return_inverse=True)
    views = np.bincount(track)
    ground = np.zeros((len(views), 3))
    rows = {name: np.flatnonzero(points.image_ids == name) for name in np.unique(points.image_ids)}
    for name, here in rows.items():
        ground[track[here]] = cameras[name].localize(points.xy[here], cameras[name].height_off).ground
    residual = np.zeros((len(track), 2))
    for _ in range(6):
        normal, right = np.zeros((len(views), 3, 3)), np.zeros((len(views), 3))
        for name, here in rows.items():
            xy, by_ground = cameras[name].project_with_metric_jacobian(ground[track[here]])
            residual[here] = points.xy[here] - xy
            np.add.at(normal, track[here], by_ground.swapaxes(1, 2) @ by_ground)
            np.add.at(right, track[here], np.einsum("nij,ni->nj", by_ground, residual[here]))
        step = np.linalg.solve(normal + 1e-9 * np.eye(3), right[..., None])[..., 0]
        ground += step / metres_per_degree(ground)
    return residual, views[track], ground[track]


# ---- SIFT ----------------------------------------------------------------------------------------------------------


def find_sift_features(paths: list[str]) -> dict[str, Any]:
    """Find SIFT features in the upper left tile of every image; return the seconds of the processor for a megapixel."""
    import cv2

    cv2.setNumThreads(1)
    finder = cv2.SIFT_create(SIFT_FEATURES, contrastThreshold=0.01)
    tiles = [open_image(path).raster.read(0, 0, SIFT_TILE, SIFT_TILE)[0] for path in paths]
    began = time.process_time()
    for grey in tiles:
        low, high = np.percentile(grey[::4, ::4], (1.0, 99.0))
        finder.detectAndCompute(np.clip((grey - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8), None)
    return {"cpu_per_mpx": (time.process_time() - began) / (len(tiles) * SIFT_TILE**2 * 1e-6)}


def print_errors(points: ImagePoints, cameras: dict[str, RPC], heights: np.ndarray | None = None) -> None:
    """Print the errors of positions by the number of views, and along the epipolar lines by ``heights`` of a period."""
    residual, views, ground = true_residuals(points, cameras)
    size = np.hypot(*residual.T)
    for count in np.unique(views):
        here = views == count
        print(
            f"       on {count} images: {here.sum() // count} points, RMSE {np.sqrt(np.mean(size[here] ** 2)):.3f} px, "
            f"worst {size[here].max():.2f} px, {np.mean(size[here] > 1.0):.2%} beyond 1 px"
        )
    if heights is not None:
        straight = parallel_rpc(round(2 * next(iter(cameras.values())).samp_off), 0.0)
        column, line = np.round(straight.project(ground)).astype(int).T % PERIOD
        along = TILT / GSD_M * (ground[:, 2] - 250.0 - heights[line, column])
        along -= np.median(along)
        print(f"       heights by the truth, as parallax: RMSE {np.sqrt(np.mean(along**2)):.3f} px")


# ---- large images whose content repeats ----------------------------------------------------------------------------


def parallel_rpc(size: int, tilt: float, place: tuple[int, int] = (0, 0)) -> RPC:
    """Return a camera of parallel rays over flat axes: a point h metres up moves by ``tilt * h`` metres to the east.

    place : pixels of the image's corner from that of the first place
    """
    half = size / 2.0
    sample, line, one = np.zeros(20), np.zeros(20), np.zeros(20)
    sample[1], sample[3] = 1.0, tilt * 500.0 / (half * GSD_M)
    line[2], one[0] = -1.0, 1.0
    lat, lon = 45.0, 5.0
    metres_lon, metres_lat, _ = metres_per_degree(np.array([[lon, lat, 250.0]]))[0]
    lat, lon = lat - place[1] * GSD_M / metres_lat, lon + place[0] * GSD_M / metres_lon
    return RPC(half, half, lat, lon, 250.0, half, half, half * GSD_M / metres_lat, half * GSD_M / metres_lon, 500.0,
               line, one, sample, one)  # fmt: skip


def periodic_noise(side: int, slope: float, seed: int, smallest: float) -> np.ndarray:
    """Return fractal noise that repeats at its edges, of standard deviation 1, without waves below ``smallest`` px."""
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None])
    frequency[0, 0] = 1.0
    spectrum = frequency**-slope * np.exp(-((frequency * smallest) ** 2))
    spectrum[0, 0] = 0.0
    noise = np.fft.irfft2(np.fft.rfft2(np.random.default_rng(seed).normal(size=(side, side))) * spectrum, (side, side))
    return noise / noise.std()


def make_heights() -> np.ndarray:
    """Return the heights of one period of the ground in m."""
    return 20.0 * periodic_noise(PERIOD, 2.0, 1, 60.0)


def write_tile(folder: str, tilt: float) -> str:
    """Write one period of the ground as a camera of parallel rays sees it, if it is not there; return its path."""
    import cv2

    path = f"{folder}/tile_{tilt:+.2f}.tif"
    os.makedirs(folder, exist_ok=True)
    if os.path.exists(path):
        return path
    height = np.pad(make_heights(), 64, mode="wrap").astype(np.float32)
    texture = 800.0 + 150.0 * periodic_noise(PERIOD, 1.2, 2, 1.2)
    texture = (texture + np.random.default_rng(3).normal(0, 2, texture.shape)).astype(np.float32)
    rows, columns = np.mgrid[0:PERIOD, 0:PERIOD].astype(np.float32)
    at = columns.copy()
    for _ in range(30 if tilt else 0):
        shift = tilt / GSD_M * cv2.remap(height, at + 64, rows + 64, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        at = columns - shift
    pixels = cv2.remap(
        np.pad(texture, 64, mode="wrap"), at + 64, rows + 64, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP
    )
    dataset = gdal.GetDriverByName("GTiff").Create(path, PERIOD, PERIOD, 1, gdal.GDT_UInt16, ["TILED=YES"])
    dataset.GetRasterBand(1).WriteArray(np.clip(pixels, 1, 4095).astype(np.uint16))
    return path


def write_repeated(path: str, tile: str, size: int, rpc: RPC) -> None:
    """Write a virtual image that repeats a tile, with its RPC."""
    dataset = gdal.GetDriverByName("VRT").Create(path, size, size, 1, gdal.GDT_UInt16)
    dataset.SetMetadata(gdal_metadata(rpc), "RPC")
    for number, (x, y) in enumerate(itertools.product(range(0, size, PERIOD), repeat=2)):
        width, height = min(PERIOD, size - x), min(PERIOD, size - y)
        source = (
            f'<SimpleSource><SourceFilename relativeToVRT="0">{os.path.abspath(tile)}</SourceFilename>'
            f'<SourceBand>1</SourceBand><SrcRect xOff="0" yOff="0" xSize="{width}" ySize="{height}"/>'
            f'<DstRect xOff="{x}" yOff="{y}" xSize="{width}" ySize="{height}"/></SimpleSource>'
        )
        dataset.GetRasterBand(1).SetMetadataItem(f"source_{number}", source, "new_vrt_sources")


def write_views(folder: str, size: int, tilts: Sequence[float], places: int) -> dict[str, RPC]:
    """Write images of ``size`` px with each tilt at each place of a square; return their cameras by path.

    Neighbouring places overlap by a period or more.
    """
    step, cameras = (size // PERIOD - 1) * PERIOD, {}
    for tilt, x, y in itertools.product(tilts, range(places), range(places)):
        path = f"{folder}/view_{size}_{tilt:+.2f}_{x}{y}.vrt"
        cameras[path] = parallel_rpc(size, tilt, (x * step, y * step))
        write_repeated(path, write_tile(folder, tilt), size, cameras[path])
    return cameras


def print_large(folder: str, size: int, threads: int, tilts: Sequence[float] = (0.0, TILT), places: int = 1) -> None:
    """Print time, memory and errors of large images."""
    cameras = write_views(folder, size, tilts, places)
    with tempfile.TemporaryDirectory() as output:
        ours = in_own_process("ties", ",".join(cameras), str(threads), output)
        points = read_points(output)
    megapixels = len(cameras) * size**2 * 1e-6
    print(
        f"{len(cameras)} images of {size} x {size} px ({megapixels:.0f} Mpx), {threads} threads: "
        f"{ours['pairs']} pairs, {ours['wall_s']:.0f} s wall, {ours['cpu_s']:.1f} s CPU "
        f"({ours['cpu_s'] / megapixels:.4f} s/Mpx), peak {ours['peak_mib']:.0f} MiB "
        f"(GDAL's cache {gdal.GetCacheMax() / 2**20:.0f}), {ours['points']} points, "
        f"least {min(ours['cells'])} of 64 parts",
        flush=True,
    )
    print_errors(points, {Path(path).stem: rpc for path, rpc in cameras.items()}, make_heights())


def one(arguments: list[str]) -> dict[str, Any]:
    """Do one measurement in this process."""
    what, paths, *rest = arguments
    if what == "sift":
        return measured(lambda: find_sift_features(paths.split(",")))
    return measured(lambda: tie_points(paths.split(","), int(rest[0]), rest[1]))


def main() -> None:
    """Read the arguments and print what they ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default="build/large_images", help="of the images")
    parser.add_argument("--sizes", nargs="*", type=int, default=[5000, 10000, 20000, 40000], help="of pairs, px")
    parser.add_argument("--layouts", nargs="*", default=["3x1", "5x1", "3x2", "5x2"], help="views of each place x side")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--one", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(given.one)))
        return
    sift = in_own_process("sift", ",".join(write_views(given.folder, PERIOD, (0.0, TILT), 1)))
    print(f"OpenCV's SIFT on a tile of {SIFT_TILE} px of two images: {sift['cpu_per_mpx']:.2f} s CPU per Mpx, "
          f"peak {sift['peak_mib']:.0f} MiB")  # fmt: skip
    for size in given.sizes:
        print_large(given.folder, size, given.threads)
    for layout in given.layouts:
        views, side = map(int, layout.split("x"))
        print_large(given.folder, 12000, given.threads, [TILT * (view - views // 2) for view in range(views)], side)


if __name__ == "__main__":
    main()

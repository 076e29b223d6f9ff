"""Tie points of large images: time, memory and growth beside OpenCV's SIFT on the same images, and errors by truth.

    hrsi simulate --size 12000 --images 3 --strips 2 --places 2 --seed 7 --output-dir BLOCK   # 3.5 GB, once
    python benchmarks/tie_points_speed.py --block BLOCK [--counts 3 6 12] [--threads 1]
    python benchmarks/tie_points_speed.py --large FOLDER [--sizes 5000 10000 20000 40000]   # pairs of growing size
    python benchmarks/tie_points_speed.py --twenty FOLDER   # 20 images of 12 000 x 12 000 px: five views of four places

The last two write virtual images, of which each is one tile of ground that repeats.

Every measurement runs in a process of its own. Peak memory is its maximum resident set: Python, NumPy, OpenCV and
GDAL's block cache (whose limit is printed) included. SIFT runs on tiles of 2048 x 2048 px with a border of 32 px, the
8000 strongest features of each, descriptors included, on a sample of the tiles of every image; its exact matching
(nearest two) on a share of the features of two tiles. Its time for the block is extrapolated by pixels, and is that of
the features alone. Truth is in the simulated block: tie points are intersected with the true RPCs, and what is left
over are the errors of the positions (with two images, those across the epipolar lines).
"""

from __future__ import annotations

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

SIFT_TILE, SIFT_BORDER = 2048, 32
SIFT_FEATURES = 8000  # of a tile: without a limit simulated texture gives 100 000, and SIFT takes many times as long
MATCH_EVERY = 32  # exact matching of a tile is timed on this share of its features: all of them take a minute
PERIOD = 4000  # of the large pair's ground: it repeats
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


def images_of(folder: str, count: int) -> list[str]:
    """Return the first images of a simulated block."""
    return sorted(str(path) for path in Path(folder).glob("strip*.tif"))[:count]


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
    """Return each row's residuals ``(n, 2)`` px after intersecting its track with the true cameras, views and ground."""
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


def sift(paths: list[str], tiles: int) -> dict[str, Any]:
    """Find SIFT features on a sample of the tiles of every image; return seconds a tile and a pair of tiles."""
    import cv2

    cv2.setNumThreads(1)
    finder = cv2.SIFT_create(SIFT_FEATURES, contrastThreshold=0.01)
    seconds, megapixels, matching, last = 0.0, 0.0, [], None
    for path in paths:
        image = open_image(path)
        columns, rows = (length // SIFT_TILE for length in image.size)
        chosen = np.linspace(0, columns * rows - 1, tiles).round().astype(int)
        for number in chosen:
            left, top = SIFT_TILE * (number % columns), SIFT_TILE * (number // columns)
            began = time.process_time()
            side = SIFT_TILE + 2 * SIFT_BORDER
            grey, _ = image.raster.read(int(left) - SIFT_BORDER, int(top) - SIFT_BORDER, side, side)
            low, high = np.percentile(grey[::4, ::4], (1.0, 99.0))
            byte = np.clip((grey.astype(np.float32) - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8)
            _, descriptors = finder.detectAndCompute(byte, None)
            seconds += time.process_time() - began
            megapixels += SIFT_TILE**2 * 1e-6
            if last is not None and not matching:
                began = time.process_time()
                nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(descriptors[::MATCH_EVERY], last, k=2)
                matching.append(MATCH_EVERY * (time.process_time() - began))
                assert nearest
            last = descriptors
    return {"cpu_per_mpx": seconds / megapixels, "match_s": matching[0], "features": len(last), "tile_mpx": megapixels}


def print_block(folder: str, counts: list[int], threads: int, sift_tiles: int) -> None:
    """Print time and memory of growing blocks beside SIFT, and the errors of the largest."""
    truth = json.loads(Path(folder, "truth.json").read_text())
    cameras = {name: RPC(**entry["true_rpc"]["rpc"]) for name, entry in truth["images"].items()}
    cache = gdal.GetCacheMax() / 2**20
    theirs = in_own_process("sift", folder, str(min(counts)), str(sift_tiles))
    print(
        f"OpenCV SIFT on tiles of {SIFT_TILE} px ({theirs['tile_mpx']:.0f} Mpx sampled): "
        f"{theirs['cpu_per_mpx']:.3f} s of a processor per Mpx, {theirs['features']} features a tile, "
        f"{theirs['match_s']:.2f} s to match two tiles exactly, peak {theirs['peak_mib']:.0f} MiB in one process"
    )
    print(f"tie-points with {threads} threads; GDAL's cache may take {cache:.0f} MiB of the peak")
    print("images   Mpx  pairs  wall s   CPU s  CPU s/Mpx  of SIFT  peak MiB  points  measurements  on 3+  least cells")
    for count in counts:
        with tempfile.TemporaryDirectory() as output:
            ours = in_own_process("ties", folder, str(count), str(threads), output)
            sizes = [open_image(path).size for path in images_of(folder, count)]
            megapixels = sum(a * b for a, b in sizes) * 1e-6
            per = ours["cpu_s"] / megapixels
            several = sum(number for views, number in ours["views"].items() if int(views) > 2)
            print(
                f"{count:6d} {megapixels:5.0f} {ours['pairs']:6d} {ours['wall_s']:7.1f} {ours['cpu_s']:7.1f} "
                f"{per:10.4f} {per / theirs['cpu_per_mpx']:8.2f} {ours['peak_mib']:9.0f} {ours['points']:7d} "
                f"{ours['observations']:13d} {several:6d} {min(ours['cells']):6d}/64"
            )
            print_errors(read_points(output), cameras)


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
        ours = in_own_process("large", ",".join(cameras), str(threads), output)
        points = read_points(output)
    megapixels = len(cameras) * size**2 * 1e-6
    print(
        f"{len(cameras)} images of {size} x {size} px ({megapixels:.0f} Mpx), {threads} threads: {ours['pairs']} pairs, "
        f"{ours['wall_s']:.0f} s wall, {ours['cpu_s']:.1f} s CPU ({ours['cpu_s'] / megapixels:.4f} s/Mpx), peak "
        f"{ours['peak_mib']:.0f} MiB (GDAL's cache {gdal.GetCacheMax() / 2**20:.0f}), {ours['points']} points, least "
        f"{min(ours['cells'])} of 64 parts",
        flush=True,
    )
    print_errors(points, {Path(path).stem: rpc for path, rpc in cameras.items()}, make_heights())


def one(arguments: list[str]) -> dict[str, Any]:
    """Do one measurement in this process."""
    what, *rest = arguments
    if what == "sift":
        return measured(lambda: sift(images_of(rest[0], int(rest[1])), int(rest[2])))
    if what == "ties":
        return measured(lambda: tie_points(images_of(rest[0], int(rest[1])), int(rest[2]), rest[3]))
    return measured(lambda: tie_points(rest[0].split(","), int(rest[1]), rest[2]))


def main() -> None:
    """Read the arguments and print what they ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--block", metavar="FOLDER")
    parser.add_argument("--counts", nargs="+", type=int, default=[3, 6, 12])
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--sift-tiles", type=int, default=6, help="sampled tiles of each image")
    parser.add_argument("--large", metavar="FOLDER")
    parser.add_argument("--sizes", nargs="+", type=int, default=[5000, 10000, 20000, 40000])
    parser.add_argument("--twenty", metavar="FOLDER", help="twenty images of 12 000 x 12 000 px")
    parser.add_argument("--one", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(given.one)))
    if given.block:
        print_block(given.block, given.counts, given.threads, given.sift_tiles)
    for size in given.sizes if given.large else ():
        print_large(given.large, size, given.threads)
    if given.twenty:
        print_large(given.twenty, 12000, given.threads, (-2 * TILT, -TILT, 0.0, TILT, 2 * TILT), places=2)


if __name__ == "__main__":
    main()

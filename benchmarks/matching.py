"""Matching by control networks: simulated pairs against truth, real ones against RPC geometry, cost of the search.

    python benchmarks/matching.py [--large] [--only simulated|real|search] [--pairs NAME] [--data ../shared/data/real]

Prints the tables of docs/matching.md, section "Control network". Seconds are of the processor; --large adds windows of
2000 x 2000 px.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.control_network import ControlNetworkMatch, match_windows
from hrsi.hrsi_engine.laboratory.control_network.leaves import Tolerance
from hrsi.hrsi_engine.laboratory.control_network.super_points import match_super_points
from hrsi.tests.conftest import TEST_DATA
from hrsi.tests.network_scenes import (
    FALSE_PX,
    POINTS_PX,
    TEXTURES,
    across_epipolar,
    by_trying_everything,
    point_sets,
    true_pair,
    turned,
)

TURNS = (0.0, 45.0, 315.0)
REAL_TURNS = (45.0, 315.0)
S2P, QUAKE, VENTOUX = "s2p_triplet_phr", "kahramanmaras_phr4", "ventoux_phr_pair"


class RealPair(NamedTuple):
    """Two files, the height of the ground, and inliers and NMAD of the SIFT baseline of the data's README."""

    name: str
    folder: str
    files: tuple[str, str]
    height_m: float
    baseline: tuple[int, float]


PAIRS = (
    RealPair("s2p 01-02", S2P, ("img_01.tif", "img_02.tif"), 206.0, (9580, 0.143)),
    RealPair("s2p 01-03", S2P, ("img_01.tif", "img_03.tif"), 206.0, (6808, 0.161)),
    RealPair("s2p 02-03", S2P, ("img_02.tif", "img_03.tif"), 206.0, (9526, 0.151)),
    RealPair("Kahramanmaras before", QUAKE, ("pre_event_img1.tif", "pre_event_img2.tif"), 704.0, (2447, 0.200)),
    RealPair("Kahramanmaras after", QUAKE, ("post_event_img1.tif", "post_event_img2.tif"), 704.0, (2588, 0.206)),
    RealPair("Ventoux", VENTOUX, ("left_image.tif", "right_image.tif"), 537.0, (534, 0.193)),
    RealPair("two dates, 4°", QUAKE, ("pre_event_img1.tif", "post_event_img1.tif"), 704.0, (337, 0.225)),
    RealPair("two dates, 3°", QUAKE, ("pre_event_img2.tif", "post_event_img2.tif"), 704.0, (295, 0.211)),
    RealPair("two dates, 13°", QUAKE, ("pre_event_img2.tif", "post_event_img1.tif"), 704.0, (85, 0.258)),
    RealPair("two dates, 20°", QUAKE, ("pre_event_img1.tif", "post_event_img2.tif"), 704.0, (68, 0.239)),
)


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--only", choices=("simulated", "real", "search"))
    parser.add_argument("--pairs", default="", help="only real pairs whose name begins so")
    parser.add_argument("--data", type=Path, default=TEST_DATA / "real")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    pair = true_pair("grass", 128)
    match_windows(pair.first, pair.second)  # compiles
    if given.only in (None, "simulated"):
        print_simulated(given.large)
    if given.only in (None, "real") and given.data.is_dir():
        print_real(given.data, given.pairs)
    if given.only in (None, "search"):
        print_search()


def timed(work: Callable) -> tuple:
    """Return a result and the processor's seconds."""
    start = time.process_time()
    return work(), time.process_time() - start


def print_simulated(large: bool) -> None:
    """Print correspondences and errors against truth."""
    print(
        "\n| texture | window | rotated | interest points | correspondences | median error | largest | false "
        "| seconds |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    cases = [(texture, 400, turn) for texture in TEXTURES for turn in TURNS]
    cases += [(texture, 2000, 45.0) for texture in TEXTURES if large]
    for texture, side, turn in cases:
        pair = true_pair(texture, side, turn)
        found, seconds = timed(partial(match_windows, pair.first, pair.second))
        error = np.hypot(*(found.positions.second - pair.carried(found.positions.first)).T)
        print(
            f"| {texture} | {side} x {side} | {turn:.0f}° | {found.points[0]}, {found.points[1]} | {len(found)} "
            f"| {np.median(error):.3f} px | {error.max():.2f} px | {np.sum(error > FALSE_PX)} | {seconds:.1f} |",
            flush=True,
        )


def print_real(data: Path, chosen: str) -> None:
    """Print correspondences of whole images and of 400 x 400 windows, and distances across the epipolar lines."""
    print(
        "\n| pair | rotated | correspondences | NMAD | beyond 1.5 px | seconds | SIFT inliers, NMAD "
        "| 400 x 400: correspondences | beyond | seconds |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for pair in PAIRS:
        for turn in REAL_TURNS if pair.name.startswith(chosen) else ():
            whole, part = (judged(data, pair, turn, window) for window in windows(data, pair))
            count, nmad, far, seconds = whole
            inliers, baseline = pair.baseline
            print(
                f"| {pair.name} | {turn:.0f}° | {count} | {nmad} | {far} | {seconds} | {inliers}, {baseline:.3f} px "
                f"| {part[0]} | {part[2]} | {part[3]} |",
                flush=True,
            )


def windows(data: Path, pair: RealPair) -> Iterator[tuple[tuple[int, int, int, int], ...]]:
    """Yield the whole images, then 400 x 400 px in the middle of the first and what the RPC predicts in the second."""
    images = [open_image(str(data / pair.folder / name)) for name in pair.files]
    yield tuple((0, 0, *image.raster.size) for image in images)
    grid = np.stack(np.meshgrid(*(np.arange(200, size - 200, 25) for size in images[0].raster.size)), -1).reshape(-1, 2)
    there = images[1].rpc.project(images[0].rpc.localize(grid.astype(float), pair.height_m).ground)
    room = np.minimum(there, np.array(images[1].raster.size) - 1.0 - there).min(axis=1)
    middle = np.abs(grid - grid.mean(axis=0)).max(axis=1)
    best = np.lexsort((middle, -np.minimum(room, 200.0)))[0]
    yield tuple(
        (*np.clip(np.rint(xy) - 200, 0, np.array(image.raster.size) - 400).astype(int), 400, 400)
        for xy, image in zip((grid[best], there[best]), images, strict=True)
    )


def judged(data: Path, pair: RealPair, turn: float, areas: tuple) -> tuple[str, ...]:
    """Return number, NMAD across the epipolar lines, share beyond `FALSE_PX`, and seconds, as text."""
    images = [open_image(str(data / pair.folder / name)) for name in pair.files]
    cut = [ArrayRaster(*image.raster.read(*(int(v) for v in area))) for image, area in zip(images, areas, strict=True)]
    other = turned(cut[1], turn)
    found, seconds = timed(partial(match_windows, cut[0], other.window))
    if not len(found):
        return found.status, "-", "-", f"{seconds:.1f}"
    first, second = in_images(found, areas, other.back)
    across = np.abs(across_epipolar(images[0].rpc, images[1].rpc, first, second, pair.height_m))
    far = int(np.sum(across > FALSE_PX))
    return str(len(found)), f"{1.4826 * np.median(across):.3f} px", f"{far} ({far / len(found):.2%})", f"{seconds:.1f}"


def in_images(found: ControlNetworkMatch, areas: tuple, back: Callable[[np.ndarray], np.ndarray]) -> tuple:
    """Return the positions in the original images."""
    return found.positions.first + areas[0][:2], back(found.positions.second) + areas[1][:2]


def print_search() -> None:
    """Print how the search for the best roots grows with the number of super points, 60 % of which repeat."""
    print("\n| super points | hypotheses | roots evaluated | seconds | trying everything, seconds |")
    print("|---|---|---|---|---|")
    for count in (12, 24, 36, 50, 100, 200, 400):
        common = round(0.6 * count)
        first, second, _ = point_sets(7, common, count - common)
        stretch = 40.0 * np.sqrt(count) / POINTS_PX  # one point in 40 x 40 px
        first, second = stretch * first, stretch * second
        sets = first, second, Tolerance(2.0, 0.02), 200.0, (1.0,)
        found, seconds = timed(partial(match_super_points, *sets))
        everything = f"{timed(partial(by_trying_everything, *sets))[1]:.2f}" if count <= 36 else "-"
        hypotheses = (count * (count - 1) * (count - 2)) ** 2  # as the thesis counts them
        print(
            f"| {count} | {hypotheses:.1e} | {found.evaluated_pairs} of {count**2} | {seconds:.2f} | {everything} |",
            flush=True,
        )


if __name__ == "__main__":
    main()

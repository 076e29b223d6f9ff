"""Accuracy of tie points on real images, beside OpenCV's SIFT measured in the same run: `tie_points_accuracy.py`.

Arguments name tables (pairs, bands, triangulate); without any, all are printed as markdown. The data lie in
HRSI_TEST_DATA (see CONTRIBUTING.md).
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from real_blocks import DATA, describe_sift, match_sift, sift_tracks, tie_rmse

from hrsi.hrsi_engine import AdjustOptions, adjust, open_image
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Image, ImagePoints
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import compute_epipolar_deviation, transfer
from hrsi.hrsi_engine.measurement.tile_matching.features import detect_tile_points
from hrsi.hrsi_engine.measurement.tile_matching.pair_matching import (
    ImageTile,
    TileMatchOptions,
    TilePairGeometry,
    match_tile,
)
from hrsi.hrsi_engine.measurement.window_matching.least_squares_matching import match_patches
from hrsi.hrsi_engine.measurement.window_matching.windows import DONE, MATCHING_BANDS, LsmOptions
from hrsi.processing_algorithms import run

CELLS = 8
RELIEF_M, MARGIN_PX = 40.0, 20.0
EDGE_PX = 25.0  # of the overlap: half a window and some


class Sample(NamedTuple):
    """Images of a folder of real data, and the height (m) of the ground."""

    folder: str
    files: tuple[str, ...]
    height_m: float


SAMPLES = {
    "triplet": Sample("s2p_triplet_phr", tuple(f"img_0{k}.tif" for k in (1, 2, 3)), 206.0),
    "Kahramanmaras": Sample(
        "kahramanmaras_phr4",
        tuple(f"{date}_event_img{k}.tif" for date in ("pre", "post") for k in (1, 2)), 704.0,
    ),
    "Ventoux": Sample("ventoux_phr_pair", ("left_image.tif", "right_image.tif"), 537.0),
}  # fmt: skip


def paths(sample: Sample) -> list[str]:
    return [str(DATA / "real" / sample.folder / file) for file in sample.files]


def whole(image: Image) -> ImageTile:
    """Return all of an image as one tile."""
    assert image.raster is not None and image.size is not None
    grey, valid = image.raster.read(0, 0, *image.size)
    return ImageTile(grey.astype(np.float32), valid)


# ---- pairs ---------------------------------------------------------------------------------------------------------


def sift_matches(images: Sequence[Image]) -> tuple[np.ndarray, np.ndarray]:
    """Return matches of OpenCV's SIFT with 20 000 keypoints an image; no RPC is used."""
    first, second = (describe_sift(image, 20_000) for image in images)
    i, j = match_sift(first, second).T
    return first[0][i], second[0][j]


def across(images: Sequence[Image], xy1: np.ndarray, xy2: np.ndarray, height_m: float) -> tuple[float, float]:
    """Return median and NMAD of the epipolar distance by the original RPCs, by the norm of its four coefficients."""
    first, second = images[0].rpc, images[1].rpc
    miss = compute_epipolar_deviation(first, second, xy1, xy2, height_m)
    line = transfer(first, second, xy1, height_m + 50.0) - transfer(first, second, xy1, height_m - 50.0)
    normal = np.column_stack([-line[:, 1], line[:, 0]]) / np.linalg.norm(line, axis=1)[:, None]
    here = transfer(first, second, xy1, height_m)
    slope = [np.sum((transfer(first, second, xy1 + step, height_m) - here) * normal, axis=1) for step in np.eye(2)]
    distance = miss.across_px / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    middle = float(np.median(distance))
    return middle, float(1.4826 * np.median(np.abs(distance - middle)))


def coverage(images: Sequence[Image], tile: ImageTile, xy1: np.ndarray, height_m: float) -> tuple[int, int]:
    """Return how many of the 8 x 8 cells of the first image that overlap and have texture have matches, and those."""
    size = np.array(images[0].size)
    points = detect_tile_points(tile, TileMatchOptions()).astype(float)
    seen = transfer(images[0].rpc, images[1].rpc, points, height_m)
    inside = np.all((seen >= EDGE_PX) & (seen < np.array(images[1].size) - EDGE_PX), axis=1)
    textured = np.bincount(_cell(points[inside], size), minlength=CELLS**2) >= 5
    matched = np.bincount(_cell(xy1, size), minlength=CELLS**2) > 0
    return int((textured & matched).sum()), int(textured.sum())


def _cell(xy: np.ndarray, size: np.ndarray) -> np.ndarray:
    return np.floor(np.clip(xy / size, 0.0, 0.999) * CELLS).astype(np.int64) @ [1, CELLS]


def print_pairs() -> None:
    """Print both matchers on each pair."""
    print(
        "\nEvery pair as one window: SIFT, ratio 0.75, mutual, MAGSAC | ours. NMAD across the epipolar lines in px.\n"
    )
    print("| pair | SIFT inliers | NMAD | ours | NMAD | of SIFT's | bias | sigma (median) | cells | CPU s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, sample in SAMPLES.items():
        images = [open_image(path) for path in paths(sample)]
        tiles = [whole(image) for image in images]
        for a, b in combinations(range(len(images)), 2):
            pair, height = (images[a], images[b]), sample.height_m
            theirs = sift_matches(pair)
            _, their_nmad = across(pair, *theirs, height)
            geometry = TilePairGeometry(
                pair[0].rpc, pair[1].rpc, height - RELIEF_M, height + RELIEF_M, margin_px=(MARGIN_PX, MARGIN_PX)
            )
            start = time.process_time()
            ours = match_tile(tiles[a], tiles[b], geometry)
            seconds = time.process_time() - start
            bias, nmad = across(pair, ours.first_xy, ours.second_xy, height)
            have, want = coverage(pair, tiles[a], ours.first_xy, height)
            print(
                f"| {name} {a + 1}-{b + 1} | {len(theirs[0])} | {their_nmad:.3f} | {len(ours)} | {nmad:.3f} | "
                f"{nmad / their_nmad:.2f} | {bias:+.3f} | {np.median(ours.sigma_px):.3f} | {have}/{want} | "
                f"{seconds:.1f} |",
                flush=True,
            )


# ---- bands ---------------------------------------------------------------------------------------------------------


def shifted_texture(size: int, shift: tuple[float, float]) -> np.ndarray:
    """Return a periodic texture of unit contrast, displaced exactly by ``shift`` px in the frequency domain."""
    fx, fy = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size))
    radius = np.hypot(fx, fy)
    white = np.fft.fft2(np.random.default_rng(1).normal(size=(size, size)))
    spectrum = white / (0.02 + radius) * np.exp(-0.5 * (radius / 0.2) ** 2)
    field = np.real(np.fft.ifft2(spectrum * np.exp(-2j * np.pi * (fx * shift[0] + fy * shift[1]))))
    return field / np.sqrt(np.mean(np.abs(spectrum) ** 2)) * size


def print_bands() -> None:
    """Print bias, scatter, honesty and speed of least-squares matching on windows with known displacement."""
    print("\nLeast-squares matching of simulated windows: contrast 100, white noise in both; 1500 windows.\n")
    print("| band | window | noise | shift | bias x, y (px) | RMS (px) | RMS / sigma | windows / CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    size, rng = 640, np.random.default_rng(2)
    centres = rng.integers(50, size - 50, (1500, 2))
    valid, shape = np.ones((size, size), bool), np.tile(np.eye(2), (len(centres), 1, 1))
    for (band, filters), window, noise, shift in _cases():
        grey = [600.0 + 100.0 * shifted_texture(size, s) + rng.normal(0, noise, valid.shape) for s in ((0, 0), shift)]
        images = [filters.filter_image(layer, valid) for layer in grey]
        match_patches(images[0], images[1], centres[:2], centres[:2] + 0.4, shape[:2], LsmOptions(window))
        start = time.process_time()
        found = match_patches(images[0], images[1], centres, centres + 0.4, shape, LsmOptions(window))
        speed = len(centres) / (time.process_time() - start)
        good = found.status == DONE
        error = (found.xy - centres - shift)[good]
        bias, rms = np.median(error, axis=0), float(np.std(error))
        honest = rms / float(np.sqrt(np.mean(found.sigma_px[good] ** 2))) / filters.sigma_factor
        print(
            f"| {band} | {window} | {noise:g} | {shift[0]}, {shift[1]} | {bias[0]:+.4f}, {bias[1]:+.4f} | {rms:.4f} | "
            f"{honest:.2f} | {speed:.0f} |"
        )


def _cases() -> Iterator[tuple]:
    for band in MATCHING_BANDS.items():
        for window in (21, 31):
            for noise in (3.0, 15.0):
                yield band, window, noise, (0.25, 0.5)


# ---- triangulate ---------------------------------------------------------------------------------------------------


def print_triangulate() -> None:
    """Print the residuals of the tie points that `triangulate` finds, and of SIFT's tracks by its RPCs."""
    print("\n`triangulate` without any option: residuals per observation (px), by number of images.\n")
    print("| block | seconds | tie points | RMSE | by rays: points, RMSE | SIFT tracks by the refined RPCs |")
    print("|---|---|---|---|---|---|")
    for name, sample in SAMPLES.items():
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            report = run("triangulate", images=paths(sample), output_dir=folder, overwrite=True)
            seconds = time.perf_counter() - start
            refined = [open_image(report["images"][open_image(path).id]["output"]).rpc for path in paths(sample)]
        ties = report["ties"]
        rays = "; ".join(f"{n}: {part['points']}, {part['rmse_px']:.3f}" for n, part in ties["by_rays"].items())
        check = sift_rmse([open_image(path) for path in paths(sample)], refined)
        print(f"| {name} | {seconds:.1f} | {ties['points']} | {ties['rmse_px']:.3f} | {rays} | {check} |", flush=True)


def sift_rmse(images: Sequence[Image], refined: Sequence[RPC]) -> str:
    """Return the RMSE of SIFT tracks by refined RPCs that are held, of all tracks and of those on all images.

    In brackets what an adjustment (shift) of the SIFT tracks themselves leaves: no RPCs can be much better. All images
    have the same weight: with sigmas estimated for each, most of a residual falls to the images of larger sigma.
    """
    tracks = sift_tracks(images)
    held = [replace(image, rpc=rpc) for image, rpc in zip(images, refined, strict=True)]
    ours = _tie_rmse(held, tracks, AdjustOptions(fixed_images=tuple(image.id for image in images)))
    own = _tie_rmse(images, tracks, AdjustOptions(model="shift"))
    return f"all {ours[0]:.3f} ({own[0]:.3f}), on {len(images)} images {ours[1]:.3f} ({own[1]:.3f})"


def _tie_rmse(images: Sequence[Image], tracks: list[ImagePoints], options: AdjustOptions) -> tuple[float, float]:
    result = adjust(assemble(images, [], tracks), replace(options, reject_sigma=0.0, test_sigmas=False))
    return tie_rmse(result), tie_rmse(result, len(images))


TABLES: dict[str, Callable[[], None]] = {
    "bands": print_bands,
    "pairs": print_pairs,
    "triangulate": print_triangulate,
}


def main(names: Sequence[str] = ()) -> None:
    """Print the named tables, or all."""
    for name in names or TABLES:
        TABLES[name]()


if __name__ == "__main__":
    main(sys.argv[1:])

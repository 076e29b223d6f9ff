"""`match` at scales and rotations that it is not told: all real pairs, with OpenCV's SIFT in the same run.

    python benchmarks/matching_unknown.py [--pairs NAME] [--seed 41] [--scales 0.6,0.8,1,1.25,1.7] [--docs]

The second image of each real pair is resampled by a known map: a scale, and a rotation drawn at random. Points found
are carried back by that map and judged by what knows nothing of either matcher's work on the resampled pair: the RPCs'
epipolar lines, whose constant bias SIFT tells on the pair as it is; the limit is in pixels of the coarser image, in
which least squares measures. SIFT as it is commonly used stands beside it: ratio
test 0.8, RANSAC of a fundamental matrix with 2 px. It has found a pair where at least `LEAST_FOUND` matches are left of
which nine in ten lie within `FAR_PX` of the line. --docs enters the rows into docs/matching.md, in the place of those
of the same pair and scale.
"""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from hrsi.benchmarks.pages import DOCS, make_parser, put_between
from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.control_network import match_windows
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import compute_epipolar_deviation
from hrsi.tests.conftest import TEST_DATA

PAGE = DOCS / "matching.md"
S2P, QUAKE, VENTOUX = "s2p_triplet_phr", "kahramanmaras_phr4", "ventoux_phr_pair"


class RealPair(NamedTuple):
    """Two files, and the height of the ground."""

    name: str
    folder: str
    files: tuple[str, str]
    height_m: float


PAIRS = (
    RealPair("s2p 01-02", S2P, ("img_01.tif", "img_02.tif"), 206.0),
    RealPair("s2p 01-03", S2P, ("img_01.tif", "img_03.tif"), 206.0),
    RealPair("s2p 02-03", S2P, ("img_02.tif", "img_03.tif"), 206.0),
    RealPair("Kahramanmaras before", QUAKE, ("pre_event_img1.tif", "pre_event_img2.tif"), 704.0),
    RealPair("Kahramanmaras after", QUAKE, ("post_event_img1.tif", "post_event_img2.tif"), 704.0),
    RealPair("Ventoux", VENTOUX, ("left_image.tif", "right_image.tif"), 537.0),
    RealPair("two dates, 4°", QUAKE, ("pre_event_img1.tif", "post_event_img1.tif"), 704.0),
    RealPair("two dates, 3°", QUAKE, ("pre_event_img2.tif", "post_event_img2.tif"), 704.0),
    RealPair("two dates, 13°", QUAKE, ("pre_event_img2.tif", "post_event_img1.tif"), 704.0),
    RealPair("two dates, 20°", QUAKE, ("pre_event_img1.tif", "post_event_img2.tif"), 704.0),
)
FAR_PX, LEAST_FOUND, FOUND_SHARE = 2.0, 15, 0.9
SIFT_RATIO, RANSAC_PX = 0.8, 2.0
STRETCH_PERCENT = (1.0, 99.0)


class Seen(NamedTuple):
    """Resampled pixels of an image, and the map from the original's pixels to them."""

    raster: ArrayRaster
    matrix: np.ndarray
    shift: np.ndarray

    def back(self, xy: np.ndarray) -> np.ndarray:
        """Return where points ``(n, 2)`` are in the image as it was."""
        return (xy - self.shift) @ np.linalg.inv(self.matrix).T


def timed(work: Callable) -> tuple:
    """Return a result and the processor's seconds."""
    start = time.process_time()
    return work(), time.process_time() - start


def main() -> None:
    """Print one row a pair and scale."""
    parser = make_parser(__doc__.splitlines()[0], PAGE)
    parser.add_argument("--pairs", default="", help="only pairs whose name begins so")
    parser.add_argument("--seed", type=int, default=41, help="of the rotations")
    parser.add_argument("--scales", default="0.6,0.8,1,1.25,1.7")
    parser.add_argument("--data", type=Path, default=TEST_DATA / "real")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(given.seed)
    rows = [
        "| pair | scale | rotated | `match` | beyond 2 px | CPU s | SIFT | beyond 2 px | CPU s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    print("\n".join(rows), flush=True)
    for pair in PAIRS:
        images = [open_image(str(given.data / pair.folder / name)) for name in pair.files]
        bias = None
        for scale in map(float, given.scales.split(",")):
            turn = float(rng.uniform(0.0, 360.0))
            if not pair.name.startswith(given.pairs):
                continue
            bias = _bias(images, pair) if bias is None else bias
            rows.append(_row(images, pair, scale, turn, bias))
            print(rows[-1], flush=True)
    print(summary(rows[2:]))
    if given.docs:
        enter(rows)


def summary(rows: list[str]) -> str:
    """Return in words what rows of the table say together."""
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    ours, sift = ([of_case[column].isdigit() for of_case in cells] for column in (3, 6))
    both = sum(a and b for a, b in zip(ours, sift, strict=True))
    far = sum(int(of_case[4]) for of_case in cells if of_case[4].isdigit())
    return (
        f"`match` finds {sum(ours)} of {len(rows)}, SIFT {sum(sift)}; {both} of SIFT's are found by `match`. "
        f"Correspondences of `match` beyond {FAR_PX:g} px: {far}"
    )


def enter(rows: list[str]) -> None:
    """Write a table's rows into the page, which keeps those of other pairs and scales."""
    text = PAGE.read_text(encoding="utf-8").partition("made by benchmarks/matching_unknown.py -->")[2]
    kept = [line for line in text.partition("<!--")[0].splitlines() if line.startswith("|")][2:]
    every = {tuple(row.split("|")[1:3]): row for row in [*kept, *rows[2:]]}
    place = {pair.name: number for number, pair in enumerate(PAIRS)}
    order = sorted(every, key=lambda case: (place[case[0].strip()], float(case[1])))
    table = [every[case] for case in order]
    put_between(PAGE, "unknown scale and rotation", "\n".join([*rows[:2], *table, "", summary(table)]))


def _row(images: list[Image], pair: RealPair, scale: float, turn: float, bias: float) -> str:
    """Return the row of a case."""
    first = ArrayRaster(*images[0].raster.read(0, 0, *images[0].raster.size))
    second = resampled(ArrayRaster(*images[1].raster.read(0, 0, *images[1].raster.size)), scale, turn)
    found, seconds = timed(partial(match_windows, first, second.raster))
    (sift_xy, sift_other), sift_seconds = timed(partial(sift_matches, first, second.raster))

    def far(xy: np.ndarray, other: np.ndarray) -> int:
        miss = compute_epipolar_deviation(images[0].rpc, images[1].rpc, xy, second.back(other), pair.height_m)
        return int(np.sum(~(np.abs(miss.across_px - bias) <= FAR_PX * max(1.0, 1.0 / scale))))

    beyond = far(found.positions.first, found.positions.second) if len(found) else 0
    sift_beyond = far(sift_xy, sift_other) if len(sift_xy) else 0
    sift_found = len(sift_xy) >= LEAST_FOUND and sift_beyond <= (1.0 - FOUND_SHARE) * len(sift_xy)
    ours = str(len(found)) if len(found) else found.status
    return (
        f"| {pair.name} | {scale:g} | {turn:.0f}° | {ours} | {beyond if len(found) else '-'} | {seconds:.1f} "
        f"| {len(sift_xy) if sift_found else 'not found'} | {sift_beyond if sift_found else '-'} | {sift_seconds:.1f} |"
    )


def _bias(images: list[Image], pair: RealPair) -> float:
    """Return the RPCs' constant bias across the epipolar lines, from SIFT on the pair as it is."""
    rasters = [ArrayRaster(*image.raster.read(0, 0, *image.raster.size)) for image in images]
    xy, other = sift_matches(*rasters)
    return float(
        np.median(compute_epipolar_deviation(images[0].rpc, images[1].rpc, xy, other, pair.height_m).across_px)
    )


def resampled(image: ArrayRaster, scale: float, degrees: float) -> Seen:
    """Return an image turned from sample towards line and scaled, in a frame that holds all of it."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = scale * np.array([[cos, -sin], [sin, cos]])
    samples, lines = image.size
    corners = np.array([[0, 0], [samples - 1, 0], [0, lines - 1], [samples - 1, lines - 1]]) @ matrix.T
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    frame = tuple(int(length) for length in high - low + 1)
    affine = np.column_stack([matrix, -low])
    grey = image.grey.astype(np.float32)
    if scale < 1.0:  # the blur of a pixel to that of a larger one
        grey = cv2.GaussianBlur(grey, (0, 0), 0.5 * np.sqrt(scale**-2 - 1.0))
    grey = cv2.warpAffine(grey, affine, frame, flags=cv2.INTER_CUBIC)
    valid = cv2.warpAffine(image.valid.astype(np.uint8), affine, frame, flags=cv2.INTER_NEAREST)
    valid = cv2.erode(valid, np.ones((9, 9), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(bool)
    grey = np.where(valid, np.clip(np.rint(grey), 1, 65535), 0).astype(np.uint16)
    return Seen(ArrayRaster(grey, valid), matrix, -low)


def sift_matches(first: ArrayRaster, second: ArrayRaster) -> tuple[np.ndarray, np.ndarray]:
    """Return what SIFT with ratio test and RANSAC matches, positions ``(n, 2)`` in both."""
    described = []
    for raster in (first, second):
        low, high = np.percentile(raster.grey[raster.valid], STRETCH_PERCENT)
        byte = np.clip((raster.grey.astype(np.float32) - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8)
        mask = cv2.erode(raster.valid.astype(np.uint8), np.ones((9, 9), np.uint8))
        points, descriptors = cv2.SIFT_create(10000).detectAndCompute(byte, mask)
        described.append((np.array([point.pt for point in points]), descriptors))
    (xy1, d1), (xy2, d2) = described
    near = cv2.BFMatcher().knnMatch(d1, d2, k=2)
    chosen = np.array([(a.queryIdx, a.trainIdx) for a, b in near if a.distance < SIFT_RATIO * b.distance], dtype=int)
    if len(chosen) < LEAST_FOUND:
        return np.empty((0, 2)), np.empty((0, 2))
    xy1, xy2 = xy1[chosen[:, 0]], xy2[chosen[:, 1]]
    cv2.setRNGSeed(1)
    _, inliers = cv2.findFundamentalMat(xy1, xy2, cv2.FM_RANSAC, RANSAC_PX, 0.999, 20000)
    keep = inliers.ravel().astype(bool) if inliers is not None else np.zeros(len(xy1), bool)
    return xy1[keep], xy2[keep]


if __name__ == "__main__":
    main()

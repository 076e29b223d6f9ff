"""Gravity centres on real pairs: how many there are, and how many of them the other view has too.

    python benchmarks/interest_points_real.py [--pairs NAME | --docs]

Each image gets its centres by itself, with the default quality. A centre is found again where the other image has one
within 1 px of its epipolar line, at a parallax like those around: between the least and the largest of the 12 nearest
SIFT matches of the pair, and 1.5 px beyond. The RPCs' bias across the lines is that of those matches. Asked are centres
whose place in the other image, with the object around them, lies inside it; both directions count. By chance some
would be found anywhere: the same count with the other image's centres moved by (23, 19) px. Blobs were tuned and their
chance fitted on the first pair of Kahramanmaras and on s2p 01-03 (*); the other pairs judge.

Then how reliable the quality is: the share found again of centres of each quality, on the pairs that judge. --docs
writes the tables into docs/protocols/interest_points_accuracy.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from hrsi.benchmarks.matching import PAIRS, RealPair, timed
from hrsi.benchmarks.pages import DOCS, make_parser, put_between
from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.interest_points import DetectionOptions, InterestPoints, detect_interest_points
from hrsi.hrsi_engine.measurement.interest_points import STRONG_QUALITY, CentreOptions
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import (
    check_rpc_consistency,
    compute_epipolar_deviation,
    match_descriptors,
    transfer,
)
from hrsi.hrsi_engine.measurement.tile_matching.features import FEATURES, compute_root_sift, stretch_to_byte
from hrsi.tests.conftest import TEST_DATA

PAGE = DOCS / "protocols/interest_points_accuracy.md"
ONE_DATE = ("s2p", "Kahramanmaras", "Ventoux")
FITTED = ("s2p 01-03", "Kahramanmaras before")
ACROSS_PX, PARALLAX_ROOM_PX, NEIGHBOURS = 1.0, 1.5, 12
MOST_FEATURES, RATIO = 12000, 0.85
ELSEWHERE_PX = (23.0, 19.0)
BORDER_PX = 6.0
LOWEST = 0.3  # quality of the centres whose reliability is asked
QUALITIES = (0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 1.0)


@dataclass(frozen=True, eq=False)
class Truth:
    """What SIFT tells of one direction of a pair: positions, heights by the RPCs, and the bias across the lines."""

    first: Image
    second: Image
    xy: np.ndarray
    height_m: np.ndarray
    bias_px: float
    stretch: float

    def found_again(self, points: InterestPoints, others: np.ndarray) -> np.ndarray:
        """Return the row of ``others (m, 2)`` that each point is found at, -1 for none, -2 where it is not asked."""
        _, near = cKDTree(self.xy).query(points.xy, k=NEIGHBOURS)
        around = self.height_m[near]
        middle, low, high = np.median(around, axis=1), around.min(axis=1), around.max(axis=1)
        there = transfer(self.first.rpc, self.second.rpc, points.xy, middle)
        margin = np.sqrt(np.prod(points.size_px, axis=1))[:, None] / 2.0 + BORDER_PX
        inside = np.all((there > margin) & (there < np.array(self.second.known_size) - 1.0 - margin), axis=1)
        result, best = np.where(inside, -1, -2), np.full(len(there), np.inf)
        reach = (high - low) * self.stretch + PARALLAX_ROOM_PX + abs(self.bias_px) + 2.0
        candidates = cKDTree(others).query_ball_point(there, reach)
        row = np.repeat(np.arange(len(there)), [len(rows) for rows in candidates])
        other = np.array([k for rows in candidates for k in rows], dtype=np.int64)
        if not len(row):
            return result
        miss = compute_epipolar_deviation(self.first.rpc, self.second.rpc, points.xy[row], others[other], middle[row])
        away = np.abs(miss.across_px - self.bias_px)
        room = PARALLAX_ROOM_PX / miss.stretch
        fits = (away <= ACROSS_PX) & (miss.height_m >= low[row] - room) & (miss.height_m <= high[row] + room)
        for k in np.flatnonzero(fits & inside[row]):
            if away[k] < best[row[k]]:
                best[row[k]], result[row[k]] = away[k], other[k]
        return result

    def across_px(self, points: InterestPoints, others: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Return the distances across the epipolar lines of what is found again."""
        rows = np.flatnonzero(found >= 0)
        xy, there = points.xy[rows], others[found[rows]]
        return compute_epipolar_deviation(self.first.rpc, self.second.rpc, xy, there, 0.0).across_px - self.bias_px


def main() -> None:
    """Print both tables."""
    parser = make_parser(__doc__.splitlines()[0], PAGE)
    parser.add_argument("--pairs", default="", help="only pairs whose name begins so")
    parser.add_argument("--data", type=Path, default=TEST_DATA / "real")
    given = parser.parse_args()
    if given.docs and given.pairs:
        parser.error("--docs writes all tables: leave --pairs out")
    cv2.setNumThreads(1)
    rows = [
        "| pair | centres per Mpx | found again, both ways | by chance | shapes alone | across the lines | CPU s/Mpx |",
        "|---|---|---|---|---|---|---|",
    ]
    print("\n".join(rows), flush=True)
    told: list[tuple[np.ndarray, np.ndarray]] = []
    for pair in PAIRS:
        if not pair.name.startswith(ONE_DATE) or not pair.name.startswith(given.pairs):
            continue
        row, quality, found = judge(given.data, pair)
        rows.append(row)
        print(row, flush=True)
        if pair.name not in FITTED:
            told.append((quality, found))
    reliability = []
    if told and not given.pairs:  # it is of all pairs
        quality, found = (np.concatenate(part) for part in zip(*told, strict=True))
        reliability = ["", "| quality | centres | mean quality | found again |", "|---|---|---|---|"]
        for low, high in pairwise(QUALITIES):
            here = (quality >= low) & (quality < high)
            if here.sum() >= 20:
                reliability.append(
                    f"| {low:g} to {high:g} | {here.sum()} | {quality[here].mean():.2f} | {found[here].mean():.2f} |"
                )
        print("\n".join(reliability))
    if given.docs:
        put_between(PAGE, "real pairs", "\n".join([*rows, *reliability]))


def judge(data: Path, pair: RealPair) -> tuple[str, np.ndarray, np.ndarray]:
    """Return a pair's row, and quality and whether it is found again of each centre of both images."""
    images = [open_image(str(data / pair.folder / name)) for name in pair.files]
    rasters = [ArrayRaster(*image.raster.read(0, 0, *image.raster.size)) for image in images]
    area = 1e-6 * sum(float(np.prod(raster.size)) for raster in rasters)
    options = DetectionOptions(centres=CentreOptions(quality=LOWEST), threads=1)
    every, seconds = timed(lambda: [detect_interest_points(raster, "centres", options) for raster in rasters])
    strong = [points.select(points.quality >= STRONG_QUALITY) for points in every]
    ways = truths(images, rasters, pair.height_m)
    shares, chances, shapes, across, quality, again = [], [], [], [], [], []
    for k, truth in enumerate(ways):
        found = truth.found_again(strong[k], strong[1 - k].xy)
        asked = found > -2
        shares.append(np.mean(found[asked] >= 0))
        by_chance = truth.found_again(strong[k], strong[1 - k].xy + ELSEWHERE_PX)
        chances.append(np.mean(by_chance[by_chance > -2] >= 0))
        of_shape = asked & (strong[k].kind != "blob")
        shapes.append(np.mean(found[of_shape] >= 0) if of_shape.any() else np.nan)
        across.append(truth.across_px(strong[k], strong[1 - k].xy, found))
        among = truth.found_again(every[k], every[1 - k].xy)
        quality.append(every[k].quality[among > -2])
        again.append(among[among > -2] >= 0)
    mark = "*" if pair.name in FITTED else ""
    row = (
        f"| {pair.name}{mark} | {sum(map(len, strong)) / area:.0f} | {shares[0]:.0%}, {shares[1]:.0%} "
        f"| {np.mean(chances):.0%} | {shapes[0]:.0%}, {shapes[1]:.0%} "
        f"| {np.sqrt(np.mean(np.concatenate(across) ** 2)):.2f} px | {seconds / area:.1f} |"
    )
    return row, np.concatenate(quality), np.concatenate(again)


def truths(images: list[Image], rasters: list[ArrayRaster], height_m: float) -> list[Truth]:
    """Return what SIFT tells of a pair, there and back."""
    described = []
    for raster in rasters:
        byte = stretch_to_byte(raster.grey, raster.valid)
        points, descriptors = cv2.SIFT_create(MOST_FEATURES, contrastThreshold=FEATURES.contrast).detectAndCompute(
            byte, None
        )
        described.append((np.array([point.pt for point in points]), compute_root_sift(descriptors)))
    (xy, first), (other, second) = described
    i, j = match_descriptors(first, second, RATIO)
    good = check_rpc_consistency(images[0].rpc, images[1].rpc, xy[i], other[j], height_m).good
    positions = xy[i[good]], other[j[good]]
    ways = []
    for a, b in ((0, 1), (1, 0)):
        miss = compute_epipolar_deviation(images[a].rpc, images[b].rpc, positions[a], positions[b], height_m)
        ways.append(
            Truth(images[a], images[b], positions[a], miss.height_m, float(np.median(miss.across_px)),
                  float(np.median(miss.stretch)))
        )  # fmt: skip
    return ways


if __name__ == "__main__":
    main()

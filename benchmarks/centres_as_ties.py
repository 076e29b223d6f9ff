"""What gravity centres do to real blocks as tie points: numbers, spread, and the fit of tracks that took no part.

    python benchmarks/centres_as_ties.py [NAME …] [--docs]

Ties of `tie-points` are corners. Centres are those of `match --detector centres`, pair by pair, joined to tracks where
pairs share a centre; they are added to the corners. The blocks are adjusted with either and with both, all else equal,
and `evaluate` judges the RPCs on tracks of OpenCV's SIFT. Then the same with few ties drawn at random, equally many of
each set, where what a single tie is worth shows: means over draws with a fixed seed. ``--docs`` writes the tables
into docs/protocols/interest_points_accuracy.md; NAME chooses blocks whose name begins so.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from real_blocks import DATA, sift_tracks

from hrsi.benchmarks.pages import DOCS, make_parser, put_between
from hrsi.hrsi_engine import open_image
from hrsi.hrsi_engine.block.block import Image, ImagePoints
from hrsi.hrsi_engine.io.point_files.csv_text import write_measurements
from hrsi.hrsi_engine.laboratory.control_network.matching import match_windows
from hrsi.hrsi_engine.laboratory.control_network.options import ControlNetworkOptions
from hrsi.hrsi_engine.measurement.block_matching.joining import build_tracks
from hrsi.hrsi_engine.measurement.tie_points import find_tie_points
from hrsi.processing_algorithms import run

PAGE = DOCS / "protocols/interest_points_accuracy.md"
BLOCKS = {
    "s2p triplet": ("s2p_triplet_phr", ("img_01.tif", "img_02.tif", "img_03.tif")),
    "Kahramanmaras before": ("kahramanmaras_phr4", ("pre_event_img1.tif", "pre_event_img2.tif")),
    "Kahramanmaras, both dates": (
        "kahramanmaras_phr4",
        tuple(f"{date}_event_img{k}.tif" for date in ("pre", "post") for k in (1, 2)),
    ),
}
SETS = ("corners", "centres", "corners and centres")
CELLS = 16  # along each side of an image, of which ties reach a share
FEW, DRAWS, SEED = 24, 10, 51
WRONG_PX = 6.0  # tracks of SIFT that no RPC fits


def main() -> None:
    """Print both tables; write them into the page where asked."""
    parser = make_parser(__doc__.splitlines()[0], PAGE)
    parser.add_argument("names", nargs="*", default=[""], help="only blocks whose name begins so")
    given = parser.parse_args()
    if given.docs and given.names != [""]:
        parser.error("--docs writes all blocks: leave the names out")
    cv2.setNumThreads(1)
    every = [
        "| block | set | tracks | on three images | cells with a tie point | fit (px) | predicted (px) |",
        "|---|---|---|---|---|---|---|",
    ]
    few = [
        "",
        f"| block | {FEW} tie points of | adjusted | fit (px), mean | worst | predicted (px), mean | worst |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, (folder, files) in BLOCKS.items():
        if not name.startswith(tuple(given.names)):
            continue
        with tempfile.TemporaryDirectory() as place:
            of_all, of_few = judge(name, [str(DATA / "real" / folder / file) for file in files], Path(place))
        every += of_all
        few += of_few
        print("\n".join([*every[:2], *of_all, *few[:3], *of_few]), flush=True)
    if given.docs:
        put_between(PAGE, "centres as tie points", "\n".join([*every, *few]))


def judge(name: str, paths: list[str], place: Path) -> tuple[list[str], list[str]]:
    """Return a block's lines of both tables."""
    images = [open_image(path) for path in paths]
    corners = find_tie_points(images).image_points
    ties = dict(zip(SETS[:2], (corners, centre_tracks(images)), strict=True))
    ties[SETS[2]] = joined(ties[SETS[0]], ties[SETS[1]])
    rng = np.random.default_rng(SEED)
    tried = {label.replace(" ", "-"): points for label, points in ties.items()}
    for label, points in few_of(ties).items():
        tried |= {f"{label.replace(' ', '-')}-{k}": drawn(points, rng) for k in range(DRAWS)}
    sets = evaluated(paths, images, tried, place)
    of_all, of_few = [], []
    for label, points in ties.items():
        key = label.replace(" ", "-")
        _, views = np.unique(points.ids, return_counts=True)
        entry = sets[key]
        of_all.append(
            f"| {name} | {label} | {len(views)} | {np.sum(views > 2)} | {cells(images, points):.0%} "
            f"| {number(entry['fit_rmse_px'])} | {number(entry['predicted_rmse_px'])} |"
        )
        draws = [sets[f"{key}-{k}"] for k in range(DRAWS) if f"{key}-{k}" in sets]
        figures = [np.array([draw[f"{what}_rmse_px"] or np.nan for draw in draws]) for what in ("fit", "predicted")]
        columns = " | ".join(f"{number(values.mean())} | {number(values.max())}" for values in figures)
        of_few.append(f"| {name} | {label} | {len(draws)} of {DRAWS} | {columns} |")
    return of_all, of_few


def centre_tracks(images: list[Image]) -> ImagePoints:
    """Return centres matched in each pair of images; pairs that measure the same pixel of an image share a track."""
    options = ControlNetworkOptions(detector="centres")
    nodes: dict[tuple[int, float, float], int] = {}
    sigma: list[float] = []
    edges = []
    for i, j in combinations(range(len(images)), 2):
        found = match_windows(images[i].raster, images[j].raster, options).positions
        for first, second, px in zip(found.first.tolist(), found.second.tolist(), found.sigma_px.tolist(), strict=True):
            edges.append([nodes.setdefault((k, *xy), len(nodes)) for k, xy in ((i, first), (j, second))])
            sigma += [px] * (len(nodes) - len(sigma))
    first, second = np.array(edges).reshape(-1, 2).T
    where = np.array(list(nodes))
    image = where[:, 0].astype(int)
    track = build_tracks(first, second, image)
    held = np.flatnonzero(track >= 0)
    ids = [f"centre_{number}" for number in track[held]]
    return ImagePoints(ids, [images[k].id for k in image[held]], where[held, 1:], np.array(sigma)[held], "tie")


def joined(first: ImagePoints, second: ImagePoints) -> ImagePoints:
    """Return the ties of both."""
    columns = ("ids", "image_ids", "xy", "sigma_px")
    both = (np.concatenate([getattr(first, name), getattr(second, name)]) for name in columns)
    return ImagePoints(*both, "tie")


def few_of(ties: Mapping[str, ImagePoints]) -> dict[str, tuple[ImagePoints, ...]]:
    """Return what few ties of each set are drawn from, in equal parts."""
    return {label: (points,) for label, points in ties.items()} | {SETS[2]: (ties[SETS[0]], ties[SETS[1]])}


def drawn(parts: tuple[ImagePoints, ...], rng: np.random.Generator) -> ImagePoints:
    """Return `FEW` tracks, equally many of each part."""
    chosen = []
    for points in parts:
        ids = np.unique(points.ids)
        chosen.append(points.select(np.isin(points.ids, rng.choice(ids, FEW // len(parts), replace=False))))
    return chosen[0] if len(chosen) == 1 else joined(*chosen)


def evaluated(paths: list[str], images: list[Image], tried: Mapping[str, ImagePoints], place: Path) -> dict[str, Any]:
    """Return what `evaluate` says of the RPCs that each set of ties leads to, on tracks of SIFT."""
    adjusted = []
    for name, points in tried.items():
        write_measurements(str(place / f"{name}.csv"), points)
        run("triangulate", images=paths, tie_points=str(place / f"{name}.csv"), model="affine", write="sidecar",
            report=False, height_datum="ellipsoidal", output_dir=str(place / name))  # fmt: skip
        if all(any((place / name).glob(f"{image.id}_RPC.TXT")) for image in images):  # not of images left out
            adjusted.append(name)
    tracks = place / "sift.csv"
    write_measurements(str(tracks), sift_tracks(images)[0])
    report = run("evaluate", images=paths, tracks=str(tracks), reject=WRONG_PX, report=False,
                 rpcs={name: place / name for name in adjusted}, output_dir=str(place / "evaluation"))  # fmt: skip
    return {entry: report["sets"][entry] for entry in adjusted}


def cells(images: list[Image], points: ImagePoints) -> float:
    """Return the share of the images' cells that a tie lies in."""
    shares = []
    for image in images:
        xy = points.xy[points.image_ids == image.id]
        at = np.clip((CELLS * (xy + 0.5) / np.array(image.known_size)).astype(int), 0, CELLS - 1)
        shares.append(len(np.unique(at, axis=0)) / CELLS**2)
    return float(np.mean(shares))


def number(value: float | None) -> str:
    """Return three decimals, a dash for what is not known."""
    return "–" if value is None or np.isnan(value) else f"{value:.3f}"


if __name__ == "__main__":
    main()

"""Tie points between images of different sensors and resolutions: `mixed_sensors.py [--docs]`.

Two simulated sensors look at the same ground on two dates, off nadir by up to 20 degrees; nothing but their RPCs tells
how much coarser one is. Matches are compared with the true cameras and the true ground: a third of a pixel of the
coarser image is a good measurement, 2 px are wrong. ``--docs`` writes the table into docs/many_dates.md. Times are
processor seconds.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from hrsi.benchmarks.pages import DOCS
from hrsi.hrsi_engine import find_tie_points
from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.workers.scheduling import open_scheduler
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    Noise,
    PointCounts,
    SceneSpec,
    draw_acquisitions,
    make_renderer,
    make_views_of_dates,
    simulate_block,
)
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import transfer

GROUND_M, RELIEF_M, OFF_NADIR_DEG = 420.0, 40.0, 20.0
PAIRS = (
    ("worldview-2", "quickbird"), ("worldview-2", "pleiades"), ("worldview-2", "ikonos"), ("quickbird", "ikonos"),
    ("ikonos", "worldview-2"),
)  # fmt: skip
WRONG_PX = 2.0
HEAD = "<!-- mixed sensors: printed by benchmarks/mixed_sensors.py -->"
END = "<!-- end of mixed sensors -->"
PAGE = DOCS / "many_dates.md"


def scene(names: tuple[str, str], seed: int) -> tuple[list[Image], list[RPC], np.ndarray]:
    """Return the images of two sensors, their true RPCs, and ground points ``(n, 3)``."""
    spec = SceneSpec(relief_m=RELIEF_M, seed=seed)
    taken = draw_acquisitions(12, spec.lat_deg, spec.seed)
    first = int(np.random.default_rng(seed).integers(3, 8))  # from spring to autumn
    views = []
    for number, name in enumerate(names):
        side = round(GROUND_M / SENSORS[name].gsd_m)
        of_date = make_views_of_dates(SENSORS[name], taken, 1, (side, side), 190.0, OFF_NADIR_DEG, seed)[first + number]
        views.append(replace(of_date, id=f"{name}_{number}"))
    block = simulate_block(spec, tuple(views), PointCounts(0, 0, 3000), Noise())
    images = []
    for view, image in zip(block.views, block.block.images, strict=True):
        size = image.known_size
        images.append(replace(image, raster=ArrayRaster(make_renderer(block, view.id).window(0, 0, *size))))
    return images, [fit.rpc for fit in block.truth.rpcs], block.truth.ground


def measured(names: tuple[str, str], seed: int) -> str:
    """Return a line of the table."""
    images, truth, ground = scene(names, seed)
    start = time.process_time()
    found = find_tie_points(images, scheduler=open_scheduler(None, 1))
    seconds = time.process_time() - start
    points = found.image_points
    xy = [points.xy[points.image_ids == image.id] for image in images]
    scale = SENSORS[names[1]].gsd_m / SENSORS[names[0]].gsd_m
    if not len(xy[0]):
        return f"| {names[0]} – {names[1]} | {scale:.2f} | 0 | – | – | {seconds:.1f} |"
    height = LinearNDInterpolator(ground[:, :2], ground[:, 2])
    at = np.full(len(xy[0]), np.median(ground[:, 2]))
    for _ in range(4):
        known = height(truth[0].localize(xy[0], at).ground[:, :2])
        at = np.where(np.isfinite(known), known, at)
    miss = xy[1] - transfer(truth[0], truth[1], xy[0], at)
    away = np.hypot(*miss[np.isfinite(known)].T) / max(1.0, 1.0 / scale)
    return (
        f"| {names[0]} – {names[1]} | {scale:.2f} | {len(xy[0])} | {np.median(away):.2f} | "
        f"{np.mean(away > WRONG_PX):.1%} | {seconds:.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=41)
    parser.add_argument("--docs", action="store_true")
    words = parser.parse_args()
    lines = [
        "| sensors | pixel sizes | tie points | median px | beyond 2 px | CPU s |",
        "|---|---|---|---|---|---|",
    ]
    for number, names in enumerate(PAIRS):
        lines.append(measured(names, words.seed + number))
        print(lines[-1], flush=True)
    if words.docs:
        text = PAGE.read_text(encoding="utf-8")
        before, rest = text.split(HEAD)
        PAGE.write_text(before + HEAD + "\n" + "\n".join(lines) + "\n" + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    main()

"""What the choice of pairs itself costs in blocks of thousands of images, without pixels: `many_images.py [COUNT …]`.

Two kinds of blocks: triplets over a square of places that overlap by a fifth, and a stack of 30 dates over each place.
Overlaps are found through a tree of polygons, the pairs worth a probe are chosen, and edge-disjoint spanning trees are
made of probes whose outcome is drawn here: neighbours in time agree well, others by chance; a tenth of the pairs fails.
``--docs`` writes the table into docs/many_dates.md. Times are processor seconds.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from tie_points_speed import TILT, parallel_rpc

from hrsi.benchmarks.pages import DOCS
from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.measurement.block_matching import overlaps
from hrsi.hrsi_engine.measurement.block_matching.overlaps import (
    choose_probes,
    compute_central_views,
    compute_convergence_deg,
    find_likely_overlaps,
)
from hrsi.hrsi_engine.measurement.block_matching.pair_choice import PairChoice, Probe

SIDE_PX = 12000
TREES, FAILS = 4, 0.1
ALL_CELLS = (511, 511)
HEAD = "<!-- many images: printed by benchmarks/many_images.py -->"
END = "<!-- end of many images -->"
PAGE = DOCS / "many_dates.md"


def stacks(count: int, dates: int) -> list[Image]:
    """Return so many images of each place of a square; places overlap by a fifth, views differ in tilt."""
    width = int(np.ceil(np.sqrt(-(-count // dates))))
    cameras = [parallel_rpc(SIDE_PX, TILT * tilt) for tilt in np.linspace(-1.0, 1.0, dates)]
    images = []
    for number in range(count):
        row, column = divmod(number // dates, width)
        camera = cameras[number % dates]
        rpc = replace(
            camera, long_off=camera.long_off + 1.6 * column * camera.long_scale,
            lat_off=camera.lat_off - 1.6 * row * camera.lat_scale,
        )  # fmt: skip
        images.append(Image(f"I{number:05d}", rpc, (SIDE_PX, SIDE_PX)))
    return images


def measured(kind: str, count: int, dates: int) -> str:
    """Return a line of the table."""
    images, rng = stacks(count, dates), np.random.default_rng(count)
    start = time.process_time()
    found = find_likely_overlaps(images, overlaps.find_ground_ranges(images, None, 0.0), None, 0.02)
    first, second = (np.array([getattr(pair, name) for pair in found]) for name in ("first", "second"))
    angle = compute_convergence_deg(compute_central_views(images), first, second)
    probed = choose_probes(found, angle)
    overlapping = time.process_time() - start
    agreeing = rng.poisson(2.0 + 120.0 * np.exp(-np.abs(first - second)[probed] / 8.0))
    probes = [Probe(int(first[row]), int(second[row]), int(agreeing[k]), float(angle[row]), ALL_CELLS)
              for k, row in enumerate(probed.tolist())]  # fmt: skip
    start = time.process_time()
    choice = PairChoice(count, probes, TREES, (TREES + 1) * count)
    while pairs := choice.choose_round():
        for pair, fails in zip(pairs, rng.random(len(pairs)) < FAILS, strict=True):
            choice.tell(pair, not fails)
    choosing = time.process_time() - start
    spent = 1e3 * (overlapping + choosing) / count
    return (
        f"| {kind} | {count} | {len(found)} | {len(probed)} | {choice.tried} | {overlapping:.1f} | {choosing:.1f} | "
        f"{spent:.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", nargs="*", type=int, default=[1000, 3000, 10000])
    parser.add_argument("--docs", action="store_true")
    words = parser.parse_args()
    lines = [
        "| block | images | pairs measured | probed | tried | CPU s, overlaps | CPU s, choice | ms per image |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind, dates in (("triplets", 3), ("30 dates", 30)):
        for count in words.counts:
            lines.append(measured(kind, count, dates))
            print(lines[-1], flush=True)
    if words.docs:
        before, rest = PAGE.read_text(encoding="utf-8").split(HEAD)
        PAGE.write_text(before + "\n".join([HEAD, *lines, END]) + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    main()

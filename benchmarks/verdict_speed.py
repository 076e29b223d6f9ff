"""What the checks of the verdict cost beside the adjustment: `verdict_speed.py [IMAGES]`.

A simulated block of 100 images with about 690 000 image points, the medium block of the speed figures. CPU seconds, the
best of three; data snooping on, as the command line does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from hrsi.benchmarks.adjust_speed import OPTIONS, simulated
from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine.adjustment.solver import adjust
from hrsi.hrsi_engine.plausibility import check_block
from hrsi.hrsi_engine.results.residuals import compute_residuals
from hrsi.hrsi_engine.results.verdict import Evidence, find_reasons

REPEATS = 3
POINTS_AN_IMAGE = 6900


def seconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU seconds of the fastest call, and what the last one returned."""
    best = float("inf")
    for _ in range(REPEATS):
        began = time.process_time()
        result = call()
        best = min(best, time.process_time() - began)
    return best, result


def main() -> None:
    """Print the table."""
    images = int(sys.argv[1]) if sys.argv[1:] else 100
    block = simulated(images, POINTS_AN_IMAGE)
    print(f"{len(block.images)} images, {len(block.measurements)} image points, {len(block.points)} points")
    options = replace(OPTIONS, reject_sigma=4.0)
    adjusting, result = seconds(lambda: adjust(block, options))
    left = compute_residuals(result)
    pairs = zip(block.images, result.values, strict=True)
    refined = [result.model.compute_refined_rpc(image, values) for image, values in pairs]
    before, found = seconds(lambda: check_block(block))
    after, more = seconds(lambda: find_reasons(Evidence(result, left, refined)))
    rows = [
        [what, f"{spent:.2f}", f"{100.0 * spent / adjusting:.1f}"]
        for what, spent in (("adjustment", adjusting), ("checks before it", before), ("checks after it", after))
    ]
    print(render(("part", "CPU s", "% of the adjustment"), rows))
    print("reasons:", [reason.code for reason in (*found, *more)])


if __name__ == "__main__":
    main()

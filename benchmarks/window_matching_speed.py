"""What compiled loops gain in window matching: `window_matching_speed.py` (CPU seconds for 3000 windows).

Least-squares matching and window search run on simulated texture, first compiled, then by NumPy, as a QGIS without
numba does it. The least of three runs counts.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter

from hrsi.hrsi_engine.measurement.window_matching.least_squares_matching import match_patches
from hrsi.hrsi_engine.measurement.window_matching.window_search import search_windows
from hrsi.hrsi_engine.measurement.window_matching.windows import LsmOptions, MatchImage

COUNT, SIDE_PX, SHIFT_PX, RUNS = 3000, 1200, (2.0, 1.0), 3


def make_images() -> tuple[MatchImage, MatchImage]:
    """Return a texture and the same moved by `SHIFT_PX`, with noise."""
    rng = np.random.default_rng(1)
    grey = 1000.0 + 400.0 * gaussian_filter(rng.standard_normal((SIDE_PX, SIDE_PX)), 1.5)
    moved = np.roll(grey, (1, 2), (0, 1)) + rng.normal(0.0, 5.0, grey.shape)
    everywhere = np.ones(grey.shape, dtype=bool)
    return MatchImage(grey, everywhere, 0.7), MatchImage(moved, everywhere, 0.7)


def measure_seconds(work: Callable[[int], object]) -> float:
    """Return the CPU seconds of ``work(COUNT)``; a short run compiles before."""
    work(100)
    seconds = []
    for _ in range(RUNS):
        start = time.process_time()
        work(COUNT)
        seconds.append(time.process_time() - start)
    return min(seconds)


def main() -> None:
    """Print the seconds with and without compiled loops."""
    centre = np.random.default_rng(2).integers(60, SIDE_PX - 60, (COUNT, 2))
    start, same = centre + np.array(SHIFT_PX) + 0.4, np.broadcast_to(np.eye(2), (COUNT, 2, 2))
    along, reach = np.tile([1.0, 0.0], (COUNT, 1)), np.tile([12.0, 3.0], (COUNT, 1))
    print("| work | compiled (s) | NumPy (s) |\n|---|---|---|")
    first, second = make_images()
    works: dict[str, Callable[[int], object]] = {}
    for side in (21, 31, 41):
        works[f"least-squares matching, {side} px"] = lambda n, side=side: match_patches(
            first, second, centre[:n], start[:n], same[:n], LsmOptions(side)
        )
    for half in (7, 10):
        works[f"window search, {2 * half + 1} px"] = lambda n, half=half: search_windows(
            first, second, centre[:n], start[:n], along[:n], reach[:n], half
        )
    for name, work in works.items():
        seconds = []
        for setting in ("1", "0"):
            os.environ["HRSI_COMPILED"] = setting
            seconds.append(measure_seconds(work))
        print(f"| {name} | {seconds[0]:.2f} | {seconds[1]:.2f} |")


if __name__ == "__main__":
    main()

"""Does a process that runs an algorithm again and again grow? ``repeated_runs.py [--runs 200] [--docs] [NAME …]``.

Every declared algorithm runs on small sound inputs (`tests/every_algorithm.py`), each in a process of its own, as a
script or QGIS calls it. Its resident memory is looked at after each run: that of the first fifth, in which modules,
compiled loops and caches come, is the warm-up; printed are the medians of the next and of the last tenth of the runs.
``--docs`` writes the table into docs/protocols/robustness.md.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import multiprocessing
import os
import shutil
import statistics
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from every_algorithm import make_scene, sound_options  # noqa: E402  # lies with the tests

from hrsi.benchmarks.robustness_page import write_section  # noqa: E402
from hrsi.benchmarks.thesis_tables import render  # noqa: E402
from hrsi.processing_algorithms import REGISTRY, run  # noqa: E402

MOST_GROWTH = 0.05
WARM_UP, LOOKED_AT = 0.2, 0.1  # shares of the runs
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def resident_mb() -> float:
    """Return the memory that this process holds, without what it has freed already."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES / 2**20


def run_again_and_again(name: str, scene: Path, folder: Path, runs: int) -> None:
    """Run an algorithm so often; leave the memory after each run, MB, and the files open at the end."""
    options = sound_options(REGISTRY[name], scene)
    if options.pop("no_report", False):
        options["report"] = False
    memory = []
    for number in range(runs):
        output = folder / str(number)
        run(name, **options, output_dir=str(output))
        shutil.rmtree(output)
        memory.append(resident_mb())
    (folder / "memory.json").write_text(json.dumps([memory, len(os.listdir("/proc/self/fd"))]))


def measured(name: str, runs: int) -> tuple[float, float, int]:
    """Return the memory after the warm-up and at the end, MB, and the open files, in a fresh process."""
    with tempfile.TemporaryDirectory(prefix="hrsi-repeated-") as place:
        folder = Path(place)
        make_scene(folder / "scene")
        process = multiprocessing.get_context("spawn").Process(
            target=run_again_and_again, args=(name, folder / "scene", folder, runs)
        )
        process.start()
        process.join()
        memory, files = json.loads((folder / "memory.json").read_text())
    warm, some = int(WARM_UP * runs), max(1, int(LOOKED_AT * runs))
    return statistics.median(memory[warm : warm + some]), statistics.median(memory[-some:]), files


def main(words: Sequence[str]) -> int:
    """Print the table; return 1 where an algorithm grows by more than it may."""
    parser = argparse.ArgumentParser(prog="repeated_runs.py", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these algorithms")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2, help="algorithms at the same time")
    parser.add_argument("--docs", action="store_true")
    options = parser.parse_args(list(words))
    rows, grown = [], []
    names = options.names or list(REGISTRY)
    with ThreadPoolExecutor(options.jobs) as pool:
        for name, found in zip(names, pool.map(lambda name: measured(name, options.runs), names), strict=True):
            first, last, files = found
            growth = last / first - 1.0
            grown += [name] if growth > MOST_GROWTH else []
            rows.append([name, str(options.runs), f"{first:.0f}", f"{last:.0f}", f"{100 * growth:+.1f} %", str(files)])
            print(" | ".join(rows[-1]), flush=True)
    table = render(["algorithm", "runs", "MB after the warm-up", "MB at the end", "growth", "open files"], rows)
    verdict = f"{len(rows)} algorithms; growth of more than {MOST_GROWTH:.0%}: {', '.join(grown) or 'none'}."
    print(f"\n{table}\n\n{verdict}")
    if options.docs:
        write_section("Memory of repeated runs", f"benchmarks/repeated_runs.py --runs {options.runs}", table, verdict)
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""What removing jitter costs: `jitter_cost.py [--lines 20000 40000] [--runs N] [--docs]`.

The whole command `hrsi adjust`, reading and writing included, with `--jitter none` and `--jitter auto` by turns: two
images, and three with a DEM, whose attitude vibrates by 1 px with a period of 1000 lines or not at all; 8 GCPs and 3000
tie points.
CPU times are the operating system's, each the least of the runs. With --docs the table goes into docs/jitter.md.
"""

import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from hrsi.benchmarks.jitter_found import PAGE
from hrsi.benchmarks.pages import make_parser, put_between, render
from hrsi.processing_algorithms import run

SEED = 5
HEADER = ("lines", "images", "surface", "jitter px", "none CPU s", "auto CPU s", "ratio")


def measure_cpu(command: Sequence[str]) -> float:
    """Return the processor time of a command, in s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def compare(work: Path, lines: int, images: int, jitter_px: int, runs: int) -> tuple[float, float]:
    """Return the CPU time without and with the removal of jitter, in s."""
    block = work / f"{lines}_{images}_{jitter_px}"
    vibration = {"jitter": f"{jitter_px},1000"} if jitter_px else {}
    run("simulate", images=images, size=4000, lines=lines, gcps=8, checks=20, ties=3000, pixels=False, seed=SEED,
        output_dir=str(block), **vibration)  # fmt: skip
    command = [
        sys.executable, "-m", "hrsi", "adjust", *map(str, sorted(block.glob("image_*_RPC.TXT"))),
        "--gcps", str(block / "ground_points.csv"), "--image-points", str(block / "image_points.csv"),
        "--height-datum", "ellipsoidal", "--quiet", "--overwrite",
        *(["--dem", str(block / "dem.tif"), "--sigma-dem", "2"] if images > 2 else []),
    ]  # fmt: skip
    least = {"none": float("inf"), "auto": float("inf")}
    for _ in range(runs):
        for jitter in least:
            spent = measure_cpu([*command, "--jitter", jitter, "--output-dir", str(work / f"{block.name}_{jitter}")])
            least[jitter] = min(least[jitter], spent)
    return least["none"], least["auto"]


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--lines", nargs="+", type=int, default=[20_000, 40_000])
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args(words)
    rows = []
    with tempfile.TemporaryDirectory() as work:
        for lines in options.lines:
            for images, jitter_px in product((2, 3), (0, 1)):
                none, auto = compare(Path(work), lines, images, jitter_px, options.runs)
                surface = "yes" if images > 2 else ""
                seconds = f"{none:.1f}", f"{auto:.1f}", f"{auto / none:.2f}"
                rows.append([str(lines), str(images), surface, str(jitter_px), *seconds])
                print(*rows[-1], flush=True)
    print(render(HEADER, rows))
    if options.docs:
        put_between(PAGE, "cost", render(HEADER, rows).strip())


if __name__ == "__main__":
    main()

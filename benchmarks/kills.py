"""Runs that are ended at any moment: ``kills.py [--kills 540] [--seed 1] [--signals …] [--docs]``.

Everything that writes (`tests/killed_runs.py`: every algorithm and every choice of ``write``) is ended by KILL, TERM
and INT in turn, the moments drawn with a seed, most of them in the writing; then everything is looked at, the next run
is started, and everything is looked at once more. ``--docs`` writes the table into docs/protocols/robustness.md.
"""

from __future__ import annotations

import math
import os
import random
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # a process that forks must have no other threads
    os.environ[_name] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from every_algorithm import make_scene  # noqa: E402  # lies with the tests
from killed_runs import SIGNALS, Kill, Target, add_shifted_rpcs, load_everything, writers  # noqa: E402

from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections  # noqa: E402

PAGE = DOCS / "protocols/robustness.md"
FEWEST = 3  # times that each signal ends a writer
#: What counts as which fault, by how it is told.
FAULTS = {
    "inputs damaged": ("input damaged", "third camera"),
    "half-written": ("half-written", "half a result", "another result", "hidden", "mixed"),
    "left over": ("left over", "the next run"),
    "changed without a report": ("images changed without", "report without"),
    "tracebacks, exit codes": ("traceback", "exit code"),
}
HEAD = ["writer", "kills", "nothing there", "whole result", "finished parts", *FAULTS]


def counted(kills: Sequence[Kill]) -> list[str]:
    """Return the cells of a row: how often what was found."""
    states = Counter(kill.state for kill in kills)
    faults = [sum(any(text.startswith(words) for text in kill.wrong) for kill in kills) for words in FAULTS.values()]
    return [str(cell) for cell in (len(kills), states["nothing"], states["whole"], states["part"], *faults)]


def rounds_of(targets: Sequence[Target], kills: float) -> list[int]:
    """Return how often each signal ends each writer: quick ones more often, so that all take about the same time."""
    share = [1.0 / target.measured.whole_s for target in targets]
    wanted = kills / sum(share)
    return [max(FEWEST, math.ceil(wanted * one)) for one in share]


def main(words: Sequence[str]) -> int:
    """Print the table; return 1 where anything is wrong."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--writers", dest="names", nargs="+", help="only those whose name holds one of these words")
    parser.add_argument("--kills", type=int, default=540, help="at least so many in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--signals", nargs="+", default=[number.name for number in SIGNALS], metavar="NAME")
    options = parser.parse_args(list(words))
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's job in the background ignores it
    numbers = [signal.Signals[name] for name in options.signals]
    chosen = [one for one in writers() if not options.names or any(name in str(one) for name in options.names)]
    rng, rows, every = random.Random(options.seed), [], []
    place = Path(tempfile.mkdtemp(prefix="hrsi-kills-"))
    try:
        make_scene(place / "scene")
        add_shifted_rpcs(place / "scene")
        load_everything(chosen, place / "scene", place / "loaded")
        targets = [Target(one, place / "scene", place / str(one).replace(" ", "_")) for one in chosen]
        for target, rounds in zip(targets, rounds_of(targets, options.kills / len(numbers)), strict=True):
            kills = [target.kill(number, rng) for _ in range(rounds) for number in numbers]
            shutil.rmtree(target.folder)
            rows.append([str(target.writer), *counted(kills)])
            every += kills
            print(" | ".join(rows[-1]), flush=True)
            for kill in kills:
                if kill.wrong:
                    print(f"    {kill.number.name} {kill.code} {kill.state}: {'; '.join(kill.wrong)}", flush=True)
    finally:
        shutil.rmtree(place)
    rows.append(["all", *counted(every)])
    codes = Counter(f"{kill.number.name} {kill.code}" for kill in every)
    wrong = sum(bool(kill.wrong) for kill in every)
    said = (
        f"{len(every)} runs ended, {wrong} with any fault. Exit codes (0: done before the signal came): "
        + ", ".join(f"{name} {count} times" for name, count in sorted(codes.items())) + "."
    )  # fmt: skip
    table = render(HEAD, rows)
    print(f"\n{table}\n\n{said}")
    if options.docs:
        title = f"Runs that are ended by {', '.join(options.signals)}"
        write_sections(PAGE, {title: f"{table}\n\n{said}"})
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The matrix of bad input: ``bad_inputs.py [--docs] [ALGORITHM …]``.

Every algorithm x every input that it declares x every kind of fault (`tests/bad_inputs.py`), and bad output folders.
Printed are the numbers of cases by algorithm and by kind, and every case that is wrong. ``--docs`` writes the tables
into docs/protocols/robustness.md.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from osgeo import gdal

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from bad_inputs import (  # noqa: E402  # lies with the tests
    OUTPUTS,
    REFUSED,
    SILENT,
    TOLD,
    Case,
    Outcome,
    cases,
    hanging,
    hanging_server,
    judge,
    judge_output,
    sound_telling,
)
from every_algorithm import inputs_of, make_scene  # noqa: E402

from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections  # noqa: E402
from hrsi.processing_algorithms import REGISTRY  # noqa: E402

PAGE = DOCS / "protocols/robustness.md"
HANGS = "hanging /vsicurl"
PATIENCE_S = "1"  # of the requests here; a user's or the program's own patience is longer
LONGEST_S = 60.0  # that a case may take
HEAD = ["cases", "refused", "reported", "done", "wrong"]


def outcomes(name: str) -> list[tuple[str, str, Outcome]]:
    """Return what was asked of an algorithm, the kind of fault, and how it ended."""
    gdal.SetConfigOption("GDAL_HTTP_TIMEOUT", PATIENCE_S)
    algorithm, found = REGISTRY[name], []
    with tempfile.TemporaryDirectory(prefix="hrsi-bad-") as folder, hanging_server() as address:
        place, scene = Path(folder), Path(folder) / "scene"
        make_scene(scene)
        for kind in OUTPUTS:
            found.append((f"{name} {kind}", kind, judge_output(algorithm, kind, scene, place / kind)))
        for key, role in inputs_of(algorithm).items():
            told = sound_telling(algorithm, key, scene, place / key)
            hangs = Case(algorithm, key, role, HANGS, hanging(address))
            for case in [*(case for case in cases(algorithm) if case.key == key), hangs]:
                began = time.monotonic()
                outcome = judge(case, scene, place / key / case.kind.replace("/", ""), told)
                seconds = time.monotonic() - began
                if outcome is not None:
                    outcome.wrong += [f"took {seconds:.0f} s"] if case.kind == HANGS and seconds > LONGEST_S else []
                    found.append((str(case), case.kind, outcome))
    return found


def row_of(name: str, found: Sequence[Outcome]) -> list[str]:
    """Return the cells of a row."""
    ended = [sum(outcome.what == what for outcome in found) for what in (REFUSED, TOLD, SILENT)]
    return [name, *map(str, (len(found), *ended, sum(bool(outcome.wrong) for outcome in found)))]


def main(words: Sequence[str]) -> int:
    """Print the tables; return 1 where a case is wrong."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("names", nargs="*", metavar="ALGORITHM", help="only these")
    parser.add_argument("--jobs", type=int, default=2, help="algorithms at the same time")
    options = parser.parse_args(list(words))
    by_name: dict[str, list[Outcome]] = {}
    by_kind: dict[str, list[Outcome]] = defaultdict(list)
    names = options.names or list(REGISTRY)
    with ProcessPoolExecutor(options.jobs, multiprocessing.get_context("spawn")) as pool:
        for name, found in zip(names, pool.map(outcomes, names), strict=True):
            by_name[name] = [outcome for _, _, outcome in found]
            for said, kind, outcome in found:
                by_kind[kind].append(outcome)
                if outcome.wrong:
                    print(f"WRONG {said}: {'; '.join(outcome.wrong)} | {outcome.text[:300]}")
            print(" | ".join(row_of(name, by_name[name])), flush=True)
    every = [outcome for found in by_name.values() for outcome in found]
    first = render(["algorithm", *HEAD], [*(row_of(*one) for one in by_name.items()), row_of("all", every)])
    second = render(["kind", *HEAD], [row_of(*one) for one in by_kind.items()])
    print(f"\n{first}\n\n{second}")
    if options.docs:
        write_sections(PAGE, {"Bad input": f"{first}\n\n{second}"})
    return 1 if any(outcome.wrong for outcome in every) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Damaged files of every kind through every reader: crashes, tracebacks, and readings above 10 s or 1 GiB.

`damaged_files.py [--files N] [--seed S] [--readers R …] [--data FOLDER] [--keep FOLDER] [--docs]`. Readings run in
forked processes with limits. What fails is kept where ``--keep`` says.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # a process that forks must have no other threads
    os.environ[_name] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from damaged_files import DAMAGES, READERS, Ending, Laboratory, SoundFile, sound_files  # noqa: E402

from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections  # noqa: E402

#: Readers whose readings take long: each so many turns they have one.
LONG = {"adjust": 5, "layers": 5, "session": 3}
BATCH = 40  # readings of a process: a new one for each takes longer than most readings
PAGE = DOCS / "protocols/damaged_files.md"
FAULTS = ("crash", "traceback", "time", "memory")


def plan(files: list[SoundFile], count: int) -> list[tuple[SoundFile, str, int]]:
    """Return which file is damaged how, ``count`` in all: readers in turn, their files, all kinds of damage."""
    kinds, chosen = list(DAMAGES), []
    by_reader: dict[str, list[SoundFile]] = defaultdict(list)
    for file in files:
        by_reader[file.reader].append(file)
    number = 0
    while len(chosen) < count:
        for reader, own in by_reader.items():
            turn, rest = divmod(number, LONG.get(reader, 1))
            if not rest:
                chosen.append((own[turn % len(own)], kinds[turn // len(own) % len(kinds)], number))
        number += 1
    return chosen[:count]


_laboratory: Laboratory  # of this process


def _begin(folder: str, files: list[SoundFile]) -> None:
    global _laboratory
    _laboratory = Laboratory(Path(tempfile.mkdtemp(dir=folder)), files)


Job = tuple[SoundFile, str, int]


def _examine(jobs: tuple[list[Job], Path | None]) -> list[tuple[SoundFile, str, int, Ending]]:
    """Damage files, have them read in one process, and keep those where that fails."""
    batch, keep = jobs
    contents = [_laboratory.damaged(*job) for job in batch]
    endings = _laboratory.examine_all([(job[0], content) for job, content in zip(batch, contents, strict=True)])
    for (file, kind, seed), content, ending in zip(batch, contents, endings, strict=True):
        if keep is not None and ending.how in FAULTS:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{ending.how}-{file.reader}-{kind}-{seed}-{file.name}").write_bytes(content)
    return [(*job, ending) for job, ending in zip(batch, endings, strict=True)]


def main() -> int:
    """Damage, read, print the tables; return 1 where a reading failed."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--readers", nargs="*", choices=READERS, default=list(READERS))
    parser.add_argument("--data", type=Path, default=os.environ.get("HRSI_TEST_DATA"))
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="end then, with fewer files")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    counts: Counter[tuple[str, str, str]] = Counter()
    slowest: dict[str, Ending] = {}
    largest: dict[str, Ending] = {}
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hrsi-damaged-") as name:
        files = [file for file in sound_files(Path(name), options.data) if file.reader in options.readers]
        laboratory = Laboratory(Path(name), files)
        for file in files:
            ending = laboratory.examine(file, file.content)
            if ending.how != "read":
                print(f"{file.reader} {file.name} is not read although it is sound: {ending.text}")
        first = options.seed * 1_000_000
        jobs = [(file, kind, first + number) for file, kind, number in plan(files, options.files)]
        batches = [(jobs[start : start + BATCH], options.keep) for start in range(0, len(jobs), BATCH)]
        with multiprocessing.get_context("fork").Pool(options.processes, _begin, (name, files)) as pool:
            results = itertools.chain.from_iterable(pool.imap_unordered(_examine, batches))
            for file, kind, seed, ending in results:
                if time.monotonic() - started > 60.0 * options.minutes:
                    break
                counts[file.reader, kind, ending.how] += 1
                slowest[file.reader] = max(slowest.get(file.reader, ending), ending, key=lambda one: one.seconds)
                largest[file.reader] = max(largest.get(file.reader, ending), ending, key=lambda one: one.bytes)
                if ending.how in FAULTS:
                    cost = f"{ending.seconds:.1f} s, {ending.bytes / 2**20:.0f} MiB"
                    print(f"{ending.how} {file.reader} {file.name} {kind} {seed}: {cost}\n{ending.text}", flush=True)
    print(f"{time.monotonic() - started:.0f} s")
    sections = make_sections(counts, slowest, largest)
    print(f"{len(files)} undamaged files", *sections.values(), sep="\n\n")
    if options.docs:
        write_sections(PAGE, sections)
    return int(any(how in FAULTS for _, _, how in counts))


def make_sections(
    counts: Counter[tuple[str, str, str]], slowest: dict[str, Ending], largest: dict[str, Ending]
) -> dict[str, str]:
    """Return tables by heading: by reader how readings ended and their cost; by reader and kind what was refused."""
    ends = ("read", "refused", *FAULTS)
    rows = []
    for reader in [reader for reader in READERS if reader in slowest]:
        row = [sum(n for (one, _, how), n in counts.items() if (one, how) == (reader, end)) for end in ends]
        cost = f"{slowest[reader].seconds:.1f}", f"{largest[reader].bytes / 2**20:.0f}"
        rows.append([reader, str(sum(row)), *map(str, row), *cost])
    all_of = [sum(n for (_, _, how), n in counts.items() if how == end) for end in ends]
    cost = (
        f"{max(one.seconds for one in slowest.values()):.1f}",
        str(max(one.bytes for one in largest.values()) // 2**20),
    )
    rows.append(["all", str(sum(all_of)), *map(str, all_of), *cost])
    by_kind = []
    for reader in [reader for reader in READERS if reader in slowest]:
        cells = []
        for kind in DAMAGES:
            ended = {how: counts[reader, kind, how] for how in ends}
            wrong = sum(ended[fault] for fault in FAULTS)
            cells.append(f"{ended['refused']} of {sum(ended.values())}" + (f", {wrong} wrong" if wrong else ""))
        by_kind.append([reader, *cells])
    return {
        "": render(["reader", "files", *ends, "longest, CPU s", "most memory, MiB"], rows),
        "What was refused, by the kind of damage": render(["reader", *DAMAGES], by_kind),
    }


if __name__ == "__main__":
    sys.exit(main())

"""Which test fails without a threshold: `threshold_tests.py [--areas NAME …] [--seconds 3] [--docs] [TESTS …]`.

The tests run once, and it is noted which thresholds each of them reads. Then each threshold is switched off, set to
nothing and to any size, in a process of its own that runs the tests that read it, the quick ones first, until one
fails. A test that also fails with the threshold as it is does not count. ``--docs`` adds the tests to the table of
`rules.py`, which does the same with kinds of wrong input.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import resource
import select
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence

import pytest
from _pytest.runner import runtestprotocol

from hrsi.benchmarks.rules import ROOT, TABLE, Threshold, changed, find_thresholds, noted_reads

TESTS = ("adjustment", "plausibility", "results", "refinement", "measurement", "ortho", "io", "processing_algorithms")
LONG = "coverage or rendered or killed or wrong_inputs or real or programs or large or thorough"
MOST_TESTS = 40
ENDED_S, ENDED_CPU_S = 60.0, 15  # a run that takes longer has failed


class Trial:
    """Plugin of pytest that runs the tests with and without each threshold."""

    def __init__(self, thresholds: Sequence[Threshold], seconds: float) -> None:
        self.thresholds, self.seconds = thresholds, seconds
        self.found: dict[str, str] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Replace the loop of pytest."""
        readers = note_reads(session.items, self.thresholds)
        for one in self.thresholds:
            tests, spent = [], 0.0
            for seconds, _, item in sorted(readers[one.home], key=lambda row: (row[0] + 0.02) * row[1] ** 0.5):
                if len(tests) < MOST_TESTS and spent + seconds <= self.seconds:
                    tests, spent = [*tests, item], spent + seconds
            failing = self.find_failing(one, tests)
            self.found |= {one.home: failing} if failing else {}
            print(f"{one.home} | {failing or f'none of {len(tests)} of {len(readers[one.home])}'}", flush=True)
        return True

    def find_failing(self, threshold: Threshold, tests: Sequence[pytest.Item]) -> str:
        """Return the first test that fails without a threshold; empty if none does."""
        for change in ("none", "any"):
            rest = list(tests)
            while rest and (number := run_apart(rest, threshold, change)) is not None:
                if run_apart(rest[number : number + 1], threshold, "") is None:
                    return rest[number].nodeid
                rest = rest[number + 1 :]
        return ""


def note_reads(
    items: Sequence[pytest.Item], thresholds: Sequence[Threshold]
) -> dict[str, list[tuple[float, int, pytest.Item]]]:
    """Return for each threshold the tests that read it, with their time and the number of thresholds they read.

    The tests run in a process of their own: one with threads, as GDAL and OpenBLAS have, cannot be forked later.
    """
    with tempfile.TemporaryFile("w+") as file:
        if (child := os.fork()) == 0:
            with noted_reads(thresholds) as noted:
                for number, (item, following) in enumerate(zip(items, [*items[1:], None], strict=True)):
                    noted.clear()
                    start = time.process_time()
                    runtestprotocol(item, nextitem=following, log=False)
                    file.write(json.dumps([number, time.process_time() - start, sorted(noted)]) + "\n")
            file.flush()
            os._exit(0)
        os.waitpid(child, 0)
        file.seek(0)
        readers = defaultdict(list)
        for number, seconds, homes in map(json.loads, file):
            for home in homes:
                readers[home].append((seconds, len(homes), items[number]))
    return readers


def run_apart(tests: Sequence[pytest.Item], threshold: Threshold, change: str) -> int | None:
    """Return the number of the first test that fails in a process of its own, or that ends it; None if all pass."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (ENDED_CPU_S, ENDED_CPU_S + 2))
            with changed([threshold] if change else [], change):
                for test, following in zip(tests, [*tests[1:], None], strict=True):
                    os.write(writer, b"b")
                    if any(report.failed for report in runtestprotocol(test, nextitem=following, log=False)):
                        break
                else:
                    os.write(writer, b"e")
        finally:
            os._exit(0)
    os.close(writer)
    marks, deadline = b"", time.time() + ENDED_S
    while time.time() < deadline:
        if select.select([reader], [], [], 1.0)[0]:
            read = os.read(reader, 4096)
            if not read:
                break
            marks += read
    else:
        os.kill(child, 9)
    os.close(reader)
    os.waitpid(child, 0)
    return None if marks.endswith(b"e") or not tests else max(len(marks) - 1, 0)


def main(words: Sequence[str] | None = None) -> None:
    """Print the test of each threshold; ``--docs`` adds them to the table."""
    parser = argparse.ArgumentParser(prog="threshold_tests.py", description=__doc__)
    parser.add_argument("--areas", nargs="+", default=("hrsi_engine", "processing_algorithms"), metavar="MODULE")
    parser.add_argument("--seconds", type=float, default=3.0, help="processor time of the tests of a threshold")
    parser.add_argument("--docs", action="store_true", help=f"add the tests to {TABLE.name}")
    parser.add_argument("tests", nargs="*", default=[str(ROOT / "tests" / name) for name in TESTS])
    options = parser.parse_args(words)
    trial = Trial(find_thresholds(options.areas), options.seconds)
    os.chdir(ROOT)
    pytest.main(["-qs", "-p", "no:pytest_qgis", "-p", "no:xdist", "-m", f"not ({LONG})", *options.tests], [trial])
    if options.docs:
        with TABLE.open(encoding="utf-8", newline="") as file:
            rows = dict(list(csv.reader(file))[1:])
        rows = {home: test for home, test in trial.found.items() if home not in rows} | rows
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([["rule", "fails without it"], *sorted(rows.items())])


if __name__ == "__main__":
    main()

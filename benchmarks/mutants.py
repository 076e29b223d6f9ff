"""Do the tests notice an error in the code? `mutants.py [WORD …]` tries those whose name or file holds a word.

`mutants.toml` lists errors, each with the test that must notice it: a text of a source file is exchanged for another
one. Nothing is written to the sources: the changed module takes its place when it is imported, in a process of its own.
The tests are run without an error first. Exit status 1 if an error is not noticed, or if its text is no longer there.
"""

import importlib.machinery
import os
import resource
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MUTANTS: list[dict[str, str]] = tomllib.loads((ROOT / "benchmarks/mutants.toml").read_text(encoding="utf-8"))["mutant"]
PYTEST = [
    "-x",
    "-q",
    "--no-header",
    "--tb=no",
    "-p",
    "no:pytest_qgis",
    "-p",
    "no:cacheprovider",
    "--rootdir",
    str(ROOT),
]
#: What pytest returns if a test fails; other numbers are faults of the run.
TEST_FAILED = 1
#: Processor time after which an endless loop counts as noticed.
MOST_CPU_S = 300


def replace_module(mutant: dict[str, str]) -> None:
    """Load the module of a mutant with its text exchanged, as soon as anything imports it."""
    path = ROOT / mutant["file"]
    source = path.read_text(encoding="utf-8").replace(mutant["old"], mutant["new"])
    changed, load = compile(source, str(path), "exec"), importlib.machinery.SourceFileLoader.get_code

    def get_code(loader: importlib.machinery.SourceFileLoader, name: str) -> object:
        return changed if os.path.realpath(loader.path) == os.path.realpath(path) else load(loader, name)

    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign,assignment]


def run_tests(tests: Sequence[str], number: int | None = None) -> int:
    """Run tests in another process, with a mutant or without one; return how it ended."""
    words = [sys.executable, str(Path(__file__)), "--child", "" if number is None else str(number), *tests]
    return subprocess.run(words, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode


def run_child(number: str, *tests: str) -> int:
    """Run tests in this process, with the mutant of a number if there is one."""
    import pytest

    if number:
        resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))
        replace_module(MUTANTS[int(number)])
    return int(pytest.main([*PYTEST, *tests]))


def judge_mutant(number: int) -> str:
    """Return *noticed*, or what is wrong with a mutant."""
    mutant = MUTANTS[number]
    if (ROOT / mutant["file"]).read_text(encoding="utf-8").count(mutant["old"]) != 1:
        return "NOT IN THE SOURCES ONCE"
    status = run_tests([mutant["test"]], number)
    return "noticed" if status == TEST_FAILED or status < 0 else "NOT NOTICED"


def main(words: Sequence[str]) -> int:
    """Try the mutants and print a line for each."""
    chosen = [
        number for number, mutant in enumerate(MUTANTS)
        if not words or any(word in mutant["name"] or word in mutant["file"] for word in words)
    ]  # fmt: skip
    if run_tests(sorted({MUTANTS[number]["test"] for number in chosen})):
        print("a test fails without a mutant")
        return 1
    found = {}
    for number in chosen:
        found[number] = judge_mutant(number)
        print(f"{found[number]:<12}{MUTANTS[number]['name']} ({MUTANTS[number]['test']})", flush=True)
    missed = sum(verdict != "noticed" for verdict in found.values())
    print(f"{len(found) - missed} of {len(found)} are noticed")
    return int(missed > 0)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    sys.exit(run_child(*arguments[1:]) if arguments[:1] == ["--child"] else main(arguments))

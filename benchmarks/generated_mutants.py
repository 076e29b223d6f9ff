"""Do the tests notice a slip anywhere in the product? Faults are made by `mutant_operators` and drawn by a seed.

    python benchmarks/generated_mutants.py collect [TEST ...]      which quick tests run which line (needs coverage)
    python benchmarks/generated_mutants.py run [--count 300] [--seed 2] [--minutes 60] [--docs]
    python benchmarks/generated_mutants.py since [WORD ...]        survivors that a named test is said to notice by now
    python benchmarks/generated_mutants.py chosen [WORD ...]       mutants of outputs, chosen by hand

`collect` writes ``build/mutants/lines.json``; `run` tries each mutant with the tests that run its line, those of the
oracle first, then those that take least time. It stops at the first that fails, or where all numbers of all outputs of
the oracle are those without the mutant; its results go to ``build/mutants/results.json``. A later run tries what is
new, and with ``--again`` the survivors, with the tests as they are now.
A mutant is never written to a file: it is put in place of its module as that is imported, in a process of its own.
``benchmarks/mutants_sorted_out.toml`` names survivors that change no output (``mutants``), each with the reason, and
says of others (``survivors``) why no test notices them; these count as survivors. Of survivors of a past state it names
the test that notices them now (``since``): `since` puts each of these faults into the sources as they are, and runs it.
Each mutant of ``chosen`` exchanges a text of the sources; the named test must notice it.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import importlib
import importlib.machinery
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType

import numpy as np
import pytest

from hrsi.benchmarks.mutant_operators import Fault, list_faults, with_fault
from hrsi.benchmarks.pages import DOCS, ROOT, put_between

sys.path.append(str(ROOT / "tests"))
from independent_formulas import leaves

FOLDER = ROOT / "build" / "mutants"
LINES, RESULTS, OUTPUTS = FOLDER / "lines.json", FOLDER / "results.json", FOLDER / "outputs.json"
SORTED_OUT = Path(__file__).with_name("mutants_sorted_out.toml")
#: Markers of tests that are left to `make test-all`; those of the oracle are run with the others here.
LONG = set(re.search(r"^LONG := (.+)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)[1].split(" or "))
PYTEST = ["-p", "no:pytest_qgis", "-p", "no:cacheprovider", "-q", "--no-header", "--tb=no", "--rootdir", str(ROOT)]
#: What makes no number of an output: how work is shared out, pictures, pages, locks, what a command line looks like.
WITHOUT_NUMBERS = (
    "foundation", "drawing", "io/pages", "io/safety", "io/opening", "laboratory", "interface", "declarations",
    "io/output_dir.py", "io/catalogue/lineage.py", "projects", "memory", "budgets",
)  # fmt: skip
#: What a mutant is called that its line's commands are not changed by: all numbers of all their outputs are the same.
SAME = "no output differs"
OF_RUN = re.compile(r"versions\.|options\.|settings\.|seconds\.|inputs|.*(seconds|size)$")
#: Mutants are of lines that the commands under this folder run: from these come the numbers of outputs.
ORACLE = "tests/oracle/"
#: Seconds of other tests that one mutant may take, as they took without it; and of the processor, after which tests
#: that take less than half of it are taken as hanging.
MOST_SECONDS, MOST_CPU = 40.0, 120


# ---- which tests run which line --------------------------------------------------------------------------------------


class Recorder:
    """A plugin of pytest that gives each phase of each test its context, and keeps its time and outcome."""

    def __init__(self, coverage) -> None:
        self.coverage, self.tests = coverage, {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [
            item for item in items
            if item.nodeid.startswith(ORACLE) or LONG.isdisjoint(mark.name for mark in item.iter_markers())
        ]  # fmt: skip

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.tests[nodeid] = {"setup": 0.0, "call": 0.0, "teardown": 0.0, "passed": True}
        self.coverage.switch_context(f"{nodeid}|setup")

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> None:
        self.coverage.switch_context(f"{item.nodeid}|call")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.tests[report.nodeid][report.when] = report.duration
        self.tests[report.nodeid]["passed"] &= report.outcome == "passed"


def collect(tests: list[str]) -> int:
    """Run the quick tests and all of the oracle once and write which lines of the product each of them runs."""
    import coverage

    found = coverage.Coverage(
        data_file=None, source=[str(ROOT / "hrsi_engine"), str(ROOT / "processing_algorithms")], config_file=False
    )
    found.start()
    recorder = Recorder(found)
    where = tests or [str(ROOT / "tests")]
    ignored = [f"--ignore={ROOT / 'tests' / name}" for name in ("qgis", "desktop", "qt6", "test_structure.py")]
    pytest.main([*PYTEST, *ignored, *where], plugins=[recorder])
    found.stop()
    data, lines = found.get_data(), {}
    for file in sorted(data.measured_files()):
        name = str(Path(file).relative_to(ROOT))
        lines[name] = {
            str(line): sorted({context for context in contexts if context})
            for line, contexts in data.contexts_by_lineno(file).items()
        }
    known = json.loads(LINES.read_text()) if LINES.exists() else {"tests": {}, "lines": {}}
    known["tests"] |= recorder.tests
    for name, of_file in lines.items():
        into = known["lines"].setdefault(name, {})
        for line, contexts in of_file.items():
            kept = [one for one in into.get(line, []) if one.split("|")[0] not in recorder.tests]
            into[line] = sorted({*kept, *contexts})
    shutil.rmtree(FOLDER / "block", ignore_errors=True)  # with what was made from it: tests may have changed
    for made in (OUTPUTS, *FOLDER.glob("*.pickle")):
        made.unlink(missing_ok=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    LINES.write_text(json.dumps(known))
    print(f"{len(recorder.tests)} tests, {len(lines)} files")
    return 0


def tests_of(known: dict, file: str, line: int) -> list[str]:
    """Return the tests that run a line: those of the oracle, then the others, cheap ones first."""
    tests, contexts = known["tests"], known["lines"].get(file, {}).get(str(line), [])
    of_file = collections.defaultdict(list)
    for name, entry in tests.items():
        if entry["passed"]:
            of_file[name.split("::")[0]].append(name)
    found = set()
    for context in contexts:
        name, phase = context.rsplit("|", 1)
        if phase == "setup" and tests[name]["setup"] > 0.2:  # made once for all tests of the file
            found.update(of_file[name.split("::")[0]])
        elif tests[name]["passed"]:
            found.add(name)
    oracle, others, spent = [], [], 0.0
    for name in sorted(found, key=lambda name: (tests[name]["setup"] + tests[name]["call"], name)):
        if name.startswith(ORACLE):
            oracle.append(name)
        elif spent <= MOST_SECONDS:
            others.append(name)
            spent += tests[name]["setup"] + tests[name]["call"]
    return [*oracle, *others]


#: What becomes of a module: a fault of one expression, a text and what takes its place, or nothing.
Change = Fault | tuple[str, str] | None
#: Name, file, change and tests.
Job = tuple[str, str, Change, list[str]]


# ---- mutants ---------------------------------------------------------------------------------------------------------


def product_files() -> list[str]:
    """Return the modules from which numbers of outputs come."""
    files = [path.relative_to(ROOT) for top in ("hrsi_engine", "processing_algorithms") for path in
             sorted((ROOT / top).rglob("*.py"))]  # fmt: skip
    return [str(file) for file in files if not any(f"/{part}" in f"/{file}" for part in WITHOUT_NUMBERS)]


def module_of(file: str) -> str:
    """Return the part of the product that a row of the table stands for."""
    parts = Path(file).parts
    return parts[1] if parts[0] == "hrsi_engine" else parts[0]


def drawn(known: dict, seed: int, count: int, before: set[str]) -> list[tuple[str, Fault]]:
    """Return mutants by a seed: each part of the product by the root of its faults, so that none is left out.

    before : names of mutants of other seeds, which are not drawn again; their lines may have been others
    """
    tried = {without_place(name) for name in before}
    faults = collections.defaultdict(list)
    for file in product_files():
        run_by = {
            int(line) for line, contexts in known["lines"].get(file, {}).items()
            if any(context.startswith(ORACLE) for context in contexts)
        }  # fmt: skip
        if run_by:
            found = list_faults((ROOT / file).read_text(encoding="utf-8"))
            faults[module_of(file)] += [
                (file, fault) for fault in found
                if fault.line in run_by and without_place(name_of(file, fault)) not in tried
            ]  # fmt: skip
    weights = {part: len(found) ** 0.5 for part, found in faults.items()}
    chosen = []
    for part in sorted(faults):
        generator = random.Random(f"{seed} {part}")
        number = round(count * weights[part] / sum(weights.values()))
        chosen += generator.sample(faults[part], min(max(number, 1), len(faults[part])))
    return chosen


def name_of(file: str, fault: Fault) -> str:
    return f"{file}:{fault.line}:{fault.column} {fault.kind}: {fault.before} -> {fault.after}"


def without_place(name: str) -> str:
    """Return the name of a mutant without line and column, which other changes of its file move."""
    return re.sub(r":\d+:\d+ ", " ", name, count=1)


def numbers_of(folder: Path, of: set[str] | None = None) -> dict[str, list[float]]:
    """Return all numbers in the outputs below a folder but times, by file; ``of``: those of some of its folders."""
    from osgeo import gdal, ogr

    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if of is not None and name.split("/")[0] not in of:
            continue
        if path.suffix == ".json":
            found[name] = [value for place, value in leaves(json.loads(path.read_text())) if not OF_RUN.match(place)]
        elif path.suffix == ".gpkg":
            dataset = ogr.Open(str(path))
            for layer in (dataset.GetLayer(index) for index in range(dataset.GetLayerCount())):
                rows = [] if layer.GetName() == "layer_styles" else list(layer)
                found[f"{name}/{layer.GetName()}"] = [
                    float(value) for row in rows for value in [*row.items().values(), *corners(row.GetGeometryRef())]
                    if isinstance(value, int | float)
                ]  # fmt: skip
        elif path.suffix == ".csv":
            words = (word for line in path.read_text().splitlines() for word in line.split(","))
            found[name] = [float(word) for word in words if word.strip().lstrip("-").replace(".", "").isdigit()]
        elif path.suffix in (".tif", ".vrt"):
            image = gdal.Open(str(path))
            tags = " ".join((image.GetMetadata("RPC") or {}).values()).split()
            found[name] = [*map(float, tags), *image.GetGeoTransform(), float(image.GetRasterBand(1).Checksum())]
    return found


def corners(geometry) -> list[float]:
    """Return the coordinates of a geometry's points and of its ring."""
    rings = [] if geometry is None else [geometry.GetGeometryRef(k) for k in range(geometry.GetGeometryCount())]
    return [] if geometry is None else [one for ring in rings or [geometry] for xyz in ring.GetPoints() for one in xyz]


def are_the_same(found: dict[str, list[float]], right: dict[str, list[float]]) -> bool:
    """Return whether numbers agree to what the end of an iteration leaves open."""
    shared = found.keys() & right.keys()  # other tests than those of the oracle write files, too
    return bool(shared) and all(
        len(found[name]) == len(right[name])
        and np.allclose(found[name], right[name], rtol=1e-6, atol=1e-9, equal_nan=True)
        for name in shared
    )  # fmt: skip


class FirstFailure:
    """A plugin of pytest that keeps which test failed first, and ends where the oracle's outputs are all the same.

    tests : in the order in which they run
    is_same : tells whether all numbers in the outputs that are there are those without the mutant
    """

    def __init__(self, tests: list[str], is_same: Callable[[], bool]) -> None:
        self.order, self.is_same = {name: place for place, name in enumerate(tests)}, is_same
        self.name, self.same, self.left = "", None, sum(name.startswith(ORACLE) for name in tests)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: self.order.get(item.nodeid, len(self.order)))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.name:
            self.name = report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and not self.name:
            self.name = report.nodeid

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        done = yield
        self.left -= item.nodeid.startswith(ORACLE)
        if item.nodeid.startswith(ORACLE) and not self.left and not self.name:
            self.same = self.is_same()
            if self.same:
                item.session.shouldstop = SAME
        return done


def put_in_place(file: str, code: CodeType) -> None:
    """Have a module's code replaced as it is imported."""
    path, own = str(ROOT / file), importlib.machinery.SourceFileLoader.get_code

    def get_code(self, fullname: str) -> CodeType:
        return code if os.path.realpath(self.path) == os.path.realpath(path) else own(self, fullname)

    importlib.machinery.SourceFileLoader.get_code = get_code


def try_in_child(file: str, fault: Change, tests: list[str], answer: int) -> None:
    """Run the tests with the mutant in this process, and write what failed first."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU, MOST_CPU + 5))
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    os.chdir(ROOT)
    if fault is not None:
        source = (ROOT / file).read_text(encoding="utf-8")
        changed = source.replace(*fault) if isinstance(fault, tuple) else with_fault(source, fault)
        put_in_place(file, compile(changed, str(ROOT / file), "exec"))
    outputs = Path(f"/tmp/mutant-{os.getpid()}")

    def is_same() -> bool:
        if fault is None or not OUTPUTS.exists():
            return False
        right = json.loads(OUTPUTS.read_text())
        return are_the_same(numbers_of(outputs, {name.split("/")[0] for name in right}), right)

    failure = FirstFailure(tests, is_same)
    code = pytest.main([*PYTEST, "-x", "--basetemp", str(outputs), *tests], plugins=[failure])
    told = failure.name or (SAME if failure.same else "" if code == 0 else f"pytest ends with {int(code)}")
    if fault is None and not OUTPUTS.exists():
        OUTPUTS.write_text(json.dumps(numbers_of(outputs)))
    os.write(answer, told.encode())


def start(file: str, fault: Change, tests: list[str]) -> tuple[int, int]:
    """Start the tests of a mutant in a process of its own; return its id and where it answers."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(read)
            try_in_child(file, fault, tests, write)
        except BaseException as error:
            os.write(write, f"{type(error).__name__} before the tests".encode())
        finally:
            os._exit(0)
    os.close(write)
    return child, read


def run_all(jobs: list[Job], processes: int, done: Callable[[str, str, float], None], minutes: float = np.inf) -> None:
    """Run jobs and call ``done(name, what failed, seconds)`` for each; none is begun after some minutes."""
    last = time.monotonic() + 60.0 * minutes
    waiting, running = list(reversed(jobs)), {}
    while waiting or running:
        if time.monotonic() > last:
            waiting.clear()
        while waiting and len(running) < processes:
            name, file, fault, tests = waiting.pop()
            child, answer = start(file, fault, tests)
            running[child] = (name, answer, time.monotonic())
        time.sleep(0.05)
        for child, (name, answer, began) in list(running.items()):
            pid, status = os.waitpid(child, os.WNOHANG)
            if pid != child:
                continue
            seconds = time.monotonic() - began
            with os.fdopen(answer, "rb") as file:
                failed = file.read().decode()
            if os.WIFSIGNALED(status):
                failed = failed or f"ended by signal {os.WTERMSIG(status)}"
            shutil.rmtree(f"/tmp/mutant-{child}", ignore_errors=True)
            del running[child]
            done(name, failed, seconds)


def load_heavy() -> None:
    """Import what tests and product import, once, so that the processes of the mutants share it; nothing of HRSI."""
    import hypothesis.strategies  # noqa: F401

    modules = [
        ".".join(["hrsi", *Path(file).with_suffix("").parts]).removesuffix(".__init__") for file in product_files()
    ]
    words = f"""
import contextlib, importlib, sys
for name in {modules}:
    with contextlib.suppress(ImportError):
        importlib.import_module(name)
print(*(name for name in sys.modules if name.split(".")[0] not in ("hrsi", "__main__")))
"""
    found = subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in found.stdout.splitlines()[-1].split():
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


def run(options: argparse.Namespace) -> int:
    """Try the mutants, print the table; return 1 where fewer than 95 % are noticed."""
    known = json.loads(LINES.read_text())
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    judged = tomllib.loads(SORTED_OUT.read_text()) if SORTED_OUT.exists() else {}
    reasons = judged.get("mutants", {})
    before = set(json.loads(options.without.read_text())) if options.without else set()
    chosen = drawn(known, options.seed, options.count, before)
    mutants = {name_of(file, fault): (file, fault) for file, fault in chosen}
    jobs = []
    for name, (file, fault) in mutants.items():
        if name in results and (results[name]["by"] or not options.again or name in reasons):
            continue
        tests = tests_of(known, file, fault.line)
        if tests:
            jobs.append((name, file, fault, tests))
        else:
            results[name] = {"by": "", "seconds": 0.0, "tests": 0}
    random.Random(options.seed).shuffle(jobs)  # a run that is broken off has some of every part
    jobs.sort(key=lambda job: job[0] not in results)  # survivors first
    counts = {name: len(tests) for name, _, _, tests in jobs}

    def done(name: str, failed: str, seconds: float) -> None:
        results[name] = {"by": failed, "seconds": round(seconds, 1), "tests": counts[name]}
        RESULTS.write_text(json.dumps(results, indent=1))
        verdict = "same" if failed == SAME else "dies" if failed else "SURVIVES"
        print(f"{verdict:<9}{seconds:5.1f} s  {name}  {failed}", flush=True)

    load_heavy()
    os.nice(options.nice)
    os.environ["HRSI_ORACLE_BLOCK"] = str(FOLDER / "block")  # made once, by the product without a mutant
    if not OUTPUTS.exists():
        oracle = [name for name, entry in known["tests"].items() if name.startswith(ORACLE) and entry["passed"]]
        broken: list[str] = []
        run_all([("", "", None, oracle)], 1, lambda name, failed, seconds: broken.append(failed))
        if broken != [""]:
            print(f"fails without a mutant: {broken[0]}")
            return 1
    run_all(jobs, options.processes, done, options.minutes)
    drop_false_alarms(results)
    RESULTS.write_text(json.dumps(results, indent=1))
    text, share = table(mutants, results, judged)
    print(text)
    if options.docs:
        page = DOCS / "developing/mutants.md"
        put_between(page, f"mutants of seed {options.seed}", text)
        put_between(page, "mutants of all seeds", sum_of(page.read_text(encoding="utf-8")))
    return 0 if share >= 0.95 else 1


def try_named(step: str, words: list[str]) -> int:
    """Try the mutants that a named test must notice, of those whose names hold a word; return 1 where one does not."""
    judged = tomllib.loads(SORTED_OUT.read_text())
    named = list_since(judged["since"]) if step == "since" else list_chosen(judged["chosen"])
    chosen = [job for job in named if not words or any(word in job[0] for word in words)]
    jobs = [job for job in chosen if job[2] is not None]
    for name in [name for name, _, change, _ in chosen if change is None]:
        print(f"GONE      {name}")
    missed = len(chosen) - len(jobs)

    def done(name: str, failed: str, seconds: float) -> None:
        nonlocal missed
        missed += not failed.startswith("tests/")
        verdict = "dies" if failed.startswith("tests/") else "SURVIVES"
        print(f"{verdict:<9}{seconds:5.1f} s  {name}  {failed}", flush=True)

    load_heavy()
    words = [sys.executable, "-m", "pytest", *PYTEST, *sorted({tests[0] for *_, tests in jobs})]
    right = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)  # nothing is imported here
    if right.returncode:
        print(f"a test fails without a mutant:\n{right.stdout[-1000:]}")
        return 1
    run_all(jobs, 1, done)
    print(f"{len(jobs)} tried, {missed} of {len(chosen)} are not noticed")
    return 1 if missed else 0


def list_since(since: dict[str, dict]) -> Iterator[Job]:
    """Yield survivors of a past state, each fault where it is in today's sources (None: nowhere)."""
    for name, entry in since.items():
        file = entry.get("file", name.split(":")[0])
        line, what = int(name.split(":")[1]), name.split(" ", 1)[1]
        faults = [
            fault for fault in list_faults((ROOT / file).read_text(encoding="utf-8"))
            if f"{fault.kind}: {fault.before} -> {fault.after}" == what
        ]  # fmt: skip
        yield name, file, min(faults, key=lambda fault: abs(fault.line - line), default=None), [entry["test"]]


def list_chosen(chosen: list[dict]) -> Iterator[Job]:
    """Yield mutants chosen by hand (None: the text that they exchange is gone)."""
    for entry in chosen:
        is_there = entry["old"] in (ROOT / entry["file"]).read_text(encoding="utf-8")
        yield entry["name"], entry["file"], (entry["old"], entry["new"]) if is_there else None, [entry["test"]]


def drop_false_alarms(results: dict[str, dict]) -> None:
    """Run each test that noticed a mutant once without any; what one noticed that fails then, too, is tried again."""
    alarms = sorted({found["by"] for found in results.values() if found["by"].startswith("tests/")})
    while alarms:
        failed: list[str] = []
        run_all([("", "", None, alarms)], 1, lambda name, by, seconds, failed=failed: failed.append(by))
        if not failed[0]:
            return
        print(f"fails without a mutant: {failed[0]}")
        alarms = [name for name in alarms if name != failed[0]]
        for name in [name for name, found in results.items() if found["by"] == failed[0]]:
            del results[name]


def sum_of(page: str) -> str:
    """Return the sum of all tables of a page."""
    found = re.findall(r"^\| all \| ((?:\d+ \| )+)", page, re.MULTILINE)
    tables = [dict(zip(KINDS, map(int, row.split("|")[:-1]), strict=True)) for row in found]
    total = {key: sum(row[key] for row in tables) for key in KINDS}
    counted = total["dies"] + total["since"] + total["survives"]
    return (
        f"Of {total['drawn']} mutants of {len(tables)} seeds {counted} change an output. Tests of the commit they were "
        f"drawn on notice {total['dies']} ({100 * total['dies'] / counted:.1f} %); tests of today notice "
        f"{total['dies'] + total['since']} ({100 - 100 * total['survives'] / counted:.1f} %)."
    )


KINDS = ("drawn", "same", "sorted out", "dies", "since", "survives")


def table(mutants: dict, results: dict, judged: dict) -> tuple[str, float]:
    """Return the page's table, and the share of the mutants that change an output and are noticed, also since.

    judged : what `SORTED_OUT` says
    """
    reasons, remarks, since = (judged.get(key, {}) for key in ("mutants", "survivors", "since"))
    rows, survivors = collections.defaultdict(collections.Counter), []
    by = collections.defaultdict(collections.Counter)
    for name, (file, _) in mutants.items():
        part, found = module_of(file), results.get(name)
        if found is None:
            continue
        rows[part]["drawn"] += 1
        if found["by"] == SAME:
            rows[part]["same"] += 1
        elif found["by"]:
            rows[part]["dies"] += 1
            by[part][found["by"].split("::")[0].removeprefix("tests/")] += 1
        elif name in reasons:
            rows[part]["sorted out"] += 1
        elif name in since:
            rows[part]["since"] += 1
        else:
            rows[part]["survives"] += 1
            survivors.append(name)
    total = sum(rows.values(), collections.Counter())
    heads = ("part", "mutants", "no output differs", "sorted out", "noticed", "since", "survive", "noticed by (mostly)")
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for part in sorted(rows):
        row = rows[part]
        most = ", ".join(f"`{name}` {number}" for name, number in by[part].most_common(3))
        lines.append(f"| {part} | {' | '.join(str(row[key]) for key in KINDS)} | {most} |")
    counted = total["dies"] + total["since"] + total["survives"]
    first, share = (number / max(counted, 1) for number in (total["dies"], total["dies"] + total["since"]))
    told = f"{100 * first:.1f} % of {counted}, now {100 * share:.1f} %"
    lines.append(f"| all | {' | '.join(str(total[key]) for key in KINDS)} | {told} |")
    lines += [
        "",
        "Noticed since, by:",
        "",
        *(
            f"* `{name}`: `{since[name]['test']}`"
            for name in sorted(since)
            if name in mutants and not results.get(name, {"by": "-"})["by"]
        ),
    ]
    lines += [
        "",
        "Survivors:",
        "",
        *(f"* `{name}`{': ' + remarks[name] if name in remarks else ''}" for name in sorted(survivors)),
    ]
    sorted_out = sorted(name for name in reasons if name in mutants and not results.get(name, {}).get("by"))
    if sorted_out:
        lines += ["", "Sorted out:", "", *(f"* `{name}`: {reasons[name]}" for name in sorted_out)]
    lines[:0] = [f"{total['drawn']} of {len(mutants)} mutants drawn were tried, in a random order.", ""]
    return "\n".join(lines), share


def main(words: list[str]) -> int:
    """Run what the words say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = parser.add_subparsers(dest="step", required=True)
    steps.add_parser("collect").add_argument("tests", nargs="*")
    own = steps.add_parser("run")
    own.add_argument("--count", type=int, default=320)
    own.add_argument("--seed", type=int, default=2)
    own.add_argument("--without", type=Path, help="results of another seed; its mutants are not drawn again")
    own.add_argument("--processes", type=int, default=2)
    own.add_argument("--nice", type=int, default=10)
    own.add_argument("--minutes", type=float, default=float("inf"), help="then the table has what was tried")
    own.add_argument("--again", action="store_true")
    for step in ("since", "chosen"):
        steps.add_parser(step).add_argument("words", nargs="*")
    own.add_argument("--docs", action="store_true")
    options = parser.parse_args(words)
    if options.step in ("since", "chosen"):
        return try_named(options.step, options.words)
    return collect(options.tests) if options.step == "collect" else run(options)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The figures of the documentation: made by commands from benchmarks/registry.toml, renewed and checked here.

    python benchmarks/figures.py                      the registry: what is made by what, when, and what is stale
    python benchmarks/figures.py renew [NAME …]       make what is stale, or what is named, anew
    python benchmarks/figures.py check [NAME …]       make it aside and compare; exit status 1 where a figure moved
    python benchmarks/figures.py check --turn [DAY]   a tenth of the registry, another one every day: for CI
    python benchmarks/figures.py check --samples      everything: short figures whole, long studies by their samples
    python benchmarks/figures.py check 'blocks 2'     one sample of an entry
    python benchmarks/figures.py check --note …       write down which were as documented, and on which commit
    python benchmarks/figures.py page                 write docs/developing/figures.md

Studies of hours have samples in the registry: commands that make some rows of the page again. Each of these rows has to
be on the page.

A figure is stale where the data that it was made from, or the command, are others than those noted in
benchmarks/made.csv. A check tells more: it runs the command, as the sources are now, with its page going into a
temporary folder (HRSI_DOCS), and names every number that lies beyond its tolerance, with the page and line. What it
notes goes to benchmarks/checked.csv, and from there to docs/developing/figures.md.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import hashlib
import os
import platform
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hrsi.benchmarks.pages import DATA, ROOT

REGISTRY, MADE = ROOT / "benchmarks" / "registry.toml", ROOT / "benchmarks" / "made.csv"
CHECKED = ROOT / "benchmarks" / "checked.csv"
MADE_COLUMNS = ["name", "commit", "date", "machine", "data", "cpu_s"]
CHECKED_COLUMNS = ["name", "commit", "date", "what", "cpu_s"]  # what: whole, the numbers of the samples, or DIFFERS
DIFFERS = "differs"
#: A figure that takes longer is checked by a full check only, never in a turn.
MOST_CPU_S_IN_TURN = 300.0
TURNS = 10
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
#: What belongs to the machine and the day: times, memory and their columns.
TIMES = re.compile(r"[-+]?\d[\d.]* ?(?:CPU s|seconds|minutes|ms|s|MiB|GiB|MB|GB)\b")
TIME_COLUMNS = re.compile(r"\b(CPU s|seconds|MiB|GiB|time|ms|s)\b", re.IGNORECASE)


@dataclass(frozen=True)
class Figure:
    """One entry of the registry; its fields are described there."""

    name: str
    page: str
    command: str
    data: tuple[str, ...]
    cpu_s: float
    tolerance: float
    part: str = ""
    without: tuple[str, ...] = ()
    samples: tuple[str, ...] = ()
    sample_cpu_s: float = 0.0
    prints_rows: bool = False

    def digest(self) -> str:
        """Return the hash of the data that the command reads, and of the command itself; "" without the data."""
        total = hashlib.sha256(self.command.encode())
        for folder in self.data:
            files = sorted(path for path in (DATA / folder).rglob("*") if path.is_file())
            if not files:
                return ""
            for path in files:
                total.update(str(path.relative_to(DATA)).encode())
                with open(path, "rb") as file:
                    total.update(hashlib.file_digest(file, "sha256").digest())
        return total.hexdigest()[:16]

    def draw_samples(self) -> list[Figure]:
        """Return the samples of a long study, each as a figure of its own."""
        return [
            replace(
                self,
                name=f"{self.name} {number}",
                command=command,
                cpu_s=self.sample_cpu_s,
                samples=(),
                prints_rows="--docs" not in command,
            )
            for number, command in enumerate(self.samples, 1)
        ]

    def text(self, docs: Path) -> str:
        """Return the page, or the part of it that the command makes."""
        content = (docs / self.page).read_text(encoding="utf-8")
        if not self.part:
            return content
        return content.split(f"<!-- {self.part}:", 1)[1].split(f"<!-- end of {self.part} -->", 1)[0]


def read_registry() -> dict[str, Figure]:
    """Return the entries of the registry by name."""
    with open(REGISTRY, "rb") as file:
        table = tomllib.load(file)
    return {name: Figure(name, **{k: _as_tuple(v) for k, v in entry.items()}) for name, entry in table.items()}


def _as_tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


def read_rows(path: Path) -> dict[str, dict[str, str]]:
    """Return by name what is known of the last time that a figure was made (`MADE`), or checked (`CHECKED`)."""
    if not path.exists():
        return {}
    with open(path, encoding="utf-8", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def write_rows(path: Path, rows: dict[str, dict[str, str]], columns: Sequence[str]) -> None:
    """Write `MADE` or `CHECKED`."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[name] for name in sorted(rows))


def read_commit() -> str:
    """Return the commit whose sources run."""
    words = ["git", "rev-parse", "--short=8", "HEAD"]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


# ---- making --------------------------------------------------------------------------------------------------------


def run(figure: Figure, docs: Path) -> tuple[bool, float, str, str]:
    """Run a figure's command with its page in `docs`; return success, CPU s, its output and its messages."""
    words = [word.format(docs=docs) for word in shlex.split(figure.command)]
    environment = os.environ | {"HRSI_DOCS": str(docs), "OPENBLAS_NUM_THREADS": "1", "HRSI_TEST_DATA": str(DATA)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.returncode == 0, seconds, done.stdout, done.stderr


def renew(figures: Sequence[Figure], made: dict[str, dict[str, str]]) -> int:
    """Make figures anew, in the documentation; return how many failed."""
    commit, failed = read_commit(), 0
    for figure in figures:
        well, seconds, output, messages = run(figure, ROOT / "docs")
        print(f"{figure.name}: {'made' if well else 'FAILED'}, {seconds:.0f} CPU s", flush=True)
        if not well:
            print((output + messages)[-2000:], file=sys.stderr)
            failed += 1
            continue
        made[figure.name] = {
            "name": figure.name, "commit": commit, "date": datetime.date.today().isoformat(),
            "machine": f"{os.cpu_count()} cores {platform.machine()}", "data": figure.digest(),
            "cpu_s": f"{seconds:.0f}",
        }  # fmt: skip
        write_rows(MADE, made, MADE_COLUMNS)
        checked = read_rows(CHECKED)
        if checked.pop(figure.name, None):  # it was of the page before
            write_rows(CHECKED, checked, CHECKED_COLUMNS)
    write_page(list(read_registry().values()), made)
    return failed


# ---- comparing -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Difference:
    """A line of a page that says something else now; `number` is the column of the number in it, 0: the words."""

    line: int
    was: str
    now: str


def compare(was: str, now: str, tolerance: float, without: Sequence[str] = ()) -> list[Difference]:
    """Return where two states of a page differ by more than the tolerance, leaving times and memory out.

    Numbers may differ by the relative `tolerance`, and by one unit of the last digit that is printed. Everything else
    must be the same, except for spaces and the lines of tables that only align columns.
    """
    old, new = (list(_comparable(text, without)) for text in (was, now))
    if len(old) != len(new):
        return [Difference(0, f"{len(old)} lines", f"{len(new)} lines")]
    return [
        Difference(number, a, b)
        for (number, a), (_, b) in zip(old, new, strict=True)
        if a != b and not _are_close(a, b, tolerance)
    ]


def compare_rows(page: str, output: str, tolerance: float, without: Sequence[str] = ()) -> list[Difference]:
    """Return the printed rows that a page does not have: none of its rows with the same first cell has these numbers.

    What is printed beside rows is passed over; an output without any row of the page is a difference itself.
    """
    rows: dict[str, list[str]] = {}
    for _, cells in _split_lines(page, without):
        rows.setdefault(cells[0], []).append(" | ".join(cells[1:]))
    found, known = [], 0
    for _, cells in _split_lines(output, without):
        start = next((k for k in (0, 1) if len(cells) > k + 2 and cells[k] in rows), None)  # a column may stand before
        if start is None:
            continue
        known += 1
        now, was = " | ".join(cells[start + 1 :]), rows[cells[start]]
        if not any(_are_close(one, now, tolerance) for one in was):
            nearest = max(
                was, key=lambda one: sum(a == b for a, b in zip(one.split(" | "), cells[start + 1 :], strict=False))
            )
            found.append(Difference(0, f"{cells[start]} | {nearest}", f"{cells[start]} | {now}"))
    return found if known else [Difference(0, "rows of the page", "none of them is printed")]


def _split_lines(text: str, without: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield line numbers and cells, which lie between bars or two blanks apart; no columns and numbers of times."""
    skipped: set[int] = set()
    in_table = False
    for number, line in enumerate(text.splitlines(), 1):
        words = line.strip()
        cells = [cell.strip() for cell in (words.strip("|").split("|") if "|" in words else re.split(r" {2,}", words))]
        if words.startswith("|"):
            if not in_table:
                skipped = {k for k, cell in enumerate(cells) if TIME_COLUMNS.search(cell) or cell in without}
            if set("".join(cells)) <= set("-: "):
                cells = []
            cells = [cell for k, cell in enumerate(cells) if k not in skipped]
        in_table = words.startswith("|")
        while len(cells) > 1 and not cells[-1]:
            cells.pop()
        if any(cells):
            yield number, [" ".join(TIMES.sub("TIME", cell).split()) for cell in cells]


def _comparable(text: str, without: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield line numbers and lines with the columns and numbers of times left out."""
    return ((number, " | ".join(cells)) for number, cells in _split_lines(text, without))


def _are_close(was: str, now: str, tolerance: float) -> bool:
    old, new = NUMBER.findall(was), NUMBER.findall(now)
    if NUMBER.sub("#", was) != NUMBER.sub("#", now) or len(old) != len(new):
        return False
    for a, b in zip(old, new, strict=True):
        x, y = (float(text.replace("−", "-")) for text in (a, b))
        if abs(x - y) > max(1.001 * _last_digit(a), tolerance * abs(x)):
            return False
    return True


def _last_digit(text: str) -> float:
    """Return the worth of the last digit of a number; of a whole one nothing is rounded."""
    mantissa, _, exponent = text.lower().partition("e")
    digits = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - digits) if digits or exponent else 0.0


def check(figures: Sequence[Figure], note: bool = False) -> int:
    """Make figures aside and compare; return how many differ or failed. ``note``: write `CHECKED` and the page."""
    wrong, total, commit, checked = 0, 0.0, read_commit(), read_rows(CHECKED)
    for figure in figures:
        if not figure.digest():
            print(f"{figure.name}: not checked, its data ({', '.join(figure.data)}) are not in HRSI_TEST_DATA")
            continue
        with tempfile.TemporaryDirectory() as folder:
            aside = Path(folder) / "docs"
            shutil.copytree(ROOT / "docs", aside, ignore=shutil.ignore_patterns("pictures", "site", "*.png"))
            well, seconds, output, messages = run(figure, aside)
            documented = figure.text(ROOT / "docs")
            if figure.prints_rows:
                found = compare_rows(documented, output, figure.tolerance, figure.without)
            else:
                found = compare(documented, figure.text(aside), figure.tolerance, figure.without)
        total += seconds
        state = "FAILED" if not well else f"{len(found)} lines differ" if found else "as documented"
        print(f"{figure.name}: {state}, {seconds:.0f} CPU s (docs/{figure.page})", flush=True)
        for one in found[:20]:
            print(f"  docs/{figure.page}:{one.line}\n    documented: {one.was}\n    now:        {one.now}")
        if not well:
            print((output + messages)[-2000:], file=sys.stderr)
        wrong += bool(found) or not well
        if note:
            note_check(checked, figure, commit, seconds, well and not found)
    if note:
        write_rows(CHECKED, checked, CHECKED_COLUMNS)
        write_page(list(read_registry().values()), read_rows(MADE))
    print(f"{len(figures)} checked, {wrong} wrong, {total:.0f} CPU s")
    return wrong


def note_check(checked: dict[str, dict[str, str]], figure: Figure, commit: str, seconds: float, well: bool) -> None:
    """Write down a check; samples of one commit stand in one entry, and differ where one of them does."""
    name, _, number = figure.name.partition(" ")  # of a sample
    last = checked.get(name)
    more = bool(number and last and last["commit"] == commit and last["what"] != "whole")
    what = "whole"
    if not well or (more and last["what"] == DIFFERS):
        what = DIFFERS
    elif number:
        what = f"{last['what']} {number}" if more else f"samples {number}"
    checked[name] = {
        "name": name, "commit": commit, "date": datetime.date.today().isoformat(), "what": what,
        "cpu_s": f"{seconds + (float(last['cpu_s']) if more else 0.0):.0f}",
    }  # fmt: skip


def list_checks(figures: Sequence[Figure]) -> list[Figure]:
    """Return what is checked in place of all figures: the samples of those that have some, the others themselves."""
    return [one for figure in figures for one in (figure.draw_samples() or [figure])]


def take_turn(figures: Sequence[Figure], day: int) -> list[Figure]:
    """Return a day's share: what is short enough for CI, dealt to ten days by their times, the longest first."""
    shares: list[list[Figure]] = [[] for _ in range(TURNS)]
    for figure in sorted(list_checks(figures), key=lambda one: (-one.cpu_s, one.name)):
        if figure.cpu_s <= MOST_CPU_S_IN_TURN:
            min(shares, key=lambda share: sum(one.cpu_s for one in share)).append(figure)
    return shares[day % TURNS]


# ---- the page ------------------------------------------------------------------------------------------------------


def is_stale(figure: Figure, made: dict[str, dict[str, str]]) -> bool:
    """Return whether the data or the command are others than those that made the figure; without the data: no."""
    digest = figure.digest()
    return figure.name not in made or (bool(digest) and made[figure.name]["data"] != digest)


def write_page(figures: Sequence[Figure], made: dict[str, dict[str, str]]) -> None:
    """Write docs/developing/figures.md."""
    rows, checked = [], read_rows(CHECKED)
    longest = max(sum(one.cpu_s for one in take_turn(figures, day)) for day in range(TURNS))
    for figure in sorted(figures, key=lambda one: one.page):
        last = made.get(figure.name, dict.fromkeys(("commit", "date", "machine", "cpu_s"), ""))
        found = checked.get(figure.name)
        seen = f"{found['date']}, {found['commit']}, {found['what']}" if found else ""
        where = f"[{figure.page}](../{figure.page})" + (f", *{figure.part}*" if figure.part else "")
        rows.append(
            f"| {where} | `{figure.command.format(docs='docs')}` | {last['date']} | {last['commit']} "
            f"| {last['machine']} | {last['cpu_s']} | {100.0 * figure.tolerance:g} % | {seen} |"
        )
    (ROOT / "docs" / "developing/figures.md").write_text(
        "\n".join([PAGE_HEAD.format(longest=longest), *rows, ""]), encoding="utf-8"
    )


PAGE_HEAD = """# Where the figures come from

Each page below, or the named part of it, is written by one command only. `make figures` writes the pages again whose
data or command changed. `make figures-check` runs every command in a separate folder and compares the numbers. A number
may differ by the tolerance, or by one unit of its last digit. Times and memory depend on the computer and are not
compared. Studies of hours have samples in `benchmarks/registry.toml`: commands that make some of their rows again. CI
checks a tenth of the shorter figures and samples every day (`figures.py check --turn`), {longest:.0f} CPU s at most by
the times of the registry. `figures.py check --samples` checks all of them. This page is written by
`python benchmarks/figures.py page`.

The last column is about the last check: date, commit, and whether the whole page or samples of it were as documented,
or differed. Without an entry there was none. A page without a date of its own is older than these notes: rows that no
sample makes again may be of an earlier version.

| page | made by `python …` | date | commit | machine | CPU s | tolerance | checked |
|---|---|---|---|---|---:|---:|---|"""


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=("list", "renew", "check", "page"), default="list")
    parser.add_argument(
        "names", nargs="*",
        help="entries of the registry, or one of an entry's samples: 'blocks 1'; default: all, or all that are stale",
    )  # fmt: skip
    parser.add_argument("--samples", action="store_true", help="of long studies their samples alone")
    parser.add_argument("--turn", nargs="?", type=int, const=datetime.date.today().toordinal(), metavar="DAY")
    parser.add_argument("--note", action="store_true", help="write down what was as documented")
    words = parser.parse_intermixed_args()
    registry, made = read_registry(), read_rows(MADE)
    known = registry | {one.name: one for figure in registry.values() for one in figure.draw_samples()}
    unknown = sorted(set(words.names) - set(known if words.what == "check" else registry))
    if unknown:
        parser.error(f"not in the registry: {', '.join(unknown)}; there are {', '.join(registry)}")
    figures = [known[name] for name in words.names or registry]
    if words.what == "renew":
        return min(1, renew(figures if words.names else [one for one in figures if is_stale(one, made)], made))
    if words.what == "check":
        chosen = list_checks(figures) if words.samples else figures
        return min(1, check(chosen if words.turn is None else take_turn(figures, words.turn), words.note))
    if words.what == "page":
        write_page(list(registry.values()), made)
        return 0
    for one in figures:
        state = "stale" if is_stale(one, made) else f"made {made[one.name]['date']} at {made[one.name]['commit']}"
        print(f"{one.name:16s} docs/{one.page:28s} {one.cpu_s:6.0f} CPU s  {state}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

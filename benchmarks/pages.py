"""Where benchmarks read and write: the test data, and the documentation's pages.

The prose of a page stands in the page alone; benchmarks put their tables into it: below headings, or between marks.
``HRSI_DOCS`` names another folder of pages than ``docs``: `figures.py check` compares what is written there with what
the documentation says, and leaves the documentation alone.
"""

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = Path(os.environ.get("HRSI_DOCS") or ROOT / "docs")
#: The real data and those of the thesis; see CONTRIBUTING.md.
DATA = Path(os.environ.get("HRSI_TEST_DATA") or ROOT.parent / "shared" / "data")


def make_parser(description: str | None, page: Path) -> argparse.ArgumentParser:
    """Return the parser of a benchmark's command line, with the option that has its page written."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help=f"write the tables into {page.name}")
    return parser


def render(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table that reads well as text and as Markdown."""
    width = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    lines = [
        [cell.ljust(w) for cell, w in zip(row, width, strict=True)] for row in [head, ["-" * w for w in width], *rows]
    ]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def read_rows(page: Path) -> list[list[str]]:
    """Return the cells of the rows that the only table of a page has."""
    lines = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line[1:].rstrip().removesuffix("|").split("|")] for line in lines]


def write_sections(page: Path, bodies: Mapping[str, str]) -> None:
    """Write what a benchmark made below headings of a page (``""``: before the first); other sections stay.

    The prose of a section, all that stands before its first table, stays too. New headings come last.
    """
    head, *others = page.read_text(encoding="utf-8").split("\n## ")
    sections = {"": head.rstrip("\n")} | {text.partition("\n")[0]: text.rstrip("\n") for text in others}
    for title, body in bodies.items():
        text = sections.get(title, title)
        prose = text.partition("\n|")[0] if "\n|" in text else title
        sections[title] = f"{prose.rstrip()}\n\n{body.strip()}"
    page.write_text("\n\n## ".join(sections.values()) + "\n", encoding="utf-8")


def put_between(page: Path, name: str, text: str) -> None:
    """Replace what stands between ``<!-- NAME: … -->`` and ``<!-- end of NAME -->`` of a page."""
    content = page.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}:", f"<!-- end of {name} -->"
    head, rest = content.split(begin)
    mark, tail = rest.split("-->", 1)[0], rest.split(end)[1]
    page.write_text(f"{head}{begin}{mark}-->\n\n{text}\n\n{end}{tail}", encoding="utf-8")

"""The page docs/protocols/robustness.md, of which each benchmark writes its own section."""

from __future__ import annotations

from hrsi.benchmarks.pages import DOCS

PAGE = DOCS / "protocols/robustness.md"
HEAD = """# Robustness

This page describes the files and the memory when inputs are bad, and when runs are ended, started twice or repeated.
Each section is written by the benchmark that it names.
"""


def write_section(title: str, command: str, *parts: str) -> None:
    """Write a section, in the place of an earlier one of the same title; sections keep their order."""
    text = PAGE.read_text(encoding="utf-8") if PAGE.exists() else HEAD
    head, *sections = text.split("\n## ")
    found = {section.partition("\n")[0]: section for section in sections}
    body = "\n\n".join([f"Made by `python {command}`.", *parts])
    found[title] = f"{title}\n\n{body}\n"
    PAGE.write_text("\n## ".join([head.rstrip() + "\n", *(section.rstrip() + "\n" for section in found.values())]))

"""Tables that benchmarks write into a part of a page of the documentation, between two marks."""

from __future__ import annotations

from pathlib import Path


def put_between(page: Path, name: str, text: str) -> None:
    """Replace what stands between ``<!-- NAME: … -->`` and ``<!-- end of NAME -->`` of a page."""
    content = page.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}:", f"<!-- end of {name} -->"
    head, rest = content.split(begin)
    mark, tail = rest.split("-->", 1)[0], rest.split(end)[1]
    page.write_text(f"{head}{begin}{mark}-->\n\n{text}\n\n{end}{tail}", encoding="utf-8")

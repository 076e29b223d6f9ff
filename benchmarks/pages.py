"""Where benchmarks read and write: the test data, and the documentation's pages, whole or between two marks.

``HRSI_DOCS`` names another folder of pages than ``docs``: `figures.py check` compares what is written there with what
the documentation says, and leaves the documentation alone.
"""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = Path(os.environ.get("HRSI_DOCS") or ROOT / "docs")
#: The real data and those of the thesis; see CONTRIBUTING.md.
DATA = Path(os.environ.get("HRSI_TEST_DATA") or ROOT.parent / "shared" / "data")

#: What every page with figures of Hobart says of them.
HOBART_NOTE = """\
The RPCs of Hobart were fitted to its image points, because the thesis does not print those of the vendor. So its check
points are not independent of the RPCs; the check points of the other real blocks are.
"""


def put_between(page: Path, name: str, text: str) -> None:
    """Replace what stands between ``<!-- NAME: … -->`` and ``<!-- end of NAME -->`` of a page."""
    content = page.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}:", f"<!-- end of {name} -->"
    head, rest = content.split(begin)
    mark, tail = rest.split("-->", 1)[0], rest.split(end)[1]
    page.write_text(f"{head}{begin}{mark}-->\n\n{text}\n\n{end}{tail}", encoding="utf-8")

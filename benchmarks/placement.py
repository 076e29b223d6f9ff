"""Table of images that were cut, reduced, enlarged or converted: errors of their RPCs, and what HRSI says.

``python benchmarks/placement.py [--docs]``: one cell for each combination of program, carrier of the RPC and grid, and
the sums; ``--docs`` writes docs/protocols/placement.md. A warning is false if the image's position is right to 0.5 px.
GDAL's displacement of resampled images, half a pixel of the original less half a new one, is a true error below 1 px,
which HRSI states with its size: it is counted apart.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import placement_cases  # noqa: E402
from placement_cases import Case, Finding  # noqa: E402

from hrsi.benchmarks.pages import DOCS, render, write_sections  # noqa: E402

PAGE = DOCS / "protocols/placement.md"


def main() -> None:
    """Print the table and the sums, or write them to the page."""
    rows: dict[str, dict[str, str]] = defaultdict(dict)
    counts: Counter[str] = Counter()
    for case in placement_cases.list_cases():
        with tempfile.TemporaryDirectory() as folder:
            found = placement_cases.examine(case, placement_cases.write_case(case, Path(folder)))
        rows[f"{case.shape}, {case.tool}, {case.grid} grid"][name_carrier(case)] = format_cell(found)
        count(found, counts)
    carriers = list(dict.fromkeys(carrier for row in rows.values() for carrier in row))
    cells = [[name, *(row.get(one, "") for one in carriers)] for name, row in rows.items()]
    table = render(["image", *carriers], cells)
    text = "\n".join([table, "", *(f"* {name}: {number}" for name, number in counts.items())])
    print(text)
    if "--docs" in sys.argv:
        write_sections(PAGE, {"": text})


def name_carrier(case: Case) -> str:
    """Return the column of a case."""
    return case.carrier + (" + size" if case.states_size else "")


def format_cell(found: Finding) -> str:
    """Return the errors before and after, and the first letter of what HRSI says."""
    after = "" if abs(found.after_px - found.before_px) < 1e-3 else f" → {found.after_px:.2f}"
    return f"{found.before_px:.2f}{after} {found.says[:1]}".rstrip()


def count(found: Finding, counts: Counter[str]) -> None:
    """Count a case in the sums."""
    is_doubted = found.says not in ("", "moved")
    stated_px = float(found.says.split()[-2]) if is_doubted else 0.0
    is_slight = is_doubted and 0.01 < found.after_px <= 1.0 and stated_px <= 1.0
    counts["combinations"] += 1
    counts["wrong as they are (> 1 px)"] += found.before_px > 1.0
    counts["corrected"] += found.before_px > 1.0 >= found.after_px
    counts["reported as doubtful"] += found.after_px > 1.0 and is_doubted
    counts["silent errors above 1 px"] += found.after_px > 1.0 and not is_doubted
    counts["true warnings of less than 1 px"] += is_slight
    counts["false warnings (right to 0.5 px)"] += is_doubted and found.after_px <= 0.5 and not is_slight


if __name__ == "__main__":
    main()

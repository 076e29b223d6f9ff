"""Table of images that were cut, reduced, enlarged or converted: errors of their RPCs, and what HRSI says.

``python benchmarks/placement.py``: one row for each combination of program, carrier of the RPC and grid, and the sums.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import placement_cases  # noqa: E402


def main() -> None:
    """Print the table."""
    print(f"{'image':64} {'before px':>9} {'after px':>9}  HRSI says")
    counts: Counter[str] = Counter()
    for case in placement_cases.list_cases():
        with tempfile.TemporaryDirectory() as folder:
            found = placement_cases.examine(case, placement_cases.write_case(case, Path(folder)))
        print(f"{case!s:64} {found.before_px:9.3f} {found.after_px:9.3f}  {found.says}")
        counts["combinations"] += 1
        counts["wrong as they are (> 1 px)"] += found.before_px > 1.0
        counts["corrected"] += found.before_px > 1.0 >= found.after_px
        doubted = found.says not in ("", "moved")
        counts["told as doubtful"] += found.after_px > 1.0 and doubted
        counts["silent errors above 1 px"] += found.after_px > 1.0 and not doubted
        counts["false warnings"] += found.after_px < 0.01 and doubted
    for name, count in counts.items():
        print(f"{name}: {count}")


if __name__ == "__main__":
    main()

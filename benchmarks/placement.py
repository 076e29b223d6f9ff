"""Table of images that were cut, reduced, enlarged or converted: errors of their RPCs, and what HRSI says.

``python benchmarks/placement.py``: one row for each combination of program, carrier of the RPC and grid, and the sums.
A warning is false if the image's position is right to 0.5 px. GDAL's displacement of resampled images, half a pixel of
the original less half a new one, is a true error below 1 px, which HRSI states with its size: it has a row of its own.
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
        stated_px = float(found.says.split()[-2]) if doubted else 0.0
        is_slight = doubted and 0.01 < found.after_px <= 1.0 and stated_px <= 1.0
        counts["true warnings of less than 1 px"] += is_slight
        counts["false warnings (right to 0.5 px)"] += doubted and found.after_px <= 0.5 and not is_slight
    for name, count in counts.items():
        print(f"{name}: {count}")


if __name__ == "__main__":
    main()

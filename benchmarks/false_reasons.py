"""Right blocks that were refused or accused: `false_reasons.py [--families NAME …] [--seeds FIRST COUNT]`.

Families of simulated blocks without an error: two GCPs with a free DEM (two stated accuracies), drifting images with
six GCPs, jitter that is removed, and pairs of small convergence. Printed are the verdicts, the reasons, and the medians
of CE90 and LE90 at the check points over the predicted ones, which contain no measurement of the check points.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.processing_algorithms import run

PLACE = {"lon": 24.5, "lat": -28.7, "pixels": False}
PAIR = {"images": 2, "along": [-12.0, 12.0], "size": 6000, "checks": 25, "ties": 80, **PLACE}
#: Options of `simulate`, and of `adjust`, by the family's name.
FAMILIES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "two GCPs, free DEM of 2 m": ({"sensor": "pleiades", "gcps": 2, "free_dem": 30, **PAIR}, {"sigma_dem": 2.0}),
    "two GCPs, free DEM of 2.4 m": ({"sensor": "pleiades", "gcps": 2, "free_dem": 30, **PAIR}, {"sigma_dem": 2.4}),
    "six GCPs, three images": (
        {"sensor": "quickbird", "gcps": 6, **PAIR, "images": 3, "along": [-15.0, 0.0, 15.0]}, {},
    ),
    "jitter removed": (
        {"sensor": "worldview-2", "gcps": 10, **PAIR, "images": 3, "along": [-15.0, 2.0, 16.0], "size": 8000,
         "checks": 60, "ties": 6000, "noise_image": 0.2, "jitter": ["1.8"], "jitter_period": 900},
        {"jitter": "auto"},
    ),
    "six degrees of convergence, no GCPs": (
        {"sensor": "pleiades", "gcps": 0, **PAIR, "along": [-3.2, 3.2]}, {},
    ),
}  # fmt: skip


def run_block(family: str, seed: int) -> tuple[str, list[str], float | None, float | None]:
    """Return the level of a block's verdict, its codes, and CE90 and LE90 over the predicted ones; None without."""
    simulate, adjust = FAMILIES[family]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run("simulate", output_dir=str(folder / "block"), seed=seed, **simulate)
        dem = {"dem": str(folder / "block/free_dem.tif")} if "free_dem" in simulate else {}
        try:
            report = run(
                "adjust", images=sorted(map(str, (folder / "block").glob("image_*_RPC.TXT"))),
                gcps=str(folder / "block/ground_points.csv"), image_points=str(folder / "block/image_points.csv"),
                height_datum="ellipsoidal", write="none", report=False, output_dir=str(folder / "out"), **dem, **adjust,
            )  # fmt: skip
        except HrsiError as error:
            return "refused", [str(error)[:60]], None, None
    verdict, check = report["verdict"], report["check"]
    part = next(iter(report["parts"]), {})
    ratios = [
        check[key] / part[key] if check.get(key) and part.get(key) else None for key in ("ce90_m", "le90_m")
    ]  # fmt: skip
    return verdict["level"], [reason["code"] for reason in verdict["reasons"]], ratios[0], ratios[1]


def main(words: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="false_reasons.py", description=__doc__)
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list(FAMILIES))
    parser.add_argument("--seeds", nargs=2, type=int, default=(70_000, 20), metavar=("FIRST", "COUNT"))
    options = parser.parse_args(words)
    first, count = options.seeds
    rows = []
    for family in options.families:
        outcomes = [run_block(family, seed) for seed in range(first, first + count)]
        levels = Counter(level for level, *_ in outcomes)
        codes = Counter(code for _, found, *_ in outcomes for code in found)
        ratios = [[one[k] for one in outcomes if one[k] is not None] for k in (2, 3)]
        rows.append([
            family, str(count), *(str(levels[level]) for level in ("ok", "doubtful", "unusable", "refused")),
            ", ".join(f"{code} {number}" for code, number in codes.most_common()),
            *(f"{np.median(kind):.2f}" if kind else "-" for kind in ratios),
        ])  # fmt: skip
        print(rows[-1], flush=True)
    head = (
        "blocks",
        "number",
        "ok",
        "doubtful",
        "unusable",
        "refused",
        "reasons",
        "CE90 / predicted",
        "LE90 / predicted",
    )
    print(render(head, rows))


if __name__ == "__main__":
    main()

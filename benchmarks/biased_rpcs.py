"""RPCs biased beyond their sensor's figure, all else right: `biased_rpcs.py [--seeds A:B] [--docs]`.

Two images of every simulated sensor see the ground 5 to 10 times as far off as the sensor points (CE90), in eight
directions. GCPs take the bias away, so that nothing is wrong with the result: no block may be unusable, and none blamed
on a datum.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections
from hrsi.hrsi_engine import AdjustOptions, adjust, check_block, judge
from hrsi.hrsi_engine.block.block import Block
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    Noise,
    OrientationError,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)
from hrsi.hrsi_engine.results.verdict import Verdict

PAGE = DOCS / "protocols/biased_rpcs.md"
#: Sensor, and its CE90 without ground control (`block.pointing`); of the wide-field camera, of its simulated errors.
FIGURES_M = {
    "ikonos": 15.0,
    "quickbird": 17.5,
    "worldview-2": 5.0,
    "pleiades": 12.0,
    "spot5": 60.0,
    "wide-field": 145.0,
}
PLACES = ((5.45, 43.53), (147.3, -42.85), (-71.6, -33.4), (-105.0, 39.7), (36.9, 37.6), (113.2, 34.6), (18.4, -33.9))
DIRECTIONS = 8


def make_block(sensor: str, bias_m: float, direction: int, seed: int) -> Block:
    """Return a block whose images all lie ``bias_m`` off in one of eight directions; its place goes with the seed."""
    angle = 2.0 * np.pi * direction / DIRECTIONS
    error = OrientationError(position_m=(bias_m * np.sin(angle), bias_m * np.cos(angle), 0.0))
    views = make_along_track_views(SENSORS[sensor], 2, (2000, 2000))
    views = tuple(replace(view, vendor_error=error) for view in views)
    lon, lat = PLACES[seed % len(PLACES)]
    return simulate_block(SceneSpec(lon, lat, relief_m=100.0, seed=seed), views, PointCounts(8, 30, 200), Noise()).block


def judge_block(block: Block) -> Verdict:
    """Return the verdict on a block as the command line gives it."""
    before = check_block(block)
    return judge(adjust(block, AdjustOptions()), before)


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--seeds", default="100:101", metavar="A:B", help="seeds from A to below B")
    parser.add_argument("--factors", nargs="*", type=float, default=[5.0, 7.5, 10.0], help="biases over the CE90")
    parser.add_argument("--sensors", nargs="+", default=list(FIGURES_M), metavar="NAME")
    options = parser.parse_args(words)
    first, last = map(int, options.seeds.split(":"))
    rows = []
    for sensor in options.sensors:
        figure = FIGURES_M[sensor]
        for factor in options.factors:
            verdicts = [
                judge_block(make_block(sensor, factor * figure, direction, seed))
                for seed in range(first, last)
                for direction in range(DIRECTIONS)
            ]
            codes = [{reason.code for reason in verdict.reasons} for verdict in verdicts]
            levels = [verdict.level.label for verdict in verdicts]
            others = Counter(code for found in codes for code in found - {"rpc-biased"})
            rows.append([
                sensor, f"{factor * figure:.0f} m", *(str(levels.count(one)) for one in ("ok", "doubtful", "unusable")),
                str(sum("horizontal-datum" in found for found in codes)),
                str(sum("rpc-biased" in found for found in codes)),
                ", ".join(f"{code} ({count})" for code, count in others.most_common()),
            ])  # fmt: skip
            print(" | ".join(rows[-1]), flush=True)
    head = ["sensor", "bias", "ok", "doubtful", "unusable", "blamed on a datum", "named as biased", "other reasons"]
    if options.docs:
        write_sections(PAGE, {"": render(head, rows)})


if __name__ == "__main__":
    main()

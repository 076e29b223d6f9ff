"""How many sound blocks are called sound: `clean_verdicts.py [--seeds FIRST COUNT] [--models NAME …] [--docs]`.

Blocks of every simulated sensor, two to four images, 0 to 12 GCPs, with the noise and vendor errors that the sensors
are known for, adjusted with the defaults of the command line; and the real blocks of HRSI_TEST_DATA. Every block is
judged before and after the adjustment. Thresholds were tuned on seeds below 1000; judge on others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from hrsi.benchmarks import real_blocks
from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections
from hrsi.hrsi_engine import AdjustOptions, adjust, check_block, find_tie_points, judge, open_image
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    Noise,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)
from hrsi.hrsi_engine.results.verdict import Verdict

PAGE = DOCS / "protocols/sound_blocks.md"
MODELS_JUDGED = ("shift", "affine")
SIDES = (4000, 8000, 12000)


def simulated(sensor: str, seed: int) -> tuple[Block, int]:
    """Return a block that its seed describes altogether, and its number of GCPs."""
    rng = np.random.default_rng([seed, 7])
    side, gcps = int(rng.choice(SIDES)), int(rng.integers(0, 13))
    views = make_along_track_views(SENSORS[sensor], int(rng.integers(2, 5)), (side, side))
    counts = PointCounts(gcps, int(rng.integers(0, 30)), int(rng.choice((40, 200, 800))))
    noise = Noise(float(rng.choice((0.1, 0.3, 0.5))), blunders=float(rng.choice((0.0, 0.02, 0.05))))
    place = SceneSpec(
        float(rng.uniform(-170.0, 170.0)), float(rng.uniform(-60.0, 60.0)), float(rng.uniform(0.0, 2000.0)),
        relief_m=float(rng.uniform(20.0, 600.0)), seed=seed,
    )  # fmt: skip
    return simulate_block(place, views, counts, noise).block, gcps


def matched(folder: str, names: Sequence[str]) -> Block:
    """Return a block of real images with the tie points that HRSI finds in them."""
    images = [open_image(str(real_blocks.DATA / "real" / folder / name)) for name in names]
    return assemble(images, [], [find_tie_points(images).image_points])


#: The real blocks at hand.
REAL: dict[str, Callable[[], Block]] = {
    "Hobart, IKONOS, 10 GCPs": real_blocks.hobart,
    "ZY-3, 7 GCPs": real_blocks.zy3,
    "QuickBird-2, 5 GCPs": real_blocks.quickbird,
    "SPOT 7, tie points of MicMac": real_blocks.spot7,
    "Pleiades triplet, tie points of OpenCV": real_blocks.triplet,
    "Pleiades triplet": lambda: matched("s2p_triplet_phr", ("img_01.tif", "img_02.tif", "img_03.tif")),
    "Kahramanmaras, two dates": lambda: matched(
        "kahramanmaras_phr4",
        [f"{when}_event_img{k}.tif" for when in ("pre", "post") for k in (1, 2)],
    ),
    "Ventoux": lambda: matched("ventoux_phr_pair", ("left_image.tif", "right_image.tif")),
}


def judged(block: Block, model: str) -> tuple[Adjustment, Verdict]:
    """Return an adjustment and the verdict on it."""
    before = check_block(block)
    result = adjust(block, AdjustOptions(model=model))
    return result, judge(result, before)


def study(first: int, count: int, model: str, sensors: Sequence[str] = tuple(SENSORS)) -> Iterator[tuple[str, Verdict]]:
    """Yield sensor and verdict of every simulated block; what is not ok is printed."""
    for seed in range(first, first + count):
        for sensor in sensors:
            block, gcps = simulated(sensor, seed)
            try:
                _, verdict = judged(block, model)
            except HrsiError as error:  # too few points for this model
                print(f"{sensor} {seed}, {model}, {gcps} GCPs: {error}", flush=True)
                continue
            for reason in verdict.reasons:
                told = f"{reason.level.label} {reason.code}: {reason.message}"
                print(f"{sensor} {seed}, {model}, {gcps} GCPs: {told}", flush=True)
            yield sensor, verdict


def simulated_table(first: int, count: int, models: Sequence[str], sensors: Sequence[str] = tuple(SENSORS)) -> str:
    """Return how many simulated blocks got which verdict, by model and sensor."""
    rows = []
    for model in models:
        tally = Counter((sensor, verdict.level.label) for sensor, verdict in study(first, count, model, sensors))
        for sensor in sensors:
            rows.append([model, sensor, *(str(tally[sensor, level]) for level in ("ok", "doubtful", "unusable"))])
    return render(("model", "sensor", "ok", "doubtful", "unusable"), rows)


def real_table(models: Sequence[str]) -> str:
    """Return the verdicts on the real blocks."""
    rows = []
    for name, make in REAL.items():
        block = make()
        for model in models:
            result, verdict = judged(block, model)
            codes = ", ".join(reason.code for reason in verdict.reasons)
            rows.append([name, model, f"{result.sigma0:.2f}", verdict.sentence, verdict.level.label, codes])
    return render(("block", "model", "sigma0", "sentence", "verdict", "reasons"), rows)


def main(words: Sequence[str] | None = None) -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--seeds", nargs=2, type=int, default=(5000, 36), metavar=("FIRST", "COUNT"))
    parser.add_argument("--real", action="store_true", help="print the real blocks alone")
    parser.add_argument("--sensors", nargs="+", choices=[*SENSORS], help="print simulated blocks of these alone")
    parser.add_argument("--models", nargs="+", default=MODELS_JUDGED, metavar="NAME")
    options = parser.parse_args(words)
    first, count = options.seeds
    if options.real:
        print(real_table(options.models))
        return
    if options.sensors:
        print(simulated_table(first, count, options.models, options.sensors))
        return
    sections = {
        "Real blocks": real_table(options.models),
        "Simulated blocks": simulated_table(first, count, options.models),
    }
    print(*sections.values(), sep="\n\n")
    if options.docs:
        write_sections(PAGE, sections)


if __name__ == "__main__":
    main()

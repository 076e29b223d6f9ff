"""How many sound blocks are called sound: `clean_verdicts.py [--seeds FIRST COUNT] [--model NAME] [--real]`.

Blocks of every simulated sensor, two to four images, 0 to 12 GCPs, with the noise and vendor errors that the sensors
are known for, adjusted with the defaults of the command line; and the real blocks of HRSI_TEST_DATA. Thresholds were
tuned on seeds below 1000; judge on others.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.block.block import Block
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.foundation.reasons import Reason
from hrsi.hrsi_engine.refinement import RefinedRPC
from hrsi.hrsi_engine.results.residuals import residuals
from hrsi.hrsi_engine.results.verdict import Evidence, Verdict, find_reasons
from hrsi.hrsi_engine.simulation import SENSORS, Noise, PointCounts, SceneSpec, along_track_views, simulate_block

COMMAND_LINE = {"reject_sigma": 4.0}  #: what its defaults are, beside the model
SIDES = (4000, 8000, 12000)


def simulated(sensor: str, seed: int) -> tuple[Block, int]:
    """Return a block that its seed describes altogether, and its number of GCPs."""
    rng = np.random.default_rng([seed, 7])
    side, gcps = int(rng.choice(SIDES)), int(rng.integers(0, 13))
    views = along_track_views(SENSORS[sensor], int(rng.integers(2, 5)), (side, side))
    counts = PointCounts(gcps, int(rng.integers(0, 30)), int(rng.choice((40, 200, 800))))
    noise = Noise(float(rng.choice((0.1, 0.3, 0.5))), blunders=float(rng.choice((0.0, 0.02, 0.05))))
    place = SceneSpec(
        float(rng.uniform(-170.0, 170.0)), float(rng.uniform(-60.0, 60.0)), float(rng.uniform(0.0, 2000.0)),
        float(rng.uniform(20.0, 600.0)), seed=seed,
    )  # fmt: skip
    return simulate_block(place, views, counts, noise).block, gcps


def model_rpc(result: Adjustment, index: int) -> RefinedRPC:
    """Return the refined RPC of one image."""
    return result.model.refined_rpc(result.block.images[index], result.values[index])


def judged(block: Block, options: AdjustOptions) -> tuple[Adjustment, list[Reason], float]:
    """Return an adjustment, the reasons against it, and the time these took as a share of the adjustment's."""
    began = time.perf_counter()
    result = adjust(block, options)
    middle = time.perf_counter()
    refined = [model_rpc(result, index) for index in range(len(block.images))]
    evidence = Evidence(result, residuals(result), refined)
    start = time.perf_counter()
    reasons = find_reasons(evidence)
    return result, reasons, (time.perf_counter() - start) / (middle - began)


def study(first: int, count: int, model: str) -> Iterator[tuple[str, int, list[Reason]]]:
    """Yield sensor, seed and reasons of every simulated block."""
    for seed in range(first, first + count):
        for sensor in SENSORS:
            block, gcps = simulated(sensor, seed)
            try:
                result, reasons, _ = judged(block, AdjustOptions(model=model, **COMMAND_LINE))
            except HrsiError as error:
                print(f"{sensor} {seed}: {gcps} GCPs: {error}")
                continue
            for reason in reasons:
                told = f"{reason.level.label} {reason.code}: {reason.message}"
                print(f"{sensor} {seed}: {gcps} GCPs, sigma0 {result.sigma0:.2f}: {told}", flush=True)
            yield sensor, seed, reasons


def real(model: str) -> Iterator[list[str]]:
    """Yield a row for every real block."""
    from hrsi.benchmarks import real_blocks

    for name in ("hobart", "zy3", "quickbird", "spot7", "triplet"):
        block = getattr(real_blocks, name)()
        result, reasons, share = judged(block, AdjustOptions(model=model, **COMMAND_LINE))
        verdict = Verdict.of("", reasons)
        told = "; ".join(f"{reason.code}: {reason.message}" for reason in reasons)
        yield [name, model, f"{result.sigma0:.2f}", verdict.level.label, told, f"{100 * share:.1f}"]


def main(words: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(1, 5), metavar=("FIRST", "COUNT"))
    parser.add_argument("--model", default="shift")
    parser.add_argument("--real", action="store_true")
    options = parser.parse_args(words)
    if options.real:
        print(render(("block", "model", "sigma0", "verdict", "reasons", "time, %"), list(real(options.model))))
        return
    tally: Counter[tuple[str, str]] = Counter()
    for sensor, _, reasons in study(*options.seeds, options.model):
        tally[sensor, Verdict.of("", reasons).level.label] += 1
    rows = [[sensor, *(str(tally[sensor, level]) for level in ("ok", "doubtful", "unusable"))] for sensor in SENSORS]
    print(render(("sensor", "ok", "doubtful", "unusable"), rows))


if __name__ == "__main__":
    main()

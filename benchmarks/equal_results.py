"""Whether a change of the code leaves the results of real and simulated blocks as they are.

`equal_results.py FILE [--blocks NAME …]` adjusts the blocks and stores their results in a file that does not exist;
from an existing file it compares: measurements and residuals to 1e-6 px, positions to 1e-6 m, verdicts and texts by
letter. Run it in a checkout before the change and in one after it.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hrsi.benchmarks import real_blocks
from hrsi.hrsi_engine import AdjustOptions, adjust, check_block, judge
from hrsi.hrsi_engine.block.block import Block
from hrsi.hrsi_engine.ground.geodesy import metres_per_degree

LIMIT = 1e-6  # px and m


def thinned_spot7() -> Block:
    """Return an eighth of the tie points of the SPOT 7 pair."""
    block = real_blocks.spot7()
    return block.with_measurements(block.measurements.point % 8 == 0)


def matched_triplet() -> Block:
    """Return the Pleiades triplet with tie points that are matched anew."""
    return real_blocks.matched("s2p_triplet_phr", [f"img_0{number}.tif" for number in (1, 2, 3)])


def simulated(gcps: int, checks: int) -> Block:
    """Return a simulated block of three images."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    import simulated_blocks

    return simulated_blocks.block(gcps=gcps, checks=checks)[0]


ROBUST = AdjustOptions(variance_components=True, robust="tukey")
BLOCKS: dict[str, tuple[Callable[[], Block], AdjustOptions]] = {
    "hobart": (real_blocks.hobart, AdjustOptions()),
    "hobart, affine": (real_blocks.hobart, replace(ROBUST, robust="none", model="affine", check_as_ties=True)),
    "hobart, leave-one-out": (lambda: real_blocks.hobart(real_blocks.TEN[:5]), AdjustOptions(cross_validate=True)),
    "quickbird": (real_blocks.quickbird, AdjustOptions()),
    "zy3": (real_blocks.zy3, AdjustOptions()),
    "spot7": (thinned_spot7, AdjustOptions()),
    "skysat": (lambda: real_blocks.skysat("skysat_san_luis_obispo_mountains"), AdjustOptions()),
    "triplet, matched": (matched_triplet, AdjustOptions()),
    "simulated": (lambda: simulated(10, 10), AdjustOptions()),
    "simulated, robust": (lambda: simulated(4, 6), ROBUST),
}


def compute_results(name: str) -> dict[str, np.ndarray]:
    """Return the results of a block as arrays: numbers, and one of texts."""
    make, options = BLOCKS[name]
    block = make()
    result = adjust(block, options)
    verdict = judge(result, check_block(block))
    metres = result.ground * metres_per_degree(np.nan_to_num(result.ground))
    texts = [result.model.name, verdict.level.label, *(reason.message for reason in verdict.reasons), *result.warnings]
    return {
        "measured": block.measurements.xy, "residual": result.residual_px, "ground": metres,
        "sigma0": np.array([result.sigma0, result.redundancy]), "texts": np.array(texts),
    }  # fmt: skip


def find_differences(before: dict[str, Any], after: dict[str, np.ndarray]) -> Iterator[str]:
    """Yield what differs between two results."""
    for column, new in after.items():
        old = before[column]
        if old.shape != new.shape:
            yield f"{column}: {old.shape} became {new.shape}"
        elif column == "texts":
            yield from (f"{a!r} became {b!r}" for a, b in zip(old, new, strict=True) if a != b)
        elif not np.allclose(old, new, rtol=0.0, atol=LIMIT, equal_nan=True):
            yield f"{column}: {np.nanmax(np.abs(old - new)):.3g}"


def main(words: list[str]) -> int:
    """Store the results, or print what differs; return 1 if anything does."""
    parser = argparse.ArgumentParser(prog="equal_results.py", description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--blocks", nargs="*", default=list(BLOCKS))
    options = parser.parse_args(words)
    results = {name: compute_results(name) for name in options.blocks}
    if not options.file.exists():
        np.savez(options.file, **{f"{name}/{column}": values for name, one in results.items()
                                  for column, values in one.items()})  # fmt: skip
        return 0
    stored, differences = np.load(options.file), 0
    for name, after in results.items():
        found = list(find_differences({column: stored[f"{name}/{column}"] for column in after}, after))
        print(f"{name}: {'; '.join(found) or 'equal'}")
        differences += len(found)
    return int(differences > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""What half and double of thresholds change on measured blocks: `threshold_sensitivity.py [--docs]`.

Thresholds that no data decided say *judgement* as their origin. Here each of those that are read while blocks are
adjusted and judged is halved and doubled, alone, and compared with the result as it is: the verdict with its reasons,
and by how much the points move in their own standard deviations. ``--docs`` writes the table, from which
`scripts/list_thresholds.py` takes what it says of them. The blocks: Hobart (three IKONOS images, ten GCPs), the same
with a GCP 136 m off, the same without GCPs, the ZY-3 pair (seven GCPs), QuickBird (one image, five GCPs), and six
simulated images with ties and GCPs wrong. HRSI_TEST_DATA names the data.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hrsi.benchmarks.adjust_speed import simulated, with_blunders
from hrsi.benchmarks.real_blocks import hobart, moved_gcp, quickbird, zy3
from hrsi.hrsi_engine import AdjustOptions, adjust, check_block, judge
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.foundation.thresholds import JUDGEMENT
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "developing/threshold_sensitivity.csv"
UNCHANGED = 1e-3  # standard deviations of a point that no map shows


def make_blocks() -> dict[str, Block]:
    """Return the blocks that thresholds are tried on."""
    block = hobart()
    ties = np.where(block.points.role == Role.GCP, Role.CHECK, block.points.role)
    return {
        "Hobart": block,
        "Hobart, a GCP moved": moved_gcp(block, "H035"),
        "Hobart without GCPs": replace(block, points=replace(block.points, role=ties)),
        "ZY-3": zy3(),
        "QuickBird": quickbird(),
        "simulated, wrong ties and GCPs": with_blunders(simulated(6, 60), 0.05)[0],
    }


def adjust_and_judge(block: Block) -> tuple[tuple[Any, ...], np.ndarray, np.ndarray]:
    """Return the verdict's level and reasons, the points (m, 3) and their standard deviations (m, 3) in metres."""
    try:
        result = adjust(block, AdjustOptions(threads=1))
        verdict = judge(result, check_block(block))
    except Exception as error:  # a threshold may make any step impossible
        return (type(error).__name__,), np.empty((0, 3)), np.empty((0, 3))
    told = verdict.level.label, tuple(sorted(reason.code for reason in verdict.reasons))
    return told, result.ground, result.ground_sigma_m


def compare(before: tuple[Any, ...], after: tuple[Any, ...]) -> float:
    """Return by how many standard deviations a point moves at the most; infinite where the verdict is another one."""
    (told, ground, sigma), (told_now, ground_now, _) = before, after
    if told != told_now or len(ground) != len(ground_now):
        return np.inf
    known = np.isfinite(ground).all(axis=1) & np.isfinite(ground_now).all(axis=1)
    moved = np.abs(ground_difference_m(ground[known], ground_now[known])) / sigma[known]
    return float(np.nanmax(moved, initial=0.0))


@contextmanager
def noting_reads(topics: list[Any]) -> Iterator[set[tuple[str, str]]]:
    """Give the set of thresholds (topic, field) that are read while this lasts."""
    read: set[tuple[str, str]] = set()

    def make(kind: type) -> Any:
        def get(self: Any, name: str) -> Any:
            read.add((kind.__name__, name))
            return object.__getattribute__(self, name)

        return get

    for topic in topics:
        type(topic.values).__getattribute__ = make(type(topic.values))  # type: ignore[method-assign]
    try:
        yield read
    finally:
        for topic in topics:
            del type(topic.values).__getattribute__


def list_variants(value: Any) -> list[Any]:
    """Return half and double of a number, of the same kind."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not value:
        return []
    return [max(value // 2, 1), 2 * value] if isinstance(value, int) else [value / 2.0, value * 2.0]


def describe(change: float) -> str:
    """Return a change as the table has it."""
    if np.isinf(change):
        return "verdict"
    return "nothing" if change < UNCHANGED else f"{change:.2g} sigma"


def main(words: list[str]) -> None:
    """Try all thresholds; print the table, and write it with ``--docs``."""
    parser = argparse.ArgumentParser(prog="threshold_sensitivity.py", description=__doc__)
    parser.add_argument("--docs", action="store_true", help=f"write {TABLE.name}")
    options = parser.parse_args(words)
    sys.path.insert(0, str(ROOT / "scripts"))
    from list_thresholds import find_topics

    blocks, topics = make_blocks(), find_topics()
    with noting_reads(topics) as read:
        before = {name: adjust_and_judge(block) for name, block in blocks.items()}
    rows = []
    for topic in topics:
        kind = type(topic.values).__name__
        for name in topic.values.__dataclass_fields__:
            value, said = getattr(topic.values, name), topic.values.__dataclass_fields__[name].metadata
            if (kind, name) not in read or said["origin"] != JUDGEMENT or not list_variants(value):
                continue
            changes = []
            for variant in list_variants(value):
                object.__setattr__(topic.values, name, variant)
                changes.append(max(compare(before[key], adjust_and_judge(block)) for key, block in blocks.items()))
                object.__setattr__(topic.values, name, value)
            rows.append([f"{topic.module.removeprefix('hrsi.')}.{topic.name}.{name}", *map(describe, changes)])
            print(" | ".join(rows[-1]), flush=True)
    if options.docs:
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([["threshold", "half", "double"], *rows])


if __name__ == "__main__":
    main(sys.argv[1:])

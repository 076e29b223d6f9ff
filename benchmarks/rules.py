"""What fails without a rule of the verdict: `rules.py [--areas NAME …] [--seeds A:B] [--docs]`.

A rule is a code of the verdict, or a threshold of `plausibility`, `results` or the steps of a block that judge. The
cases are kinds of wrong input (`wrong_inputs`, `wrong_kinds`), right simulated blocks and real ones. Each case is
adjusted once by `adjust` from files; then its inputs and its result are judged anew with rules switched off, which
takes milliseconds. A code is switched off by leaving its reasons out; a threshold is set to nothing and to any size.
Thresholds are changed in groups, which are halved where a case changes (group testing). A case fails without a rule if
the level of its verdict changes, or if the cause is no longer named. ``--docs`` writes the table, from which
`scripts/list_thresholds.py` names the case of each threshold.
"""

import argparse
import csv
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from hrsi.benchmarks import real_blocks
from hrsi.benchmarks.wrong_inputs import KINDS, Inputs, clean, make_generator, with_dem, written
from hrsi.benchmarks.wrong_kinds import TRUE_KINDS
from hrsi.hrsi_engine import AdjustOptions, adjust, check_block
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.foundation.reasons import Level, Reason
from hrsi.hrsi_engine.results.residuals import compute_residuals
from hrsi.hrsi_engine.results.verdict import Evidence, find_reasons
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.block_steps import block_run
from hrsi.processing_algorithms.block_steps import plausibility as steps

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "developing" / "rules.csv"
AREAS = ("hrsi_engine.plausibility", "hrsi_engine.results", "processing_algorithms.block_steps.plausibility")
SENSORS = ("pleiades", "ikonos", "spot5", "worldview-2")
CHANGES: dict[str, Callable[[float], float]] = {
    "none": lambda value: value * 1e-6,
    "any": lambda value: value * 1e6,
}
GROUP = 12  # thresholds that are changed together at first


class Outcome(NamedTuple):
    """The level of a verdict (`refused` where inputs were refused), and the codes of its reasons."""

    level: str
    codes: frozenset[str]


@dataclass(frozen=True, eq=False)
class Case:
    """A block whose inputs and result can be judged again.

    codes : causes by which a wrong input may be named; empty if only the level counts
    checks : arguments of `check_block`; ground : those of `ground_reasons`; others : reasons found elsewhere
    """

    name: str
    codes: frozenset[str]
    checks: tuple[Any, dict[str, Any]]
    evidence: tuple[Any, ...] | None = None
    ground: tuple[Any, ...] | None = None
    others: tuple[Reason, ...] = ()

    def find_reasons(self) -> list[Reason]:
        """Return the reasons as the thresholds are now."""
        block, options = self.checks
        before = [*check_block(block, **options), *self.others]
        if self.evidence is None:
            return before
        before += [] if self.ground is None else steps.ground_reasons(*self.ground)
        return find_reasons(Evidence(*self.evidence), before)

    def judge(self, without: str = "") -> Outcome:
        """Return the outcome, without the reasons of one code."""
        try:
            reasons = [reason for reason in self.find_reasons() if reason.code != without]
        except Exception as error:  # a threshold may make any step impossible
            return Outcome(type(error).__name__, frozenset())
        level = max((reason.level for reason in reasons), default=0)
        codes = frozenset(reason.code for reason in reasons)
        return Outcome(str(int(level)), codes & self.codes if self.codes else frozenset())


# ---- cases ---------------------------------------------------------------------------------------------------------


def list_inputs(seed: int) -> Iterator[tuple[str, frozenset[str], Inputs]]:
    """Yield name, causes and inputs of every kind of wrong input and of right blocks."""
    for number, kind in enumerate(KINDS):
        sensor = SENSORS[(number + seed) % len(SENSORS)]
        wrong = kind.spoil(clean(sensor, seed, kind.images, kind.gcps), make_generator(seed, kind.name))
        yield f"{kind.name} ({sensor})", frozenset(kind.codes), wrong
    for number, other in enumerate(TRUE_KINDS):
        sensor = SENSORS[(number + seed) % len(SENSORS)]
        right = clean(sensor, seed, other.images, other.gcps, other.relief_m, other.checks, other.place)
        yield f"{other.name} ({sensor})", frozenset(), other.spoil(right, make_generator(seed, other.name))
    for number in range(24):
        sensor, rng = SENSORS[number % len(SENSORS)], np.random.default_rng([seed, number])
        gcps = int(rng.integers(0, 13))
        right = clean(sensor, seed + number, int(rng.integers(2, 5)), gcps)
        right = with_dem()(right, rng) if number % 2 else right
        yield f"right block {seed + number} ({sensor})", frozenset(), right


class Refusal(HrsiError):
    """Inputs that are unusable need no adjustment."""


def check_first(block: Block, **options: Any) -> list[Reason]:
    """As `check_block`; unusable inputs end the run."""
    reasons = check_block(block, **options)
    if any(reason.level is Level.UNUSABLE for reason in reasons):
        raise Refusal(reasons[0].message)
    return reasons


def record_case(name: str, codes: frozenset[str], inputs: Inputs, folder: Path) -> Case | None:
    """Return the case of inputs that `adjust` reads from files in a folder; None if it refuses them."""
    with ExitStack() as stack:
        checked = stack.enter_context(mock.patch.object(steps, "check_block", side_effect=check_first))
        judged = stack.enter_context(
            mock.patch("hrsi.hrsi_engine.results.judged_block.find_reasons", wraps=find_reasons)
        )
        ground = stack.enter_context(mock.patch.object(block_run, "ground_reasons", wraps=steps.ground_reasons))
        folder.mkdir()
        with suppress(HrsiError):
            run("adjust", **written(inputs, folder))
    if not checked.call_args:
        return None
    checks = checked.call_args.args[0], checked.call_args.kwargs
    if not judged.call_args:
        return Case(name, codes, checks)
    evidence, before = judged.call_args.args
    of_ground = ground.call_args.args
    found = {reason.code for reason in [*check_block(checks[0], **checks[1]), *steps.ground_reasons(*of_ground)]}
    others = tuple(reason for reason in before if reason.code not in found)
    return Case(name, codes, checks, (evidence.result, evidence.left, evidence.refined), of_ground, others)


def make_real_cases() -> Iterator[Case]:
    """Yield real blocks that are right, from arrays."""
    hobart = real_blocks.hobart()
    checks = np.where(hobart.points.role == Role.GCP, Role.CHECK, hobart.points.role)
    blocks = {
        "Hobart, 10 GCPs": hobart, "Hobart, 1 GCP": real_blocks.hobart(real_blocks.TEN[:1]),
        "Hobart, no GCPs": replace(hobart, points=replace(hobart.points, role=checks)), "ZY-3": real_blocks.zy3(),
        "QuickBird": real_blocks.quickbird(),
    }  # fmt: skip
    for name, block in blocks.items():
        result = adjust(block, AdjustOptions(threads=1))
        refined = [
            result.model.compute_refined_rpc(image, values)
            for image, values in zip(block.images, result.values, strict=True)
        ]
        yield Case(name, frozenset(), (block, {}), (result, compute_residuals(result), refined))


# ---- thresholds ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Threshold:
    """A field of a topic of thresholds."""

    home: str
    topic: Any = field(compare=False, repr=False)
    name: str = ""
    value: Any = None

    def vary(self, change: str) -> Any:
        """Return another value of the same type."""
        if isinstance(self.value, tuple):
            return tuple(Threshold(self.home, self.topic, value=one).vary(change) for one in self.value)
        value = CHANGES[change](self.value)
        return int(value) if isinstance(self.value, int) else value


def find_thresholds(areas: Sequence[str]) -> list[Threshold]:
    """Return the numbers among the thresholds of modules whose names begin with an area."""
    sys.path.insert(0, str(ROOT / "scripts"))
    from list_thresholds import find_topics

    found = []
    for topic in find_topics():
        module = topic.module.removeprefix("hrsi.")
        if not module.startswith(tuple(areas)):
            continue
        for name in topic.values.__dataclass_fields__:
            value = getattr(topic.values, name)
            numbers = value if isinstance(value, tuple) else (value,)
            if all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers):
                found.append(Threshold(f"{module}.{topic.name}.{name}", topic.values, name, value))
    return found


@contextmanager
def changed(thresholds: Sequence[Threshold], change: str) -> Iterator[None]:
    """Change thresholds while this lasts."""
    for one in thresholds:
        object.__setattr__(one.topic, one.name, one.vary(change))
    try:
        yield
    finally:
        for one in thresholds:
            object.__setattr__(one.topic, one.name, one.value)


@contextmanager
def noted_reads(thresholds: Sequence[Threshold]) -> Iterator[set[str]]:
    """Yield a set to which every read of a threshold adds its home while this lasts."""
    homes = {(type(one.topic), one.name): one.home for one in thresholds}
    kinds = {kind for kind, _ in homes}
    noted: set[str] = set()

    def get(topic: object, name: str) -> object:
        if home := homes.get((type(topic), name)):
            noted.add(home)
        return object.__getattribute__(topic, name)

    for kind in kinds:
        kind.__getattribute__ = get  # type: ignore[method-assign, assignment]
    try:
        yield noted
    finally:
        for kind in kinds:
            del kind.__getattribute__


def note_reads(cases: Sequence[Case], thresholds: Sequence[Threshold]) -> dict[str, list[Case]]:
    """Return for each threshold the cases in which it is read."""
    readers: dict[str, list[Case]] = {one.home: [] for one in thresholds}
    with noted_reads(thresholds) as noted:
        for case in cases:
            noted.clear()
            case.judge()
            for home in noted:
                readers[home].append(case)
    return readers


def find_failing(
    group: Sequence[Threshold], change: str, readers: dict[str, list[Case]], before: dict[str, Outcome]
) -> dict[str, str]:
    """Return for each threshold of a group the first case that changes with it; those without are left out."""
    cases = list({case.name: case for one in group for case in readers[one.home]}.values())
    with changed(group, change):
        failing = next((case.name for case in cases if case.judge() != before[case.name]), None)
    if failing is None:
        return {}
    if len(group) == 1:
        return {group[0].home: failing}
    half = len(group) // 2
    return {
        **find_failing(group[:half], change, readers, before),
        **find_failing(group[half:], change, readers, before),
    }


# ---- table ---------------------------------------------------------------------------------------------------------


def tabulate_codes(cases: Sequence[Case], before: dict[str, Outcome]) -> Iterator[list[str]]:
    """Yield for each code that was raised the cases that change without it, the first three."""
    raised = {case.name: {reason.code for reason in case.find_reasons()} for case in cases}
    for code in sorted(set().union(*raised.values())):
        names = [case.name for case in cases if code in raised[case.name] and case.judge(code) != before[case.name]]
        yield [code, f"{len(names)}: " + "; ".join(names[:3]) if names else "nothing"]


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; ``--docs`` writes it."""
    parser = argparse.ArgumentParser(prog="rules.py", description=__doc__)
    parser.add_argument(
        "--areas", nargs="+", default=AREAS, metavar="MODULE", help="modules whose thresholds are tried"
    )
    parser.add_argument("--seeds", default="300:301", metavar="A:B", help="seeds of the blocks, from A to below B")
    parser.add_argument("--codes", action="store_true", help="codes alone")
    parser.add_argument("--docs", action="store_true", help=f"write {TABLE.name}")
    options = parser.parse_args(words)
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as name:
        cases = list(make_real_cases())
        for seed in range(*map(int, options.seeds.split(":"))):
            for number, (title, codes, inputs) in enumerate(list_inputs(seed)):
                case = record_case(title, codes, inputs, Path(name) / f"{seed}_{number}")
                cases += [] if case is None else [case]
        before = {case.name: case.judge() for case in cases}
        cases = [case for case in cases if before[case.name].level.isdigit()]
        print(f"{len(cases)} cases, {time.process_time():.0f} CPU s", file=sys.stderr, flush=True)
        rows += tabulate_codes(cases, before)
        for row in rows:
            print(" | ".join(row), flush=True)
        if not options.codes:
            thresholds = find_thresholds(options.areas)
            readers = note_reads(cases, thresholds)
            found: dict[str, dict[str, str]] = {one.home: {} for one in thresholds}
            for change in CHANGES:
                for first in range(0, len(thresholds), GROUP):
                    group = thresholds[first : first + GROUP]
                    for home, case_name in find_failing(group, change, readers, before).items():
                        found[home][change] = case_name
                print(f"{change}: {time.process_time():.0f} CPU s", file=sys.stderr, flush=True)
            for one in thresholds:
                told = "; ".join(f"{change}: {case_name}" for change, case_name in found[one.home].items())
                rows.append([one.home, told or "nothing"])
                print(" | ".join(rows[-1]), flush=True)
    if options.docs:
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([["rule", "fails without it"], *rows])


if __name__ == "__main__":
    main()

"""Write `docs/developing/thresholds.md`: every threshold of the product by topic, with value, unit, meaning and origin.

``python scripts/list_thresholds.py`` imports each module that declares a topic (`hrsi_engine.foundation.thresholds`)
and writes the page; ``--check`` only tells whether the page is current. The plugin is left out: it needs QGIS.
"""

import csv
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "developing/thresholds.md"
COMMAND = ".venv/bin/python scripts/list_thresholds.py"
PARTS = ("hrsi_engine", "processing_algorithms")
#: A module that declares a topic has this line; the others are not imported.
DECLARATION = re.compile(r"^@thresholds$", re.MULTILINE)
HEAD = f"""# Thresholds

<!-- Written by `{COMMAND}`: change the declarations and run it again. -->

Every number that HRSI compares with, by topic: the limits of tests, the sizes of windows and buffers, the ends of
iterations. Each is a field of its topic, `NAME.field` in the module below the heading. The origin is a theory, a
publication, the data and date of the tuning, or *judgement* where an engineer chose it and no data decided. *Without
it* names the wrong input (`benchmarks/rules.py`) or the test (`benchmarks/threshold_tests.py`) that fails when the
threshold is switched off. A threshold that nothing needs is a fault, and the number of those without an entry may only
decrease. The unit of a number names what is counted; a meaning that begins with an ellipsis continues that of the row
above.
"""
#: The case or test that fails without a threshold, by its module, topic and field.
CASES = ROOT / "docs" / "developing/rules.csv"
#: Largest number of thresholds without an entry there.
MOST_UNTRIED = 106


class Topic(NamedTuple):
    """A topic of thresholds: its name in the module, and the frozen dataclass that holds them."""

    module: str
    name: str
    values: Any


def declaring_modules() -> Iterator[str]:
    """Yield the names, from `hrsi` on, of the modules that declare topics."""
    for path in sorted(file for part in PARTS for file in (ROOT / part).rglob("*.py")):
        if DECLARATION.search(path.read_text(encoding="utf-8")):
            yield ".".join(("hrsi", *path.relative_to(ROOT).with_suffix("").parts))


def topics_of(module: ModuleType) -> Iterator[Topic]:
    """Yield the topics that a module declares."""
    for name, value in vars(module).items():
        if type(value).__module__ == module.__name__ and is_topic(value):
            yield Topic(module.__name__, name, value)


def is_topic(value: Any) -> bool:
    """Tell whether a value was declared by `thresholds`: a dataclass whose fields all have a meaning."""
    fields = getattr(value, "__dataclass_fields__", {})
    return bool(fields) and all("meaning" in field.metadata for field in fields.values())


def find_topics() -> list[Topic]:
    """Return all topics in the order of their modules."""
    return [topic for name in declaring_modules() for topic in topics_of(import_module(name))]


@cache
def read_cases() -> dict[str, str]:
    """Return the case that fails without each threshold that was tried, by ``module.TOPIC.field``."""
    with CASES.open(encoding="utf-8", newline="") as file:
        return {row["rule"]: row["fails without it"] for row in csv.DictReader(file)}


def name_threshold(topic: Topic, field: str) -> str:
    """Return ``module.TOPIC.field`` of a threshold."""
    return f"{topic.module.removeprefix('hrsi.')}.{topic.name}.{field}"


def count_untried(topics: list[Topic]) -> int:
    """Return the number of thresholds without a case in the table of rules."""
    return sum(
        name_threshold(topic, field) not in read_cases()
        for topic in topics for field in topic.values.__dataclass_fields__
    )  # fmt: skip


def find_faults(topic: Topic) -> Iterator[str]:
    """Yield what a topic lacks: unit, meaning or origin of a field, or a case that needs it."""
    for field in topic.values.__dataclass_fields__.values():
        home = f"{topic.module}.{topic.name}.{field.name}"
        if read_cases().get(name_threshold(topic, field.name)) == "nothing":
            yield f"{home}: no case fails without it: delete it"
        yield from (
            f"{home}: say its {what}" for what in ("meaning", "origin") if not str(field.metadata[what]).strip()
        )
        if not isinstance(field.metadata["unit"], str):
            yield f'{home}: say its unit; "" for a ratio'


def format_value(value: Any) -> str:
    """Return a threshold as the page shows it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}".replace(",", " ")
    if isinstance(value, tuple):
        return ", ".join(map(format_value, value))
    return str(value)


def format_topic(topic: Topic) -> Iterator[str]:
    """Yield the lines of a topic: heading, where it is declared, what it decides, and a table."""
    yield from ("", f"## {topic.name.replace('_', ' ').capitalize()}", "")
    yield from (f"`{topic.module.removeprefix('hrsi.')}`", "")
    yield " ".join((topic.values.__doc__ or "").split()).replace("``", "`")
    yield ""
    yield f"| {topic.name} | value | unit | meaning | origin | without it |"
    yield "|---|---:|---|---|---|---|"
    for field in topic.values.__dataclass_fields__.values():
        texts = field.name, format_value(getattr(topic.values, field.name)), *(
            field.metadata[key] for key in ("unit", "meaning")
        ), field.metadata["origin"], read_cases().get(name_threshold(topic, field.name), "")  # fmt: skip
        yield "| " + " | ".join(text.replace("``", "`").replace("|", "\\|") for text in texts) + " |"


def write_page() -> str:
    """Return the text of the page."""
    lines = [line for topic in find_topics() for line in format_topic(topic)]
    return HEAD + "\n".join(lines) + "\n"


def main() -> None:
    topics = find_topics()
    faults = [fault for topic in topics for fault in find_faults(topic)]
    if (untried := count_untried(topics)) > MOST_UNTRIED:
        faults.append(f"{untried} thresholds are not in {CASES.name}, at most {MOST_UNTRIED}: run benchmarks/rules.py")
    if faults:
        raise SystemExit("\n".join(faults))
    if "--check" in sys.argv[1:]:
        if not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != write_page():
            raise SystemExit(f"{PAGE.relative_to(ROOT)} is not current: run {COMMAND} (or `make thresholds`)")
        return
    PAGE.write_text(write_page(), encoding="utf-8")
    print(PAGE.relative_to(ROOT))


if __name__ == "__main__":
    main()

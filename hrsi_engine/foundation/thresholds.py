"""Thresholds by topic: frozen dataclasses whose fields say unit, meaning and origin.

Each topic is declared once, in the module that decides, under the name by which it is used (``LINKS.closure_px``)::

    @thresholds
    class LINKS:
        ...  # docstring: which pairs of images may hold a block together
        closure_px: float = threshold(3.0, "px", "largest median closure of a sound triangle of images", MANY_DATES)
        fewest_closures: int = threshold(8, "triangles", "closures that a link needs to be judged", JUDGEMENT)

``docs/thresholds.md`` lists all of them (`scripts/list_thresholds.py`). Numbers that are mathematics (a quantile, the
coefficients of a formula) are no thresholds and stay where the formula stands.
"""

from dataclasses import dataclass, field
from typing import Any, TypeVar, dataclass_transform

Value = TypeVar("Value")
Topic = TypeVar("Topic")

#: Origin of a value that was chosen by an engineer's judgement and never tuned on data.
JUDGEMENT = "judgement"


def threshold(value: Value, unit: str, meaning: str, origin: str = JUDGEMENT) -> Value:
    """Declare a threshold as a field of a class made by `thresholds`.

    unit : ``"px"``, ``"m"``, ``"sigma"``, ``"matches"``; empty for a ratio
    meaning : what is compared with it, and what follows
    origin : a theory or publication, or the data and date by which it was tuned, or `JUDGEMENT`
    """
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "origin": origin})


@dataclass_transform(frozen_default=True)  # to type checkers each `threshold` is a plain default
def thresholds(topic: type[Topic]) -> type[Topic]:
    """Make a topic a frozen dataclass, with a docstring and `threshold` for each field; return its only instance.

    To type checkers it stays the class, whose fields are attributes. Of a class not in capitals no instance is made.
    """
    made: Any = dataclass(frozen=True)(topic)
    if not topic.__doc__ or topic.__doc__.startswith(f"{topic.__name__}("):
        raise TypeError(f"{topic.__name__}: describe in a docstring what its thresholds decide")
    bare = [name for name, declared in made.__dataclass_fields__.items() if "meaning" not in declared.metadata]
    if bare:
        raise TypeError(f"{topic.__name__}.{bare[0]}: declare it by `threshold`, with unit, meaning and origin")
    return made() if topic.__name__.isupper() else made

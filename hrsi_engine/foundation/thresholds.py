"""Thresholds by topic: frozen dataclasses whose fields have a unit, a meaning and an origin.

Each topic is declared once, in the module that uses it, as a constant (``EPIPOLAR.mode_px``)::

    @thresholds
    class LINKS:
        ...  # docstring: conditions for links between images to be used
        closure_px: float = threshold(3.0, "px", "largest median closure of a triangle of images", MANY_DATES)
        fewest_closures: int = threshold(8, "points", "fewest common points of a triangle that is tested", JUDGEMENT)

``docs/developing/thresholds.md`` lists all of them (`scripts/list_thresholds.py`). Numbers of mathematical origin
(a quantile, the coefficients of a formula) are not thresholds and are written where they are used.
"""

from dataclasses import dataclass, field
from typing import Any, TypeVar, dataclass_transform

Value = TypeVar("Value")
Topic = TypeVar("Topic")

#: Origin of a value that was chosen by engineering judgement and never tuned on data.
JUDGEMENT = "judgement"


def threshold(value: Value, unit: str, meaning: str, origin: str = JUDGEMENT) -> Value:
    """Declare a threshold as a field of a class made by `thresholds`.

    unit : ``"px"``, ``"m"``, ``"sigma"``, ``"matches"``; empty for a ratio
    meaning : the quantity in standard terms, as a noun phrase, and what happens beyond the value
    origin : a theory or publication, or the data and date by which it was tuned, or `JUDGEMENT`
    """
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "origin": origin})


@dataclass_transform(frozen_default=True)  # type checkers treat each `threshold` as a plain default
def thresholds(topic: type[Topic]) -> type[Topic]:
    """Make a class of `threshold` fields with a docstring a frozen dataclass, and return its only instance.

    Type checkers see the class, with the fields as attributes. If its name is not in capitals, the class is returned.
    """
    frozen_class: Any = dataclass(frozen=True)(topic)
    if not topic.__doc__ or topic.__doc__.startswith(f"{topic.__name__}("):
        raise TypeError(f"{topic.__name__}: describe in a docstring what its thresholds decide")
    bare = [name for name, declared in frozen_class.__dataclass_fields__.items() if "meaning" not in declared.metadata]
    if bare:
        raise TypeError(f"{topic.__name__}.{bare[0]}: declare it by `threshold`, with unit, meaning and origin")
    return frozen_class() if topic.__name__.isupper() else frozen_class

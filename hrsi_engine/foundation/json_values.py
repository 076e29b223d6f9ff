"""Conversion of values to JSON text, in this module only, so that no NaN (which JSON does not have) is ever written."""

import json
import math
from collections.abc import Mapping
from enum import Enum
from functools import partial
from typing import Any

import numpy as np

_READY = frozenset({str, int, bool, type(None)})


def json_ready(value: Any) -> Any:
    """Return a value made of dicts, lists, texts, numbers, bools and None only; NaN and infinities become None."""
    if type(value) in _READY:  # the most frequent case in a report
        return value
    if type(value) is float:  # the second most frequent case
        return value if math.isfinite(value) else None
    if type(value) is list and set(map(type, value)) == {float} and math.isfinite(sum(value)):  # an RPC, a matrix
        return value.copy()
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return json_ready(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [json_ready(item) for item in value]
    if isinstance(value, Enum):
        return json_ready(value.value)
    if isinstance(value, np.generic):
        return json_ready(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (str, int, bool)) else str(value)


def json_text(value: Any, indent: int | None = None, sort_keys: bool = False) -> str:
    """Return any value as JSON text, converted by `json_ready`."""
    return _encoder(indent=indent, sort_keys=sort_keys).encode(json_ready(value))


_encoder = partial(json.JSONEncoder, allow_nan=False, default=json_ready)
_of_lines = _encoder(ensure_ascii=False)


def json_lines(value: Mapping[str, Any]) -> str:
    """Return a mapping as JSON text with one line for each value, and one for each item of values that are containers.

    Each image of a report is thus one line. Deeper indentation would make Python use its slow, uncompiled encoder.
    """
    return "{\n" + ",\n".join(f" {_dump(str(key))}: {_in_lines(item)}" for key, item in value.items()) + "\n}"


def _in_lines(value: Any) -> str:
    """Return a value as JSON text; a mapping or sequence that is not empty has one line for each item."""
    value = value if isinstance(value, (Mapping, list, tuple)) else json_ready(value)
    if isinstance(value, Mapping) and value:
        return "{\n" + ",\n".join(f"  {_dump(str(key))}: {_dump(item)}" for key, item in value.items()) + "\n }"
    if isinstance(value, (list, tuple)) and value:
        return "[\n" + ",\n".join(f"  {_dump(item)}" for item in value) + "\n ]"
    return _dump(value)


def _dump(value: Any) -> str:
    """Return a value as JSON on one line; `json_ready` converts it only if encoding fails, which is rare."""
    try:
        return _of_lines.encode(value)
    except (TypeError, ValueError):  # a key that is not a string, or a number that is not finite
        return _of_lines.encode(json_ready(value))

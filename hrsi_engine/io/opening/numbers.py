"""Parsing of numbers in text: the complete text is a number or none, so ``43,5`` is never read as 43."""

import math
import re

_COMMAS = re.compile(r"\s*[+-]?\d+,\d+\s+[+-]?\d+,\d+(\s|$)", re.ASCII)


def parse_finite(text: str) -> float | None:
    """Return the number that the complete text is, in ASCII; None for anything else.

    So ``43,5``, ``43.5abc``, ``1_000``, ``0x10``, full-width digits, ``nan`` and ``1e400`` are no numbers.
    """
    try:
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def has_decimal_commas(line: str) -> bool:
    """Return whether a line, separated by blanks or commas, begins with two decimal-comma numbers (``43,5 7,1``)."""
    return _COMMAS.match(line) is not None

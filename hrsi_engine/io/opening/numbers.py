"""Parsing of numbers in text: the complete text is a number or none, so ``43,5`` is never read as 43."""

import math
import re

_COMMAS = re.compile(r"\s*[+-]?\d+,\d+\s+[+-]?\d+,\d+(\s|$)", re.ASCII)


def parse_finite(text: str | None) -> float | None:
    """Return the number that the complete text is, in ASCII; None for anything else, and for None.

    So ``43,5``, ``43.5abc``, ``1_000``, ``0x10``, full-width digits, ``nan`` and ``1e400`` are no numbers.
    """
    try:
        value = float(text) if text and text.isascii() and "_" not in text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


_ANGLE = re.compile(
    r"""\s*([NSEW]?)\s*([+-]?)(\d+(?:\.\d+)?)\s*[°º:d\s]\s*(?:(\d+(?:\.\d+)?)\s*(?:['′’:m\s]|$)\s*)?"""
    r"""(?:(\d+(?:\.\d+)?)\s*(?:["″”s]|''|$)?)?\s*([NSEW]?)\s*""",
    re.IGNORECASE,
)


def parse_angle(text: str) -> float | None:
    """Return the decimal degrees of degrees, minutes and seconds; None for anything else.

    ``43°31'30.5"N``, ``43:31:30.5``, ``W 5 26 24``: with a sign of degrees, colons, or a letter of the hemisphere.
    """
    match = _ANGLE.fullmatch(text.replace(",", "."))
    if match is None or not (match[1] or match[6] or any(sign in text for sign in "°º:")) or (match[1] and match[6]):
        return None
    degrees, minutes, seconds = (float(part or 0.0) for part in match.group(3, 4, 5))
    if minutes >= 60.0 or seconds >= 60.0:
        return None
    negative = match[2] == "-" or (match[1] or match[6]).upper() in ("S", "W")
    return (-1.0 if negative else 1.0) * (degrees + minutes / 60.0 + seconds / 3600.0)


def has_decimal_commas(line: str) -> bool:
    """Return whether a line, separated by blanks or commas, begins with two decimal-comma numbers (``43,5 7,1``)."""
    return _COMMAS.match(line) is not None

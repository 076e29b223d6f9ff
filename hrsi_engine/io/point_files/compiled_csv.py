"""The compiled loops of `plain_csv`: where fields begin and end, and what they say."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

_NEWLINE, _RETURN, _TAB, _BLANK, _QUOTE, _DELETE = 10, 13, 9, 32, 34, 127
_PLUS, _MINUS, _POINT, _ZERO, _NINE = 43, 45, 46, 48, 57
_EXACT_POWER = 22  # largest power of ten that is a double without rounding
_POWERS = 10.0 ** np.arange(_EXACT_POWER + 1)
_EXACT_MANTISSA = 2**53
_MOST_DIGITS = 18  # of a mantissa that fits in 64 bits
_LARGEST_EXPONENT = 400


@njit(cache=True, nogil=True)
def split_fields(data: np.ndarray, separator: int, place: np.ndarray) -> int:
    """Find the fields of lines, without the blanks around them; return the number of rows, -1 where not plain.

    Parameters
    ----------
    data : (b,) bytes, a line break last
    separator : byte between fields
    place : (2, width, rows) first byte of each field and the one behind it, filled here
    """
    width = place.shape[1]
    row, column, begin, filled = 0, 0, 0, False
    for i in range(len(data)):
        byte = data[i]
        if byte in (separator, _NEWLINE):
            stop = i
            if byte == _NEWLINE and stop > begin and data[stop - 1] == _RETURN:
                stop -= 1
            while begin < stop and (data[begin] == _BLANK or data[begin] == _TAB):
                begin += 1
            while begin < stop and (data[stop - 1] == _BLANK or data[stop - 1] == _TAB):
                stop -= 1
            if byte == _NEWLINE and column == 0 and begin == stop:  # an empty line
                begin = i + 1
                continue
            if column == width:
                return -1
            place[0, column, row], place[1, column, row] = begin, stop
            filled |= begin < stop
            column, begin = column + 1, i + 1
            if byte == _NEWLINE:
                if column != width or not filled:
                    return -1
                row, column, filled = row + 1, 0, False
        elif byte == _RETURN:
            if data[i + 1] != _NEWLINE:
                return -1
        elif byte == _QUOTE or byte >= _DELETE or (byte < _BLANK and byte != _TAB):
            return -1
    return row


@njit(cache=True, nogil=True)
def parse_numbers(data: np.ndarray, start: np.ndarray, end: np.ndarray, values: np.ndarray, others: np.ndarray) -> int:
    """Read decimal numbers; return how many are left to others, -1 where one is no number.

    Parameters
    ----------
    data : (b,) bytes
    start, end : (n,) of the fields
    values : (n,) the numbers, filled here; NaN where a field is empty
    others : (n,) the rows that take more than one rounding, filled here
    """
    left = 0
    for row in range(len(start)):
        i, stop = start[row], end[row]
        if i == stop:
            values[row] = np.nan
            continue
        negative = data[i] == _MINUS
        if negative or data[i] == _PLUS:
            i += 1
        mantissa: Any = np.int64(0)
        digits, power, any_digit, behind = 0, 0, False, False
        while i < stop:
            byte = data[i]
            if _ZERO <= byte <= _NINE:
                any_digit = True
                if digits < _MOST_DIGITS:
                    mantissa = mantissa * np.int64(10) + np.int64(byte) - np.int64(_ZERO)
                digits += mantissa > 0
                power -= behind
            elif byte == _POINT and not behind:
                behind = True
            else:
                break
            i += 1
        if not any_digit:
            return -1
        if i < stop:  # e, E and an exponent
            if data[i] != 101 and data[i] != 69:
                return -1
            i += 1
            below = i < stop and data[i] == _MINUS
            if i < stop and (below or data[i] == _PLUS):
                i += 1
            if i == stop:
                return -1
            exponent: Any = np.int64(0)
            while i < stop:
                if not (_ZERO <= data[i] <= _NINE):
                    return -1
                exponent = np.int64(min(exponent * 10 + data[i] - _ZERO, _LARGEST_EXPONENT))
                i += 1
            power += -exponent if below else exponent
        if digits >= _MOST_DIGITS or mantissa > _EXACT_MANTISSA or abs(power) > _EXACT_POWER:
            others[left] = row
            left += 1
            continue
        value = float(mantissa)
        value = value / _POWERS[-power] if power < 0 else value * _POWERS[power]
        values[row] = -value if negative else value
    return left


@njit(cache=True, nogil=True)
def copy_texts(data: np.ndarray, start: np.ndarray, end: np.ndarray, texts: np.ndarray) -> None:
    """Copy ASCII fields ``(n,)`` to characters ``(n, longest)``, which are zero."""
    for row in range(len(start)):
        for i in range(start[row], end[row]):
            texts[row, i - start[row]] = data[i]

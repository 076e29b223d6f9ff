"""Points as plain text whose first line does not name the columns, or does so between blanks.

Columns are told by their contents where only one meaning is possible: an id and an image beside two numbers are a
measurement; an id and three numbers a ground point, in degrees where one column goes beyond 90 (a longitude) or in
metres where both are large. Everything else needs names: ``FILE|columns=id,lat,lon,height``.
"""

from collections.abc import Iterable, Sequence
from functools import partial
from itertools import islice

import numpy as np

from ...foundation.errors import InputError
from ..opening.budgets import FILE_BUDGETS, require_size
from ..opening.numbers import parse_finite
from .table import FIELDS, MAY_BE_INFINITE, NUMBER_FIELDS, PointTable, match_fields, parse_numbers, strip_texts

NAMED_COLUMNS = "columns="  #: begins the names of the columns of a file
ADVICE = (
    "add a header line, or name the columns: FILE|columns=id,lon,lat,height (or id,x,y,height; id,image,sample,line)"
)


def read_plain_text(path: str, lines: Iterable[str], names: Sequence[str] = ()) -> PointTable:
    """Return the known fields of a text with a point a line, its columns named, or told by what they hold.

    Raises `InputError` naming the line where it is damaged, or the columns where they cannot be told.
    """
    require_size(path, "points")
    most = FILE_BUDGETS.gcp_rows
    numbered = [(number, line) for number, line in enumerate(islice(lines, most), 1) if line.strip() and line[0] != "#"]
    if len(numbered) == most:
        raise InputError(f"{path}: has {most} lines or more, and no names of columns: add a header line")
    separator = next((sign for sign in (";", "\t", ",") if numbered and sign in numbered[0][1]), None)
    rows = [[text.strip().strip('"') for text in line.strip().split(separator)] for _, line in numbered]
    if rows and not names and not any(parse_finite(text.replace(",", ".")) is not None for text in rows[0]):
        names, rows, numbered = rows[0], rows[1:], numbered[1:]
        if not match_fields(names):
            raise InputError(
                f"{path}: its columns are called {', '.join(names)}, which are no fields of points: call them id, lon, "
                f"lat, height (or x, y), image, sample, line, or {ADVICE[23:]}"
            )
    width = len(names) or (len(rows[0]) if rows else 0)
    wrong = next((number for (number, _), row in zip(numbered, rows, strict=True) if len(row) != width), None)
    if wrong is not None:
        raise InputError(f"{path}, line {wrong}: has not the {width} columns of the others: correct it")
    names = [name.strip() for name in names] or tell_columns(path, rows)
    found = match_fields(names)
    if not found:
        raise InputError(f"{path}: {', '.join(names)} are no fields of points ({', '.join(list(FIELDS)[:12])} …)")
    columns: dict[str, np.ndarray] = {}
    for field, column in found.items():
        texts = [row[column] for row in rows]
        where = partial(lambda field, index: f"{path}, field {field!r}, line {numbered[index][0]}", field)
        columns[field] = (
            parse_numbers(texts, where, separator != ",", field in MAY_BE_INFINITE)
            if field in NUMBER_FIELDS
            else strip_texts(texts, path, field)
        )
    notes = (f"{path}: read as the columns {', '.join(names)}",)
    return PointTable(path, columns, tuple(names), lambda row: f"line {numbered[row][0]}", notes=notes)


def tell_columns(path: str, rows: Sequence[Sequence[str]]) -> list[str]:
    """Return what columns without names hold; raise `InputError` where more than one meaning is possible."""
    texts = list(zip(*rows, strict=True))
    numbers = [[parse_finite(text.replace(",", ".")) for text in column] for column in texts]
    is_number = [None not in column for column in numbers]
    if len(texts) == 4 and is_number[1:] == [False, True, True]:
        ids, images = (len(set(column)) for column in texts[:2])
        return ["id", "image", "sample", "line"] if is_number[0] or ids >= images else ["image", "id", "sample", "line"]
    if len(texts) == 4 and is_number[1:] == [True] * 3:
        largest = [max(abs(value or 0.0) for value in column) for column in numbers[1:3]]
        if min(largest) > 360.0:
            return ["id", "x", "y", "height"]
        if max(largest) <= 180.0 and (largest[0] > 90.0) != (largest[1] > 90.0):
            return ["id", "lon", "lat", "height"] if largest[0] > 90.0 else ["id", "lat", "lon", "height"]
    first_row = ", ".join(rows[0]) if rows else "nothing"
    raise InputError(f"{path}: has no header line, and its {len(texts)} columns ({first_row}) are ambiguous: {ADVICE}")

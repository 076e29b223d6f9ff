"""CSV and plain text: columns separated by commas, semicolons, tabs or blanks; UTF-8 (BOM or not), UTF-16 or Latin-1.

The first line names the columns. If there are no names, or blanks separate them, the columns are identified by their
contents if only one meaning is possible: id, image and two numbers are a measurement; an id and three numbers are a
ground point, in degrees if one column exceeds 90 (a longitude), or in metres if both are large. All other files need
names: ``FILE|columns=id,lat,lon,height``.

Decimal commas are read if the separator is not the comma. The file is read in chunks of rows, and only known fields
are kept, so that millions of image points need little more memory than their columns. NumPy's reader (`numpy.loadtxt`)
reads simple files in half the time; Python's `csv` reads all others and determines their errors.

Tables are written completely or not at all.
"""

import codecs
import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import Any, BinaryIO, TextIO

import numpy as np

from ...block.points import ImagePoints
from ...foundation.errors import InputError
from ..opening.budgets import FILE_BUDGETS, MOST_BYTES, require_texts
from ..opening.datasets import read_head
from ..opening.files import parse_angle, parse_finite, require_size
from ..safety.replacing import replacing
from . import table

NAMED_COLUMNS = "columns="  #: prefix of the names of a file's columns
HOW_TO_NAME = "name the columns: FILE|columns=id,lon,lat,height (or id,x,y,height; id,image,sample,line)"
_CHUNK_ROWS = 5_000  # their texts fit in the processor's cache: nearly twice as fast as 100 000
_NUMPY_ROWS = 50_000  # rows that NumPy's reader reads at once


def read(path: str, layer: str = "", chosen: Mapping[str, str] | None = None) -> table.PointTable:
    """Return the known fields of a CSV file; raise `InputError` with line and field if it is damaged.

    ``layer`` may name the columns (``columns=id,lon,lat,height``); ``chosen`` are fields with other names in the file,
    see `match_fields`.
    """
    try:
        encoding = _find_encoding(path)
        if layer.startswith(NAMED_COLUMNS):
            with _open_text(path, encoding) as file:
                return read_plain_text(path, file, layer.removeprefix(NAMED_COLUMNS).split(","))
        return _read_table(path, encoding, chosen or {})
    except (OSError, UnicodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error}): check the file") from None


def _read_table(path: str, encoding: str, fields_given: Mapping[str, str]) -> table.PointTable:
    rows = _read_rows(path, encoding)
    names = [name.strip() for name in next(rows, [])]
    result = table.match_fields(names, fields_given, path)
    if not result:
        with _open_text(path, encoding) as file:
            return read_plain_text(path, file)
    row_name = partial(_row_name, path, encoding)
    separator = _find_separator(path, encoding)
    plain = _columns_by_numpy(path, encoding, separator, len(names), result)
    if plain is not None:
        return table.PointTable(path, plain, tuple(names), row_name)
    decimal_comma = separator != ","
    parts: dict[str, list[np.ndarray]] = {field: [] for field in result}
    rows_read = 0
    while chunk := list(islice(rows, _CHUNK_ROWS)):
        texts = _transpose(path, chunk, len(names), row_name, rows_read)
        for field, column in result.items():
            place_of = partial(_name_field, path, field, row_name, rows_read)
            parts[field].append(table.parse_column(field, texts[column], path, place_of, decimal_comma))
        rows_read += len(chunk)
    columns = {field: _join_parts(path, field, parts.pop(field)) if rows_read else np.empty(0) for field in result}
    return table.PointTable(path, columns, tuple(names), row_name)


def _columns_by_numpy(
    path: str, encoding: str, separator: str, width: int, result: Mapping[str, int]
) -> dict[str, np.ndarray] | None:
    """Return the columns by NumPy's reader; None if the file has quotes, or numbers that are missing or invalid."""
    kinds = {column: "f8" if field in table.NUMBER_FIELDS else "O" for field, column in result.items()}
    if "f8" not in kinds.values():  # empty rows would not be noticed
        return None
    layout = [(str(column), kinds.get(column, "U1")) for column in range(width)]
    parts: dict[str, list[np.ndarray]] = {field: [] for field in result}
    with _open_text(path, encoding) as file:
        if '"' in next(line for line in file if _is_header(line)):
            return None
        while lines := list(islice(file, _NUMPY_ROWS)):
            text = "".join(lines)
            if text.isspace():
                continue
            if '"' in text or "\0" in text:
                return None
            try:
                rows = np.loadtxt(lines, layout, comments=None, delimiter=separator, ndmin=1, encoding=encoding)
            except ValueError:
                return None
            for field, column in result.items():
                values = rows[str(column)]
                if field not in table.NUMBER_FIELDS:
                    values = table.strip_texts(values.tolist(), path, field)
                elif not np.isfinite(values).all():
                    return None
                parts[field].append(np.ascontiguousarray(values))
    return (
        {field: _join_parts(path, field, parts.pop(field)) for field in result} if parts[next(iter(result))] else None
    )


def _name_field(path: str, field: str, row_name: Callable[[int], str], rows_read: int, index: int) -> str:
    return f"{path}, field {field!r}, {row_name(rows_read + index)}"


def _join_parts(path: str, field: str, parts: list[np.ndarray]) -> np.ndarray:
    if parts[0].dtype.kind == "U":
        require_texts(path, field, sum(map(len, parts)), max(part.dtype.itemsize // 4 for part in parts))
    return np.concatenate(parts)


def _open_bytes(path: str) -> BinaryIO:
    """Return an opened file; a file of GDAL's virtual file systems is read as a whole."""
    if not path.startswith("/vsi"):
        return open(path, "rb")
    require_size(path, "points")
    return io.BytesIO(read_head(path, MOST_BYTES["points"]))


def _open_text(path: str, encoding: str) -> TextIO:
    return io.TextIOWrapper(_open_bytes(path), encoding=encoding, newline="")


def read_lines(path: str, largest: int) -> list[str]:
    """Return the first lines of a text that are neither empty nor comments; raise `InputError` if it is no text."""
    try:
        with _open_text(path, _find_encoding(path)) as file:
            return [line.strip() for line in islice(filter(_is_header, file), largest)]
    except (OSError, UnicodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error}): check the file") from None


def _find_separator(path: str, encoding: str) -> str:
    """Return the separator that occurs most in the header line."""
    with _open_text(path, encoding) as file:
        header = next((line for line in file if _is_header(line)), "")
    return max((",", ";", "\t"), key=header.count)


def _is_header(line: str) -> bool:
    """Return whether a line is neither empty nor a comment before the header."""
    return bool(line.strip()) and not line.startswith("#")


def _read_rows(path: str, encoding: str, line_numbers: list[int] | None = None) -> Iterator[list[str]]:
    """Yield the header and every row that is not empty; append the last line of each to ``line_numbers`` if given."""
    separator = _find_separator(path, encoding)
    with _open_text(path, encoding) as file:
        previous = next((number for number, line in enumerate(file) if _is_header(line)), 0)
        file.seek(0)
        reader = csv.reader(islice(file, previous, None), delimiter=separator, skipinitialspace=True)
        for row in reader:
            if row and (row[0] or any(row)):
                if line_numbers is not None:
                    line_numbers.append(reader.line_num + previous)
                yield row


def _transpose(
    path: str, rows: list[list[str]], width: int, row_name: Callable[[int], str], rows_read: int
) -> list[tuple[str, ...]]:
    """Return the columns of rows that follow ``rows_read`` others; short rows are completed with empty fields."""
    if set(map(len, rows)) != {width}:
        index = next((index for index, row in enumerate(rows) if any(row[width:])), None)
        if index is not None:
            raise InputError(
                f"{path}, {row_name(rows_read + index)}: has {len(rows[index])} fields, the header {width}: quote "
                "texts with separators, and separate by semicolons where numbers have decimal commas"
            )
        rows = [row[:width] + [""] * (width - len(row)) for row in rows]
    return list(zip(*rows, strict=True))


def _row_name(path: str, encoding: str, row: int) -> str:
    """Return the line of a row, by reading the file again: only error messages need it."""
    numbers: list[int] = []
    next(islice(_read_rows(path, encoding, numbers), row + 1, None), None)
    return f"line {numbers[-1]}"


def _find_encoding(path: str) -> str:
    """Return UTF-8 or UTF-16 by the byte order mark, UTF-8 if all bytes are valid, otherwise Latin-1.

    This reads the complete file: raises `InputError` for one without line breaks, which would be read as one line.
    """
    decoder, is_utf8, unbroken = codecs.getincrementaldecoder("utf-8")(), True, 0
    marks = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
    with _open_bytes(path) as file:
        head = file.read(4)
        file.seek(0)
        marked = next((name for mark, name in marks if head.startswith(mark)), None)
        while block := file.read(1 << 20):
            unbroken = 0 if b"\n" in block or b"\r" in block else unbroken + len(block)
            if unbroken > FILE_BUDGETS.line_characters:
                raise InputError(
                    f"{path}: contains {unbroken} bytes without a line break: it is no table, check the file"
                )
            if marked is None and is_utf8:
                try:
                    decoder.decode(block, final=len(block) < 1 << 20)
                except UnicodeDecodeError:
                    is_utf8 = False
    return marked or ("utf-8" if is_utf8 else "latin-1")


ENDINGS = (".csv", ".tsv", ".txt", ".tab")
READER = table.PointReader(
    "CSV", lambda _path, name, _head: name.removesuffix(".gz").endswith(ENDINGS), read, chooses_fields=True
)


def write_csv(path: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a table as CSV.

    Parameters
    ----------
    path : str
        The file, replaced in one step.
    header : sequence of str
        Names of the columns.
    rows : iterable of sequences
        Their values.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_measurements(path: str, points: ImagePoints) -> None:
    """Write image points: id, image, sample, line, sigma, kind, and quality if any is known."""
    columns = {
        "id": points.ids,
        "image": points.image_ids,
        "sample": points.xy[:, 0],
        "line": points.xy[:, 1],
        "sigma": points.sigma_px,
        "kind": points.kind,
    }
    if np.isfinite(points.quality).any():
        columns["quality"] = points.quality
    write_csv(path, list(columns), zip(*(column.tolist() for column in columns.values()), strict=True))


def read_plain_text(path: str, lines: Iterable[str], names: Sequence[str] = ()) -> table.PointTable:
    """Return the known fields of a text with one point in each line; unnamed columns are identified by their contents.

    Raises `InputError` with the line that is damaged, or with the columns if they are ambiguous.
    """
    require_size(path, "points")
    limit = FILE_BUDGETS.gcp_rows
    numbered = [
        (number, line) for number, line in enumerate(islice(lines, limit), 1) if line.strip() and line[0] != "#"
    ]
    if len(numbered) == limit:
        raise InputError(f"{path}: has {limit} lines or more, and no names of columns: add a header line")
    if len(numbered) > 1 and numbered[0][1].strip() == str(len(numbered) - 1):  # the number of points that follow
        numbered = numbered[1:]
    separator, rows = split_rows([line for _, line in numbered])
    if titles := count_header_rows(rows, separator):
        header, rows, numbered = rows[titles - 1], rows[titles:], numbered[titles:]
        if not names and not table.match_fields(header):
            raise InputError(
                f"{path}: its columns are called {', '.join(header)}, which are no fields of points: call them id, "
                f"lon, lat, height (or x, y), image, sample, line, or name those meant: FILE|columns=id={header[0]},…"
            )
        names = names or header
    width = len(names) or (len(rows[0]) if rows else 0)
    for (number, _), row in zip(numbered, rows, strict=True):
        if len(row) != width:
            expected = "columns are named" if names else "are in the first row"
            raise InputError(f"{path}, line {number}: has {len(row)} columns, but {width} {expected}: correct it")
    names = [name.strip() for name in names] or _tell_columns(path, rows)
    result = table.match_fields(names)
    if not result:
        raise InputError(f"{path}: {', '.join(names)} are no fields of points ({', '.join(list(table.FIELDS)[:12])} …)")
    columns: dict[str, np.ndarray] = {}
    for field, column in result.items():
        place_of = partial(lambda field, index: f"{path}, field {field!r}, line {numbered[index][0]}", field)
        columns[field] = table.parse_column(field, [row[column] for row in rows], path, place_of, separator != ",")
    notes = (f"{path}: read as the columns {', '.join(names)}",)
    return table.PointTable(path, columns, tuple(names), lambda row: f"line {numbered[row][0]}", notes=notes)


def split_rows(lines: Sequence[str]) -> tuple[str | None, list[list[str]]]:
    """Return the separator of a text (None for blanks), and its rows; tabs may be repeated as blanks are.

    Titles above a table need not have its separators: the separator is in most lines.
    """
    separator = next((sign for sign in (";", "\t", ",") if sum(sign in line for line in lines) * 2 > len(lines)), None)
    if separator == "\t" and len({line.strip().count("\t") for line in lines}) > 1:
        separator = None if len({len(line.split()) for line in lines}) == 1 else separator
    ends = " \r\n" if separator == "\t" else None  # the last fields may be empty
    return separator, [[text.strip().strip('"') for text in line.strip(ends).split(separator)] for line in lines]


def parse_field(text: str, separator: str | None) -> float | None:
    """Return the number of a field, which may have a decimal comma or be an angle; None for a text."""
    value = parse_finite(text if separator == "," else text.replace(",", "."))
    return parse_angle(text) if value is None else value


def count_header_rows(rows: Sequence[Sequence[str]], separator: str | None) -> int:
    """Return the number of rows without any number above the others: the last names the columns, others are titles."""
    has_number = (any(parse_field(text, separator) is not None for text in row) for row in rows)
    return next((number for number, found in enumerate(has_number) if found), 0)


def _tell_columns(path: str, rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the names of unnamed columns by their contents; raise `InputError` if several meanings are possible."""
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
    raise InputError(
        f"{path}: has no header line, and its {len(texts)} columns ({first_row}) are ambiguous: add a header "
        f"line, or {HOW_TO_NAME}"
    )

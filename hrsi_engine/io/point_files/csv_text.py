"""CSV and plain text: columns between commas, semicolons, tabs or blanks; UTF-8 (BOM or not), UTF-16 or Latin-1.

The first line names the columns. Where none does, they are told by their contents (`plain_text`).

Decimal commas are understood where the separator is not the comma. The file is read in chunks of rows, and only
the fields that are known are kept, so that millions of image points need little more memory than their columns. NumPy's
reader (`numpy.loadtxt`) takes what it understands in half the time; Python's `csv` decides what every other file
means and what is wrong with it.

Written tables appear whole or not at all.
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
from ..opening.budgets import FILE_BUDGETS, MOST_BYTES, require_size, require_texts
from ..rpc_files.content import read_head
from ..safety.replacing import replacing
from .plain_text import NAMED_COLUMNS, read_plain_text
from .table import MAY_BE_INFINITE, NUMBER_FIELDS, PointReader, PointTable, match_fields, parse_numbers, strip_texts

_CHUNK_ROWS = 5_000  # their texts fit in the processor's cache: nearly twice as fast as 100 000
_NUMPY_ROWS = 50_000  # at once by NumPy's reader


def read(path: str, layer: str = "", renamed: Mapping[str, str] | None = None) -> PointTable:
    """Return the known fields of a CSV file; raise `InputError` naming line and field where it is damaged.

    ``layer`` may name the columns (``columns=id,lon,lat,height``); ``renamed`` are fields (lower case) that a program
    calls otherwise.
    """
    try:
        encoding = _find_encoding(path)
        if layer.startswith(NAMED_COLUMNS):
            with _open_text(path, encoding) as file:
                return read_plain_text(path, file, layer.removeprefix(NAMED_COLUMNS).split(","))
        return _read_table(path, encoding, renamed or {})
    except (OSError, UnicodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error}): check the file") from None


def _read_table(path: str, encoding: str, renamed: Mapping[str, str]) -> PointTable:
    rows = _read_rows(path, encoding)
    names = [name.strip() for name in next(rows, [])]
    found = match_fields([renamed.get(name.lower(), name) for name in names])
    if not found:
        with _open_text(path, encoding) as file:
            return read_plain_text(path, file)
    row_name = partial(_row_name, path, encoding)
    separator = _find_separator(path, encoding)
    plain = _columns_by_numpy(path, encoding, separator, len(names), found)
    if plain is not None:
        return PointTable(path, plain, tuple(names), row_name)
    decimal_comma = separator != ","
    parts: dict[str, list[np.ndarray]] = {field: [] for field in found}
    done = 0
    while chunk := list(islice(rows, _CHUNK_ROWS)):
        texts = _transpose(path, chunk, len(names), row_name, done)
        for field, column in found.items():
            if field in NUMBER_FIELDS:
                where = partial(_name_field, path, field, row_name, done)
                values = parse_numbers(texts[column], where, decimal_comma, field in MAY_BE_INFINITE)
            else:
                values = strip_texts(texts[column], path, field)
            parts[field].append(values)
        done += len(chunk)
    columns = {field: _join_parts(path, field, parts.pop(field)) if done else np.empty(0) for field in found}
    return PointTable(path, columns, tuple(names), row_name)


def _columns_by_numpy(
    path: str, encoding: str, separator: str, width: int, found: Mapping[str, int]
) -> dict[str, np.ndarray] | None:
    """Return the columns of a file without quotes whose numbers are all there; None for any other, or a wrong one."""
    kinds = {column: "f8" if field in NUMBER_FIELDS else "O" for field, column in found.items()}
    if "f8" not in kinds.values():  # empty rows would not show
        return None
    layout = [(str(column), kinds.get(column, "U1")) for column in range(width)]
    parts: dict[str, list[np.ndarray]] = {field: [] for field in found}
    with _open_text(path, encoding) as file:
        if '"' in next(line for line in file if _is_header(line)):
            return None
        while lines := list(islice(file, _NUMPY_ROWS)):
            text = "".join(lines)
            if text.isspace():
                continue
            if '"' in text or "\0" in text:
                return None
            filled = [line for line in lines if not line.isspace()]
            try:
                rows = np.loadtxt(filled, layout, comments=None, delimiter=separator, ndmin=1, encoding=encoding)
            except ValueError:
                return None
            for field, column in found.items():
                values = rows[str(column)]
                if field not in NUMBER_FIELDS:
                    values = strip_texts(values.tolist(), path, field)
                elif not np.isfinite(values).all():
                    return None
                parts[field].append(np.ascontiguousarray(values))
    return {field: _join_parts(path, field, parts.pop(field)) for field in found} if parts[next(iter(found))] else None


def _name_field(path: str, field: str, row_name: Callable[[int], str], done: int, index: int) -> str:
    return f"{path}, field {field!r}, {row_name(done + index)}"


def _join_parts(path: str, field: str, parts: list[np.ndarray]) -> np.ndarray:
    if parts[0].dtype.kind == "U":
        require_texts(path, field, sum(map(len, parts)), max(part.dtype.itemsize // 4 for part in parts))
    return np.concatenate(parts)


def _open_bytes(path: str) -> BinaryIO:
    """Return an opened file; one of GDAL's virtual file systems comes as a whole."""
    if not path.startswith("/vsi"):
        return open(path, "rb")
    require_size(path, "points")
    return io.BytesIO(read_head(path, MOST_BYTES["points"]))


def _open_text(path: str, encoding: str) -> TextIO:
    return io.TextIOWrapper(_open_bytes(path), encoding=encoding, newline="")


def _find_separator(path: str, encoding: str) -> str:
    """Return the separator that occurs most in the header line."""
    with _open_text(path, encoding) as file:
        header = next((line for line in file if _is_header(line)), "")
    return max((",", ";", "\t"), key=header.count)


def _is_header(line: str) -> bool:
    """Whether a line is neither empty nor a comment before the header."""
    return bool(line.strip()) and not line.startswith("#")


def _read_rows(path: str, encoding: str, line_numbers: list[int] | None = None) -> Iterator[list[str]]:
    """Yield the header and every row that is not empty; on request note the line where each one ends."""
    separator = _find_separator(path, encoding)
    with _open_text(path, encoding) as file:
        before = next((number for number, line in enumerate(file) if _is_header(line)), 0)
        file.seek(0)
        reader = csv.reader(islice(file, before, None), delimiter=separator, skipinitialspace=True)
        for row in reader:
            if row and (row[0] or any(row)):
                if line_numbers is not None:
                    line_numbers.append(reader.line_num + before)
                yield row


def _transpose(
    path: str, rows: list[list[str]], width: int, row_name: Callable[[int], str], done: int
) -> list[tuple[str, ...]]:
    """Return the columns of rows behind ``done`` others; short rows are filled up with empty fields."""
    if set(map(len, rows)) != {width}:
        index = next((index for index, row in enumerate(rows) if any(row[width:])), None)
        if index is not None:
            raise InputError(
                f"{path}, {row_name(done + index)}: has {len(rows[index])} fields, the header {width}: quote texts "
                "with separators, and separate by semicolons where numbers have decimal commas"
            )
        rows = [row[:width] + [""] * (width - len(row)) for row in rows]
    return list(zip(*rows, strict=True))


def _row_name(path: str, encoding: str, row: int) -> str:
    """Return the line of a row by reading the file again: only error messages want it."""
    numbers: list[int] = []
    next(islice(_read_rows(path, encoding, numbers), row + 1, None), None)
    return f"line {numbers[-1]}"


def _find_encoding(path: str) -> str:
    """Return UTF-8 or UTF-16 by the byte order mark or because every byte fits, otherwise Latin-1.

    The whole file passes here once: raises `InputError` for one without line breaks, which would come as one line.
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


READER = PointReader("CSV", lambda _path, name, _head: name.endswith((".csv", ".tsv", ".txt", ".tab")), read)


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
    """Write image points: id, image, sample, line, sigma, kind, and quality where it is known."""
    columns = {
        "id": points.ids, "image": points.image_ids, "sample": points.xy[:, 0], "line": points.xy[:, 1],
        "sigma": points.sigma_px, "kind": points.kind,
    }  # fmt: skip
    if np.isfinite(points.quality).any():
        columns["quality"] = points.quality
    write_csv(path, list(columns), zip(*(column.tolist() for column in columns.values()), strict=True))

"""The compiled loops that write rows as pages of an SQLite file; `sqlite_rows` calls them.

A table is a tree of pages. A leaf page has cells, one a row: the length of its record and its key, then the record: the
length of its head, a serial type for each value, and the values. A branch page has a cell for each page below it but
the last: its number and the largest key in it. Cells stand at the end of a page, their places at its beginning; numbers
are big-endian, lengths and keys varints of seven bits a byte. Source: https://www.sqlite.org/fileformat2.html, sections
1.6 (pages) and 2.1 (records).
"""

import numpy as np
from numba import njit

from .typed_rows import INTEGER_CELL, NUMBER_CELL, TEXT_CELL

LEAF_HEAD, BRANCH_HEAD = 8, 12  # bytes at the beginning of a page
PLACE, CHILD, LONGEST_VARINT = 2, 4, 9  # bytes of a cell's place, of a page's number, of a varint
_LEAF, _BRANCH = 13, 5  # kinds of pages
_NULL, _REAL, _ZERO, _BYTES, _TEXT = 0, 7, 8, 12, 13  # serial types; integers 1 to 6, and 1 is that of zero + 1
_INTEGER_BYTES = np.array([0, 1, 2, 3, 4, 6, 8, 8, 0, 0])  # of each serial type


@njit(nogil=True, cache=True)
def add_rows(
    pages: np.ndarray, state: np.ndarray, last_keys: np.ndarray, begin: int, kinds: np.ndarray, words: np.ndarray,
    reals: np.ndarray, lengths: np.ndarray, content: np.ndarray,
) -> int:  # fmt: skip
    """Put rows into leaf pages; return the first row that found no room, their number if all did.

    pages : (p, size) bytes
    state : (4,) page that is being filled, its cells, where the cells begin, key of the last one; changed here
    last_keys : (p,) largest key of each full page, filled here
    begin : first row
    kinds : (c,) of the columns (`sqlite_rows.Cells`); the first is that of the keys
    words, reals, lengths : (c, n) the cells: integers or places in ``content``, the same as numbers, lengths of bytes
    content : (b,) all texts and bytes
    """
    columns, rows = words.shape
    types = np.empty(columns, dtype=np.int64)
    number, count, end, last = state
    done = begin
    for row in range(begin, rows):
        head, body = _choose_types(types, row, kinds, words, reals, lengths)
        key = words[0, row]
        size = _varint_bytes(head + body) + _varint_bytes(key) + head + body
        # A new page where this one is full
        if end - size < LEAF_HEAD + PLACE * (count + 1):
            _write_head(pages[number], _LEAF, count, end)
            last_keys[number] = last
            number, count, end = number + 1, 0, pages.shape[1]
            if number == len(pages):
                break
            pages[number] = 0
        # The cell: lengths, key, serial types, values
        page = pages[number]
        end -= size
        _write_integer(page, LEAF_HEAD + PLACE * count, PLACE, end)
        at = _write_varint(page, end, head + body)
        at = _write_varint(page, at, key)
        at = _write_varint(page, at, head)
        for column in range(columns):
            if types[column] < 128:  # nearly always; called for all of them, the function is not inlined
                page[at] = types[column]
                at += 1
            else:
                at = _write_varint(page, at, types[column])
        _write_values(page, at, types, row, kinds, words, reals, lengths, content)
        count, last, done = count + 1, key, row + 1
    state[0], state[1], state[2], state[3] = number, count, end, last
    return done


@njit(nogil=True, cache=True)
def _choose_types(
    types: np.ndarray, row: int, kinds: np.ndarray, words: np.ndarray, reals: np.ndarray, lengths: np.ndarray
) -> tuple[int, int]:
    """Fill in the serial types of a row; return the bytes of its record's head, and of its values."""
    types[0], head, body = _NULL, 1, 0  # the key stands in the cell
    for column in range(1, len(types)):
        kind = kinds[column]
        if kind == NUMBER_CELL:
            real = reals[column, row]
            if np.isnan(real):
                serial = _NULL
            elif abs(real) < 2.0**47 and real == np.floor(real):  # SQLite keeps these as integers, too
                serial = _integer_type(int(real))
            else:
                serial = _REAL
            body += _INTEGER_BYTES[serial]
        elif kind == INTEGER_CELL:
            serial = _integer_type(words[column, row])
            body += _INTEGER_BYTES[serial]
        elif lengths[column, row] < 0:
            serial = _NULL
        else:
            serial = (_TEXT if kind == TEXT_CELL else _BYTES) + 2 * lengths[column, row]
            body += lengths[column, row]
        types[column] = serial
        head += _varint_bytes(serial)
    return head + (1 if head < 127 else 2), body  # the head counts itself


@njit(nogil=True, cache=True)
def _write_values(
    page: np.ndarray, at: int, types: np.ndarray, row: int, kinds: np.ndarray, words: np.ndarray, reals: np.ndarray,
    lengths: np.ndarray, content: np.ndarray,
) -> None:  # fmt: skip
    """Write a row's values, of these serial types, from a place of the page on."""
    for column in range(1, len(types)):
        serial, word = types[column], words[column, row]
        if serial >= _BYTES:
            for byte in range(lengths[column, row]):
                page[at + byte] = content[word + byte]
            at += lengths[column, row]
        elif serial == _REAL:
            for byte in range(8):  # a loop of known length becomes one instruction
                page[at + byte] = (word >> (56 - 8 * byte)) & 255
            at += 8
        elif serial != _NULL:
            if kinds[column] == NUMBER_CELL:
                word = int(reals[column, row])
            _write_integer(page, at, _INTEGER_BYTES[serial], word)
            at += _INTEGER_BYTES[serial]


@njit(nogil=True, cache=True)
def end_page(pages: np.ndarray, state: np.ndarray, last_keys: np.ndarray) -> None:
    """Write the head of the page that is being filled."""
    _write_head(pages[state[0]], _LEAF, state[1], state[2])
    last_keys[state[0]] = state[3]


@njit(nogil=True, cache=True)
def fill_branches(pages: np.ndarray, bounds: np.ndarray, children: np.ndarray, last_keys: np.ndarray) -> None:
    """Fill branch pages.

    pages : (p, size) bytes, all zero
    bounds : (p + 1,) children of page i are those from ``bounds[i]`` to ``bounds[i + 1]``
    children, last_keys : (n,) numbers of the pages below, and the largest key in each
    """
    for number in range(len(pages)):
        page, first, last, end = pages[number], bounds[number], bounds[number + 1] - 1, pages.shape[1]
        for child in range(first, last):
            end -= CHILD + _varint_bytes(last_keys[child])
            _write_integer(page, BRANCH_HEAD + PLACE * (child - first), PLACE, end)
            _write_integer(page, end, CHILD, children[child])
            _write_varint(page, end + CHILD, last_keys[child])
        _write_head(page, _BRANCH, last - first, end)
        _write_integer(page, LEAF_HEAD, CHILD, children[last])


@njit(nogil=True, cache=True)
def _write_head(page: np.ndarray, kind: int, count: int, end: int) -> None:
    page[0] = kind
    _write_integer(page, 3, 2, count)
    _write_integer(page, 5, 2, end)


@njit(nogil=True, cache=True)
def _integer_type(value: int) -> int:
    """Return the serial type of an integer: that of the fewest bytes."""
    if 0 <= value <= 1:
        return _ZERO + value
    most = value if value >= 0 else ~value
    for serial in range(1, 6):
        if most >> (8 * _INTEGER_BYTES[serial] - 1) == 0:
            return serial
    return 6


@njit(nogil=True, cache=True)
def _write_integer(page: np.ndarray, at: int, count: int, value: int) -> None:
    for byte in range(count):
        page[at + byte] = (value >> (8 * (count - 1 - byte))) & 255


@njit(nogil=True, cache=True)
def _varint_bytes(value: int) -> int:
    count = 1
    while value > 127:
        value >>= 7
        count += 1
    return count


@njit(nogil=True, cache=True)
def _write_varint(page: np.ndarray, at: int, value: int) -> int:
    """Write a number below 2**56; return the place behind it."""
    count = _varint_bytes(value)
    for byte in range(count):
        page[at + byte] = ((value >> (7 * (count - 1 - byte))) & 127) | (128 if byte < count - 1 else 0)
    return at + count

"""The compiled loop that binds the values of rows and has SQLite insert them; `sqlite_rows` calls it."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from .row_cells import INTEGER_CELL, NUMBER_CELL, TEXT_CELL

_DONE = 101  # SQLITE_DONE: the row is in


def _call_in_c(*arguments: types.Type) -> Any:
    """Return signature and code of the call of a C function at an address with these arguments; it gives an ``int``.

    numba does not keep a loop on disk that calls functions of `ctypes`; one that gets their addresses it does.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [context.get_value_type(argument) for argument in arguments])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])

    return types.int32(types.int64, *arguments), generate


def _bind_double(typing, address, statement, place, value):  # type: ignore[no-untyped-def]
    return _call_in_c(types.int64, types.int32, types.float64)


def _bind_integer(typing, address, statement, place, value):  # type: ignore[no-untyped-def]
    return _call_in_c(types.int64, types.int32, types.int64)


def _bind_bytes(typing, address, statement, place, content, length, destructor):  # type: ignore[no-untyped-def]
    return _call_in_c(types.int64, types.int32, types.int64, types.int32, types.int64)


def _bind_null(typing, address, statement, place):  # type: ignore[no-untyped-def]
    return _call_in_c(types.int64, types.int32)


def _act(typing, address, statement):  # type: ignore[no-untyped-def]
    return _call_in_c(types.int64)


bind_double: Any = intrinsic(_bind_double)
bind_integer: Any = intrinsic(_bind_integer)
bind_bytes: Any = intrinsic(_bind_bytes)
bind_null: Any = intrinsic(_bind_null)
act: Any = intrinsic(_act)


@numba.njit(nogil=True, cache=True)
def _varying(words: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the columns whose cells are not all the same."""
    found = np.empty(len(words), dtype=np.int64)
    count = 0
    for column in range(len(words)):
        for row in range(1, words.shape[1]):
            if words[column, row] != words[column, 0] or lengths[column, row] != lengths[column, 0]:
                found[count] = column
                count += 1
                break
    return found[:count]


@numba.njit(nogil=True, cache=True)  # no fast mathematics: NaN is to be told
def insert(
    statement: int, functions: np.ndarray, kinds: np.ndarray, words: np.ndarray, reals: np.ndarray, lengths: np.ndarray
) -> int:
    """Insert rows; return 0, or SQLite's code of what failed.

    Parameters
    ----------
    statement : address of the prepared statement
    functions : (7,) addresses of `sqlite_rows._LOOP_FUNCTIONS`
    kinds : (c,) of the columns
    words, reals, lengths : (c, n) the cells: as integers or addresses, the same as numbers, and lengths of bytes
    """
    double, integer, text, blob, null, step, reset = functions
    varying = _varying(words, lengths)
    for row in range(words.shape[1]):
        for number in range(len(varying) if row else len(kinds)):  # what is bound stays bound
            column = varying[number] if row else number
            place, kind, word = np.int32(column + 1), kinds[column], words[column, row]
            if kind == NUMBER_CELL and np.isnan(reals[column, row]):
                code = bind_null(null, statement, place)
            elif kind == NUMBER_CELL:
                code = bind_double(double, statement, place, reals[column, row])
            elif kind == INTEGER_CELL:
                code = bind_integer(integer, statement, place, word)
            else:
                code = bind_bytes(text if kind == TEXT_CELL else blob, statement, place, word, lengths[column, row], 0)
            if code != 0:
                return code
        code = act(step, statement)
        if code != _DONE:
            return code
        act(reset, statement)
    return 0

"""Dense matrices by SciPy's BLAS and LAPACK, called at their addresses, without Python's global lock.

The wheels of NumPy and SciPy each contain their own library. That of NumPy 1.26 does not recognise recent processors
and falls back to instructions of 2004: 16 instead of 65 billion operations a second with the one of SciPy 1.13. SciPy's
functions for Python keep Python's lock while they run; `scipy.linalg.cython_blas` and `cython_lapack` offer the
addresses of the same routines to compiled code, and so to `ctypes`, which releases it. The library's threads wait for
one another by spinning, which makes it ten times slower on a busy machine: callers limit them
(`threads.one_thread_calls`).

Matrices are contiguous rows of float64 (or parts of such matrices); of symmetric and triangular ones the lower triangle
is used. The routines have column order: to them each matrix is its transpose, with the upper triangle.
"""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import cython_blas, cython_lapack

_get_name, _get_address = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
_get_name.argtypes, _get_name.restype = [ctypes.py_object], ctypes.c_char_p
_get_address.argtypes, _get_address.restype = [ctypes.py_object, ctypes.c_char_p], ctypes.c_void_p


def _routine(library: Any, name: str) -> Callable[..., None]:
    """Return a routine; its arguments are letters, sizes, factors and matrices, each followed by its row length."""
    capsule = library.__pyx_capi__[name]
    function = ctypes.CFUNCTYPE(None)(_get_address(capsule, _get_name(capsule)))

    def call(*arguments: bytes | int | float | np.ndarray | ctypes.c_int) -> None:
        pointers: list[Any] = []
        for argument in arguments:
            if isinstance(argument, np.ndarray):
                if argument.dtype != np.float64 or argument.strides[-1] != argument.itemsize:
                    raise ValueError(f"{name} takes rows of float64 that lie in order")
                row = ctypes.c_int(max(argument.strides[0] // argument.itemsize, 1))
                pointers += [ctypes.c_void_p(argument.ctypes.data), ctypes.byref(row)]
            elif isinstance(argument, bytes):
                pointers.append(ctypes.byref(ctypes.c_char(argument)))
            elif isinstance(argument, float):
                pointers.append(ctypes.byref(ctypes.c_double(argument)))
            else:
                pointers.append(
                    ctypes.byref(argument if isinstance(argument, ctypes.c_int) else ctypes.c_int(argument))
                )
        function(*pointers)

    return call


_dgemm, _dsymm, _dsyrk, _dtrmm = (_routine(cython_blas, name) for name in ("dgemm", "dsymm", "dsyrk", "dtrmm"))
_dpotrf, _dtrtri, _dlauum = (_routine(cython_lapack, name) for name in ("dpotrf", "dtrtri", "dlauum"))


def multiply_dense(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return ``first (i, j)`` times ``second (j, k)``; either can be a transposed view."""
    (rows, inner), columns = first.shape, second.shape[1]
    result = np.zeros((rows, columns))
    if first.size and second.size:
        left, left_letter = (second, b"N") if second.strides[1] == second.itemsize else (second.T, b"T")
        right, right_letter = (first, b"N") if first.strides[1] == first.itemsize else (first.T, b"T")
        _dgemm(left_letter, right_letter, columns, rows, inner, 1.0, left, right, 0.0, result)
    return result


def inverse_cholesky(matrix: np.ndarray) -> np.ndarray:
    """Return L^-1, zero above its diagonal, of a positive definite matrix L L' ``(n, n)``; raises `LinAlgError`."""
    lower = np.tril(matrix)
    if lower.size:
        info = ctypes.c_int()
        _dpotrf(b"U", len(lower), lower, info)
        if info.value:
            raise np.linalg.LinAlgError("the matrix is not positive definite")
        _dtrtri(b"U", b"N", len(lower), lower, info)
    return lower


def square_lower(lower: np.ndarray) -> np.ndarray:
    """Return the lower triangle of L'L for a lower triangle L ``(n, n)``."""
    square = lower.copy()
    if square.size:
        _dlauum(b"U", len(square), square, ctypes.c_int())
    return square


def multiply_by_triangle(matrix: np.ndarray, lower: np.ndarray, transposed: bool = False) -> np.ndarray:
    """Return ``matrix (k, n)`` times a lower triangle L ``(n, n)``, or times L'."""
    result = np.array(matrix, order="C")
    if result.size:
        rows, columns = result.shape
        _dtrmm(b"L", b"U", b"T" if transposed else b"N", b"N", columns, rows, 1.0, lower, result)
    return result


def multiply_by_own_transpose(matrix: np.ndarray) -> np.ndarray:
    """Return the lower triangle of A'A for a ``matrix A (k, n)``."""
    rows, columns = matrix.shape
    square = np.zeros((columns, columns))
    if matrix.size:
        _dsyrk(b"U", b"N", columns, rows, 1.0, matrix, 0.0, square)
    return square


def subtract_square(matrix: np.ndarray, factor: np.ndarray) -> None:
    """Subtract B B' of a ``factor B (n, k)`` from the lower triangle of a matrix ``(n, n)``."""
    if factor.size:
        _dsyrk(b"U", b"T", *factor.shape, -1.0, factor, 1.0, matrix)


def multiply_symmetric(lower: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return a symmetric matrix ``(n, n)``, given by its lower triangle, times ``matrix (n, k)``."""
    result = np.zeros(matrix.shape)
    if matrix.size:
        rows, columns = matrix.shape
        _dsymm(b"R", b"U", columns, rows, 1.0, lower, matrix, 0.0, result)
    return result


def add_product(matrix: np.ndarray, first: np.ndarray, second: np.ndarray) -> None:
    """Add the symmetric product A'B of ``first A (n, k)`` and ``second B (n, k)`` to a matrix ``(k, k)``."""
    if first.size:
        rows, columns = first.shape
        _dgemm(b"N", b"T", columns, columns, rows, 1.0, first, second, 1.0, matrix)

"""Compiled loop of `mapping`: image positions of nodes from a chunk's lattice and heights (needs numba)."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def fill_nodes(
    lattice: np.ndarray,  # (8, rows, columns)
    spacing: float,
    columns: np.ndarray,
    rows: np.ndarray,
    cells: np.ndarray,  # heights; cell (0, 0) at grid coordinates `origin`, as row, column
    origin: tuple[float, float],
    middle_m: float,
    half_m: float,
    positions: np.ndarray,  # (2, len(rows), len(columns)), written
) -> None:
    """Write image positions of nodes at all pairs of pixel ``columns`` and ``rows``, as `mapping._Chunk` has them."""
    across = np.empty((8, lattice.shape[2]))
    v = np.empty(8)
    for i in range(len(rows)):
        top = min(int(rows[i] / spacing), lattice.shape[1] - 2)
        down = rows[i] / spacing - top
        for k in range(8):
            for m in range(lattice.shape[2]):
                across[k, m] = lattice[k, top, m] + down * (lattice[k, top + 1, m] - lattice[k, top, m])
        for j in range(len(columns)):
            left = min(int(columns[j] / spacing), lattice.shape[2] - 2)
            share = columns[j] / spacing - left
            for k in range(8):
                v[k] = across[k, left] + share * (across[k, left + 1] - across[k, left])
            x, y = v[0] - origin[1], v[1] - origin[0]
            c, r = int(x), int(y)
            x -= c
            y -= r
            upper = cells[r, c] + x * (cells[r, c + 1] - cells[r, c])
            lower = cells[r + 1, c] + x * (cells[r + 1, c + 1] - cells[r + 1, c])
            t = (upper + y * (lower - upper) - middle_m) / half_m
            positions[0, i, j] = v[2] + t * (v[3] + t * v[4])
            positions[1, i, j] = v[5] + t * (v[6] + t * v[7])

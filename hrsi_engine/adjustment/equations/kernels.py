"""Compiled loops over the points of a block for image-space models (needs numba).

Each point is taken once: its image points are evaluated (`camera_kernels.load`), eliminated and added to the reduced
matrix; no derivative is kept. With t the monomials of the projected position and C (2, M) the coefficients,
A = I2 (x) t', so that a block of the reduced matrix is a 2 x 2 matrix times t_a t_b'. The caller maps the 2 M
coefficients to the model's parameters, and calls the kernels on ranges of points in threads: they release the
interpreter's lock.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...foundation.compiled_code import OPTIONS, Arrays
from .camera_kernels import invert, load, metres

INTERSECT_STEPS = 15
CLOSURE_M = 1e-4
STEP_LIMIT_M = 5e3


@njit(**OPTIONS)
def _find(start: np.ndarray, columns: np.ndarray, row: int, column: int) -> int:
    """Return the index of block (row, column) by bisection."""
    low, high = start[row], start[row + 1] - 1
    while low < high:
        middle = (low + high) >> 1
        if columns[middle] < column:
            low = middle + 1
        else:
            high = middle
    return low


@njit(**OPTIONS)
def residuals(
    begin: int,
    end: int,
    most: int,
    observed: Arrays,
    cameras: Arrays,
    ground: np.ndarray,
    prior: Arrays,
    out: np.ndarray,
) -> None:
    """Write residuals of the points ``begin:end``."""
    first = observed[0]
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, len(cameras[3])))
    for point in range(begin, end):
        count, _, _ = load(point, observed, cameras, ground, prior, r, jac, t)
        for a in range(count):
            out[first[point] + a, 0] = r[a, 0]
            out[first[point] + a, 1] = r[a, 1]


@njit(**OPTIONS)
def _couple(
    blocks: np.ndarray,
    k: int,
    u: np.ndarray,
    jac: np.ndarray,
    t: np.ndarray,
    a: int,
    b: int,
    wb: float,
    own: float,
    forward: bool,
    backward: bool,
) -> None:
    """Add (own I - u B_b' w_b) (x) t_a t_b' of two image points to block k, or its transpose, or both."""
    terms = t.shape[1]
    for c in range(2):
        for d in range(2):
            m = -wb * (u[c, 0] * jac[b, d, 0] + u[c, 1] * jac[b, d, 1] + u[c, 2] * jac[b, d, 2])
            if c == d:
                m += own
            if forward:
                for i in range(terms):
                    x = m * t[a, i]
                    for j in range(terms):
                        blocks[k, c * terms + i, d * terms + j] += x * t[b, j]
            if backward:
                for j in range(terms):
                    x = m * t[b, j]
                    for i in range(terms):
                        blocks[k, d * terms + j, c * terms + i] += x * t[a, i]


@njit(**OPTIONS)
def eliminate(
    begin: int,
    end: int,
    most: int,
    observed: Arrays,
    cameras: Arrays,
    ground: np.ndarray,
    prior: Arrays,
    contributes: np.ndarray,
    start: np.ndarray,
    columns: np.ndarray,
    blocks: np.ndarray,
    right: np.ndarray,
    out: Arrays,
) -> None:
    """Add the points ``begin:end`` to ``blocks (b, 2M, 2M)`` and ``right (cameras, 2M)``; write what is per point.

    ``out`` : residual (n, 2), inverse (m, 3, 3), point right-hand sides (m, 3).
    """
    first, image, _, weight = observed
    camera = cameras[4]
    residual, inverse, point_right = out
    terms = len(cameras[3])
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, terms))
    u = np.empty((2, 3))
    for point in range(begin, end):
        count, n, g = load(point, observed, cameras, ground, prior, r, jac, t)
        invert(n, inverse, point)
        point_right[point, 0], point_right[point, 1], point_right[point, 2] = g
        row0 = first[point]
        for a in range(count):
            residual[row0 + a, 0], residual[row0 + a, 1] = r[a, 0], r[a, 1]
        if not contributes[point]:
            continue
        for a in range(count):
            wa = weight[row0 + a]
            if wa == 0.0:
                continue
            ca = camera[image[row0 + a]]
            for c in range(2):
                j0, j1, j2 = wa * jac[a, c, 0], wa * jac[a, c, 1], wa * jac[a, c, 2]
                for j in range(3):
                    u[c, j] = j0 * inverse[point, 0, j] + j1 * inverse[point, 1, j] + j2 * inverse[point, 2, j]
                rest = wa * r[a, c] - (u[c, 0] * g[0] + u[c, 1] * g[1] + u[c, 2] * g[2])
                for i in range(terms):
                    right[ca, c * terms + i] += t[a, i] * rest
            for b in range(a, count):
                wb = weight[row0 + b]
                if wb != 0.0:
                    cb = camera[image[row0 + b]]
                    k = _find(start, columns, min(ca, cb), max(ca, cb))
                    _couple(
                        blocks, k, u, jac, t, a, b, wb, wa if a == b else 0.0, ca <= cb, ca > cb or (ca == cb and a < b)
                    )


@njit(**OPTIONS)
def substitute(
    begin: int,
    end: int,
    most: int,
    observed: Arrays,
    cameras: Arrays,
    ground: np.ndarray,
    prior: Arrays,
    inverse: np.ndarray,
    point_right: np.ndarray,
    step: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the points' steps in metres for the cameras' ``step (cameras, 2, M)`` of the coefficients."""
    first, image, _, weight = observed
    camera, terms = cameras[4], len(cameras[3])
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, terms))
    for point in range(begin, end):
        count, _, _ = load(point, observed, cameras, ground, prior, r, jac, t)
        g0, g1, g2 = point_right[point, 0], point_right[point, 1], point_right[point, 2]
        for a in range(count):
            row = first[point] + a
            k = camera[image[row]]
            for c in range(2):
                moved = 0.0
                for i in range(terms):
                    moved += t[a, i] * step[k, c, i]
                moved *= weight[row]
                g0 -= jac[a, c, 0] * moved
                g1 -= jac[a, c, 1] * moved
                g2 -= jac[a, c, 2] * moved
        for j in range(3):
            out[point, j] = inverse[point, j, 0] * g0 + inverse[point, j, 1] * g1 + inverse[point, j, 2] * g2


@njit(**OPTIONS)
def jacobians(
    begin: int,
    end: int,
    most: int,
    points: np.ndarray,
    place: np.ndarray,
    observed: Arrays,
    cameras: Arrays,
    ground: np.ndarray,
    prior: Arrays,
    out_r: np.ndarray,
    out_j: np.ndarray,
) -> None:
    """Write residuals and derivatives by the ground of the points ``points[begin:end]`` from rows ``place``."""
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, len(cameras[3])))
    for number in range(begin, end):
        count, _, _ = load(points[number], observed, cameras, ground, prior, r, jac, t)
        for a in range(count):
            for c in range(2):
                out_r[place[number] + a, c] = r[a, c]
                for j in range(3):
                    out_j[place[number] + a, c, j] = jac[a, c, j]


@njit(**OPTIONS)
def _seen(cofactors: np.ndarray, k: int, forward: bool, t: np.ndarray, a: int, b: int, c: int, d: int) -> float:
    """Return t_a' Q t_b for coordinates c and d of two image points, Q the cofactors in block k or its transpose."""
    terms = t.shape[1]
    total = 0.0
    for i in range(terms):
        part = 0.0
        for j in range(terms):
            if forward:
                part += cofactors[k, c * terms + i, d * terms + j] * t[b, j]
            else:
                part += cofactors[k, d * terms + j, c * terms + i] * t[b, j]
        total += t[a, i] * part
    return total


@njit(**OPTIONS)
def spread(
    begin: int,
    end: int,
    most: int,
    observed: Arrays,
    cameras: Arrays,
    ground: np.ndarray,
    prior: Arrays,
    inverse: np.ndarray,
    start: np.ndarray,
    columns: np.ndarray,
    cofactors: np.ndarray,
    out: Arrays,
) -> None:
    """Write cofactors of the points (m, 3, 3) and of the computed image points (n, 2, 2).

    Over all image points of a point, with Q the ``cofactors (b, 2M, 2M)`` of the cameras::

        pull = B V^-1,   half = A Q A' w pull
        point = V^-1 + pull' w half,   computed = A Q A' - half B' - B half' + B point B'
    """
    first, image, _, weight = observed
    camera, terms = cameras[4], len(cameras[3])
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, terms))
    q, pull, half = np.empty((2 * most, 2 * most)), np.empty((2 * most, 3)), np.empty((2 * most, 3))
    for point in range(begin, end):
        count, _, _ = load(point, observed, cameras, ground, prior, r, jac, t)
        row0 = first[point]
        for a in range(count):
            ca = camera[image[row0 + a]]
            for b in range(a, count):
                cb = camera[image[row0 + b]]
                k = _find(start, columns, min(ca, cb), max(ca, cb))
                for c in range(2):
                    for d in range(2):
                        q[2 * a + c, 2 * b + d] = _seen(cofactors, k, ca <= cb, t, a, b, c, d)
                        q[2 * b + d, 2 * a + c] = q[2 * a + c, 2 * b + d]
            for c in range(2):
                for j in range(3):
                    total = 0.0
                    for i in range(3):
                        total += inverse[point, j, i] * jac[a, c, i]
                    pull[2 * a + c, j] = total
        _spread_point(point, row0, count, weight, inverse, jac, q, pull, half, out)


@njit(**OPTIONS)
def _spread_point(
    point: int,
    row0: int,
    count: int,
    weight: np.ndarray,
    inverse: np.ndarray,
    jac: np.ndarray,
    q: np.ndarray,
    pull: np.ndarray,
    half: np.ndarray,
    out: Arrays,
) -> None:
    """Write the cofactors of one point and its image points; see `spread`."""
    out_points, out_computed = out
    for a in range(2 * count):
        for j in range(3):
            total = 0.0
            for b in range(2 * count):
                total += weight[row0 + b // 2] * q[a, b] * pull[b, j]
            half[a, j] = total
    for i in range(3):
        for j in range(3):
            total = inverse[point, i, j]
            for a in range(2 * count):
                total += weight[row0 + a // 2] * pull[a, i] * half[a, j]
            out_points[point, i, j] = total
    for a in range(count):
        for c in range(2):
            for d in range(2):
                total = q[2 * a + c, 2 * a + d]
                for j in range(3):
                    total -= half[2 * a + c, j] * jac[a, d, j] + half[2 * a + d, j] * jac[a, c, j]
                    part = 0.0
                    for i in range(3):
                        part += out_points[point, j, i] * jac[a, d, i]
                    total += jac[a, c, j] * part
                out_computed[row0 + a, c, d] = total


@njit(**OPTIONS)
def intersect(
    begin: int, end: int, most: int, observed: Arrays, cameras: Arrays, ground: np.ndarray, prior: Arrays
) -> None:
    """Move the points ``begin:end`` to their least-squares positions for the cameras as they are."""
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, len(cameras[3])))
    v = np.empty((1, 3, 3))
    for point in range(begin, end):
        for _ in range(INTERSECT_STEPS):
            _, n, g = load(point, observed, cameras, ground, prior, r, jac, t)
            invert(n, v, 0)
            s0 = v[0, 0, 0] * g[0] + v[0, 0, 1] * g[1] + v[0, 0, 2] * g[2]
            s1 = v[0, 1, 0] * g[0] + v[0, 1, 1] * g[1] + v[0, 1, 2] * g[2]
            s2 = v[0, 2, 0] * g[0] + v[0, 2, 1] * g[1] + v[0, 2, 2] * g[2]
            length = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
            factor = min(1.0, STEP_LIMIT_M / max(length, STEP_LIMIT_M))
            east, north = metres(ground[point, 1], ground[point, 2])
            ground[point, 0] += factor * s0 / east
            ground[point, 1] += factor * s1 / north
            ground[point, 2] += factor * s2
            if not length > CLOSURE_M:
                break

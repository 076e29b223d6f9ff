"""Elimination of points, compiled loops: the same results as `elimination`, point by point (need numba).

With the derivatives composed as in `refinement.model.Structure`, A = G (x) t', each image point a of a point gives
``W_a = w_a G_a' B_a`` and, with V = L L', ``U_a = W_a L^-T`` (q, 3), and each pair of image points adds to the
reduced matrix ::

    S (x) t_a t_b'        S = delta_ab w_a G_a' G_a - U_a U_b'      (q, q)

V^-1 is not used directly: for almost parallel rays it is large, and so are its rounding errors in all elements.

A block is stored as t t matrices of q q numbers, so that the innermost loop runs over all of S at once
(`Structure.fold` converts it to the order of the parameters). Only blocks with row <= column are stored, so the image
point of the lower camera comes first. Where ``by_quantity`` is None, G is the identity (sample and line are the
quantities): numba compiles separate loops for that. The kernels release the interpreter's lock; the caller gives
ranges of points to threads.

Arguments that the kernels share
    rows : points (k,), place (k + 1,) of the image points of each in the linearised arrays, first (m + 1,), weight (n,)
    linear : residual (r, 2), by_ground (r, 2, 3), terms (r, t); by_quantity (r, 2, q) or None
    camera (n,) : index of each image point's camera
    prior : target, weight (m, 3), mixed (m, 3) or (1, 3) of the points' positions (`PointPriors`)
    start, columns : of the pattern
"""

import numpy as np
from numba import njit

from ...foundation.compiled_code import OPTIONS, Arrays, register
from ...ground import ellipsoid

register(*ellipsoid.ELLIPSOID_FORMULAS)

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]


@njit(**OPTIONS)
def _find_block(start: np.ndarray, columns: np.ndarray, row: int, column: int) -> int:
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
def _invert(n: Six, inverse: np.ndarray, k: int) -> Six:
    """Write V^-1 of the symmetric matrix n = (00, 01, 02, 11, 12, 22) to ``inverse[k]``; return L^-1 with V = L L'.

    That is the lower triangle (00, 10, 11, 20, 21, 22).
    """
    a = 1.0 / np.sqrt(n[0])
    l10, l20 = n[1] * a, n[2] * a
    c = 1.0 / np.sqrt(n[3] - l10 * l10)
    l21 = (n[4] - l20 * l10) * c
    f = 1.0 / np.sqrt(n[5] - l20 * l20 - l21 * l21)
    b = -l10 * a * c
    d, e = -(l20 * a + l21 * b) * f, -l21 * c * f
    inverse[k, 0, 0] = a * a + b * b + d * d
    inverse[k, 0, 1] = inverse[k, 1, 0] = b * c + d * e
    inverse[k, 0, 2] = inverse[k, 2, 0] = d * f
    inverse[k, 1, 1] = c * c + e * e
    inverse[k, 1, 2] = inverse[k, 2, 1] = e * f
    inverse[k, 2, 2] = f * f
    return a, b, c, d, e, f


@njit(**OPTIONS)
def _form_point_normal(
    point: int, begin: int, end: int, row0: int, weight: np.ndarray, linear: Arrays, ground: np.ndarray, prior: Arrays
) -> tuple[Six, Three]:
    """Return V (its upper triangle by rows) and m of a point, including its prior."""
    residual, by_ground, _ = linear
    target, target_weight, mixed = prior
    n00, n01, n02, n11, n12, n22, g0, g1, g2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(begin, end):
        w = weight[row0 + a - begin]
        for c in range(2):
            b0, b1, b2, r = by_ground[a, c, 0], by_ground[a, c, 1], by_ground[a, c, 2], residual[a, c]
            n00 += w * b0 * b0
            n01 += w * b0 * b1
            n02 += w * b0 * b2
            n11 += w * b1 * b1
            n12 += w * b1 * b2
            n22 += w * b2 * b2
            g0 += w * b0 * r
            g1 += w * b1 * r
            g2 += w * b2 * r
    t0, t1, t2 = target_weight[point, 0], target_weight[point, 1], target_weight[point, 2]
    k = min(point, len(mixed) - 1)
    t01, t02, t12 = mixed[k, 0], mixed[k, 1], mixed[k, 2]
    east, north = ellipsoid.metres_of_a_degree(ground[point, 1], ground[point, 2])
    d0 = ellipsoid.wrap_once(target[point, 0] - ground[point, 0]) * east
    d1 = (target[point, 1] - ground[point, 1]) * north
    d2 = target[point, 2] - ground[point, 2]
    g0 += t0 * d0 + t01 * d1 + t02 * d2
    g1 += t01 * d0 + t1 * d1 + t12 * d2
    g2 += t02 * d0 + t12 * d1 + t2 * d2
    return (n00 + t0, n01 + t01, n02 + t02, n11 + t1, n12 + t12, n22 + t2), (g0, g1, g2)


@njit(**OPTIONS)
def _add_pair(
    blocks: np.ndarray, k: int, s: np.ndarray, u: np.ndarray, terms: np.ndarray, begin: int, a: int, b: int, q: int
) -> None:
    """Add (S - U_a U_b') (x) t_a t_b' of two image points to block k; ``s (q q,)`` is overwritten."""
    m = terms.shape[1]
    for c in range(q):
        for d in range(q):
            s[c * q + d] -= u[a, c, 0] * u[b, d, 0] + u[a, c, 1] * u[b, d, 1] + u[a, c, 2] * u[b, d, 2]
    for i in range(m):
        for j in range(m):
            x = terms[begin + a, i] * terms[begin + b, j]
            for e in range(q * q):
                blocks[k, i * m + j, e] += x * s[e]


@njit(**OPTIONS)
def _add_pairs_of_point(
    begin: int,
    row0: int,
    count: int,
    weight: np.ndarray,
    camera: np.ndarray,
    terms: np.ndarray,
    by_quantity: np.ndarray | None,
    u: np.ndarray,
    s: np.ndarray,
    start: np.ndarray,
    columns: np.ndarray,
    blocks: np.ndarray,
) -> None:
    """Add all pairs of a point's image points to the blocks; ``s (q q,)`` is overwritten."""
    q = u.shape[1]
    for a in range(count):
        weight_a, row = weight[row0 + a], begin + a
        if weight_a == 0.0:
            continue
        ca = camera[row0 + a]
        if by_quantity is None:
            s[0] = s[3] = weight_a
            s[1] = s[2] = 0.0
        else:
            for c in range(q):
                g0, g1 = weight_a * by_quantity[row, 0, c], weight_a * by_quantity[row, 1, c]
                for d in range(q):
                    s[c * q + d] = g0 * by_quantity[row, 0, d] + g1 * by_quantity[row, 1, d]
        _add_pair(blocks, start[ca], s, u, terms, begin, a, a, q)
        for b in range(a + 1, count):
            if weight[row0 + b] == 0.0:
                continue
            cb = camera[row0 + b]
            k = _find_block(start, columns, min(ca, cb), max(ca, cb))
            if ca <= cb:
                s[:] = 0.0
                _add_pair(blocks, k, s, u, terms, begin, a, b, q)
            if ca >= cb:
                s[:] = 0.0
                _add_pair(blocks, k, s, u, terms, begin, b, a, q)


@njit(**OPTIONS)
def eliminate_points(
    rows: Arrays,
    longest: int,
    camera: np.ndarray,
    linear: Arrays,
    by_quantity: np.ndarray | None,
    ground: np.ndarray,
    prior: Arrays,
    contributes: np.ndarray,
    start: np.ndarray,
    columns: np.ndarray,
    blocks: np.ndarray,
    right: np.ndarray,
    results: Arrays,
) -> None:
    """Add points to ``blocks (b, t t, q q)`` and ``right (cameras, q t)``; write the results of each point.

    ``results`` : residual (n, 2), inverse (m, 3, 3), point right-hand sides (m, 3) of the whole block. Only points that
    contribute enter the sums.
    """
    points, place, first, weight = rows
    residual, by_ground, terms = linear
    all_residuals, inverse, point_right = results
    q = 2 if by_quantity is None else by_quantity.shape[2]
    m = terms.shape[1]
    u, s = np.empty((longest, q, 3)), np.zeros(q * q)
    for number in range(len(points)):
        point, begin, end = points[number], place[number], place[number + 1]
        row0, count = first[point], end - begin
        v, g = _form_point_normal(point, begin, end, row0, weight, linear, ground, prior)
        l00, l10, l11, l20, l21, l22 = _invert(v, inverse, point)
        g0, g1, g2 = l00 * g[0], l10 * g[0] + l11 * g[1], l20 * g[0] + l21 * g[1] + l22 * g[2]
        point_right[point, 0], point_right[point, 1], point_right[point, 2] = g
        for a in range(count):
            all_residuals[row0 + a, 0], all_residuals[row0 + a, 1] = residual[begin + a, 0], residual[begin + a, 1]
        if not contributes[point]:
            continue
        for a in range(count):
            weight_a, row, ca = weight[row0 + a], begin + a, camera[row0 + a]
            if weight_a == 0.0:
                continue
            for c in range(q):
                by_sample, by_line = weight_a * (c == 0), weight_a * (c == 1)
                if by_quantity is not None:
                    by_sample, by_line = weight_a * by_quantity[row, 0, c], weight_a * by_quantity[row, 1, c]
                w0 = by_sample * by_ground[row, 0, 0] + by_line * by_ground[row, 1, 0]
                w1 = by_sample * by_ground[row, 0, 1] + by_line * by_ground[row, 1, 1]
                w2 = by_sample * by_ground[row, 0, 2] + by_line * by_ground[row, 1, 2]
                u0, u1, u2 = l00 * w0, l10 * w0 + l11 * w1, l20 * w0 + l21 * w1 + l22 * w2
                u[a, c, 0], u[a, c, 1], u[a, c, 2] = u0, u1, u2
                reduced = by_sample * residual[row, 0] + by_line * residual[row, 1] - u0 * g0 - u1 * g1 - u2 * g2
                for i in range(m):
                    right[ca, c * m + i] += terms[row, i] * reduced
        _add_pairs_of_point(begin, row0, count, weight, camera, terms, by_quantity, u, s, start, columns, blocks)


@njit(**OPTIONS)
def solve_points(rows: Arrays, linear: Arrays, ground: np.ndarray, prior: Arrays, result: np.ndarray) -> None:
    """Write the steps ``(k, 3)`` in metres of points with fixed cameras."""
    points, place, first, weight = rows
    inverse = np.empty((1, 3, 3))
    for number in range(len(points)):
        point, begin, end = points[number], place[number], place[number + 1]
        v, g = _form_point_normal(point, begin, end, first[point], weight, linear, ground, prior)
        _invert(v, inverse, 0)
        for j in range(3):
            result[number, j] = inverse[0, j, 0] * g[0] + inverse[0, j, 1] * g[1] + inverse[0, j, 2] * g[2]


@njit(**OPTIONS)
def substitute_back(
    rows: Arrays,
    camera: np.ndarray,
    linear: Arrays,
    by_quantity: np.ndarray | None,
    inverse: np.ndarray,
    point_right: np.ndarray,
    step: np.ndarray,
    result: np.ndarray,
) -> None:
    """Write the points' steps (m, 3) in metres for the cameras' ``step (cameras, q t)`` of the coefficients."""
    points, place, first, weight = rows
    _, by_ground, terms = linear
    q = 2 if by_quantity is None else by_quantity.shape[2]
    m = terms.shape[1]
    for number in range(len(points)):
        point = points[number]
        g0, g1, g2 = point_right[point, 0], point_right[point, 1], point_right[point, 2]
        row = first[point]
        for a in range(place[number], place[number + 1]):
            k, sample, line = camera[row], 0.0, 0.0
            for c in range(q):
                change = 0.0
                for i in range(m):
                    change += terms[a, i] * step[k, c * m + i]
                if by_quantity is None:
                    if c == 0:
                        sample = change
                    else:
                        line = change
                else:
                    sample += by_quantity[a, 0, c] * change
                    line += by_quantity[a, 1, c] * change
            sample, line = weight[row] * sample, weight[row] * line
            g0 -= by_ground[a, 0, 0] * sample + by_ground[a, 1, 0] * line
            g1 -= by_ground[a, 0, 1] * sample + by_ground[a, 1, 1] * line
            g2 -= by_ground[a, 0, 2] * sample + by_ground[a, 1, 2] * line
            row += 1
        for j in range(3):
            result[point, j] = inverse[point, j, 0] * g0 + inverse[point, j, 1] * g1 + inverse[point, j, 2] * g2


@njit(**OPTIONS)
def compute_cofactors(
    rows: Arrays,
    longest: int,
    camera: np.ndarray,
    linear: Arrays,
    by_quantity: np.ndarray | None,
    inverse: np.ndarray,
    start: np.ndarray,
    columns: np.ndarray,
    cofactors: np.ndarray,
    results: Arrays,
) -> None:
    """Write cofactors of the points (m, 3, 3) and of the computed image points (n, 2, 2).

    Over all image points of a point, with Q the ``cofactors (b, t t, q q)`` of the cameras::

        pull = B V^-1,   half = A Q A' w pull
        point = V^-1 + pull' w half,   computed = A Q A' - half B' - B half' + B point B'
    """
    points, place, first, weight = rows
    _, by_ground, terms = linear
    n = 2 if by_quantity is None else by_quantity.shape[2]
    m = terms.shape[1]
    s, column = np.empty(n * n), np.empty(n)
    q, pull, half = np.empty((2 * longest, 2 * longest)), np.empty((2 * longest, 3)), np.empty((2 * longest, 3))
    for number in range(len(points)):
        point, begin, end = points[number], place[number], place[number + 1]
        row0, count = first[point], end - begin
        for a in range(count):
            for c in range(2):
                for j in range(3):
                    total = 0.0
                    for i in range(3):
                        total += inverse[point, j, i] * by_ground[begin + a, c, i]
                    pull[2 * a + c, j] = total
        for x in range(count):
            for y in range(x, count):
                a, b = (x, y) if camera[row0 + x] <= camera[row0 + y] else (y, x)
                k = _find_block(start, columns, camera[row0 + a], camera[row0 + b])
                s[:] = 0.0
                for i in range(m):
                    for j in range(m):
                        factor = terms[begin + a, i] * terms[begin + b, j]
                        for e in range(n * n):
                            s[e] += factor * cofactors[k, i * m + j, e]
                for d in range(2):
                    for e in range(n):
                        part = 0.0
                        if by_quantity is None:
                            part = s[e * n + d]
                        else:
                            for f in range(n):
                                part += s[e * n + f] * by_quantity[begin + b, d, f]
                        column[e] = part
                    for c in range(2):
                        total = 0.0
                        if by_quantity is None:
                            total = column[c]
                        else:
                            for e in range(n):
                                total += by_quantity[begin + a, c, e] * column[e]
                        q[2 * a + c, 2 * b + d] = total
                        q[2 * b + d, 2 * a + c] = total
        _compute_point_cofactors(point, begin, row0, count, weight, inverse, by_ground, q, pull, half, results)


@njit(**OPTIONS)
def _compute_point_cofactors(
    point: int,
    begin: int,
    row0: int,
    count: int,
    weight: np.ndarray,
    inverse: np.ndarray,
    by_ground: np.ndarray,
    q: np.ndarray,
    pull: np.ndarray,
    half: np.ndarray,
    results: Arrays,
) -> None:
    """Write the cofactors of one point and its image points; see `compute_cofactors`."""
    out_points, out_computed = results
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
        row = begin + a
        for c in range(2):
            for d in range(2):
                total = q[2 * a + c, 2 * a + d]
                for j in range(3):
                    total -= half[2 * a + c, j] * by_ground[row, d, j] + half[2 * a + d, j] * by_ground[row, c, j]
                    part = 0.0
                    for i in range(3):
                        part += out_points[point, j, i] * by_ground[row, d, i]
                    total += by_ground[row, c, j] * part
                out_computed[row0 + a, c, d] = total

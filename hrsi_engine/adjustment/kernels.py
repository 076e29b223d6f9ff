"""Compiled loops over points for cameras that are an RPC and a polynomial in the image (needs numba).

Each point is taken once: its image points are evaluated, eliminated and added to the reduced matrix; no derivative is
kept. With t the monomials of the projected position and C (2, M) the coefficients, A = I2 (x) t', so that a block of
the reduced matrix is a 2 x 2 matrix times t_a t_b'. The caller maps the 2 M coefficients to the model's parameters.

Arguments that all kernels share
    first (m + 1,), image (n,), xy (n, 2), weight (n,) : as in `observations`
    cubics (images, 20, 4) : coefficients of sample and line numerator, sample and line denominator
    constants (images, 12) : ground offsets and inverse scales (6), image offsets and scales (4), centre (2)
    coefficients (images, 2, M), powers (M, 2) : the polynomial
The kernels release the interpreter's lock; the caller runs them on ranges of points in threads.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

SEMI_MAJOR_M = 6378137.0
ECCENTRICITY_SQUARED = (2.0 - 1.0 / 298.257223563) / 298.257223563
OPTIONS: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
    "error_model": "numpy",
}
LOCALISE_STEPS = 12
INTERSECT_STEPS = 15
Arrays = tuple[Any, ...]
Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
CLOSURE_M = 1e-4
STEP_LIMIT_M = 5e3


@njit(**OPTIONS)
def _wrapped(degrees: float) -> float:
    if degrees > 180.0:
        return degrees - 360.0
    if degrees < -180.0:
        return degrees + 360.0
    return degrees


@njit(**OPTIONS)
def _metres(lat: float, height: float) -> tuple[float, float]:
    """Return metres per degree of longitude and of latitude."""
    phi = math.radians(lat)
    sine = math.sin(phi)
    w2 = 1.0 - ECCENTRICITY_SQUARED * sine * sine
    prime = SEMI_MAJOR_M / math.sqrt(w2)
    meridian = prime * (1.0 - ECCENTRICITY_SQUARED) / w2
    return math.radians(prime + height) * math.cos(phi), math.radians(meridian + height)


@njit(**OPTIONS)
def _cubic(c: np.ndarray, i: int, k: int, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the value and the derivatives by x, y, z of polynomial k of image i; RPC00B order of the terms."""
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    gx = c[i, 1, k] + 3.0 * xx * c[i, 11, k] + yy * c[i, 12, k] + zz * c[i, 13, k]
    gy = c[i, 2, k] + xx * c[i, 14, k] + 3.0 * yy * c[i, 15, k] + zz * c[i, 16, k]
    gz = c[i, 3, k] + xx * c[i, 17, k] + yy * c[i, 18, k] + 3.0 * zz * c[i, 19, k]
    value = c[i, 0, k] + xx * c[i, 7, k] + yy * c[i, 8, k] + zz * c[i, 9, k] + xz * c[i, 5, k] + yz * c[i, 6, k]
    value += x * (gx - 2.0 * xx * c[i, 11, k]) + y * (gy - 2.0 * yy * c[i, 15, k]) + z * (gz - 2.0 * zz * c[i, 19, k])
    value += xy * (c[i, 4, k] + z * c[i, 10, k])
    dx = gx + y * c[i, 4, k] + z * c[i, 5, k] + yz * c[i, 10, k]
    dy = gy + x * c[i, 4, k] + z * c[i, 6, k] + xz * c[i, 10, k]
    dz = gz + x * c[i, 5, k] + y * c[i, 6, k] + xy * c[i, 10, k]
    dx += 2.0 * x * (c[i, 7, k] + y * c[i, 14, k] + z * c[i, 17, k])
    dy += 2.0 * y * (c[i, 8, k] + x * c[i, 12, k] + z * c[i, 18, k])
    dz += 2.0 * z * (c[i, 9, k] + x * c[i, 13, k] + y * c[i, 16, k])
    return value, dx, dy, dz


@njit(**OPTIONS)
def _project(
    cameras: Arrays, i: int, lon: float, lat: float, height: float, east: float, north: float
) -> tuple[float, float, Three, Three]:
    """Return sample, line by the RPC of image i and their derivatives by metres east, north, up."""
    c, constants = cameras[0], cameras[1]
    sx, sy, sz = constants[i, 3], constants[i, 4], constants[i, 5]
    x = _wrapped(lon - constants[i, 0]) * sx
    y = (lat - constants[i, 1]) * sy
    z = (height - constants[i, 2]) * sz
    a0, a1, a2, a3 = _cubic(c, i, 0, x, y, z)
    b0, b1, b2, b3 = _cubic(c, i, 1, x, y, z)
    d0, d1, d2, d3 = _cubic(c, i, 2, x, y, z)
    e0, e1, e2, e3 = _cubic(c, i, 3, x, y, z)
    rs, rl = 1.0 / d0, 1.0 / e0
    s, t = a0 * rs, b0 * rl
    ks, kl = constants[i, 8] * rs, constants[i, 9] * rl
    fx, fy = sx / east, sy / north
    by_sample = (a1 - s * d1) * ks * fx, (a2 - s * d2) * ks * fy, (a3 - s * d3) * ks * sz
    by_line = (b1 - t * e1) * kl * fx, (b2 - t * e2) * kl * fy, (b3 - t * e3) * kl * sz
    return s * constants[i, 8] + constants[i, 6], t * constants[i, 9] + constants[i, 7], by_sample, by_line


@njit(**OPTIONS)
def _correct(cameras: Arrays, i: int, sample: float, line: float, t: np.ndarray, a: int) -> Six:
    """Write the monomials to ``t[a]``; return the correction of sample and line and its four derivatives by them."""
    constants, coefficients, powers = cameras[1], cameras[2], cameras[3]
    p, q = sample - constants[i, 10], line - constants[i, 11]
    cs, cl, css, csl, cls, cll = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(len(powers)):
        term, by_p, by_q = 1.0, 0.0, 0.0
        for _ in range(powers[m, 0]):
            by_p = by_p * p + term
            term *= p
        for _ in range(powers[m, 1]):
            by_p *= q
            by_q = by_q * q + term
            term *= q
        t[a, m] = term
        x, y = coefficients[i, 0, m], coefficients[i, 1, m]
        cs += x * term
        cl += y * term
        css += x * by_p
        csl += x * by_q
        cls += y * by_p
        cll += y * by_q
    return cs, cl, css, csl, cls, cll


@njit(**OPTIONS)
def _invert(n: Six, out: np.ndarray, k: int) -> None:
    """Write the inverse of the symmetric matrix n = (00, 01, 02, 11, 12, 22) to ``out[k]``."""
    c0, c1, c2 = n[3] * n[5] - n[4] * n[4], n[2] * n[4] - n[1] * n[5], n[1] * n[4] - n[2] * n[3]
    q = 1.0 / (n[0] * c0 + n[1] * c1 + n[2] * c2)
    out[k, 0, 0] = c0 * q
    out[k, 0, 1] = out[k, 1, 0] = c1 * q
    out[k, 0, 2] = out[k, 2, 0] = c2 * q
    out[k, 1, 1] = (n[0] * n[5] - n[2] * n[2]) * q
    out[k, 1, 2] = out[k, 2, 1] = (n[1] * n[2] - n[0] * n[4]) * q
    out[k, 2, 2] = (n[0] * n[3] - n[1] * n[1]) * q


@njit(**OPTIONS)
def _load(
    point: int,
    observed: Arrays,
    cameras: Arrays,
    ground: np.ndarray,
    prior: Arrays,
    r: np.ndarray,
    jac: np.ndarray,
    t: np.ndarray,
) -> tuple[int, Six, Three]:
    """Evaluate all image points of a point: residuals r (k, 2), derivatives jac (k, 2, 3), monomials t (k, M).

    Returns their number k and the point's own normal matrix and right-hand side.
    """
    first, image, xy, weight = observed
    target, target_weight = prior
    lon, lat, height = ground[point, 0], ground[point, 1], ground[point, 2]
    east, north = _metres(lat, height)
    n00, n01, n02, n11, n12, n22, g0, g1, g2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    begin = first[point]
    count = first[point + 1] - begin
    for a in range(count):
        row = begin + a
        i = image[row]
        sample, line, s, e = _project(cameras, i, lon, lat, height, east, north)
        cs, cl, css, csl, cls, cll = _correct(cameras, i, sample, line, t, a)
        css += 1.0
        cll += 1.0
        r0, r1 = xy[row, 0] - (sample + cs), xy[row, 1] - (line + cl)
        u0, u1, u2 = css * s[0] + csl * e[0], css * s[1] + csl * e[1], css * s[2] + csl * e[2]
        v0, v1, v2 = cls * s[0] + cll * e[0], cls * s[1] + cll * e[1], cls * s[2] + cll * e[2]
        r[a, 0], r[a, 1] = r0, r1
        jac[a, 0, 0], jac[a, 0, 1], jac[a, 0, 2] = u0, u1, u2
        jac[a, 1, 0], jac[a, 1, 1], jac[a, 1, 2] = v0, v1, v2
        w = weight[row]
        n00 += w * (u0 * u0 + v0 * v0)
        n01 += w * (u0 * u1 + v0 * v1)
        n02 += w * (u0 * u2 + v0 * v2)
        n11 += w * (u1 * u1 + v1 * v1)
        n12 += w * (u1 * u2 + v1 * v2)
        n22 += w * (u2 * u2 + v2 * v2)
        g0 += w * (u0 * r0 + v0 * r1)
        g1 += w * (u1 * r0 + v1 * r1)
        g2 += w * (u2 * r0 + v2 * r1)
    t0, t1, t2 = target_weight[point, 0], target_weight[point, 1], target_weight[point, 2]
    g0 += t0 * _wrapped(target[point, 0] - lon) * east
    g1 += t1 * (target[point, 1] - lat) * north
    g2 += t2 * (target[point, 2] - height)
    return count, (n00 + t0, n01, n02, n11 + t1, n12, n22 + t2), (g0, g1, g2)


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
        count, _, _ = _load(point, observed, cameras, ground, prior, r, jac, t)
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
    camera: np.ndarray,
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
    residual, inverse, point_right = out
    terms = len(cameras[3])
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, terms))
    u = np.empty((2, 3))
    for point in range(begin, end):
        count, n, g = _load(point, observed, cameras, ground, prior, r, jac, t)
        _invert(n, inverse, point)
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
    camera: np.ndarray,
    ground: np.ndarray,
    prior: Arrays,
    inverse: np.ndarray,
    point_right: np.ndarray,
    step: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the points' steps in metres for the cameras' ``step (cameras, 2, M)`` of the coefficients."""
    first, image, _, weight = observed
    terms = len(cameras[3])
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, terms))
    for point in range(begin, end):
        count, _, _ = _load(point, observed, cameras, ground, prior, r, jac, t)
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
        count, _, _ = _load(points[number], observed, cameras, ground, prior, r, jac, t)
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
    camera: np.ndarray,
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
    terms = len(cameras[3])
    r, jac, t = np.empty((most, 2)), np.empty((most, 2, 3)), np.empty((most, terms))
    q, pull, half = np.empty((2 * most, 2 * most)), np.empty((2 * most, 3)), np.empty((2 * most, 3))
    for point in range(begin, end):
        count, _, _ = _load(point, observed, cameras, ground, prior, r, jac, t)
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
            _, n, g = _load(point, observed, cameras, ground, prior, r, jac, t)
            _invert(n, v, 0)
            s0 = v[0, 0, 0] * g[0] + v[0, 0, 1] * g[1] + v[0, 0, 2] * g[2]
            s1 = v[0, 1, 0] * g[0] + v[0, 1, 1] * g[1] + v[0, 1, 2] * g[2]
            s2 = v[0, 2, 0] * g[0] + v[0, 2, 1] * g[1] + v[0, 2, 2] * g[2]
            length = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
            factor = min(1.0, STEP_LIMIT_M / max(length, STEP_LIMIT_M))
            east, north = _metres(ground[point, 1], ground[point, 2])
            ground[point, 0] += factor * s0 / east
            ground[point, 1] += factor * s1 / north
            ground[point, 2] += factor * s2
            if not length > CLOSURE_M:
                break

"""Compiled evaluation of image points for cameras that are an RPC and a polynomial in the image (needs numba).

Arguments that the kernels share
    first (m + 1,), image (n,), xy (n, 2), weight (n,) : as in `observations`
    cubics (images, 20, 4) : coefficients of sample and line numerator, sample and line denominator
    constants (images, 12) : ground offsets and inverse scales (6), image offsets and scales (4), centre (2)
    coefficients (images, 2, M), powers (M, 2) : the polynomial
    camera (images,) : which set of parameters an image has
    target, target weight (m, 3), mixed (m, 3) or (1, 3) : priors of the points' positions (`PointPriors`)

Arrays are passed whole, with indices: a view costs more here than the arithmetic on it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...foundation.compiled_code import OPTIONS, Arrays

SEMI_MAJOR_M = 6378137.0
ECCENTRICITY_SQUARED = (2.0 - 1.0 / 298.257223563) / 298.257223563
Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]


@njit(**OPTIONS)
def _wrapped(degrees: float) -> float:
    if degrees > 180.0:
        return degrees - 360.0
    if degrees < -180.0:
        return degrees + 360.0
    return degrees


@njit(**OPTIONS)
def metres(lat: float, height: float) -> tuple[float, float]:
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
def invert(n: Six, out: np.ndarray, k: int) -> None:
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
def load(
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
    target, target_weight, mixed = prior
    lon, lat, height = ground[point, 0], ground[point, 1], ground[point, 2]
    east, north = metres(lat, height)
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
    k = min(point, len(mixed) - 1)
    t01, t02, t12 = mixed[k, 0], mixed[k, 1], mixed[k, 2]
    d0 = _wrapped(target[point, 0] - lon) * east
    d1 = (target[point, 1] - lat) * north
    d2 = target[point, 2] - height
    g0 += t0 * d0 + t01 * d1 + t02 * d2
    g1 += t01 * d0 + t1 * d1 + t12 * d2
    g2 += t02 * d0 + t12 * d1 + t2 * d2
    return count, (n00 + t0, n01 + t01, n02 + t02, n11 + t1, n12 + t12, n22 + t2), (g0, g1, g2)

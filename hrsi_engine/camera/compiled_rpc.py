"""Compiled evaluation of one of many RPCs at one point, and compiled loops over many points (needs numba).

Tables and formulas are those of `RPC` (`rpc_terms`, `ellipsoid`): the terms by `FACTORS`, the coefficient tables
`RPC.polynomials` and `RPC.derivatives`, the quotient rule `slope_of_ratio`. Arrays are passed complete, with indices,
since creating a view takes longer than the arithmetic on it.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from ..foundation.compiled_code import OPTIONS, Arrays, register
from ..ground import ellipsoid
from .rpc import RPC
from .rpc_terms import FACTORS, QUADRATIC_TERMS, slope_of_ratio, solve_pair

register(*ellipsoid.ELLIPSOID_FORMULAS, slope_of_ratio, solve_pair)


def rpc_tables(rpcs: Sequence[RPC]) -> Arrays:
    """Return the arrays that `project_point` needs for a sequence of RPCs.

    constants : (k, 10) ground offsets and inverse scales (3 + 3), image offsets and scales (2 + 2)
    polynomials : (k, 20, 4) coefficients of sample and line numerator, sample and line denominator
    derivatives : (k, 10, 12) coefficients of the derivatives of these polynomials by L, by P and by H
    """
    constants = [
        [r.long_off, r.lat_off, r.height_off, 1.0 / r.long_scale, 1.0 / r.lat_scale, 1.0 / r.height_scale,
         r.samp_off, r.line_off, r.samp_scale, r.line_scale]
        for r in rpcs
    ]  # fmt: skip
    polynomials = np.stack([rpc.polynomials.T for rpc in rpcs])
    derivatives = np.stack([rpc.derivatives.T for rpc in rpcs])
    return np.array(constants), np.ascontiguousarray(polynomials), np.ascontiguousarray(derivatives)


@njit(**OPTIONS)
def project_point(
    rpcs: Arrays,
    i: int,
    lon: float,
    lat: float,
    height: float,
    east: float,
    north: float,
    terms: np.ndarray,
    computed: np.ndarray,
    by_ground: np.ndarray,
    a: int,
) -> None:
    """Write sample, line to ``computed[a]`` and their derivatives by metres east, north, up to ``by_ground[a]``.

    rpcs : `rpc_tables`; i : index of the RPC
    lon, lat, height : degrees, metres; east, north : metres per degree at this point
    terms : (20,) temporary array
    computed, by_ground : (n, 2) px, (n, 2, 3) px per m
    """
    constants, polynomials, derivatives = rpcs
    sx, sy, sz = constants[i, 3], constants[i, 4], constants[i, 5]
    terms[0] = 1.0
    terms[1] = ellipsoid.wrap_once(lon - constants[i, 0]) * sx
    terms[2] = (lat - constants[i, 1]) * sy
    terms[3] = (height - constants[i, 2]) * sz
    for k in range(4, 20):
        terms[k] = terms[FACTORS[k, 0]] * terms[FACTORS[k, 1]]
    # Separate scalars: numba keeps twelve sums in registers, but not an array
    s, t, ds, dt = 0.0, 0.0, 0.0, 0.0
    for k in range(20):
        term = terms[k]
        s += polynomials[i, k, 0] * term
        t += polynomials[i, k, 1] * term
        ds += polynomials[i, k, 2] * term
        dt += polynomials[i, k, 3] * term
    s, t = s / ds, t / dt
    sx0, tx0, sx1, tx1, sy0, ty0, sy1, ty1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sz0, tz0, sz1, tz1 = 0.0, 0.0, 0.0, 0.0
    for k in range(QUADRATIC_TERMS):
        term = terms[k]
        sx0 += derivatives[i, k, 0] * term
        tx0 += derivatives[i, k, 1] * term
        sx1 += derivatives[i, k, 2] * term
        tx1 += derivatives[i, k, 3] * term
        sy0 += derivatives[i, k, 4] * term
        ty0 += derivatives[i, k, 5] * term
        sy1 += derivatives[i, k, 6] * term
        ty1 += derivatives[i, k, 7] * term
        sz0 += derivatives[i, k, 8] * term
        tz0 += derivatives[i, k, 9] * term
        sz1 += derivatives[i, k, 10] * term
        tz1 += derivatives[i, k, 11] * term
    sample_scale, line_scale = constants[i, 8], constants[i, 9]
    fx, fy = sx / east, sy / north
    by_ground[a, 0, 0] = slope_of_ratio(sx0, sx1, s, ds) * sample_scale * fx
    by_ground[a, 0, 1] = slope_of_ratio(sy0, sy1, s, ds) * sample_scale * fy
    by_ground[a, 0, 2] = slope_of_ratio(sz0, sz1, s, ds) * sample_scale * sz
    by_ground[a, 1, 0] = slope_of_ratio(tx0, tx1, t, dt) * line_scale * fx
    by_ground[a, 1, 1] = slope_of_ratio(ty0, ty1, t, dt) * line_scale * fy
    by_ground[a, 1, 2] = slope_of_ratio(tz0, tz1, t, dt) * line_scale * sz
    computed[a, 0] = s * sample_scale + constants[i, 6]
    computed[a, 1] = t * line_scale + constants[i, 7]


@njit(**OPTIONS)
def project_points(
    rpcs: Arrays, rpc_index: np.ndarray, ground: np.ndarray, computed: np.ndarray, by_ground: np.ndarray
) -> None:
    """Write the results of `project_point` for ground points ``(n, 3)`` with the RPCs ``which (n,)``."""
    terms = np.empty(20)
    for a in range(len(rpc_index)):
        lon, lat, height = ground[a, 0], ground[a, 1], ground[a, 2]
        east, north = ellipsoid.metres_of_a_degree(lat, height)
        project_point(rpcs, rpc_index[a], lon, lat, height, east, north, terms, computed, by_ground, a)


def normalise_tables(rpcs: Arrays) -> Arrays:
    """Return `rpc_tables` with which `project_point` takes and returns normalised coordinates, without units."""
    constants, polynomials, derivatives = rpcs
    return np.tile([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0], (len(constants), 1)), polynomials, derivatives


@njit(**OPTIONS)
def invert_points(
    normalised: Arrays,
    rpc_index: np.ndarray,
    target: np.ndarray,
    height: np.ndarray,
    scale_px: np.ndarray,
    closure_px: float,
    steps: int,
    place: np.ndarray,
    least_px: np.ndarray,
) -> None:
    """Compute the ground positions of image points at given heights, by Newton's iteration from the domain centre.

    It ends at ``closure_px``, or if a step does not reduce the error, or after a number of ``steps``.

    normalised : `normalise_tables`; which : (n,) index of the RPC of each point
    target, height : (n, 2), (n,) normalised sample, line and height; scale_px : (n, 2) image scales in pixels
    place, least_px : (n, 2) normalised lon, lat, and (n,) their errors in the image; both are written
    """
    terms, computed, slopes = np.empty(20), np.empty((1, 2)), np.empty((1, 2, 3))
    for a in range(len(rpc_index)):
        x, y = 0.0, 0.0
        place[a, 0], place[a, 1], least_px[a] = x, y, np.inf
        for _ in range(steps):
            project_point(normalised, rpc_index[a], x, y, height[a], 1.0, 1.0, terms, computed, slopes, 0)
            u, v = target[a, 0] - computed[0, 0], target[a, 1] - computed[0, 1]
            error = max(abs(u) * scale_px[a, 0], abs(v) * scale_px[a, 1])
            if not error < least_px[a]:
                break
            place[a, 0], place[a, 1], least_px[a] = x, y, error
            if error <= closure_px:
                break
            dx, dy = solve_pair(slopes[0, 0, 0], slopes[0, 0, 1], slopes[0, 1, 0], slopes[0, 1, 1], u, v)
            x, y = x + dx, y + dy

"""Compiled loops of least-squares matching and window search (needs numba); `least_squares_matching` has the method.

They process ranges of windows and release the GIL, so that threads can share a tile.
"""

import math

import numpy as np
from numba import njit

from ...foundation.compiled_code import OPTIONS, Arrays
from ...foundation.thresholds import EQUALITY
from .windows import DIVERGED, DONE, ITERATIONS_USED_UP, MATCHING, OUTSIDE, TERMS, WEAK

# Compiled loops can use module names only, not attributes
RIVAL_PX, ROUNDING_SHARE, SMALLEST_GAIN = MATCHING.rival_px, EQUALITY.rounding, EQUALITY.negligible
SIDE_BY_SIDE = 8  # number of products computed together: as many as fit into a register of 32 bytes


@njit(**OPTIONS)
def _cubic_weights(t: float) -> tuple[float, float, float, float]:
    """Return the four weights of the cubic B-spline at the fraction t of a cell."""
    s = 1.0 - t
    inner, outer = 2.0 / 3.0 - 0.5 * t * t * (2.0 - t), 2.0 / 3.0 - 0.5 * s * s * (2.0 - s)
    return s * s * s / 6.0, inner, outer, t * t * t / 6.0


@njit(**OPTIONS)
def _factorise(N: np.ndarray) -> bool:
    """Replace the lower triangle of N by its Cholesky factor; return False if N is not positive definite."""
    for i in range(TERMS):
        limit = 1e-9 * N[i, i]
        for j in range(i + 1):
            total = N[i, j]
            for k in range(j):
                total -= N[i, k] * N[j, k]
            if i == j:
                if not total > limit:
                    return False
                N[i, i] = math.sqrt(total)
            else:
                N[i, j] = total / N[j, j]
    return True


@njit(**OPTIONS)
def _solve(L: np.ndarray, b: np.ndarray) -> None:
    """Replace b by the solution of L L' x = b."""
    for i in range(TERMS):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] /= L[i, i]
    for i in range(TERMS - 1, -1, -1):
        for k in range(i + 1, TERMS):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]


@njit(**OPTIONS)
def _sum_products(one: np.ndarray, second: np.ndarray, weight: np.ndarray) -> float:
    """Return the weighted sum of products of two arrays."""
    total = 0.0
    for k in range(len(weight)):
        total += one[k] * second[k] * weight[k]
    return total


@njit(**OPTIONS)
def _make_template(
    first: np.ndarray,
    by_x: np.ndarray,
    by_y: np.ndarray,
    column: int,
    row: int,
    side: int,
    weight: np.ndarray,
    A: np.ndarray,
    N: np.ndarray,
) -> None:
    """Write transposed design matrix ``A (8, pixels)`` and normal matrix of a template."""
    half = side // 2
    pixel = 0
    for j in range(side):
        for i in range(side):
            y, x = row - half + j, column - half + i
            gx, gy = by_x[y, x], by_y[y, x]
            dx, dy = (i - half) / half, (j - half) / half
            A[0, pixel], A[1, pixel] = gx, gy
            A[2, pixel], A[3, pixel], A[4, pixel], A[5, pixel] = gx * dx, gx * dy, gy * dx, gy * dy
            A[6, pixel], A[7, pixel] = first[y, x], 1.0
            pixel += 1
    A[6] -= _sum_products(A[6], A[7], weight) / weight.sum()
    for a in range(TERMS):
        for b in range(a + 1):
            N[a, b] = _sum_products(A[a], A[b], weight)


@njit(**OPTIONS)
def _sample_window(
    c: np.ndarray, warp: tuple[float, ...], half: int, weights: np.ndarray, corner: np.ndarray, sampled: np.ndarray
) -> bool:
    """Write the warped window of the second image; return False, and write nothing, if it exceeds the image.

    c : spline coefficients; warp : position x, y, then the affine map a00, a01, a10, a11 of the template's offsets
    weights, corner : memory for a row of the window: ``(8, side)`` weights of the 4 x 4 coefficients around each
    position, and ``(side,)`` the first of these
    """
    px, py, a00, a01, a10, a11 = warp
    rows, columns = c.shape
    reach_x, reach_y = half * (abs(a00) + abs(a01)), half * (abs(a10) + abs(a11))
    inside = px - reach_x >= 1.0 and py - reach_y >= 1.0 and px + reach_x < columns - 3.0 and py + reach_y < rows - 3.0
    if not inside:
        return False
    flat, line, one = c.reshape(-1), np.uintp(columns), np.uintp(1)  # unsigned indices need no test of their sign
    for j in range(-half, half + 1):
        for k in range(2 * half + 1):  # several positions at a time: no memory is read
            x, y = px + a00 * (k - half) + a01 * j, py + a10 * (k - half) + a11 * j
            column, row = math.floor(x), math.floor(y)
            weights[0, k], weights[1, k], weights[2, k], weights[3, k] = _cubic_weights(x - column)
            weights[4, k], weights[5, k], weights[6, k], weights[7, k] = _cubic_weights(y - row)
            corner[k] = (row - 1) * columns + column - 1
        for k in range(2 * half + 1):
            first, sums = np.uintp(corner[k]), (0.0, 0.0, 0.0, 0.0)
            for v in range(4, 8):
                v_k = weights[v, k]
                sums = (
                    sums[0] + v_k * flat[first],
                    sums[1] + v_k * flat[first + one],
                    sums[2] + v_k * flat[first + one + one],
                    sums[3] + v_k * flat[first + one + one + one],
                )
                first += line
            total = weights[0, k] * sums[0] + weights[1, k] * sums[1]
            sampled[(j + half) * (2 * half + 1) + k] = total + weights[2, k] * sums[2] + weights[3, k] * sums[3]
    return True


@njit(**OPTIONS)
def _invert_step(b: np.ndarray, half: int) -> tuple[bool, tuple[float, ...]]:
    """Return the inverse of the template's small warp, (I + D)^-1 and -(I + D)^-1 d; False if the warp is too large.

    b : solution of the normal equations, (g d, g D, g, o) with D in units of half windows
    """
    gain = b[6]
    d00, d01 = 1.0 + b[2] / gain / half, b[3] / gain / half
    d10, d11 = b[4] / gain / half, 1.0 + b[5] / gain / half
    det = d00 * d11 - d01 * d10
    sx, sy = b[0] / gain, b[1] / gain
    i00, i01, i10, i11 = d11 / det, -d01 / det, -d10 / det, d00 / det
    fine = 0.5 < det < 2.0 and sx * sx + sy * sy <= 4.0 * half * half
    return fine, (-(i00 * sx + i01 * sy), -(i10 * sx + i11 * sy), i00, i01, i10, i11)


@njit(**OPTIONS)
def _iterate_warp(
    A: np.ndarray,
    L: np.ndarray,
    weight: np.ndarray,
    coefficients: np.ndarray,
    warp: tuple[float, ...],
    limits: Arrays,
    b: np.ndarray,
    sampled: np.ndarray,
) -> tuple[int, tuple[float, ...], float, float]:
    """Return status and final warp of a window, the spread of its grey values, and their product with the template.

    L : Cholesky factor of the normal matrix; ``b (8,)`` and ``sampled (pixels,)`` are set to solution and grey values.
    """
    limit, closure, reach = limits
    half, total_weight = int(math.sqrt(len(weight))) // 2, weight.sum()
    start_x, start_y = warp[0], warp[1]
    spread = product = 0.0
    weights, corner = np.empty((8, 2 * half + 1)), np.empty(2 * half + 1, np.int64)
    for _ in range(limit):
        if not _sample_window(coefficients, warp, half, weights, corner, sampled):
            return OUTSIDE, warp, spread, product
        for k in range(TERMS):
            b[k] = _sum_products(A[k], sampled, weight)
        spread = _sum_products(sampled, sampled, weight) - b[7] / total_weight * b[7]
        product = b[6]  # the mean of the template's grey values is 0
        _solve(L, b)
        if not b[6] > SMALLEST_GAIN:
            return DIVERGED, warp, spread, product
        fine, step = _invert_step(b, half)
        if not fine:
            return DIVERGED, warp, spread, product
        px, py, a00, a01, a10, a11 = warp
        tx, ty, i00, i01, i10, i11 = step
        px, py = px + a00 * tx + a01 * ty, py + a10 * tx + a11 * ty
        warp = (px, py, a00 * i00 + a01 * i10, a00 * i01 + a01 * i11, a10 * i00 + a11 * i10, a10 * i01 + a11 * i11)
        away_x, away_y = px - start_x, py - start_y
        if away_x * away_x + away_y * away_y > reach * reach:
            return DIVERGED, warp, spread, product
        if abs(tx) + abs(ty) + half * (abs(i00 - 1.0) + abs(i01) + abs(i10) + abs(i11 - 1.0)) * 0.25 < closure:
            return DONE, warp, spread, product
    return ITERATIONS_USED_UP, warp, spread, product


@njit(**OPTIONS)
def _propagate_covariance(L: np.ndarray, variance: float, warp: tuple[float, ...], covariance: np.ndarray) -> None:
    """Write the covariance (2, 2) px² of a position from the normal equations and the variance of unit weight."""
    unit = np.zeros(TERMS)
    unit[0] = 1.0
    _solve(L, unit)
    c00, c01 = unit[0] * variance, unit[1] * variance
    unit[:] = 0.0
    unit[1] = 1.0
    _solve(L, unit)
    c11 = unit[1] * variance
    _, _, a00, a01, a10, a11 = warp
    covariance[0, 0] = a00 * a00 * c00 + 2.0 * a00 * a01 * c01 + a01 * a01 * c11
    covariance[1, 1] = a10 * a10 * c00 + 2.0 * a10 * a11 * c01 + a11 * a11 * c11
    covariance[0, 1] = a00 * a10 * c00 + (a00 * a11 + a01 * a10) * c01 + a01 * a11 * c11
    covariance[1, 0] = covariance[0, 1]


@njit(**OPTIONS)
def match_range(
    begin: int, end: int, images: Arrays, centre: np.ndarray, weight: np.ndarray, limits: Arrays, results: Arrays
) -> None:
    """Match the windows ``begin:end`` around pixels ``centre (n, 2)``, whose templates are inside the first image.

    images : grey values and slopes by column and row of the first, spline coefficients of the second
    weight : (side, side); limits : number of iterations, smallest change, largest distance from the start
    results : positions, affine maps (initial values, replaced), covariance, figures (correlation, gain, RMS), status
    """
    first, by_x, by_y, coefficients = images
    xy, affine, covariance, figures, status = results
    side = weight.shape[0]
    A, N = np.empty((TERMS, side * side)), np.empty((TERMS, TERMS))
    b, sampled = np.empty(TERMS), np.empty(side * side)
    weight = weight.ravel()
    total_weight = weight.sum()
    for n in range(begin, end):
        _make_template(first, by_x, by_y, centre[n, 0], centre[n, 1], side, weight, A, N)
        variance = N[6, 6]
        if not variance > 0.0 or not _factorise(N):
            status[n] = WEAK
            continue
        warp = (xy[n, 0], xy[n, 1], affine[n, 0, 0], affine[n, 0, 1], affine[n, 1, 0], affine[n, 1, 1])
        status[n], warp, spread, product = _iterate_warp(A, N, weight, coefficients, warp, limits, b, sampled)
        if status[n] == ITERATIONS_USED_UP or status[n] == DONE:
            for k in range(TERMS):
                sampled -= A[k] * b[k]
            squares = _sum_products(sampled, sampled, weight) / total_weight
            figures[n, 0] = product / math.sqrt(max(variance * spread, 1e-30))
            figures[n, 1] = b[6]
            figures[n, 2] = math.sqrt(squares)
            _propagate_covariance(N, squares / (b[6] * b[6]), warp, covariance[n])
        xy[n, 0], xy[n, 1], affine[n, 0, 0], affine[n, 0, 1], affine[n, 1, 0], affine[n, 1, 1] = warp


@njit(**OPTIONS)
def compute_window_spreads(grey: np.ndarray, half: int) -> np.ndarray:
    """Return the sum of squared deviations from the mean of the window around each pixel, 0 for flat windows.

    Windows are square, ``2 half + 1`` pixels a side; the result is 0 at pixels whose window exceeds the image.
    """
    rows, columns = grey.shape
    side = 2 * half + 1
    spreads = np.zeros((rows, columns), np.float32)
    if rows < side or columns < side:
        return spreads
    totals, squares = np.zeros(columns), np.zeros(columns)  # sums over the lines of a window, by column
    for y in range(rows):
        for x in range(columns):
            value = float(grey[y, x])
            totals[x] += value
            squares[x] += value * value
            if y >= side:
                value = float(grey[y - side, x])
                totals[x] -= value
                squares[x] -= value * value
        if y < side - 1:
            continue
        total, square = 0.0, 0.0
        for x in range(columns):
            total += totals[x]
            square += squares[x]
            if x >= side:
                total -= totals[x - side]
                square -= squares[x - side]
            if x >= side - 1:
                spread = square - total * total / (side * side)
                if spread > ROUNDING_SHARE * square:
                    spreads[y - half, x - half] = spread
    return spreads


@njit(**OPTIONS)
def _multiply_windows(template: np.ndarray, second: np.ndarray, x: int, y: int, products: np.ndarray) -> None:
    """Write the products of a template with the windows whose first pixels are ``x … x + 7`` in row ``y``.

    Each pixel of the template is multiplied with eight adjacent pixels at a time.
    """
    products[:] = 0.0
    for b in range(template.shape[0]):
        row, template_row = second[y + b], template[b]
        q0 = q1 = q2 = q3 = q4 = q5 = q6 = q7 = np.float32(0.0)
        place = np.uintp(x)
        for a in range(np.uintp(template.shape[1])):
            t = template_row[a]
            start = place + a
            q0 += t * row[start]
            q1 += t * row[start + np.uintp(1)]
            q2 += t * row[start + np.uintp(2)]
            q3 += t * row[start + np.uintp(3)]
            q4 += t * row[start + np.uintp(4)]
            q5 += t * row[start + np.uintp(5)]
            q6 += t * row[start + np.uintp(6)]
            q7 += t * row[start + np.uintp(7)]
        products[0] += q0
        products[1] += q1
        products[2] += q2
        products[3] += q3
        products[4] += q4
        products[5] += q5
        products[6] += q6
        products[7] += q7


@njit(**OPTIONS)
def _load_template(first: np.ndarray, column: int, row: int, template: np.ndarray) -> float:
    """Write the grey values around a pixel minus their mean; return the sum of their squares."""
    side = template.shape[0]
    top, left = row - side // 2, column - side // 2
    mean = 0.0
    for j in range(side):
        for i in range(side):
            value = first[top + j, left + i]
            template[j, i] = value
            mean += value
    mean /= side * side
    norm = 0.0
    for j in range(side):
        for i in range(side):
            template[j, i] -= mean
            norm += template[j, i] * template[j, i]
    return norm


@njit(**OPTIONS)
def _find_rival(score: np.ndarray, size: int, column: int, row: int) -> tuple[float, bool]:
    """Return the best other peak of a box of scores (-1 without), and whether the best one is inside the box.

    Rivals are local maxima only, not the slopes of the best peak; scores of positions that were not computed are -2.
    """
    rival = -1.0
    inside = 0 < column < size - 1 and 0 < row < size - 1
    for j in range(size):
        for i in range(size):
            separation = max(abs(i - column), abs(j - row))
            if separation > RIVAL_PX and score[j, i] > rival:
                peak = True
                for b in range(max(j - 1, 0), min(j + 2, size)):
                    for a in range(max(i - 1, 0), min(i + 2, size)):
                        if score[b, a] > score[j, i]:
                            peak = False
                if peak:
                    rival = score[j, i]
            if separation == 1 and score[j, i] < -1.5:
                inside = False
    return rival, inside


@njit(**OPTIONS)
def search_range(
    begin: int,
    end: int,
    first: np.ndarray,
    second: np.ndarray,
    clear: np.ndarray,
    spreads: np.ndarray,
    centre: np.ndarray,
    predicted: np.ndarray,
    direction: np.ndarray,
    reach: np.ndarray,
    half: int,
    best: np.ndarray,
    figures: np.ndarray,
) -> None:
    """Search the windows ``begin:end``; arguments as for `search_windows`, and the image's `compute_window_spreads`.

    ``second`` has seven more columns than ``clear``, which are in no window.
    """
    side = 2 * half + 1
    rows, columns = clear.shape
    template, products = np.empty((side, side), np.float32), np.empty(SIDE_BY_SIDE)
    largest = 2 * math.ceil(math.hypot(reach[begin:end, 0].max(), reach[begin:end, 1].max())) + 3
    score = np.empty((largest, largest))
    for n in range(begin, end):
        norm = _load_template(first, centre[n, 0], centre[n, 1], template)
        size = 2 * math.ceil(math.hypot(reach[n, 0], reach[n, 1])) + 1
        x0, y0 = round(predicted[n, 0]) - size // 2, round(predicted[n, 1]) - size // 2
        top, at_i, at_j = -2.0, -1, -1
        for j in range(size):
            computed = -1  # the last position whose product is computed
            for i in range(size):
                score[j, i] = -2.0
                dx, dy = x0 + i - predicted[n, 0], y0 + j - predicted[n, 1]
                along = dx * direction[n, 0] + dy * direction[n, 1]
                across = dx * direction[n, 1] - dy * direction[n, 0]
                if abs(along) > reach[n, 0] or abs(across) > reach[n, 1]:
                    continue
                x, y = x0 + i, y0 + j
                if x < half or y < half or x >= columns - half or y >= rows - half or not clear[y, x]:
                    continue
                if i > computed:
                    _multiply_windows(template, second, x - half, y - half, products)
                    computed = i + SIDE_BY_SIDE - 1
                value = 0.0
                if spreads[y, x] > 0.0:
                    value = products[i - computed + SIDE_BY_SIDE - 1] / math.sqrt(max(norm * spreads[y, x], 1e-20))
                score[j, i] = value
                if value > top:
                    top, at_i, at_j = value, i, j
        if at_i >= 0:
            rival, inside = _find_rival(score, size, at_i, at_j)
            best[n, 0], best[n, 1] = x0 + at_i, y0 + at_j
            figures[n, 0], figures[n, 1], figures[n, 2] = top, rival, 1.0 if inside else 0.0

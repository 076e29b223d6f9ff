"""Shifts between two orthoimages on the same grid, window by window.

A window T of the first orthoimage is searched in the second, S, at whole pixels by normalised cross-correlation, and
then by least squares with the observation equations (Gruen 1985; shifts only, since both are in one map projection)

    T(x) = g S(x + d) + o

for the shift d, gain g and offset o. The gradients are the mean of those of both windows (Benhimane and Malis 2004),
which halves the bias due to noise. S is interpolated by cubic B-splines, so that shifts are not biased towards whole or
half pixels. Both windows are smoothed slightly first.

The shift is the position in the second minus that in the first, in pixels to the right and down.

**Common shift.** If the common shift of the two orthoimages may exceed the search range of windows, probes distributed
over the common area are compared at half resolution by their gradient directions. The correlation surfaces of all
probes are summed before the peak is searched: the common shift adds up, but accidental similarities of single probes
(rows of houses, fields, water) do not.
"""

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ..foundation.pixel_filters import blur, reduce_by_area
from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import GRIDS, ITERATIONS, threshold, thresholds
from ..foundation.workers.scheduling import open_calls
from ..measurement.window_matching.correlation import (
    compute_orientation_field,
    correlate_fields,
    correlate_template,
    find_correlation_peak,
)
from ..measurement.window_matching.windows import MATCHING
from .options import MisregistrationOptions


@thresholds
class SHIFT:
    """Measurement of the shift between two orthoimages: by windows, and the common shift."""

    reach_px: float = threshold(1.0, "px", "largest shift of a window from the best whole pixel")
    reduction: int = threshold(2, "", "reduction factor of orthoimages for the common shift")
    probe_px: int = threshold(256, "px", "side of a probe (smaller in a small area)")


Read = Callable[[int, int, int, int], tuple[np.ndarray, np.ndarray]]  #: `block.Raster.read`


class WindowOutcome(IntEnum):
    """Result of matching a window."""

    MATCHED = 0
    NODATA = 1  #: not all pixels of the window are valid in both images
    FLAT = 2  #: no texture
    UNLIKE = 3  #: correlation below the limit
    FAR = 4  #: the correlation maximum is at the edge of the search area
    UNSTEADY = 5  #: least squares did not converge or are not accurate enough

    @property
    def label(self) -> str:
        return self.name.lower()


class WindowShifts(NamedTuple):
    """Shifts of windows between two orthoimages.

    centre : (n, 2) column, row of the windows' centres; shift_px : (n, 2) NaN if not matched
    correlation : (n,) normalised cross-correlation at whole pixels; sigma_px : (n,) standard deviation of a shift
    outcome : (n,) values of `WindowOutcome`
    """

    centre: np.ndarray
    shift_px: np.ndarray
    correlation: np.ndarray
    sigma_px: np.ndarray
    outcome: np.ndarray

    @property
    def good(self) -> np.ndarray:
        """Mask of the windows that were matched."""
        return np.asarray(self.outcome == WindowOutcome.MATCHED)


class Shift(NamedTuple):
    """The shift of one window."""

    xy: np.ndarray
    correlation: float
    sigma_px: float
    outcome: WindowOutcome


def window_centres(columns: int, rows: int, options: MisregistrationOptions) -> np.ndarray:
    """Return the centres of windows that are distributed evenly over an area.

    columns, rows : size of the area in pixels; options : size and number of the windows
    Result: (n, 2) column, row.
    """
    reach = options.window_px // 2 + options.search_px + MATCHING.edge_px
    spacing = max(options.window_px // 2, -(-max(columns, rows) // options.most))
    axes = []
    for size in (columns, rows):
        count = max(0, (size - 2 * reach) // spacing + 1) if size > 2 * reach else 0
        first = (size - (count - 1) * spacing) // 2
        axes.append(first + spacing * np.arange(count))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def measure_shifts(
    first: Read,
    second: Read,
    centres: np.ndarray,
    options: MisregistrationOptions,
    tell: Callable[[float], None] | None = None,
    threads: int = 1,
) -> WindowShifts:
    """Match windows of two orthoimages.

    first, second : functions that read a part of the common area; centres : (n, 2) column, row of the window centres
    options : how windows are matched; tell : receives the completed fraction; threads : number of threads
    Result: one shift for each window.
    """
    found = []
    with open_calls(threads=threads) as calls:
        shifts = calls.answers(lambda at: _match_window(first, second, at, options), centres.tolist())
        for number, shift in enumerate(shifts):
            if tell is not None and number % 32 == 0:
                tell(number / len(centres))
            found.append(shift)
    xy = np.array([f.xy for f in found]).reshape(-1, 2)
    figures = np.array([(f.correlation, f.sigma_px, f.outcome) for f in found]).reshape(-1, 3)
    return WindowShifts(centres, xy, figures[:, 0], figures[:, 1], figures[:, 2].astype(int))


def _match_window(first: Read, second: Read, centre: Sequence[int], options: MisregistrationOptions) -> Shift:
    """Return the shift of the window around column, row."""
    (column, row), side = centre, options.window_px // 2 + MATCHING.edge_px
    reach = side + options.search_px
    template = first(column - side, row - side, 2 * side, 2 * side)
    if not template[1].all():
        return _make_failure(WindowOutcome.NODATA)
    area = second(column - reach, row - reach, 2 * reach, 2 * reach)
    pixel_pair = template[0], np.where(area[1], area[0], np.mean(area[0]))
    smoothing_px, inner = MATCHING.gradient_smoothing_px, slice(MATCHING.edge_px, -MATCHING.edge_px)
    grey, place = (blur(np.asarray(pixels, dtype=np.float32), smoothing_px) for pixels in pixel_pair)
    core = grey[inner, inner]
    if not core.std(dtype=np.float64) > 1e-6 * max(1.0, abs(float(core.mean(dtype=np.float64)))):  # no overflow
        return _make_failure(WindowOutcome.FLAT)
    score = correlate_template(core, place[inner, inner])
    row, column = divmod(int(np.argmax(score)), score.shape[1])
    best = float(score[row, column])
    if best < options.min_correlation:
        return _make_failure(WindowOutcome.UNLIKE, best)
    if row in (0, score.shape[0] - 1) or column in (0, score.shape[1] - 1):
        return _make_failure(WindowOutcome.FAR, best)
    side = grey.shape[0]
    if not area[1][row : row + side, column : column + side].all():
        return _make_failure(WindowOutcome.NODATA, best)
    # Least squares from the best whole pixel; both windows have a border for interpolation
    centre_part = place[row : row + side, column : column + side]
    T, T_x, T_y = _interpolate_window(_filter_spline(grey), np.zeros(2))
    coefficients = _filter_spline(centre_part)
    line = np.exp(-0.5 * (((np.arange(len(T)) - (len(T) - 1) / 2.0) / (len(T) / 2.0)) / MATCHING.taper) ** 2)
    weight = (line[:, None] * line).ravel()
    d, gain, offset = np.zeros(2), float(T.std() / max(centre_part.std(), 1e-9)), 0.0
    for _ in range(ITERATIONS.most):
        S, S_x, S_y = _interpolate_window(coefficients, d)
        A = np.stack([(gain * S_x + T_x) / 2.0, (gain * S_y + T_y) / 2.0, S, np.ones_like(S)]).reshape(4, -1)
        misfit = (T - gain * S - offset).ravel()
        N = (A * weight) @ A.T
        scaled = N / np.sqrt(np.outer(np.diag(N), np.diag(N)))
        if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > 1e8:
            return _make_failure(WindowOutcome.UNSTEADY, best)
        step = np.linalg.solve(N, (A * weight) @ misfit)
        misfit -= step @ A
        d, gain, offset = d + step[:2], gain + step[2], offset + step[3]
        if np.abs(d).max() > SHIFT.reach_px or gain <= 0.0:
            return _make_failure(WindowOutcome.UNSTEADY, best)
        if np.hypot(*step[:2]) < ITERATIONS.fine:
            break
    variance = float(weight @ misfit**2 / weight.sum())
    # Cofactor matrix ``(4, 4)`` of the unknowns for noise that was white before the smoothing: afterwards its
    # correlation is a Gaussian of sqrt(2) times the width, so that neighbouring pixels are not independent observations
    weighted = A * weight
    side = round(np.sqrt(weighted.shape[1]))
    spread = np.stack([blur(row.reshape(side, side), np.sqrt(2.0) * smoothing_px) for row in weighted])
    inverse = np.linalg.inv(N)
    cofactors = inverse @ (4 * np.pi * smoothing_px**2 * weighted @ spread.reshape(4, -1).T) @ inverse
    Q = np.array(cofactors) * variance
    sigma = float(np.sqrt(max(Q[0, 0], Q[1, 1])))
    if sigma > options.max_sigma_px:
        return _make_failure(WindowOutcome.UNSTEADY, best)
    return Shift(np.array([column, row]) - options.search_px + d, best, sigma, WindowOutcome.MATCHED)


def _make_failure(outcome: WindowOutcome, correlation: float = np.nan) -> Shift:
    return Shift(np.full(2, np.nan), correlation, np.nan, outcome)


def _filter_spline(grey: np.ndarray) -> np.ndarray:
    return np.asarray(ndimage.spline_filter(grey, order=3, output=np.float64, mode="mirror"))


def _weigh_spline(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the four weights of the cubic B-spline at the fraction t of a cell, and those of its derivative."""
    s = 1.0 - t
    values = [s**3 / 6, 2 / 3 - t**2 * (2 - t) / 2, 2 / 3 - s**2 * (2 - s) / 2, t**3 / 6]
    slopes = [-(s**2) / 2, t * (3 * t - 4) / 2, s * (4 - 3 * s) / 2, t**2 / 2]
    return np.array(values), np.array(slopes)


def _interpolate_window(coefficients: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the window inside the border, shifted by at most `SHIFT.reach_px`, and its derivatives by x and y."""
    whole_px = np.floor(d).astype(int)
    x_values, x_slopes = _weigh_spline(float(d[0] - whole_px[0]))
    y_values, y_slopes = _weigh_spline(float(d[1] - whole_px[1]))
    side = len(coefficients) - 2 * MATCHING.edge_px
    start = MATCHING.edge_px - 1 + whole_px
    parts = [coefficients[:, start[0] + k : start[0] + k + side] for k in range(4)]
    across, slope_across = (sum(w * p for w, p in zip(ws, parts, strict=True)) for ws in (x_values, x_slopes))

    def sum_rows(rows: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.asarray(sum(w * rows[start[1] + k : start[1] + k + side] for k, w in enumerate(weights)))

    return sum_rows(across, y_values), sum_rows(slope_across, y_values), sum_rows(across, y_slopes)


# ---- statistics ------------------------------------------------------------------------------------------------------


def shift_statistics(shift_px: np.ndarray, pixel_m: float) -> dict[str, float | int | None]:
    """Return robust statistics of shifts: medians, NMADs, median and 90th percentile of the lengths.

    shift_px : (n, 2) shifts of matched windows; pixel_m : side of a pixel in metres
    Result: values by name; the names contain the unit.
    """
    if not len(shift_px):
        return dict.fromkeys(STATISTICS) | {"windows": 0}
    middle = np.median(shift_px, axis=0)
    nmad = robust_sigma(shift_px - middle, axis=0)
    length = np.hypot(*shift_px.T)
    figures = (
        len(shift_px),
        *middle.tolist(),
        *nmad.tolist(),
        float(np.median(length)),
        float(np.percentile(length, 90.0)),
        float(np.median(length)) * pixel_m,
        float(np.percentile(length, 90.0)) * pixel_m,
    )
    return dict(zip(STATISTICS, figures, strict=True))


STATISTICS = (
    "windows", "median_dx_px", "median_dy_px", "nmad_dx_px", "nmad_dy_px", "median_px", "p90_px", "median_m", "p90_m",
)  # fmt: skip


def find_common_shift(first: Read, second: Read, columns: int, rows: int) -> np.ndarray:
    """Return the common shift ``(2,)`` in whole pixels, right and down, accurate to 2 px; 0 without a significant peak.

    ``first(...)`` and ``second(...)`` read the common area of columns x rows pixels; ``second`` also beyond it.
    """
    side = min(SHIFT.probe_px, columns // 2, rows // 2) // SHIFT.reduction * SHIFT.reduction
    if side < 16 * SHIFT.reduction:
        return np.zeros(2, dtype=int)
    total = np.zeros((2 * SHIFT.probe_px // SHIFT.reduction + 1,) * 2)
    wide = side + 2 * SHIFT.probe_px
    for row in np.linspace(0, rows - side, GRIDS.coarse).astype(int).tolist():
        for column in np.linspace(0, columns - side, GRIDS.coarse).astype(int).tolist():
            probe = _compute_field(*first(column, row, side, side))
            if probe.any():
                total += correlate_fields(
                    probe, _compute_field(*second(column - SHIFT.probe_px, row - SHIFT.probe_px, wide, wide))
                )
    peak = find_correlation_peak(total)
    if peak.contrast < MATCHING.contrast:
        return np.zeros(2, dtype=int)
    return np.rint(peak.shift * SHIFT.reduction - SHIFT.probe_px).astype(int)


def _compute_field(grey: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return the gradient directions at reduced resolution; 0 for pixels reduced from pixels that are not all valid."""
    size = (grey.shape[1] // SHIFT.reduction, grey.shape[0] // SHIFT.reduction)
    mean = reduce_by_area(np.where(valid, grey, 0).astype(np.float32), size)
    is_complete = reduce_by_area(valid.astype(np.float32), size) > 0.999
    return compute_orientation_field(mean, is_complete)

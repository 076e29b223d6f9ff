"""Residuals of an image along its lines, and the significant waves in them.

A vibration of the attitude displaces all samples of a line together, so its residuals are a function of the line. The
residual v of a measurement contains the share r of its error, its redundancy number: v / r is the displacement of its
image against the mean of the other rays of its point, with the standard deviation s / sqrt(r). Two rays of a tie point
show the difference of the vibrations of two images, only across the epipolar line; with a small r they show nothing.

The spectrum is that of Lomb (1976) and Scargle (1982) as weighted least squares: to the means of cells (some lines of a
strip of samples) a sine is fitted together with a polynomial D, which an RPC's correction contains::

    y = D d + a cos(2 pi l / P) + b sin(2 pi l / P) + e      z = 1 - RSS(with the sine) / RSS(D alone)

Its false alarm probability over all periods is that of Baluev (2008, MNRAS 385, 1279), with n cells, k columns of D and
W = (1/P_min - 1/P_max) sqrt(4 pi var(l))::

    p = (1 - z)^((n - k - 2) / 2) (1 + W sqrt((n - k) z / 2) / sqrt(1 - z))

Cells of one strip can share errors (relief, matching), so that p alone is too small. In a second fit each strip has its
own sine: the common sine of all strips must be significant against their differences (F test with 2 and 2 (K - 1)
degrees of freedom). Waves are found one by one, the strongest first, each fitted together with all earlier ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import fft, special

from ...block.columns import group_by_number
from ...foundation.large_arrays import any_of_rows
from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import EQUALITY, ITERATIONS, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..result import Adjustment, Decision

#: Image axes of a residual: sample is across the track of a scanner, line along it.
WAVE_AXES = ("across", "along")


@thresholds
class WAVES:
    """Limits for the search for waves in residuals along the lines, and for their significance."""

    least_redundancy: float = threshold(
        0.25,
        "",
        "smallest redundancy number of a residual that is examined",
        "two images have 0.5 across, three along the track 0.67 in the middle one, 0.17 in the others",
    )
    shortest_lines: float = threshold(100.0, "lines", "shortest period of a wave")
    longest_share: float = threshold(
        0.6667, "", "longest period relative to the observed lines; the RPC correction absorbs longer waves"
    )
    oversampling: int = threshold(5, "", "frequencies computed in the width of a peak", "loss of height below 2 %")
    scanned_share: float = threshold(
        0.85,
        "",
        "smallest height of a peak in the transform over its exact height",
        "0.97 by frequencies, 0.94 by cells",
    )
    cells_in_period: int = threshold(8, "cells", "cells in the shortest period (amplitude reduced by 3 %)", "sinc")
    strips: int = threshold(4, "strips", "strips along the samples whose waves are compared")


_CELL_LINES = WAVES.shortest_lines / WAVES.cells_in_period  # lines of a cell


@dataclass(frozen=True, eq=False)
class LineProfile:
    """Displacements of one image along its lines, from its residuals.

    image_id : of the image; image : its number in the block
    line, sample : (n,) positions of the measurements in px
    shift_px : (n, 2) across and along the track (sample, line), residual over redundancy number; NaN: not observed
    weight : (n, 2) inverse of its variance, px⁻²; 0 if not observed
    """

    image_id: str
    image: int
    line: np.ndarray
    sample: np.ndarray
    shift_px: np.ndarray
    weight: np.ndarray

    @cached_property
    def spectra(self) -> dict[str, "Spectrum"]:
        """The spectrum of each axis with enough observations."""
        return {axis: one for axis in WAVE_AXES if (one := estimate_spectrum(self, axis)) is not None}


@dataclass(frozen=True)
class Wave:
    """``amplitude_px * sin(2 pi line / period_lines + phase_rad)`` along an axis, ``across`` or ``along``.

    sigma_px : standard deviation of the amplitude by the scatter of the cells
    false_alarm : probability of such a wave by chance, over all periods and tests
    """

    axis: str
    period_lines: float
    amplitude_px: float
    phase_rad: float
    sigma_px: float
    false_alarm: float

    def evaluate(self, line: np.ndarray) -> np.ndarray:
        """Return the displacement ``(n,)`` in px at lines."""
        phase = 2.0 * np.pi * np.asarray(line) / self.period_lines + self.phase_rad
        return np.asarray(self.amplitude_px * np.sin(phase))


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Powers of the best sine of each frequency along an axis, fitted together with a trend.

    frequencies, power : (f,) in cycles per line, ascending; power is z of the module's docstring
    residual_square, weight : weighted sum of squares of the cells without their trend, and the sum of their weights
    free : number of cells less that of the columns of the trend; line_variance : variance of the cells' lines
    """

    frequencies: np.ndarray
    power: np.ndarray
    residual_square: float
    weight: float
    free: int
    line_variance: float

    @property
    def period_lines(self) -> np.ndarray:
        """Periods ``(f,)``, from long to short ones."""
        return 1.0 / self.frequencies

    @property
    def amplitude_px(self) -> np.ndarray:
        """Amplitudes ``(f,)``: a sine of amplitude A explains A² sum(w) / 2 of the weighted sum of squares."""
        return np.sqrt(2.0 * self.power * self.residual_square / self.weight)

    @property
    def significant_px(self) -> float:
        """Amplitude (RMS over phases) that has the false alarm probability `SIGNIFICANCE.false_alarm`."""
        levels = np.linspace(0.0, 1.0, 2001)[1:-1]
        is_significant = self.compute_false_alarm(levels) < SIGNIFICANCE.false_alarm
        level = levels[np.argmax(is_significant)] if is_significant.any() else np.inf
        return float(np.sqrt(2.0 * level * self.residual_square / self.weight))

    def compute_false_alarm(self, power: np.ndarray | float, more_columns: int = 0) -> np.ndarray:
        """Return the probability that noise reaches z = ``power`` at any of the frequencies.

        more_columns : of waves that were fitted together with the trend
        """
        free, power = self.free - more_columns, np.asarray(power)
        if free < 4:
            return np.ones_like(power)
        width = (self.frequencies[-1] - self.frequencies[0]) * np.sqrt(4.0 * np.pi * self.line_variance)
        remainder = np.maximum(1.0 - power, 1e-300)
        single = remainder ** ((free - 2) / 2.0)
        return np.asarray(np.minimum(single * (1.0 + width * np.sqrt(free * power / 2.0) / np.sqrt(remainder)), 1.0))


@dataclass(frozen=True, eq=False)
class _Cells:
    """Means of cells along an axis: ``(n,)`` line, sample, value, weight and number of the strip."""

    line: np.ndarray
    sample: np.ndarray
    value: np.ndarray
    weight: np.ndarray
    strip: np.ndarray

    @property
    def root(self) -> np.ndarray:
        return np.sqrt(self.weight)

    def make_trend(self) -> np.ndarray:
        """Return the columns D ``(n, k)`` of a cubic along the lines that changes linearly over the samples."""
        u, v = (2.0 * (x - x.min()) / max(np.ptp(x), 1.0) - 1.0 for x in (self.line, self.sample))
        square = u * u
        return np.column_stack([np.ones_like(u), u, square, square * u, v, v * u, v * square])

    def make_sines(self, frequency: float) -> np.ndarray:
        angle = 2.0 * np.pi * frequency * self.line
        return np.column_stack([np.cos(angle), np.sin(angle)])


def collect_line_profiles(result: Adjustment) -> list[LineProfile]:
    """Return the line profile of each image from the residuals of an adjustment, in the order of the images.

    Residuals of tie points, GCPs and points on a surface are used equally, by redundancy numbers; rejected ones are
    not.
    """
    rows = result.block.measurements
    is_observed = np.isfinite(result.tested_residual_px) & (result.redundancy_numbers >= WAVES.least_redundancy)
    is_observed &= ((result.decision == int(Decision.KEPT)) & (result.weight > 0.0))[:, None]
    observed = np.flatnonzero(any_of_rows(is_observed))
    order, bounds = group_by_number(rows.image[observed], len(result.block.images))
    observed = observed[order]
    residual, share, is_observed = (
        values[observed] for values in (result.tested_residual_px, result.redundancy_numbers, is_observed)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = np.where(is_observed, residual / share, np.nan)
    weight = np.where(is_observed, share / result.sigma_px[observed, None] ** 2, 0.0)
    sample, line = rows.xy[observed].T
    parts = [slice(first, last) for first, last in pairwise(bounds.tolist())]
    return [
        LineProfile(image.id, number, line[part], sample[part], shift[part], weight[part])
        for number, (image, part) in enumerate(zip(result.block.images, parts, strict=True))
    ]


def estimate_spectrum(profile: LineProfile, axis: str) -> Spectrum | None:
    """Return the spectrum of a profile along an axis, None with too few observations."""
    cells = _make_cells(profile, axis)
    if cells is None:
        return None
    # The frequencies in cycles per line are those of the fast Fourier transform of `_scan_powers`
    span = max(float(np.ptp(cells.line)), 1.0)
    step = 1.0 / (fft.next_fast_len(int(np.ceil(WAVES.oversampling * span / _CELL_LINES)), real=True) * _CELL_LINES)
    first, last = int(np.ceil(1.0 / (WAVES.longest_share * span * step))), int(1.0 / (WAVES.shortest_lines * step))
    if last <= first:
        return None
    frequencies, trend = step * np.arange(first, last + 1), cells.make_trend()
    return Spectrum(
        frequencies,
        *_scan_powers(cells, trend, frequencies),
        float(cells.weight.sum()),
        len(cells.value) - trend.shape[1],
        float(np.var(cells.line)),
    )


def find_waves(profile: LineProfile, tests: int = 1) -> tuple[Wave, ...]:
    """Return the significant waves of an image, the largest first.

    tests : number of images and axes that are examined together, by which the probabilities are multiplied
    """
    waves = [wave for axis in WAVE_AXES for wave in _find_waves_along(profile, axis, tests)]
    return tuple(sorted(waves, key=lambda wave: -wave.amplitude_px))


def find_block_waves(profiles: Sequence[LineProfile]) -> list[tuple[Wave, ...]]:
    """Return the significant waves of each image of a block."""
    tests = len(WAVE_AXES) * max(len(profiles), 1)
    return [find_waves(profile, tests) for profile in profiles]


def _find_waves_along(profile: LineProfile, axis: str, tests: int) -> list[Wave]:
    """Return the significant waves along an axis, each found in what the earlier ones leave, and fitted together.

    tests : number of spectra that are examined together, by which the probabilities of a false alarm are multiplied
    """
    spectrum = profile.spectra.get(axis)
    if spectrum is None:
        return []
    frequencies, power, step = spectrum.frequencies, spectrum.power, spectrum.frequencies[1] - spectrum.frequencies[0]
    frequencies_found, chances = list[float](), list[float]()

    def compute_chance(z: float) -> float:
        return tests * float(spectrum.compute_false_alarm(z, 2 * len(frequencies_found)))

    def may_be_significant(power: np.ndarray) -> bool:
        """Whether the scan may have missed a significant wave; if not, as in most images, no exact one is computed."""
        return compute_chance(min(float(power.max()) / WAVES.scanned_share, 1.0)) < SIGNIFICANCE.false_alarm

    if not may_be_significant(power) or (cells := _make_cells(profile, axis)) is None:
        return []
    columns = cells.make_trend()
    while may_be_significant(power) and len(chances) < ITERATIONS.most:
        fine_frequencies = frequencies[int(np.argmax(power))] + step * np.linspace(-1.0, 1.0, 21)
        fine_frequencies = np.clip(fine_frequencies, frequencies[0], frequencies[-1])
        reduced = _remove_columns(cells, columns)
        z, frequency = max((_compute_power(cells, *reduced, one), one) for one in fine_frequencies.tolist())
        chance = compute_chance(z)
        if not chance < SIGNIFICANCE.false_alarm or not _compare_strips(cells, columns, frequency) < SIGNIFICANCE.level:
            break
        columns = np.column_stack([columns, cells.make_sines(frequency)])
        frequencies_found.append(frequency)
        chances.append(chance)
        power, _ = _scan_powers(cells, columns, frequencies)
        for one in frequencies_found:  # no second wave that the lines cannot separate
            power[np.abs(frequencies - one) < 1.0 / np.ptp(cells.line)] = 0.0
    if not frequencies_found:
        return []
    # All waves and the trend together
    root = cells.root
    design, value = columns * root[:, None], cells.value * root
    solved = np.linalg.lstsq(design, value, rcond=None)[0]
    variance = float(np.sum((value - design @ solved) ** 2)) / max(len(value) - design.shape[1], 1)
    sigma = float(np.sqrt(2.0 * variance / cells.weight.sum()))
    pairs = solved[-2 * len(frequencies_found) :].reshape(-1, 2)
    return [
        Wave(axis, 1.0 / frequency, float(np.hypot(a, b)), float(np.arctan2(a, b)), sigma, chance)
        for frequency, (a, b), chance in zip(frequencies_found, pairs.tolist(), chances, strict=True)
    ]


def _make_cells(profile: LineProfile, axis: str) -> _Cells | None:
    """Return the means of the cells of a profile, None where they are too few."""
    column = WAVE_AXES.index(axis)
    weight, shift = profile.weight[:, column], profile.shift_px[:, column]
    usable = np.flatnonzero((weight > 0.0) & np.isfinite(shift))
    if len(usable) < SAMPLES.fewest:
        return None
    deviation = shift[usable] - np.median(shift[usable])
    usable = usable[np.abs(deviation) <= SIGNIFICANCE.certain * max(float(robust_sigma(deviation)), 1e-12)]
    line, sample, weight, shift = profile.line[usable], profile.sample[usable], weight[usable], shift[usable]
    # Strips with equal numbers of measurements
    last = np.arange(1, WAVES.strips) * (len(sample) - 1) // WAVES.strips
    strip = sum((sample > edge).astype(np.int64) for edge in np.partition(sample, last)[last])
    cell = np.floor((line - line.min()) / _CELL_LINES).astype(np.int64) * WAVES.strips + strip
    sums = [np.bincount(cell, weight * x) for x in (1.0, line, sample, shift, strip)]
    filled = np.flatnonzero(sums[0])
    if len(filled) < SAMPLES.fewest:
        return None
    total = sums[0][filled]
    line, sample, value, strip = (one[filled] / total for one in sums[1:])
    return _Cells(line, sample, value, total, np.rint(strip).astype(np.int64))


def _scan_powers(cells: _Cells, columns: np.ndarray, frequencies: np.ndarray) -> tuple[np.ndarray, float]:
    """Return z ``(f,)`` of a sine fitted with ``columns``, and the residual sum of squares of the columns alone.

    z is the share of that sum which the sine explains. It uses fast Fourier transforms of sums over the cells of some
    lines, with a common line for each sum.

    columns : (n, k) trend and waves found so far; frequencies : (f,) multiples of one step, cycles per line
    """
    root = cells.root
    basis, value, residual_square = _remove_columns(cells, columns)
    bins = np.rint((cells.line - cells.line.min()) / _CELL_LINES).astype(np.int64)
    count = int(np.rint(1.0 / ((frequencies[1] - frequencies[0]) * _CELL_LINES)))
    bin_numbers = np.rint(frequencies * count * _CELL_LINES).astype(np.int64)

    summed = cells.weight, root * value, *(root * column for column in basis.T)
    of_weight, *transforms = fft.rfft([np.bincount(bins, one, count) for one in summed])
    of_value, of_basis = transforms[0][bin_numbers], np.stack(transforms[1:])[:, bin_numbers]
    # Normal equations of cosine and sine, reduced by the columns; none if these explain nearly all of a sine
    doubled, total = of_weight[2 * bin_numbers], of_weight[0].real
    cc = 0.5 * (total + doubled.real) - np.sum(of_basis.real**2, axis=0)
    ss = 0.5 * (total - doubled.real) - np.sum(of_basis.imag**2, axis=0)
    cs = 0.5 * doubled.imag - np.sum(of_basis.real * of_basis.imag, axis=0)
    c, s, determinant = of_value.real, of_value.imag, cc * ss - cs**2
    sound = determinant > (EQUALITY.negligible * total) ** 2
    explained = (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / np.where(sound, determinant, 1.0)
    return np.where(sound, np.clip(explained / residual_square, 0.0, 1.0), 0.0), residual_square


def _compute_power(
    cells: _Cells, basis: np.ndarray, value: np.ndarray, residual_square: float, frequency: float
) -> float:
    """Return z of a sine as `_scan_powers`, but exactly, at any frequency; other arguments are of `_remove_columns`."""
    sines = cells.make_sines(frequency) * cells.root[:, None]
    sines -= basis @ (basis.T @ sines)
    return 1.0 - float(np.sum((value - sines @ np.linalg.lstsq(sines, value, rcond=None)[0]) ** 2)) / residual_square


def _remove_columns(cells: _Cells, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return an orthonormal basis ``(n, k)`` of the weighted columns, the values without them, and their square sum."""
    weighted = columns * cells.root[:, None]
    basis = weighted @ np.linalg.inv(np.linalg.cholesky(weighted.T @ weighted)).T
    value = cells.value * cells.root
    value = value - basis @ (basis.T @ value)
    return basis, value, max(float(value @ value), 1e-30)


def _compare_strips(cells: _Cells, columns: np.ndarray, frequency: float) -> float:
    """Return the probability that strips of samples without a common wave agree so well by chance (F test).

    columns : (n, k) trend and waves found so far; frequency : of the next wave, cycles per line
    """
    counts = np.bincount(cells.strip, minlength=WAVES.strips)
    strips = np.flatnonzero(counts >= SAMPLES.fewest)
    if len(strips) < 2:
        return 1.0
    is_used = np.isin(cells.strip, strips)
    root = cells.root[is_used, None]
    value = cells.value[is_used] * root[:, 0]
    sines = cells.make_sines(frequency)[is_used]
    strip_sines = np.concatenate([sines * (cells.strip[is_used] == strip)[:, None] for strip in strips], axis=1)
    squares = [
        float(np.sum((value - design @ np.linalg.lstsq(design, value, rcond=None)[0]) ** 2))
        for design in (root * np.column_stack([columns[is_used], *extra]) for extra in ([], [sines], [strip_sines]))
    ]
    freedom = 2 * (len(strips) - 1)
    ratio = (squares[0] - squares[1]) / 2.0 / max((squares[1] - squares[2]) / freedom, 1e-30)
    return float(special.fdtrc(2, freedom, ratio))

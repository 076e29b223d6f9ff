"""Residuals of an image along its lines, for report and verdict: profile, spectrum and waves (jitter)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..adjustment.jitter.spectrum import WAVE_AXES, LineProfile, Wave
from ..block.block import Image
from ..block.imaging_geometry import measure_pixel_m
from ..foundation.thresholds import LISTS, threshold, thresholds
from ..io.rasters.sun_angles import read_line_rate


@thresholds
class LINE_PROFILE:
    """Limits for the residuals along the lines in the report."""

    periods: int = threshold(160, "periods", "largest number in a spectrum; maxima of more frequencies")


def describe_line_profiles(
    images: Sequence[Image], profiles: Sequence[LineProfile], waves: Sequence[Sequence[Wave]]
) -> dict[str, Any]:
    """Return the report's entries by image: waves, and for some images profile and spectrum of both axes."""
    order = sorted(range(len(images)), key=lambda index: -max((w.amplitude_px for w in waves[index]), default=0.0))
    plotted, texts = set(order[: LISTS.images]), {}
    for index, (image, profile) in enumerate(zip(images, profiles, strict=True)):
        axes = {axis: entry for axis in WAVE_AXES if index in plotted and (entry := _describe_axis(profile, axis))}
        if not axes and not waves[index]:
            continue
        texts[image.id] = {"observations": len(profile.line), "waves": describe_waves(image, waves[index]), **axes}
    return texts


def describe_waves(image: Image, waves: Sequence[Wave]) -> list[dict[str, Any]]:
    """Return the report's entries of an image's waves; times are None if the delivery states no line rate."""
    if not waves:
        return []
    rate = read_line_rate(image.path) if image.path else None
    middle = image.rpc.localize(image.centre_px[None], image.middle_height_m).ground
    pixel_m = dict(zip(WAVE_AXES, measure_pixel_m(image.rpc, middle), strict=True))
    return [
        {
            "axis": wave.axis,
            "period_lines": wave.period_lines,
            "period_s": wave.period_lines / rate if rate else None,
            "amplitude_px": wave.amplitude_px,
            "sigma_px": wave.sigma_px,
            "amplitude_m": wave.amplitude_px * pixel_m[wave.axis],
            "phase_rad": wave.phase_rad,
            "false_alarm": wave.false_alarm,
        }
        for wave in waves
    ]


def _describe_axis(profile: LineProfile, axis: str) -> dict[str, Any] | None:
    """Return mean displacements by parts of the lines, and amplitudes by period; None with too few observations."""
    spectrum, column = profile.spectra.get(axis), WAVE_AXES.index(axis)
    if spectrum is None:
        return None
    is_used = profile.weight[:, column] > 0.0
    line, shift, weight = profile.line[is_used], profile.shift_px[is_used, column], profile.weight[is_used, column]
    part = np.minimum(((line - line.min()) / np.ptp(line) * LINE_PROFILE.periods).astype(int), LINE_PROFILE.periods - 1)
    total, lines, shifts = (np.bincount(part, weight * x) for x in (1.0, line, shift))
    filled = total > 0.0
    amplitude = spectrum.amplitude_px
    step = -(-len(amplitude) // LINE_PROFILE.periods)
    padded = np.pad(amplitude, (0, -len(amplitude) % step)).reshape(-1, step)
    highest = np.arange(0, len(amplitude), step) + np.argmax(padded, axis=1)
    return {
        "lines": np.round(lines[filled] / total[filled], 1).tolist(),
        "shift_px": np.round(shifts[filled] / total[filled], 4).tolist(),
        "period_lines": np.round(spectrum.period_lines[highest], 1).tolist(),
        "amplitude_px": np.round(amplitude[highest], 4).tolist(),
        "significant_px": spectrum.significant_px,
    }

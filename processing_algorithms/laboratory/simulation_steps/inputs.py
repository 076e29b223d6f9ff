"""From the options of `simulate` to the views that the engine simulates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ....hrsi_engine.foundation.errors import InputError
from ....hrsi_engine.io.opening.files import read_text
from ....hrsi_engine.laboratory.simulation.acquisitions import draw_acquisitions
from ....hrsi_engine.laboratory.simulation.options import SceneSpec
from ....hrsi_engine.laboratory.simulation.sensors import SENSORS, OrientationError, Sensor, Vibration
from ....hrsi_engine.laboratory.simulation.views import (
    SceneView,
    make_along_track_views,
    make_strip_views,
    make_views_of_dates,
)
from ..declarations.simulate import VendorErrorOptions, ViewOptions

SHORTEST_PERIOD = 50.0  #: lines
#: Options that give the vendor's error, and the field of `OrientationError` that each one sets.
VENDOR_ERRORS = {
    "vendor_position": "position_m",
    "vendor_position_drift": "position_drift_m",
    "vendor_attitude": "attitude_rad",
    "vendor_attitude_drift": "attitude_drift_rad",
}


def make_views(options: ViewOptions, vendor: VendorErrorOptions, scene: SceneSpec) -> tuple[SceneView, ...]:
    """Return the views that the options describe; raises `InputError` for angles that do not match the images."""
    sensor = SENSORS[options.sensor]
    samples = options.size
    size = (samples, options.lines or samples)
    heading, images = options.heading, options.images
    across: float | None = options.across
    if options.dates > 1:
        if options.strips * options.places > 1:
            raise InputError("`dates` are taken of one place: leave `strips` and `places` at 1")
        taken_on = draw_acquisitions(options.dates, scene.lat_deg, scene.seed)
        taken = make_views_of_dates(
            sensor, taken_on, images, size=size, heading_deg=heading, off_nadir_deg=options.off_nadir, seed=scene.seed
        )
        across = options.across or None
    elif options.strips * options.places > 1:
        taken = make_strip_views(
            sensor,
            options.strips,
            options.places,
            images_per_place=images,
            size=size,
            overlap=options.overlap,
            heading_deg=heading,
        )
    else:
        taken = make_along_track_views(sensor, images, size, heading_deg=heading)
    angles = _numbers("along", options.along, images) if options.along else None
    error, vibration = _vendor_error(vendor), _make_vibration(vendor, sensor)
    # A pass has the images of one strip or date that look in one direction; each pass has its own phases
    of_pass = [(number // (images * options.places), number % images) for number in range(len(taken))]
    return tuple(
        replace(
            view,
            across_deg=view.across_deg if across is None else across,
            along_deg=view.along_deg if angles is None else angles[number % images],
            vendor_error=error,
            jitter=OrientationError(vibration=_start_vibration(vibration, [scene.seed, 62, *of_pass[number]])),
        )
        for number, view in enumerate(taken)
    )


def _numbers(argument: str, given: Sequence[str], count: int) -> tuple[float, ...]:
    """Return the numbers of an option such as ``1.5,0,-3``."""
    try:
        numbers = tuple(float(text) for text in given)
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise InputError(f"`{argument}` is {','.join(given)}: give {count} numbers separated by commas")
    return numbers


def _vendor_error(options: VendorErrorOptions) -> OrientationError | None:
    """Return the error of the vendor's orientation, None where it is to be random."""
    given = {name: values for name in VENDOR_ERRORS if (values := getattr(options, name))}
    if not given:
        return None
    found: dict[str, Any] = {VENDOR_ERRORS[name]: _numbers(name, values, 3) for name, values in given.items()}
    return OrientationError(**found)


def _make_vibration(options: VendorErrorOptions, sensor: Sensor) -> Vibration:
    """Return the vibration that is asked for; raises `InputError` for what is neither numbers nor a file of a curve."""
    given, pixel_rad = options.jitter, sensor.detector_angle_rad
    if len(given) == 1 and not _is_number(given[0]):
        table = _read_curve(given[0])
        table[:, 1:] *= -pixel_rad
        return Vibration(curve=tuple((line, roll, pitch) for line, roll, pitch in table.tolist()))
    if len(given) == 1:
        given = (given[0], str(options.jitter_period))
    numbers = _numbers("jitter", given, len(given) + len(given) % 2)
    if any(value < 0.0 for value in numbers) or any(period < SHORTEST_PERIOD for period in numbers[1::2]):
        raise InputError(
            f"`jitter` is {','.join(given)}: give amplitudes in px and periods of {SHORTEST_PERIOD:g} lines or more"
        )
    pairs = zip(numbers[::2], numbers[1::2], strict=True)
    return Vibration(waves=tuple((period, amplitude * pixel_rad, 0.0) for amplitude, period in pairs))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_curve(path: str) -> np.ndarray:
    """Return line, across and along (px) of the lines of a CSV file, ``(n, 3)``."""
    lines = read_text(path).splitlines()
    if lines and not _is_number(lines[0].partition(",")[0]):
        lines = lines[1:]
    try:
        table = np.array([line.split(",")[:3] for line in lines if line.strip()], dtype=np.float64)
    except ValueError:
        table = np.empty((0, 0))
    if table.ndim != 2 or table.shape[1:] != (3,) or len(table) < 2 or not np.isfinite(table).all():
        raise InputError(f"{path}: `jitter` takes a CSV file of numbers line, across and along (px), two rows or more")
    if not (np.diff(table[:, 0]) > 0.0).all():
        row = int(np.argmin(np.diff(table[:, 0]) > 0.0)) + 1
        raise InputError(f"{path}: line {table[row, 0]:g} follows line {table[row - 1, 0]:g}: sort the rows by line")
    return table


def _start_vibration(vibration: Vibration, seed: Sequence[int]) -> Vibration:
    """Return the vibration of a pass: its sines with random phases, its curve from a random line on."""
    rng = np.random.default_rng(seed)
    waves = tuple((period, size, float(rng.uniform(0.0, 2.0 * np.pi))) for period, size, _ in vibration.waves)
    start = float(rng.uniform(vibration.curve[0][0], vibration.curve[-1][0])) if vibration.curve else 0.0
    return replace(vibration, waves=waves, start_line=start)

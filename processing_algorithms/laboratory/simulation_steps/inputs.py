"""From the options of `simulate` to the views that the engine simulates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ....hrsi_engine.foundation.errors import InputError
from ....hrsi_engine.laboratory.simulation.acquisitions import draw_acquisitions
from ....hrsi_engine.laboratory.simulation.options import SceneSpec
from ....hrsi_engine.laboratory.simulation.sensors import SENSORS, OrientationError, Sensor
from ....hrsi_engine.laboratory.simulation.views import (
    SceneView,
    make_along_track_views,
    make_strip_views,
    make_views_of_dates,
)
from ..declarations.simulate import VendorErrorOptions, ViewOptions

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
        taken = make_views_of_dates(sensor, taken_on, images, size, heading, options.off_nadir, scene.seed)
        across = options.across or None
    elif options.strips * options.places > 1:
        taken = make_strip_views(sensor, options.strips, options.places, images, size, options.overlap, heading)
    else:
        taken = make_along_track_views(sensor, images, size, heading_deg=heading)
    angles = _numbers("along", options.along, images) if options.along else None
    error, jitter = _vendor_error(vendor), _jitter(vendor, sensor)
    return tuple(
        replace(
            view,
            across_deg=view.across_deg if across is None else across,
            along_deg=view.along_deg if angles is None else angles[number % images],
            vendor_error=error,
            jitter=jitter,
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


def _jitter(options: VendorErrorOptions, sensor: Sensor) -> OrientationError:
    """Return a vibration of roll and pitch, a quarter period apart."""
    amplitude = options.jitter * sensor.detector_angle_rad
    return OrientationError(
        jitter_rad=(amplitude, amplitude, 0.0),
        jitter_period_lines=options.jitter_period,
        jitter_phase_rad=(0.0, 1.5708, 0.0),
    )

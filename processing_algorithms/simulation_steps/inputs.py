"""From the options of `simulate` to the arguments of the engine's `simulate_block`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.simulation import (  # fmt: skip
    SENSORS,
    Noise,
    OrientationError,
    PointCounts,
    SceneSpec,
    SceneView,
    Sensor,
    along_track_views,
    strip_views,
)

#: Options that give the vendor's error, and the field of `OrientationError` that each one sets.
VENDOR_ERRORS = {
    "vendor_position": "position_m",
    "vendor_position_drift": "position_drift_m",
    "vendor_attitude": "attitude_rad",
    "vendor_attitude_drift": "attitude_drift_rad",
}


def arguments(options: Mapping[str, Any]) -> tuple[SceneSpec, tuple[SceneView, ...], PointCounts, Noise]:
    """Return scene, views, numbers of points and noise."""
    scene = SceneSpec(
        options["lon"], options["lat"], options["height"], options["relief"], options["cliffs"], options["seed"]
    )
    points = PointCounts(options["gcps"], options["checks"], options["ties"])
    noise = Noise(
        image_px=options["noise_image"], gcp_xy_m=options["noise_gcp_xy"], gcp_h_m=options["noise_gcp_h"],
        blunders=options["blunders"], gcp_blunders=options["gcp_blunders"], blunder_px=options["blunder_size"],
        wrong_heights=options["wrong_heights"], wrong_height_m=options["wrong_height_size"],
        vendor=options["vendor_error"],
    )  # fmt: skip
    return scene, views(options), points, noise


def views(options: Mapping[str, Any]) -> tuple[SceneView, ...]:
    """Return the views that the options describe; raises `InputError` for angles that do not match the images."""
    sensor = SENSORS[options["sensor"]]
    samples = options["size"]
    size = (samples, options["lines"] or samples)
    heading, images = options["heading"], options["images"]
    if options["strips"] * options["places"] > 1:
        taken = strip_views(sensor, options["strips"], options["places"], images, size, options["overlap"], heading)
    else:
        taken = along_track_views(sensor, images, size, heading_deg=heading)
    angles = _numbers(options, "along", images) if options["along"] else None
    error, jitter = _vendor_error(options), _jitter(options, sensor)
    return tuple(
        replace(
            view,
            across_deg=options["across"],
            along_deg=view.along_deg if angles is None else angles[number % images],
            vendor_error=error,
            jitter=jitter,
        )
        for number, view in enumerate(taken)
    )


def _numbers(options: Mapping[str, Any], key: str, count: int) -> Sequence[float]:
    """Return the numbers of an option such as ``1.5,0,-3``."""
    given = options[key]
    try:
        numbers = [float(text) for text in given]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InputError(f"--{key.replace('_', '-')} is {','.join(given)}: give {count} numbers separated by commas")
    return numbers


def _vendor_error(options: Mapping[str, Any]) -> OrientationError | None:
    given = {field: tuple(_numbers(options, key, 3)) for key, field in VENDOR_ERRORS.items() if options[key]}
    return OrientationError(**given) if given else None  # type: ignore[arg-type]


def _jitter(options: Mapping[str, Any], sensor: Sensor) -> OrientationError:
    """Return a vibration of roll and pitch, a quarter period apart."""
    amplitude = options["jitter"] * sensor.detector_angle_rad
    return OrientationError(
        jitter_rad=(amplitude, amplitude, 0.0),
        jitter_period_lines=options["jitter_period"],
        jitter_phase_rad=(0.0, 1.5708, 0.0),
    )

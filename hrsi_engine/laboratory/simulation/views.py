"""Views: which sensor looks at the scene from where, and usual arrangements of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .acquisitions import Acquisition
from .options import HEADING_DEG, STRIP_OVERLAP
from .pushbroom import PushbroomCamera, aim_camera
from .sensors import OrientationError, Radiometry, Sensor
from .terrain import Chart

#: Angles along the track (degrees) of pairs and triplets, in the order of acquisition.
ALONG_TRACK_DEG: dict[int, tuple[float, ...]] = {1: (0.0,), 2: (12.0, -12.0), 3: (15.0, 0.0, -15.0)}


@dataclass(frozen=True)
class SceneView:
    """One image to be taken.

    Parameters
    ----------
    id : str
        Of the image.
    sensor : Sensor
        The scanner.
    size : tuple of int
        Samples and lines.
    along_deg, across_deg, heading_deg : float
        As of `aim_camera`.
    scan_deg : float, optional
        As of `aim_camera`.
    offset_m : tuple of float
        Where the middle of the image lies, east and north of the scene centre.
    jitter : OrientationError
        Of the true camera.
    vendor_error : OrientationError, optional
        What the vendor's orientation is wrong by; by default drawn from the sensor's accuracy.
    radiometry : Radiometry
        How grey values become digital numbers.
    date : int
        Views of another date see the ground changed by `SceneSpec.change`.
    acquisition : Acquisition, optional
        A date of the year, with its sun, season and weather; it goes before ``date``.
    """

    id: str
    sensor: Sensor
    size: tuple[int, int]
    along_deg: float = 0.0
    across_deg: float = 0.0
    heading_deg: float = HEADING_DEG
    scan_deg: float | None = None
    offset_m: tuple[float, float] = (0.0, 0.0)
    jitter: OrientationError = OrientationError()
    vendor_error: OrientationError | None = None
    radiometry: Radiometry = Radiometry()
    date: int = 0
    acquisition: Acquisition | None = None

    def camera(self, chart: Chart, height_m: float) -> PushbroomCamera:
        """Return the true camera.

        Parameters
        ----------
        chart : Chart
            Where the scene lies.
        height_m : float
            At which its middle is aimed.

        Returns
        -------
        PushbroomCamera
            The camera.
        """
        target = chart.to_ground(np.array([self.offset_m]), np.array([height_m]))[0]
        camera = aim_camera(
            self.sensor,
            self.size,
            target,
            along_deg=self.along_deg,
            across_deg=self.across_deg,
            heading_deg=self.heading_deg,
            scan_deg=self.scan_deg,
        )
        # Images of a pass that began its vibration together are as many lines apart as their middles on the ground
        heading = np.radians(self.heading_deg if self.scan_deg is None else self.scan_deg)
        ahead_m = float(np.sin(heading) * self.offset_m[0] + np.cos(heading) * self.offset_m[1])
        vibration = self.jitter.vibration
        start = vibration.start_line + ahead_m / (camera.scan_rad * camera.ground_radius_m)
        return camera.disturb(replace(self.jitter, vibration=replace(vibration, start_line=start)))

    @property
    def half_diagonal_m(self) -> float:
        """Upper bound of the distance from the image's middle to its corners on the ground."""
        tilt = np.radians(np.hypot(self.along_deg, self.across_deg))
        return float(0.5 * np.hypot(*self.size) * self.sensor.gsd_m / np.cos(1.2 * tilt) ** 3)


def make_along_track_views(
    sensor: Sensor,
    images: int,
    size: tuple[int, int],
    across_deg: float = 0.0,
    heading_deg: float = HEADING_DEG,
    offset_m: tuple[float, float] = (0.0, 0.0),
    prefix: str = "image",
) -> tuple[SceneView, ...]:
    """Return views of one place from along the orbit: a pair, a triplet, or more spread over +-20 degrees.

    Parameters
    ----------
    sensor : Sensor
        The scanner.
    images : int
        Their number.
    size : tuple of int
        Samples and lines.
    across_deg, heading_deg : float
        As of `aim_camera`.
    offset_m : tuple of float
        Of the place, east and north of the scene centre.
    prefix : str
        Of the images' ids.

    Returns
    -------
    tuple of SceneView
        In the order of flight.
    """
    angles: Sequence[float] = ALONG_TRACK_DEG.get(images) or tuple(np.linspace(20.0, -20.0, images).tolist())
    return tuple(
        SceneView(f"{prefix}_{index + 1}", sensor, size, angle, across_deg, heading_deg, offset_m=offset_m)
        for index, angle in enumerate(angles)
    )


def make_strip_views(
    sensor: Sensor,
    strips: int,
    per_strip: int,
    images_per_place: int,
    size: tuple[int, int],
    overlap: float = STRIP_OVERLAP,
    heading_deg: float = HEADING_DEG,
) -> tuple[SceneView, ...]:
    """Return a block of strips.

    Parameters
    ----------
    sensor : Sensor
        The scanner.
    strips : int
        Next to each other.
    per_strip : int
        Places along each.
    images_per_place : int
        Seen from along the orbit.
    size : tuple of int
        Samples and lines.
    overlap : float
        Share of an image that its neighbours show.
    heading_deg : float
        Azimuth of the flight.

    Returns
    -------
    tuple of SceneView
        Strip by strip.
    """
    across, along = (number * sensor.gsd_m * (1.0 - overlap) for number in size)
    heading = np.radians(heading_deg)
    forward = np.array([np.sin(heading), np.cos(heading)])
    left = np.array([-np.cos(heading), np.sin(heading)])
    views: list[SceneView] = []
    for strip, place in product(range(strips), range(per_strip)):
        shift = (strip - (strips - 1) / 2) * across * left + (place - (per_strip - 1) / 2) * along * forward
        views += make_along_track_views(
            sensor,
            images_per_place,
            size,
            heading_deg=heading_deg,
            offset_m=(float(shift[0]), float(shift[1])),
            prefix=f"strip{strip + 1}_{place + 1}",
        )
    return tuple(views)


def make_views_of_dates(
    sensor: Sensor,
    acquisitions: Sequence[Acquisition],
    images: int,
    size: tuple[int, int],
    heading_deg: float,
    off_nadir_deg: float,
    seed: int,
) -> tuple[SceneView, ...]:
    """Return views of one place on several dates, each date from another side.

    Parameters
    ----------
    sensor : Sensor
        The scanner.
    acquisitions : sequence of Acquisition
        The dates.
    images : int
        Taken from along the orbit on each date.
    size : tuple of int
        Samples and lines.
    heading_deg : float
        Azimuth of the flight.
    off_nadir_deg : float
        Largest angle of the middle of a date's views from the nadir; they spread evenly over the disc below it.
    seed : int
        Of the draws.

    Returns
    -------
    tuple of SceneView
        Date by date.
    """
    rng = np.random.default_rng([seed, 61])
    width = len(str(len(acquisitions)))
    views: list[SceneView] = []
    for acquisition in acquisitions:
        tilt, side = off_nadir_deg * np.sqrt(rng.random()), rng.uniform(0.0, 2.0 * np.pi)
        missed = 0.04 * sensor.gsd_m * min(size) * rng.standard_normal(2)
        views += [
            replace(
                view,
                id=f"d{acquisition.number:0{width}d}_{view.id.rpartition('_')[2]}",
                along_deg=float(view.along_deg + tilt * np.cos(side)),
                across_deg=float(tilt * np.sin(side)),
                offset_m=(float(missed[0]), float(missed[1])),
                acquisition=acquisition,
                radiometry=acquisition.radiometry(view.radiometry),
            )
            for view in make_along_track_views(
                sensor, images, size, heading_deg=heading_deg + 2.0 * rng.standard_normal()
            )
        ]
    return tuple(views)

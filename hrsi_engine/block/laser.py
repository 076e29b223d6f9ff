"""Laser points: ground heights measured by a satellite's laser altimeter (ICESat-2, GEDI), without image points.

The height is the mean of the ground in the laser's footprint (11 m wide, or a segment of 20 to 100 m along the track);
its horizontal position has an error of a few metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from ..ground.operation_uses import OperationUse, largest_sigma_m
from .columns import Columns

LASER_KIND = "laser"  # kind of the image points of tie points that are measured at laser points


@thresholds
class LASER_HEIGHT:
    """Default standard deviation of laser heights."""

    sigma_m: float = threshold(0.3, "m", "default standard deviation of a laser height", "Neuenschwander 2020")


@dataclass(frozen=True, eq=False, repr=False)
class LaserPoints(Columns):
    """Laser heights and the quality figures of their files, ``(n,)`` each; NaN for figures that a file does not have.

    ground : (n, 3) lon, lat in degrees, ellipsoidal height in metres
    ids, track : ids; and pass of the satellite, with an error common to its points
    sigma_m : standard deviation of the height, stated in the file
    slope : slope of the ground along the track, metres per metre
    misfit_m : spread of the photons about the fitted segment; photons : number of photons in the fit
    canopy_m : height of the vegetation above the ground
    doubt : the file's reason for flagging a point as unreliable; empty if it is not flagged
    source : the file and layer, for messages
    operations : operations that converted the points to WGS84, with the errors common to all of them
    """

    ground: np.ndarray
    ids: np.ndarray = ""  # type: ignore[assignment]  # numbers by default
    track: np.ndarray = ""  # type: ignore[assignment]  # one value for all becomes an array
    sigma_m: np.ndarray = np.nan  # type: ignore[assignment]
    slope: np.ndarray = np.nan  # type: ignore[assignment]
    misfit_m: np.ndarray = np.nan  # type: ignore[assignment]
    photons: np.ndarray = np.nan  # type: ignore[assignment]
    canopy_m: np.ndarray = np.nan  # type: ignore[assignment]
    doubt: np.ndarray = ""  # type: ignore[assignment]
    source: str = ""
    operations: tuple[OperationUse, ...] = ()

    if TYPE_CHECKING:  # single values and sequences become columns

        def __init__(self, *columns: Any, **named: Any) -> None: ...

    def __post_init__(self) -> None:
        if not np.ndim(self.ids):
            object.__setattr__(self, "ids", [f"L{number + 1:06d}" for number in range(len(self.ground))])
        number = np.float64, ()
        self._fill(
            ground=(np.float64, (3,)),
            ids=(str, ()),
            track=(str, ()),
            sigma_m=number,
            slope=number,
            misfit_m=number,
            photons=number,
            canopy_m=number,
            doubt=(str, ()),
        )

    def __len__(self) -> int:
        return len(self.ground)

    @property
    def operation_sigma_m(self) -> tuple[float, float]:
        """Standard deviations of the errors common to all points: of each horizontal coordinate, and of the height."""
        return largest_sigma_m(self.operations)

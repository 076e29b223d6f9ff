"""Laser points: ground heights measured by a satellite's laser altimeter (ICESat-2, GEDI), without image points.

The height is the mean of the ground in the laser's footprint (11 m wide, or a segment of 20 to 100 m along the track);
its horizontal position has an error of a few metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from ..ground.operation_uses import OperationUse, largest_sigma_m
from .columns import Columns

LASER_KIND = "laser"  # kind of the image points of tie points that are measured at laser points


@thresholds
class LASER_HEIGHT:
    """Default standard deviation of laser heights."""

    sigma_m: float = threshold(0.3, "m", "default standard deviation of a laser height", "Neuenschwander 2020")


@dataclass(frozen=True, eq=False)
class LaserPoints(Columns):
    """Laser heights and the quality figures of their files, ``(n,)`` each; NaN for figures that a file does not have.

    ids, track : ids; and pass of the satellite, with an error common to its points
    ground : (n, 3) lon, lat in degrees, ellipsoidal height in metres
    sigma_m : standard deviation of the height, stated in the file
    slope : slope of the ground along the track, metres per metre
    misfit_m : spread of the photons about the fitted segment; photons : number of photons in the fit
    canopy_m : height of the vegetation above the ground
    doubt : the file's reason for flagging a point as unreliable; empty if it is not flagged
    source : the file and layer, for messages
    operations : operations that converted the points to WGS84, with the errors common to all of them
    """

    ids: np.ndarray
    track: np.ndarray
    ground: np.ndarray
    sigma_m: np.ndarray
    slope: np.ndarray
    misfit_m: np.ndarray
    photons: np.ndarray
    canopy_m: np.ndarray
    doubt: np.ndarray
    source: str = ""
    operations: tuple[OperationUse, ...] = ()

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def operation_sigma_m(self) -> tuple[float, float]:
        """Standard deviations of the errors common to all points: of each horizontal coordinate, and of the height."""
        return largest_sigma_m(self.operations)

    @classmethod
    def create(
        cls, ground: np.ndarray, *, ids: Sequence[str] | np.ndarray | None = None,
        track: Sequence[str] | np.ndarray | str = "", sigma_m: np.ndarray | float = np.nan,
        slope: np.ndarray | float = np.nan, misfit_m: np.ndarray | float = np.nan, photons: np.ndarray | float = np.nan,
        canopy_m: np.ndarray | float = np.nan, doubt: Sequence[str] | np.ndarray | str = "", source: str = "",
        operations: tuple[OperationUse, ...] = (),
    ) -> LaserPoints:  # fmt: skip
        """Make columns of equal length from arrays or single values; ids are numbers by default."""
        place = np.asarray(ground, dtype=np.float64).reshape(-1, 3)
        count = len(place)
        names = np.char.add("L", np.char.zfill(np.arange(1, count + 1).astype(str), 6)) if ids is None else ids

        def column(values: np.ndarray | float) -> np.ndarray:
            return np.broadcast_to(np.asarray(values, dtype=np.float64), (count,)).copy()

        def texts(values: Sequence[str] | np.ndarray | str) -> np.ndarray:
            return np.broadcast_to(np.asarray(values, dtype=str), (count,)).copy()

        return cls(
            np.asarray(names, dtype=str), texts(track), place, column(sigma_m), column(slope), column(misfit_m),
            column(photons), column(canopy_m), texts(doubt), source, operations,
        )  # fmt: skip

"""Reference data: orthoimages, points that they have in common with images, and errors common to observations.

An orthoimage is georeferenced by orbit, GCPs and mosaicking: most of its error is common to a scene, a part varies
between strips, and the rest is local. Sentinel-2's refined products have an absolute error of 8 m, and two dates differ
by 5 m (both 95 %, circular; ESA 2021): 3.3 m a coordinate, of which 1.4 m are specific to the date. Therefore 80 % of
the variance is from the reference of all dates. How it varies within a scene is not published; 64 % are assumed to be
common to the scene and 16 % to its parts. The errors of a DEM are mostly those of single cells (slopes, objects on the
ground).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..foundation.thresholds import GRIDS, threshold, thresholds
from ..ground.geodesy import ground_difference_m
from ..ground.operation_uses import OperationUse
from .block import Raster

Transform = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Orthoimage:
    """An image in which every pixel has a position on the ground.

    to_pixels : function from lon, lat ``(n, 2)`` to sample, line ``(n, 2)``, (0, 0) the centre of the first pixel
    to_lonlat : the inverse
    operations : operations that converted its coordinates to WGS84
    """

    raster: Raster
    to_pixels: Transform
    to_lonlat: Transform
    path: str = ""
    operations: tuple[OperationUse, ...] = ()

    @cached_property
    def gsd_m(self) -> float:
        """Ground distance in metres of neighbouring pixels at the image's centre (geometric mean of both axes)."""
        lonlat = self.to_lonlat(np.array(self.raster.size) / 2.0 + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        ground = np.column_stack([lonlat, np.zeros(3)])
        return float(np.sqrt(abs(np.linalg.det(ground_difference_m(ground[1:], ground[[0, 0]])[:, :2]))))


REFERENCE_KIND = "reference"  # kind of the image points measured from a reference


@dataclass(frozen=True, eq=False)
class ReferencePlaces:
    """Points of a reference orthoimage that determine a block in plan.

    ids : (k,) ids in the block
    ground : (k, 3) lon, lat in degrees, ellipsoidal height in metres; the height is an initial value
    sigma_m : standard deviation of each horizontal coordinate of the reference
    ignores_rpc_priors : True if the reference determines the block like surveyed GCPs, without priors of the RPC biases
    name : name of the reference in reports
    """

    ids: np.ndarray
    ground: np.ndarray
    sigma_m: float
    ignores_rpc_priors: bool = False
    name: str = "reference"

    def select(self, ids: np.ndarray) -> ReferencePlaces:
        """Return the places with the given ids, in the order of the ids."""
        order = np.argsort(self.ids)
        rows = order[np.searchsorted(self.ids, ids, sorter=order)]
        return replace(self, ids=self.ids[rows], ground=self.ground[rows])


@thresholds
class AREA:
    """Division of an area into parts whose observations have a common error."""

    least_side_m: float = threshold(500.0, "m", "smallest side of a part")


class ErrorShares(NamedTuple):
    """Shares of a source's standard deviation that are common to all its observations, and to a part of the area."""

    by_all: float
    by_part: float

    @property
    def independent(self) -> float:
        """Share of the standard deviation that is independent between observations."""
        return float(np.sqrt(1.0 - self.by_all**2 - self.by_part**2))

    def compute_equivalent_sigma(self, sigma_m: float, ground: np.ndarray) -> float:
        """Return the standard deviation for independent observations at places ``ground (k, 3)``.

        With it, the mean of the observations has the same variance as with the common errors.
        """
        parts = np.unique(divide_area(ground)[0], return_counts=True)[1]
        count = len(ground)
        if not count:
            return sigma_m
        common = count * self.by_all**2 + float(np.sum(parts**2)) / count * self.by_part**2
        return sigma_m * float(np.sqrt(common + self.independent**2))


ORTHOIMAGE_ERRORS, DEM = ErrorShares(0.8, 0.4), ErrorShares(0.4, 0.4)


def divide_area(ground: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the index of the part of the area of each place ``ground (k, 3)``, and the names of the parts."""
    if not len(ground):
        return np.zeros(0, dtype=np.int64), ()
    deviation = ground_difference_m(ground, np.broadcast_to(ground[0], (len(ground), 3)))[:, :2]
    low, size = deviation.min(axis=0), np.ptp(deviation, axis=0)
    side = max(AREA.least_side_m, float(size.max()) / GRIDS.parts)
    columns, rows = np.maximum(np.ceil(size / side), 1).astype(int)
    place = np.minimum(((deviation - low) / side).astype(np.int64), [columns - 1, rows - 1])
    numbers, part = np.unique(place[:, 1] * columns + place[:, 0], return_inverse=True)
    names = []
    for number in range(len(numbers)):
        lon, lat = np.median(ground[part == number, :2], axis=0)
        names.append(f"part about {lon:.4f}, {lat:.4f}")
    return part, tuple(names)

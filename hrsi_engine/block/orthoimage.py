"""Reference data: orthoimages, points of them that are measured on images, and errors that observations have in common.

An orthoimage is georeferenced as a whole by orbit, GCPs and mosaic: most of its error is common to a scene, some varies
from part to part with strips and seams, and the rest from place to place. Sentinel-2's refined products
lie 8 m off and two dates of them 5 m apart (both 95 %, circular; ESA 2021): 3.3 m a coordinate, of which 1.4 m are the
date's own. So 80 % of the variance comes from what all dates were registered to; nobody states how that is spread over
a scene, and it is taken as 64 % for all of it and 16 % for its parts. A DEM's errors are those of its cells (slopes,
what stands on the ground) for the most part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import ground_difference_m
from ..ground.operation_uses import OperationUse
from .block import Raster

Transform = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Orthoimage:
    """An image in which every pixel has a position on the ground.

    to_pixels : sample, line ``(n, 2)``, (0, 0) the centre of the first pixel, of lon, lat ``(n, 2)``
    to_lonlat : the inverse
    operations : how it came to WGS84
    """

    raster: Raster
    to_pixels: Transform
    to_lonlat: Transform
    path: str = ""
    operations: tuple[OperationUse, ...] = ()

    @cached_property
    def gsd_m(self) -> float:
        """Ground distance in metres of neighbouring pixels in the image's middle (mean of both directions)."""
        middle = np.array(self.raster.size) / 2.0
        lonlat = self.to_lonlat(middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        ground = np.column_stack([lonlat, np.zeros(3)])
        steps = ground_difference_m(ground[1:], ground[[0, 0]])
        return float(np.sqrt(abs(np.linalg.det(steps[:, :2]))))


REFERENCE_KIND = "reference"  # of their image points


@dataclass(frozen=True, eq=False)
class ReferencePlaces:
    """Points of a reference orthoimage that determine a block in plan.

    ids : (k,) their names in the block
    ground : (k, 3) lon, lat in degrees, ellipsoidal height in metres; the height is where to begin
    sigma_m : standard deviation of each horizontal coordinate of the reference
    over_rpcs : True if the reference determines the block like surveyed GCPs, without the RPCs' own accuracy
    name : what reports call it
    """

    ids: np.ndarray
    ground: np.ndarray
    sigma_m: float
    over_rpcs: bool = False
    name: str = "reference"

    def select(self, ids: np.ndarray) -> ReferencePlaces:
        """Return the places with some ids, in their order."""
        order = np.argsort(self.ids)
        rows = order[np.searchsorted(self.ids, ids, sorter=order)]
        return replace(self, ids=self.ids[rows], ground=self.ground[rows])


@thresholds
class AREA:
    """Parts of an area whose observations have errors in common."""

    least_side_m: float = threshold(500.0, "m", "smallest side of a part")
    parts_per_side: int = threshold(4, "parts", "along a side of the area, at most")


class ErrorShares(NamedTuple):
    """Shares of a source's standard deviation: common to all its observations, and to a part of the area."""

    by_all: float
    by_part: float

    @property
    def independent(self) -> float:
        """Share of the standard deviation that is independent between observations."""
        return float(np.sqrt(1.0 - self.by_all**2 - self.by_part**2))

    def compute_equivalent_sigma(self, sigma_m: float, ground: np.ndarray) -> float:
        """Return a standard deviation for places ``ground (k, 3)`` treated as independent observations.

        Their mean then has the variance that it has with the common errors.
        """
        parts = np.unique(divide_area(ground)[0], return_counts=True)[1]
        count = len(ground)
        if not count:
            return sigma_m
        shared = count * self.by_all**2 + float(np.sum(parts**2)) / count * self.by_part**2
        return sigma_m * float(np.sqrt(shared + self.independent**2))


ORTHOIMAGE, DEM = ErrorShares(0.8, 0.4), ErrorShares(0.4, 0.4)


def divide_area(ground: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the index of the part of the area of each place ``ground (k, 3)``, and the names of the parts."""
    if not len(ground):
        return np.zeros(0, dtype=np.int64), ()
    away = ground_difference_m(ground, np.broadcast_to(ground[0], (len(ground), 3)))[:, :2]
    low, size = away.min(axis=0), np.ptp(away, axis=0)
    side = max(AREA.least_side_m, float(size.max()) / AREA.parts_per_side)
    columns, rows = np.maximum(np.ceil(size / side), 1).astype(int)
    place = np.minimum(((away - low) / side).astype(np.int64), [columns - 1, rows - 1])
    numbers, part = np.unique(place[:, 1] * columns + place[:, 0], return_inverse=True)
    names = []
    for number in range(len(numbers)):
        lon, lat = np.median(ground[part == number, :2], axis=0)
        names.append(f"part about {lon:.4f}, {lat:.4f}")
    return part, tuple(names)

"""Common errors of the observations of an orthoimage or a DEM, and the effective accuracy of many of them.

An orthoimage is georeferenced as a whole by orbit, GCPs and mosaic: most of its error is common to a scene, some varies
from part to part with strips and seams, and the rest from place to place. Sentinel-2's refined products
lie 8 m off and two dates of them 5 m apart (both 95 %, circular; ESA 2021): 3.3 m a coordinate, of which 1.4 m are the
date's own. So 80 % of the variance comes from what all dates were registered to; nobody states how that is spread over
a scene, and it is taken as 64 % for all of it and 16 % for its parts. A DEM's errors are those of its cells (slopes,
what stands on the ground) for the most part.
"""

from typing import NamedTuple

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import ground_difference_m


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

"""An orthoimage: pixels and the transformation between them and the ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

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

"""The motion of tectonic plates between datums that are fixed to one and WGS84 in a given year.

ETRS89, GDA2020 or NAD83 move with their plate, WGS84 does not: they drift apart by up to 7 cm a year. PROJ has
time-dependent operations to ITRF2014, with which the realisations of WGS84 since 2012 agree to 2 cm (NGA.STND.0036,
version 1.0.0, table 2.1).
"""

from __future__ import annotations

import itertools
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np
import pyproj
from pyproj.enums import TransformDirection
from pyproj.transformer import TransformerGroup

#: EPSG codes of ITRF2014: longitude and latitude, … and ellipsoidal height.
ITRF2014, ITRF2014_3D = 9000, 7912
#: Datums (longitude and latitude) that PROJ takes to ITRF2014 by way of another one alone: ETRS89 by ETRF2000, on
#: which the national networks stand; GDA94 by GDA2020; NAD83(CSRS) by its version 7.
BY_WAY_OF = {4258: 9067, 4283: 7844, 4617: 8255}
WGS84_IN_ITRF_M = 0.02  # standard deviation of WGS84's realisations in ITRF2014 (see above)
REALISATIONS_M = 0.1  # accuracy of one realisation of a datum taken for another: what EPSG states of ETRS89's ensemble


@dataclass(frozen=True)
class PlateMotion:
    """Steps from a plate-fixed geodetic CRS to ITRF2014 in one year; heights take part where ``is_3d``.

    name : of the operations; accuracy_m : as stated, with that of WGS84
    """

    steps: tuple[pyproj.Transformer, ...]
    epoch: float
    is_3d: bool
    name: str
    accuracy_m: float

    def move(self, ground: np.ndarray) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` on WGS84 of positions on the plate's datum."""
        return self._pass(ground, self.steps, TransformDirection.FORWARD)

    def move_back(self, lonlat: np.ndarray) -> np.ndarray:
        """Return lon, lat ``(n, 2)`` on the plate's datum of positions on WGS84."""
        ground = np.column_stack([lonlat[:, :2], np.zeros(len(lonlat))])
        return self._pass(ground, self.steps[::-1], TransformDirection.INVERSE)[:, :2]

    def _pass(
        self, ground: np.ndarray, steps: tuple[pyproj.Transformer, ...], direction: TransformDirection
    ) -> np.ndarray:
        lon, lat, height = ground.T
        year = np.full(len(ground), self.epoch)
        for step in steps:
            lon, lat, moved, _ = step.transform(lon, lat, height, year, direction=direction)
            height = moved if self.is_3d else height
        return np.column_stack([lon, lat, height])


@lru_cache(maxsize=64)
def find_plate_motion(geodetic_wkt: str, epoch: float, is_3d: bool) -> PlateMotion | None:
    """Return the motion of a geodetic CRS's plate, None where PROJ has no time-dependent operation.

    Parameters
    ----------
    geodetic_wkt : str
        The geodetic CRS, of longitude and latitude or with heights.
    epoch : float
        Year.
    is_3d : bool
        Whether heights take part.

    Returns
    -------
    PlateMotion or None
        To ITRF2014.
    """
    geodetic = pyproj.CRS.from_wkt(geodetic_wkt)
    if geodetic.datum is None or geodetic.datum.to_json_dict()["type"].startswith("Dynamic"):
        return None
    route = [geodetic.to_3d() if is_3d else geodetic]
    through = BY_WAY_OF.get(_code_of(geodetic))
    if through is not None:
        between = pyproj.CRS.from_epsg(through)
        route.append(between.to_3d() if is_3d else between)
    route.append(pyproj.CRS.from_epsg(ITRF2014_3D if is_3d else ITRF2014))
    found = [_best(*pair) for pair in itertools.pairwise(route)]
    if None in found:
        return None
    steps = cast(list[pyproj.Transformer], found)
    if not any("t_epoch" in step.definition for step in steps):
        return None
    names = [
        part.name
        for step in steps
        for part in step.operations or ()
        if " to " in part.name and not part.name.startswith(("Conversion", "Ballpark"))
    ]
    accuracy = float(np.hypot(WGS84_IN_ITRF_M, sum(_accuracy_m(step) for step in steps)))
    pipelines = tuple(pyproj.Transformer.from_pipeline(step.definition) for step in steps)
    return PlateMotion(pipelines, epoch, is_3d, " + ".join(names), accuracy)


def _best(source: pyproj.CRS, target: pyproj.CRS) -> pyproj.Transformer | None:
    """Return PROJ's first operation that is no ballpark; of realisations of one datum, which are taken as one, any."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            group = TransformerGroup(source, target, always_xy=True)
    except pyproj.exceptions.ProjError:  # an operation's file cannot be opened
        return None
    real = [one for one in group.transformers if "ballpark" not in one.description.lower()]
    alike = _code_of(source) in BY_WAY_OF
    return next(iter(real or (group.transformers if alike else ())), None)


def _accuracy_m(step: pyproj.Transformer) -> float:
    """Return the accuracy of a step (m): as stated, or of one realisation of a datum taken for another."""
    return float(step.accuracy) if step.accuracy >= 0.0 else REALISATIONS_M


def _code_of(crs: pyproj.CRS) -> int:
    """Return the EPSG code of a geodetic CRS's longitude and latitude, 0 without one."""
    code = crs.to_epsg() or 0
    return {4937: 4258, 4939: 4283, 4955: 4617}.get(code, code)

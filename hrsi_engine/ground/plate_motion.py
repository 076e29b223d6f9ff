"""Motion of tectonic plates: transformations between plate-fixed datums and WGS84 in a given year.

ETRS89, GDA2020 and NAD83 move with their plate, WGS84 does not: they diverge by up to 7 cm per year. PROJ has
time-dependent operations to ITRF2014, with which the realisations of WGS84 since 2012 agree to 2 cm (NGA.STND.0036,
version 1.0.0, table 2.1).
"""

import itertools
import re
import warnings
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pyproj
from pyproj.enums import TransformDirection
from pyproj.transformer import TransformerGroup

#: EPSG codes of ITRF2014 and of ETRS89 as geographic 2D CRS.
ITRF2014, ETRS89 = 9000, 4258
#: Datums (geographic 2D CRS) that PROJ converts to ITRF2014 only through another one: ETRS89 through ETRF2000, the
#: basis of the national networks; GDA94 through GDA2020; NAD83(CSRS) through its version 7. A national realisation of
#: ETRS89, which PROJ treats as equal to it (SWEREF99, RGF93, ETRF2000-PL), is converted through ETRS89.
BY_WAY_OF = {ETRS89: 9067, 4283: 7844, 4617: 8255}
REALISED_M = 0.5  # limit of the stated accuracy for a realisation of ETRS89; a path through WGS84 states 2 m
WGS84_IN_ITRF_M = 0.02  # standard deviation of WGS84's realisations in ITRF2014 (see above)
REALISATIONS_M = 0.1  # assumed accuracy of treating realisations of a datum as equal (EPSG: ETRS89)


_ITRS = re.compile(
    "International[ _]Terrestrial[ _]Reference[ _]Frame|IG[Sb]|SIRGAS[ _]Continuously|Australian[ _]Terrestrial|"
    "World[ _]Geodetic[ _]System[ _]1984|WGS[ _]1984"
)


@dataclass(frozen=True)
class PlateMotion:
    """Steps from a plate-fixed geodetic CRS to ITRF2014 in one year; heights are changed only if ``is_3d``.

    epoch : the year; name : name of the operations; accuracy_m : stated accuracy, including that of WGS84
    """

    steps: tuple[pyproj.Transformer, ...]
    epoch: float
    is_3d: bool
    name: str
    accuracy_m: float

    def move_back(self, lonlat: np.ndarray) -> np.ndarray:
        """Return lon, lat ``(n, 2)`` on the plate-fixed datum for positions on WGS84."""
        return self.move(np.column_stack([lonlat[:, :2], np.zeros(len(lonlat))]), TransformDirection.INVERSE)[:, :2]

    def move(self, ground: np.ndarray, direction: TransformDirection = TransformDirection.FORWARD) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` on WGS84 for positions on the plate-fixed datum, or the inverse."""
        lon, lat, height = ground.T
        year = np.full(len(ground), self.epoch)
        for step in self.steps if direction is TransformDirection.FORWARD else self.steps[::-1]:
            lon, lat, moved_height, _ = step.transform(lon, lat, height, year, direction=direction)
            height = moved_height if self.is_3d else height
        return np.column_stack([lon, lat, height])


def is_realisation_of_itrs(crs: pyproj.CRS) -> bool:
    """Return whether the datum of a CRS is a realisation of the ITRS or of WGS84, which are not fixed to a plate."""
    geodetic = crs.geodetic_crs
    return geodetic is not None and geodetic.datum is not None and _ITRS.match(geodetic.datum.name) is not None


@lru_cache(maxsize=64)
def find_plate_motion(geodetic_wkt: str, epoch: float, is_3d: bool) -> PlateMotion | None:
    """Return the transformation of a plate-fixed geodetic CRS to ITRF2014 in a year; heights change only if ``is_3d``.

    None if PROJ has no time-dependent operation.
    """
    geodetic = pyproj.CRS.from_wkt(geodetic_wkt)
    if is_realisation_of_itrs(geodetic):
        return None
    through = BY_WAY_OF.get(_code_of(geodetic))
    for way in [(through,)] if through else [(), (ETRS89, BY_WAY_OF[ETRS89])]:
        route = [geodetic, *(pyproj.CRS.from_epsg(code) for code in (*way, ITRF2014))]
        if is_3d:
            route = [one.to_3d() for one in route]
        steps = [step for pair in itertools.pairwise(route) if (step := _best(*pair)) is not None]
        is_realisation = len(way) < 2 or (
            len(steps) == 3 and "helmert" not in steps[0].definition and 0.0 <= steps[0].accuracy <= REALISED_M
        )
        if len(steps) == len(route) - 1 and is_realisation and any("t_epoch" in step.definition for step in steps):
            break
    else:
        return None
    names = [
        part.name
        for step in steps
        for part in step.operations or ()
        if " to " in part.name and not part.name.startswith(("Conversion", "Ballpark"))
    ]
    # As stated, or that of treating two realisations of a datum as equal
    stated_m = [float(step.accuracy) if step.accuracy >= 0.0 else REALISATIONS_M for step in steps]
    accuracy = float(np.hypot(WGS84_IN_ITRF_M, sum(stated_m)))
    pipelines = tuple(pyproj.Transformer.from_pipeline(step.definition) for step in steps)
    return PlateMotion(pipelines, epoch, is_3d, " + ".join(names), accuracy)


def _best(source: pyproj.CRS, target: pyproj.CRS) -> pyproj.Transformer | None:
    """Return PROJ's first operation that is not ballpark; any operation if none is and ``source`` is in `BY_WAY_OF`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            group = TransformerGroup(source, target, always_xy=True)
    except pyproj.exceptions.ProjError:  # the file of an operation cannot be opened
        return None
    real = [one for one in group.transformers if "ballpark" not in one.description.lower()]
    is_equated = _code_of(source) in BY_WAY_OF
    return next(iter(real or (group.transformers if is_equated else ())), None)


def _code_of(crs: pyproj.CRS) -> int:
    """Return the EPSG code of the geographic 2D CRS of a geodetic CRS, 0 without a code."""
    code = crs.to_epsg() or 0
    return {4937: 4258, 4939: 4283, 4955: 4617}.get(code, code)

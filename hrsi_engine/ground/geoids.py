"""Geoid undulations from PROJ's grids, substitutes for missing models, and detection of wrong height datums.

EGM96 and EGM2008 are defined by their models, so that heights above them are converted without an error. If the grid of
a height datum is missing, the finest installed model replaces it. The difference between the two is nearly equal for
all points of a scene: a common error.

If heights above a geoid are used as ellipsoidal heights, they are wrong by the geoid's undulation N, up to 100 m. If
both GCPs and a DEM are given, their median difference shows it: about +N if the DEM's heights are above the geoid but
used as ellipsoidal; about -N if the GCPs' are (or if the other source was converted without need).
"""

import os
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyproj

from ..foundation.errors import InputError
from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import EQUALITY, SAMPLES, SIGNIFICANCE, threshold, thresholds


@thresholds
class GEOID:
    """Limits for geoid grids and their substitutes, and for the test of surveyed heights against a DEM."""

    largest_undulation_m: float = threshold(
        200.0, "m", "largest undulation: the geoid lies within 110 m of the ellipsoid, a local datum deviates from it"
    )
    substitute_sigma_m: float = threshold(
        1.0,
        "m",
        "standard deviation of the difference of two geoid models, or of a model and a levelling network, if "
        "a grid is missing",
    )
    smallest_difference_m: float = threshold(5.0, "m", "smallest significant difference: canopy, coarse DEM")


#: Geoid models by their name on the command line, the finest first: PROJ's file name, then an older name of it.
GEOID_GRIDS = {"egm2008": ("us_nga_egm08_25.tif", "egm08_25.gtx"), "egm96": ("us_nga_egm96_15.tif", "egm96_15.gtx")}


@dataclass(frozen=True)
class Geoid:
    """A geoid grid that PROJ can read.

    name : ``egm96``, ``egm2008`` or the path of a grid; file : the file that PROJ opens
    stands_for : the height datum that this one replaces; empty if it is the required one
    """

    name: str
    file: str
    stands_for: str = ""

    def heights(self, ground: np.ndarray) -> np.ndarray:
        """Return geoid undulations (m): ellipsoidal height = height above the geoid + undulation.

        ground : (n, 3) or (n, 2) lon, lat in degrees; a height is not used

        Raises `InputError` if the grid does not cover a point, or contains impossible undulations.
        """
        undulation = np.full(len(ground), np.nan)
        if self._pipeline is not None:
            _, _, undulation = self._pipeline.transform(ground[:, 0], ground[:, 1], np.zeros(len(ground)))
        if not np.isfinite(undulation).all():
            raise InputError(
                f"the geoid grid {self.name} does not cover all points: use another datum or a larger grid"
            )
        largest = undulation[np.abs(undulation).argmax()] if undulation.size else 0.0
        if abs(largest) > GEOID.largest_undulation_m:
            raise InputError(
                f"the geoid grid {self.name} contains {largest:g} m, which is not possible for a geoid: obtain the "
                "file again"
            )
        return np.asarray(undulation)

    @cached_property
    def _pipeline(self) -> pyproj.Transformer | None:
        return _open_grid(self.file)


def find_geoid(datum: str) -> Geoid:
    """Return the grid of a geoid model or file; if the model is not installed, the substitute (``stands_for``).

    datum : ``egm96``, ``egm2008`` or the path of a grid that PROJ reads (``.gtx``, ``.tif``)

    Raises `InputError` if it is neither a model nor a grid, or no grid of a model is installed.
    """
    names = GEOID_GRIDS.get(datum.lower())
    if names is None:
        if not os.path.isfile(datum):
            raise InputError(
                f"height datum {datum!r} is neither ellipsoidal, egm96 or egm2008 nor a geoid grid: check its name"
            )
        if _open_grid(os.path.abspath(datum)) is None:
            raise InputError(f"{datum} is no geoid grid: {how_to_get_grids()}")
        return Geoid(datum, os.path.abspath(datum))
    for file in names:
        if _open_grid(file) is not None:
            return Geoid(datum.lower(), file)
    substitute = find_substitute(datum.lower())
    if substitute is None:
        raise InputError(f"the geoid grid {names[0]} is not installed: {how_to_get_grids()}")
    return substitute


def find_substitute(datum: str) -> Geoid | None:
    """Return the finest installed geoid model as the substitute for a height datum; None if there is none."""
    grids = ((name, file) for name, files in GEOID_GRIDS.items() for file in files)  # finest first
    return next((Geoid(name, file, datum) for name, file in grids if _open_grid(file) is not None), None)


def geoid_heights(ground: np.ndarray, datum: str) -> np.ndarray:
    """Return geoid undulations N (m): ellipsoidal height = height above the geoid + N.

    ground : (n, 3) or (n, 2) lon, lat in degrees; a height is not used
    datum : ``egm96``, ``egm2008`` or the path of a grid that PROJ reads (``.gtx``, ``.tif``). A model that is not
    installed is replaced by the finest one that is (`find_geoid`).
    Result: (n,) metres.
    Raises `InputError`: there is no grid, or it does not cover a point.
    """
    return find_geoid(datum).heights(ground)


def how_to_get_grids(files: str = "us_nga_egm08_25.tif", is_geoid: bool = True) -> str:
    """Return how to obtain grids, for messages: ``files`` are projsync's names, separated by commas."""
    commands = " and ".join(f"projsync --file {file.strip()}" for file in files.split(","))
    alternative = ", or name the file of a geoid grid as the height datum" if is_geoid else ""
    folder = pyproj.datadir.get_data_dir().split(os.pathsep)[0]
    return (
        f"run {commands} (into {pyproj.datadir.get_user_data_dir()}), set PROJ_NETWORK=ON, or copy the grid from "
        f"Debian's proj-data or QGIS's share/proj to {folder}{alternative}"
    )


def _open_grid(file: str) -> pyproj.Transformer | None:
    """Return the pipeline that adds the undulations of a grid; None if PROJ cannot open it."""
    try:
        return pyproj.Transformer.from_pipeline(
            f"+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f'+step +proj=vgridshift +grids="{file}" +multiplier=1 '
            f"+step +proj=unitconvert +xy_in=rad +xy_out=deg"
        )
    except pyproj.exceptions.ProjError:
        return None


@dataclass(frozen=True)
class HeightDifference:
    """Surveyed heights minus those of a DEM at the same places, with the undulation of the geoid there.

    median_m : median of the differences; spread_m : their robust standard deviation; points : their number
    undulation_m : median of the geoid's N; NaN if no geoid grid is available
    """

    median_m: float
    spread_m: float
    points: int
    undulation_m: float

    @property
    def significant(self) -> bool:
        """Whether the median difference exceeds the usual errors of a DEM and its own standard deviation."""
        of_median_m = 1.2533 * self.spread_m / np.sqrt(self.points)
        limit = max(GEOID.smallest_difference_m, SIGNIFICANCE.gross * of_median_m)
        return self.points >= SAMPLES.plane and abs(self.median_m) > limit

    @property
    def sign_of_geoid(self) -> int:
        """1 if the difference is about N, -1 if it is about -N, 0 otherwise."""
        least_m = GEOID.smallest_difference_m
        tolerance = max((EQUALITY.size - 1.0) * abs(self.undulation_m), least_m, 2.0 * self.spread_m)
        if not self.significant or not abs(self.undulation_m) > least_m:
            return 0
        return next((sign for sign in (1, -1) if abs(self.median_m - sign * self.undulation_m) <= tolerance), 0)


def height_difference(surveyed_m: np.ndarray, dem_m: np.ndarray, undulation_m: np.ndarray) -> HeightDifference | None:
    """Return the difference of surveyed heights ``(n,)`` and those of a DEM at the same places; NaN is ignored.

    surveyed_m : (n,) surveyed heights; dem_m : (n,) heights of the DEM
    undulation_m : (n,) undulations of the geoid there, NaN if unknown
    Result: None without any pair of heights.
    """
    is_finite = np.isfinite(surveyed_m) & np.isfinite(dem_m)
    if not is_finite.any():
        return None
    difference = surveyed_m[is_finite] - dem_m[is_finite]
    middle = float(np.median(difference))
    spread = float(robust_sigma(difference - middle))
    of_geoid = undulation_m[is_finite]
    return HeightDifference(
        middle, spread, len(difference), float(np.median(of_geoid)) if np.isfinite(of_geoid).all() else float("nan")
    )

"""Conversion to and from WGS84 by PROJ's best operation at each point, with accuracies and missing grids.

Two CRS are connected by many coordinate operations, each with an area of use and a stated accuracy. `CrsOperations`
uses at each point the same one as ``cs2cs`` and GDAL (`proj_operations`); if its grid does not cover the point, the
next one. Each group of points is converted by one pipeline, and the operation of each point is recorded. There are two
differences: a ballpark operation, which treats two datums as equal, is used only if PROJ has no other one; and
the conversion from WGS84 is the inverse of the conversion to it at every point.

**Epochs.** An operation between a plate-fixed datum and WGS84 that does not change positions states an accuracy of 1 to
4 m because of the plate motion. With an epoch, that motion is removed (`PlateMotion`).
"""

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np
import pyproj
from pyproj.enums import TransformDirection

from ..foundation.errors import InputError
from .ellipsoid import wrap_once
from .geoids import find_substitute, how_to_get_grids
from .operation_uses import COORDINATES_OF_ACCURACY, CrsOperation, OperationUse, with_geoid
from .proj_operations import (
    Candidate,
    PlateMotion,
    Rectangle,
    choose_operations,
    find_plate_motion,
    has_heights,
    is_realisation_of_itrs,
    list_operations,
    name_vertical_crs,
    parse_crs,
    split_at_180,
    without_heights,
)

_KEPT = 128  # number of CRS whose operations are cached


class CrsOperations:
    """The operations between one CRS and WGS84; use `operations_of`, which caches them.

    crs : horizontal, three-dimensional, geocentric or compound
    epoch : year for which positions on a plate-fixed datum are converted to WGS84
    Raises `InputError`: PROJ has no operation to WGS84, or there is no geoid grid for the heights.
    """

    def __init__(self, crs: pyproj.CRS, epoch: float | None = None) -> None:
        self.crs, self.epoch = crs, epoch
        self.has_heights, self.vertical_name = has_heights(crs), name_vertical_crs(crs)
        flat = without_heights(crs)
        self.horizontal = self if flat is crs else CrsOperations(flat, epoch)
        of_flat: list[CrsOperation] = []
        if flat is not crs:
            of_flat = [*(one.operation for one in self.horizontal._candidates), *self.horizontal.unavailable]
        self.unavailable: tuple[CrsOperation, ...]
        available, self.unavailable = list_operations(crs, of_flat)
        real = [one for one in available if not one.operation.is_ballpark]
        self._candidates: tuple[Candidate, ...] = tuple(real or ([] if self.vertical_name else available))
        self.substitute = find_substitute(self.vertical_name) if self.vertical_name else None
        if self._candidates or self.substitute is not None:
            return
        if self.vertical_name:
            raise InputError(f"no PROJ grid to convert the heights of {crs.name!r}: {how_to_get_grids()}")
        raise InputError(f"PROJ has no operation from {crs.name!r} to WGS84: convert the layer first")

    @cached_property
    def operations(self) -> tuple[CrsOperation, ...]:
        """The available operations in PROJ's order, followed by those with a substitute for the geoid."""
        candidates = tuple(self._at_epoch(number, one.operation) for number, one in enumerate(self._candidates))
        if self.substitute is None:
            return candidates
        return candidates + tuple(with_geoid(flat, self.substitute) for flat in self.horizontal.operations)

    # ---- conversion ----------------------------------------------------------------------------------------------

    def to_wgs84(self, xyz: np.ndarray) -> np.ndarray:
        """Return lon, lat, ellipsoidal height of points; heights are not changed if the CRS has no vertical datum.

        xyz : (n, 3) in the CRS, x (east) first
        Result: (n, 3) degrees and metres; not finite for points without an operation.
        """
        return self.convert(xyz)[0]

    def convert(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `to_wgs84` of points, and the index of the operation that converted each.

        xyz : (n, 3) in the CRS, x (east) first
        Result: (n, 3) and (n,) lon, lat, height; and indices into `operations`, -1 for points without one.
        """
        ground, number = self._convert_static(np.asarray(xyz, dtype=np.float64))
        if self._motion is not None:
            rows = np.isin(number, [one for one in range(len(self.operations)) if self.is_plate_fixed(one)])
            ground[rows] = self._motion.move(ground[rows])
        return ground, number

    def height_offsets(self, xy: np.ndarray) -> np.ndarray:
        """Return the ellipsoidal heights of height 0 of the CRS.

        xy : (n, 2) in the CRS, x (east) first
        Result: (n,) metres; not finite for points outside all grids, 0 for a CRS without heights.
        """
        return self.to_wgs84(np.column_stack([xy, np.zeros(len(xy))]))[:, 2]

    def from_wgs84(self, lonlat: np.ndarray) -> np.ndarray:
        """Return x, y of positions in the horizontal CRS: the inverse of `to_wgs84`.

        lonlat : (n, 2) or (n, 3) degrees; a height is not used
        Result: (n, 2) in the CRS, x (east) first; not finite for positions outside the CRS.
        """
        if self.horizontal is not self:
            return self.horizontal.from_wgs84(lonlat)
        lonlat = np.asarray(lonlat, dtype=np.float64)[:, :2]
        still = lonlat
        if self._motion is not None:  # positions on the plate-fixed datum
            at_zero = np.column_stack([lonlat, np.zeros(len(lonlat))])
            still = self._motion.move(at_zero, TransformDirection.INVERSE)[:, :2]
        if len(self._candidates) == 1:
            return self._pass_back(0, still if self.is_plate_fixed(0) else lonlat)
        # Start with the operation by areas of use in degrees, then iterate until each is the one chosen at its result
        xy, number = np.full((len(lonlat), 2), np.inf), np.full(len(lonlat), -1)
        selected = self._choose(lonlat, [split_at_180(one.operation.bounds) for one in self._candidates], {})
        for _ in self._candidates:
            for one in np.unique(selected[selected != number]).tolist():
                rows = np.flatnonzero((selected == one) & (number != one))
                xy[rows] = self._pass_back(one, (still if self.is_plate_fixed(one) else lonlat)[rows])
            number, is_finite = selected, np.isfinite(xy[:, 0])
            selected = number.copy()
            selected[is_finite] = self._choose(xy[is_finite], [one.rectangles for one in self._candidates], {})
            if np.array_equal(selected, number):
                break
        return xy

    def _convert_static(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `convert` without plate motions."""
        areas, attempts = [one.rectangles for one in self._candidates], dict[int, np.ndarray]()
        selected = self._choose(xyz, areas, {}) if self._candidates else np.full(len(xyz), -1)
        if len(xyz) and not selected.strides[0] and selected[0] >= 0:  # one operation for all points
            first = int(selected[0])
            ground, number = self._pass(first, xyz), np.full(len(xyz), first, dtype=np.int16)
            attempts[first] = np.broadcast_to(True, len(xyz))
        else:
            ground, number = np.full((len(xyz), 3), np.inf), np.full(len(xyz), -1, dtype=np.int16)
            for one in np.unique(selected[selected >= 0]).tolist():
                rows = np.flatnonzero(selected == one)
                ground[rows], number[rows] = self._pass(one, xyz[rows]), one
                attempts[one] = selected == one
        # Points outside the grid of their operation are converted by the next one
        waiting = np.zeros(0, dtype=np.int64)
        if len(self._candidates) > 1 and not np.isfinite(ground).all():
            waiting = np.flatnonzero(~np.isfinite(ground).all(axis=1))
        while len(waiting):
            selected = self._choose(xyz[waiting], areas, {one: rows[waiting] for one, rows in attempts.items()})
            for one in np.unique(selected[selected >= 0]).tolist():
                rows = waiting[selected == one]
                ground[rows], number[rows] = self._pass(one, xyz[rows]), one
                attempts[one] = attempts.get(one, np.zeros(len(xyz), dtype=bool)) | np.isin(np.arange(len(xyz)), rows)
            waiting = waiting[(selected >= 0) & ~np.isfinite(ground[waiting]).all(axis=1)]
        if self.substitute is None:
            return ground, number
        failed = np.flatnonzero(~np.isfinite(ground).all(axis=1))
        if len(failed):
            flat, flat_number = self.horizontal._convert_static(xyz[failed])
            axis = self.crs.sub_crs_list[1].axis_info[0]
            up = -axis.unit_conversion_factor if axis.direction == "down" else axis.unit_conversion_factor
            is_finite = np.isfinite(flat[:, :2]).all(axis=1)
            flat[is_finite, 2] = flat[is_finite, 2] * up + self.substitute.heights(flat[is_finite])
            ground[failed], number[failed] = flat, np.where(flat_number >= 0, flat_number + len(self._candidates), -1)
        return ground, number

    def _pass(self, one: int, xyz: np.ndarray) -> np.ndarray:
        """Return lon, lat, height of points ``(n, 3)`` converted by one of the candidates."""
        pipeline = self._candidates[one].pipeline
        if self.vertical_name:  # positions as in the CRS without heights, so that rasters and points agree
            heights = pipeline.transform(xyz[:, 0], xyz[:, 1], xyz[:, 2])[2]
            ground = self.horizontal._convert_static(xyz)[0]
            ground[:, 2] = heights
            return ground
        if self.has_heights:
            return np.column_stack(pipeline.transform(xyz[:, 0], xyz[:, 1], xyz[:, 2]))
        return np.column_stack([*pipeline.transform(xyz[:, 0], xyz[:, 1]), xyz[:, 2]])

    def _pass_back(self, one: int, lonlat: np.ndarray) -> np.ndarray:
        """Return x, y ``(n, 2)`` of positions ``(n, 2)`` by the inverse of one of the candidates.

        The inverse of PROJ starts at height 0 on the other ellipsoid, and has errors of up to a centimetre; they are
        found by converting the result forward again, and corrected.
        """
        operation, pipeline, _ = self._candidates[one]
        zero, inverse = np.zeros(len(lonlat)), TransformDirection.INVERSE
        x, y, _ = pipeline.transform(lonlat[:, 0], lonlat[:, 1], zero, direction=inverse)
        if not operation.is_null:
            lon, lat, _ = pipeline.transform(x, y, zero)
            with np.errstate(invalid="ignore"):
                lon, lat = lonlat[:, 0] - wrap_once(lon - lonlat[:, 0]), 2.0 * lonlat[:, 1] - lat
            x, y, _ = pipeline.transform(lon, lat, zero, direction=inverse)
        return np.column_stack([x, y])

    def _choose(
        self, xy: np.ndarray, areas: Sequence[Sequence[Rectangle]], excluded: Mapping[int, np.ndarray]
    ) -> np.ndarray:
        """Return the index of the candidate for each point, by `choose_operations`; longitudes may exceed ±180."""
        if self.crs.is_geographic and len(xy) and (np.abs(xy[:, 0]) > 180.0).any():
            xy = np.column_stack([(xy[:, 0] + 180.0) % 360.0 - 180.0, xy[:, 1]])
        return choose_operations(xy, [one.operation for one in self._candidates], areas, excluded)

    # ---- the motion of plates ------------------------------------------------------------------------------------

    def motion_in(self, epoch: float) -> PlateMotion | None:
        """Return the transformation of the CRS's plate motion in a year; None if PROJ has none for its datum.

        epoch : year
        Result: the transformation to WGS84.
        """
        geodetic = self.crs.geodetic_crs
        if geodetic is None or geodetic.is_geocentric:
            return None
        return find_plate_motion(geodetic.to_wkt(), epoch, self.has_heights)

    def is_plate_fixed(self, number: int) -> bool:
        """Return whether one of `operations` treats a plate-fixed datum as equal to WGS84.

        number : index in `operations`
        Result: true if it states an accuracy above 0 but does not change positions.
        """
        if number >= len(self._candidates):
            return self.horizontal.is_plate_fixed(number - len(self._candidates))
        operation = self._candidates[number].operation
        moves = operation.is_null and not operation.is_ballpark and bool(operation.accuracy_m)
        return moves and not is_realisation_of_itrs(self.crs)

    @cached_property
    def _motion(self) -> PlateMotion | None:
        """The transformation of the CRS's plate motion at `epoch`; None without an epoch."""
        return None if self.epoch is None else self.motion_in(self.epoch)

    def _at_epoch(self, number: int, operation: CrsOperation) -> CrsOperation:
        """Return an operation combined with the plate motion, if that is applied after it."""
        motion = self._motion
        if motion is None or not self.is_plate_fixed(number):
            return operation
        sigma_m = motion.accuracy_m / COORDINATES_OF_ACCURACY**0.5
        return operation._replace(
            name=f"{operation.name} + {motion.name} in {motion.epoch:g}",
            accuracy_m=motion.accuracy_m,
            is_null=False,
            sigma_m=(sigma_m, float(np.hypot(operation.sigma_m[1], sigma_m if motion.is_3d else 0.0))),
        )

    # ---- record of the operations used ---------------------------------------------------------------------------

    def uses(self, source: str, ground: np.ndarray, number: np.ndarray) -> tuple[OperationUse, ...]:
        """Return the operations that converted the points of a source, with better ones whose grids are missing.

        source : the file and layer; ground : (n, 2) or (n, 3) converted points: lon, lat
        number : (n,) indices from `convert`
        Result: one use for each operation, that with the most points first.
        """
        uses = []
        for one in np.unique(number[number >= 0]).tolist():
            positions, operation = ground[number == one], self.operations[one]
            better, loss_m = self._better_than(one, positions)
            substitute = self.substitute if one >= len(self._candidates) else None
            missing = self._missing_at(positions) if substitute is not None else None
            grids = () if missing is None else missing.grids
            plate = self.is_plate_fixed(one) and operation.is_null
            uses.append(
                OperationUse(
                    source,
                    self.crs.name,
                    one,
                    operation=operation,
                    points=len(positions),
                    better=better,
                    loss_m=loss_m,
                    geoid=substitute,
                    geoid_grids=grids,
                    treats_plate_as_wgs84=plate,
                )
            )
        return tuple(sorted(uses, key=lambda use: -use.points))

    def uses_at(self, source: str, lonlat: np.ndarray) -> tuple[OperationUse, ...]:
        """Return `uses` at positions on WGS84: nodes of a raster, or the place of an image.

        source : name of the raster or image; lonlat : (n, 2) or (n, 3) degrees
        Result: as `uses`.
        """
        lonlat, xy = np.asarray(lonlat, dtype=np.float64), self.from_wgs84(lonlat)
        is_finite = np.isfinite(xy).all(axis=1)
        number = self.convert(np.column_stack([xy[is_finite], np.zeros(is_finite.sum())]))[1]
        return self.uses(source, lonlat[is_finite], number)

    def _missing_at(self, ground: np.ndarray) -> CrsOperation | None:
        """Return the most accurate operation with a missing grid that covers some of the points."""
        covering = [one for one in self.unavailable if not one.is_ballpark and one.covers(ground).any()]
        return min(covering, key=lambda one: np.inf if one.accuracy_m is None else one.accuracy_m, default=None)

    def _better_than(self, number: int, ground: np.ndarray) -> tuple[CrsOperation | None, float]:
        """Return the best operation with a missing grid for some of the points, and the accuracy (m) lost by that.

        The loss is NaN if the accuracy of the operation used is unknown, and excludes that of a substitute geoid.
        """
        if number >= len(self._candidates):
            return self.horizontal._better_than(number - len(self._candidates), ground)
        operation, best = self._candidates[number].operation, self._missing_at(ground)
        if best is None or operation.accuracy_m is None:
            return best, 0.0 if best is None else float("nan")
        loss_m = 0.0 if best.accuracy_m is None else operation.accuracy_m - best.accuracy_m
        return (best, loss_m) if loss_m > 0.0 else (None, 0.0)


@lru_cache(maxsize=_KEPT)
def operations_of(crs: str, epoch: float | None = None) -> CrsOperations:
    """Return the operations between a CRS and WGS84, cached for all threads.

    crs : anything PROJ reads: ``EPSG:28355``, WKT, ``EPSG:25832+5783``
    epoch : year for which positions on a plate-fixed datum are converted to WGS84

    Raises `InputError` if the CRS is unknown, or there is no operation to WGS84, or no geoid grid for the heights.
    """
    return CrsOperations(parse_crs(crs), epoch)

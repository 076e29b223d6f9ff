"""Tables of ground points and image points, as in files, from matchers, and in a block."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from ..foundation.errors import InputError
from ..foundation.json_values import json_text
from ..foundation.thresholds import EQUALITY
from ..ground.geodesy import distances_m
from ..ground.operation_uses import OperationUse, read_entry
from .columns import Columns


class Role(IntEnum):
    """Role of a ground point in the adjustment."""

    GCP = 0  #: its surveyed position is a weighted observation
    CHECK = 1  #: its surveyed position is compared with the result, and not used
    TIE = 2  #: its position is unknown, or only an initial value
    OFF = 3  #: excluded with its measurements: in files and tables of points, never in a block
    HELD_OUT = 4  #: a tie point that is not used in the adjustment, as an independent check

    @classmethod
    def parse(cls, text: str) -> Role | None:
        """Return the role for a word in a file.

        Parameters
        ----------
        text : str
            ``gcp``, ``check``, ``tie``, ``off`` and synonyms, in upper or lower case; may be empty.

        Returns
        -------
        Role or None
            None for an empty field.

        Raises
        ------
        KeyError
            The word is not a role.
        """
        return None if not text.strip() else _ROLE_NAMES[text.strip().lower()]

    @property
    def label(self) -> str:
        return self.name.lower()


#: Labels of the roles, indexed by an array of roles.
ROLE_LABELS = np.array([role.label for role in Role])
_ROLE_NAMES = {
    "gcp": Role.GCP, "control": Role.GCP, "check": Role.CHECK, "chk": Role.CHECK, "checkpoint": Role.CHECK,
    "cp": Role.CHECK, "icp": Role.CHECK, "check point": Role.CHECK, "control point": Role.GCP, "ctl": Role.GCP,
    "ground control": Role.GCP, "ground control point": Role.GCP, "passpunkt": Role.GCP, "kontrollpunkt": Role.CHECK,
    "independent check": Role.CHECK, "independent check point": Role.CHECK, "rejected": Role.OFF, "disabled": Role.OFF,
    "tie": Role.TIE, "off": Role.OFF, "held_out": Role.HELD_OUT, "held-out": Role.HELD_OUT,
}  # fmt: skip
POINT_OPERATIONS = "HRSI_POINT_OPERATIONS"  #: metadata of a layer of ground points, from `describe_operations`
UNSET = -1  #: role column of `GroundPoints`: no role in the file


@dataclass(frozen=True, eq=False, repr=False)
class GroundPoints(Columns):
    """Ground points; only the arrays ``ids`` and ``ground`` are required, and one value may replace an array.

    Parameters
    ----------
    ids : (m,) ndarray of str
        Ids of the points.
    ground : (m, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres; NaN if unknown.
    role : (m,) ndarray of int
        A `Role` or `UNSET`.
    sigma_m : (m, 2) ndarray
        Standard deviation of each horizontal coordinate and of the height; for NaN the default is used.
    source : str
        The file and layer, for messages.
    covariance_m2 : (m, 3, 3) ndarray, optional
        Of east, north and height; NaN elements, or all for None, follow from ``sigma_m``. An infinite variance means
        that the coordinate was not surveyed.
    operation : (m,) ndarray of int
        Index of the one of ``operations`` that converted the point to WGS84; -1 if it was given in WGS84.
    operations : tuple of OperationUse
        The operations, with the errors common to all their points.
    """

    ids: np.ndarray
    ground: np.ndarray
    role: np.ndarray = UNSET  # type: ignore[assignment]  # one value for all becomes an array
    sigma_m: np.ndarray = np.nan  # type: ignore[assignment]
    source: str = ""
    covariance_m2: np.ndarray | None = None
    operation: np.ndarray = -1  # type: ignore[assignment]
    operations: tuple[OperationUse, ...] = ()

    if TYPE_CHECKING:  # single values and sequences become columns

        def __init__(self, *columns: Any, **named: Any) -> None: ...

    def __post_init__(self) -> None:
        self._fill(
            ids=(str, ()),
            ground=(np.float64, (3,)),
            role=(np.int8, ()),
            sigma_m=(np.float64, (2,)),
            operation=(np.int16, ()),
        )
        if self.covariance_m2 is not None:
            covariance = np.array(self.covariance_m2, dtype=np.float64).reshape(len(self), 3, 3)
            object.__setattr__(self, "covariance_m2", covariance)

    def __len__(self) -> int:
        return len(self.ids)

    def survey_covariance_m2(self, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the covariance of some points' surveyed positions: its given elements, the others from the sigmas.

        Parameters
        ----------
        rows : (k,) ndarray or slice
            The points.

        Returns
        -------
        (k, 3, 3) ndarray
            Of east, north and height in square metres.
        """
        covariance = np.zeros((len(self.ids[rows]), 3, 3))
        covariance[:, range(3), range(3)] = self.sigma_m[rows][:, [0, 0, 1]] ** 2
        if self.covariance_m2 is not None:
            stated = self.covariance_m2[rows]
            covariance = np.where(np.isnan(stated), covariance, stated)
        return covariance

    def operation_shifts_m(self, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the shift of points by one standard deviation of the error of each operation.

        Two sources that were converted by the same operation share its error.

        Parameters
        ----------
        rows : (k,) ndarray or slice
            The points.

        Returns
        -------
        (k, 3, e) ndarray
            East, north, height in metres for each of e errors: east and north of an operation, or its height.
        """
        operation = self.operation[rows]
        columns: dict[tuple[str, int], np.ndarray] = {}
        for number, use in enumerate(self.operations):
            for axis, sigma_m in enumerate((use.operation.sigma_m[0], *use.operation.sigma_m)):
                if sigma_m > 0.0:
                    error = columns.setdefault((use.error_names[axis == 2], axis), np.zeros((len(operation), 3)))
                    error[operation == number, axis] = sigma_m
        return np.stack([*columns.values()], axis=2) if columns else np.zeros((len(operation), 3, 0))


def stack_ground_points(tables: Sequence[GroundPoints]) -> GroundPoints:
    """Return tables of ground points under each other, with the source of the first."""
    covariance, operation, operations = None, list[np.ndarray](), tuple[OperationUse, ...]()
    if any(table.covariance_m2 is not None for table in tables):  # NaN where a table has none
        stated = [np.full((len(t), 3, 3), np.nan) if t.covariance_m2 is None else t.covariance_m2 for t in tables]
        covariance = np.concatenate(stated)
    for table in tables:
        operation.append(np.where(table.operation >= 0, table.operation + len(operations), -1))
        operations += table.operations
    ids, ground, role, sigma_m = (
        np.concatenate([getattr(t, name) for t in tables]) for name in ("ids", "ground", "role", "sigma_m")
    )
    return GroundPoints(
        ids,
        ground,
        role,
        sigma_m=sigma_m,
        source=tables[0].source,
        covariance_m2=covariance,
        operation=np.concatenate(operation),
        operations=operations,
    )


def describe_operations(points: GroundPoints) -> str:
    """Return the operations that are not exact as JSON, in the form of reports, with point ids; empty without any."""
    result = [
        {**use.entry(), "ids": points.ids[points.operation == number].tolist()}
        for number, use in enumerate(points.operations)
        if use.operation.accuracy_m != 0.0 and (points.operation == number).any()
    ]
    return json_text(result) if result else ""


def with_operations(points: GroundPoints, described: str) -> GroundPoints:
    """Return points with the operations of a text by `describe_operations`; raise `InputError` if it is damaged."""
    operation, uses = np.full(len(points), -1), list[OperationUse]()
    try:
        for number, entry in enumerate(json.loads(described)):
            rows = np.isin(points.ids, [str(name) for name in entry["ids"]])
            operation[rows] = number
            uses.append(read_entry(entry, int(rows.sum())))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{points.source}: its list of coordinate operations is damaged ({error!r}): obtain the file again"
        ) from None
    return replace(points, operation=operation, operations=tuple(uses))


@dataclass(frozen=True, eq=False, repr=False)
class ImagePoints(Columns):
    """Measurements of points on images, as files and matchers deliver them.

    Only the arrays ``ids``, ``image_ids`` and ``xy`` are required, and one value may replace an array.

    Parameters
    ----------
    ids, image_ids : (n,) ndarray of str
        Ids of the point and of the image; from files as `columns.NameColumn`, which behaves like such an array.
    xy : (n, 2) ndarray
        Sample, line in pixels.
    sigma_px : (n,) ndarray
        Standard deviation of each coordinate; for NaN the default is used.
    kind : (n,) ndarray of str
        Kind of the measured object: ``corner``, ``center`` …
    quality : (n,) ndarray
        Larger is better, NaN if unknown.
    source : str
        The file and layer, for messages.
    """

    ids: np.ndarray
    image_ids: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray = np.nan  # type: ignore[assignment]  # one value for all becomes an array
    kind: np.ndarray = ""  # type: ignore[assignment]
    quality: np.ndarray = np.nan  # type: ignore[assignment]
    source: str = ""

    if TYPE_CHECKING:  # single values and sequences become columns

        def __init__(self, *columns: Any, **named: Any) -> None: ...

    def __post_init__(self) -> None:
        self._fill(
            ids=(str, ()),
            image_ids=(str, ()),
            xy=(np.float64, (2,)),
            sigma_px=(np.float64, ()),
            kind=(str, ()),
            quality=(np.float64, ()),
        )

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False, repr=False)
class Measurements(Columns):
    """Image points of a block with ids resolved: ``point`` and ``image`` are indices of the block's points and images.

    Sorted by point, then by image.
    """

    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray
    kind: np.ndarray
    quality: np.ndarray

    def __len__(self) -> int:
        return len(self.point)


def are_apart(ground: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return which positions of equal ids differ by more than `EQUALITY.position_m`, ``(n,)``.

    ground, reference : (n, 3) lon, lat in degrees, also beyond ±180, height in metres; unknown heights are equal
    """
    has_heights = np.isfinite(ground[:, 2]) & np.isfinite(reference[:, 2])
    first, second = (
        np.column_stack([xyz[:, :2], np.where(has_heights, xyz[:, 2], 0.0)]) for xyz in (ground, reference)
    )
    return distances_m(first, second) > EQUALITY.position_m

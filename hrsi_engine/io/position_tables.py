"""Tables of positions in images, alone or with their ground positions, from any point file; ids are not needed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..foundation.errors import InputError
from ..ground.operation_uses import OperationUse
from .opening.budgets import require_heights
from .point_files.find import point_reader_of, split_spec
from .point_files.in_memory import PointsInMemory
from .point_files.interpret import image_names
from .point_files.positions import Reference, ground_positions, has_positions
from .point_files.table import PointTable


class ImagePositions(NamedTuple):
    """Positions to localize: ids and image ids (n,) str, sample and line (n, 2), ellipsoidal height (n,) or NaN."""

    ids: np.ndarray
    image_ids: np.ndarray
    image: np.ndarray
    height_m: np.ndarray


class Correspondences(NamedTuple):
    """Ground points (n, 3) lon, lat, ellipsoidal height, where they are in one image (n, 2), and warnings.

    ``operations`` brought the ground points to WGS84.
    """

    ground: np.ndarray
    image: np.ndarray
    warnings: tuple[str, ...]
    operations: tuple[OperationUse, ...] = ()


def read_image_positions(spec: str, image_ids: Sequence[str]) -> ImagePositions:
    """Return the rows of a file with the fields sample and line, and image and height where it has them.

    Rows without an id are numbered from 1. Raises `InputError` naming file, row and field.
    """
    table = _read_table(spec)
    image = _sample_line(table)
    rows = np.arange(len(table))
    ids = table.columns.get("id", (rows + 1).astype(str))
    height = table.columns.get("height", np.full(len(table), np.nan))
    return ImagePositions(ids, np.asarray(image_names(table, rows, image_ids)), image, height)


def read_correspondences(
    spec: str, *, ground_crs: str | None = None, height_datum: str = "layer", epoch: float | None = None
) -> Correspondences:
    """Return the correspondences of a file with positions (geometry, lon and lat, x and y), heights, sample and line.

    Raises `InputError` naming file, row and field.
    """
    table = _read_table(spec)
    image = _sample_line(table)
    if not has_positions(table):
        raise InputError(
            f"{table.source}: has no ground positions (point geometry, lon and lat, x and y): add them"
        )  # fmt: skip
    placed = ground_positions(table, Reference(ground_crs or "", height_datum, epoch=epoch))
    ground = placed.ground
    missing = np.flatnonzero(np.isnan(ground).any(axis=1))
    if missing.size:
        raise InputError(f"{table.name_row(missing[0])}: has no ground position: fill it in, or remove the row")
    require_heights(ground[:, 2], table.name_row)
    return Correspondences(ground, image, (*table.notes, *placed.warnings), placed.operations)


def _read_table(spec: str) -> PointTable:
    if isinstance(spec, PointsInMemory):
        table = spec.table()
    else:
        path, layer = split_spec(spec)
        table = point_reader_of(path).read(path, layer)
    if not len(table):
        raise InputError(f"{table.source}: holds no points: add some, or name another layer")
    return table


def _sample_line(table: PointTable) -> np.ndarray:
    for field in ("sample", "line"):
        if field not in table.columns:
            fields = ", ".join(table.field_names) or "none"
            raise InputError(f"{table.source}: has no field {field!r}; its fields are {fields}: rename or add it")
    image = np.column_stack([table.columns["sample"], table.columns["line"]])
    missing = np.flatnonzero(np.isnan(image).any(axis=1))
    if missing.size:
        raise InputError(f"{table.name_row(missing[0])}: sample or line is empty: fill it in, or remove the row")
    return image

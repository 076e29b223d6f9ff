"""Converts the rows of a point file into ground points and image points, and checks them for all formats.

Readers return a `PointTable` of texts and numbers, unchecked. Here a row with a position becomes a ground point, and a
row with sample and line a measurement; one row may be both (a GCP measured in one image). Errors name the file and
the line or feature, as the user finds it there.

The accuracy of most surveys is given by ``sigma_xy`` and ``sigma_h``. ``sigma_east`` and ``sigma_north`` may differ;
``corr_en``, ``corr_eh`` and ``corr_nh`` are correlations; ``cov_ee`` to ``cov_nh`` are the elements of a covariance of
east, north and height in m², as a network adjustment prints it. Elements of the covariance take precedence over
correlations and sigmas, and these over ``sigma_xy``.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ...block.columns import NameColumn, find_unique_ids
from ...block.points import UNSET, GroundPoints, ImagePoints, Role, are_apart, with_operations
from ...foundation.errors import InputError
from ...foundation.large_arrays import any_of_rows
from ..opening.budgets import RPC_BUDGETS, require_heights
from ..rasters.images import image_id
from .positions import Reference, ground_positions, has_positions
from .table import PointTable

#: Field of HRSI's own layers with the standard deviation of adjusted heights; surveyed ones have ``sigma_h``.
ADJUSTED_SIGMA = "sigma_height_m"


@dataclass(frozen=True)
class PointTables:
    """Points of one file.

    Parameters
    ----------
    ground : GroundPoints or None
        None if it contains none.
    image : ImagePoints or None
        None if it contains none.
    warnings : tuple of str
        Remarks on the file for the user.
    pairwise : bool
        Whether each id connects two images only, see `PointTable`.
    """

    ground: GroundPoints | None
    image: ImagePoints | None
    warnings: tuple[str, ...] = ()
    pairwise: bool = False


def interpret(table: PointTable, reference: Reference, image_ids: Sequence[str]) -> PointTables:
    """Return a table's ground points and image points; raise `InputError` with the row and the remedy."""
    measures, with_positions = bool(table.columns.keys() & {"sample", "line"}), has_positions(table)
    if not (measures or with_positions):
        raise InputError(
            f"{table.source}: has neither positions (point geometry, lon and lat, x and y) nor image coordinates "
            f"(sample and line); its fields are {', '.join(table.field_names) or 'none'}: rename or add them, or name "
            "those that are meant: FILE|columns=id=NAME,x=NAME,y=NAME,height=NAME"
        )
    if not len(table):
        raise InputError(f"{table.source}: contains no points: add some, or name another layer")
    require_field(table, "id")
    table.refuse(table.columns["id"] == "", "field 'id' is empty: fill it in")
    image = _image_points(table, with_positions, image_ids) if measures else None
    ground, warnings = _ground_points(table, reference) if with_positions else (None, [])
    return PointTables(ground, image, (*table.notes, *warnings), table.pairwise)


def require_field(table: PointTable, field: str) -> np.ndarray:
    """Return a column; if it is missing, raise `InputError` with the fields of the file."""
    if field not in table.columns:
        raise InputError(
            f"{table.source}: has no field {field!r}; its fields are {', '.join(table.field_names) or 'none'}: add it, "
            f"or name the one that is meant: FILE|columns={field}=NAME"
        )
    return table.columns[field]


def _image_points(table: PointTable, with_positions: bool, image_ids: Sequence[str]) -> ImagePoints | None:
    """Return the rows that have sample and line; rows without are allowed only in a table with ground points."""
    xy = np.column_stack([require_field(table, "sample"), require_field(table, "line")])
    empty = np.isnan(xy)
    subset = any_of_rows(empty)
    is_incomplete = subset & ~empty.all(axis=1) if with_positions else subset
    for field, is_empty in zip(("sample", "line"), empty.T, strict=True):
        table.refuse(is_incomplete & is_empty, f"field {field!r} is empty: fill it in, or remove the row")
    distant = np.abs(xy).max(axis=1, initial=0.0, where=~empty) > RPC_BUDGETS.image_px
    table.refuse(distant, lambda row: f"sample {xy[row, 0]:g}, line {xy[row, 1]:g} is in no image: correct it")
    if subset.all():
        return None
    sigma = positive(table, "sigma")
    if subset.any():  # millions of rows are copied only if necessary
        table, xy, sigma = table.select(~subset), xy[~subset], sigma[~subset]
    columns, images = table.columns, cast(Any, image_names(table, image_ids))  # used as an array
    return ImagePoints(
        columns["id"],
        images,
        xy,
        sigma_px=sigma,
        kind=columns.get("kind", np.zeros(len(table), dtype="U1")),
        quality=columns.get("quality", np.full(len(table), np.nan)),
        source=table.source,
    )


def image_names(table: PointTable, image_ids: Sequence[str]) -> NameColumn:
    """Return the image id of each row; without such a field, the id of the only image of the block."""
    if "image" not in table.columns and len(image_ids) == 1:
        return NameColumn(np.array(image_ids, dtype=str), np.zeros(len(table), dtype=np.int32))
    column = require_field(table, "image")
    table.refuse(column == "", "field 'image' is empty: fill it in")
    place, number = dict[str, int](), np.empty(len(column), dtype=np.int32)
    for start in range(0, len(column), 100_000):  # sorting millions of names would take more memory than the table
        names = column[start : start + 100_000].tolist()
        for name in sorted(set(names) - place.keys()):
            place[name] = len(place)
        number[start : start + len(names)] = [place[name] for name in names]
    return matching_names(NameColumn(np.array(list(place), dtype=str), number), image_ids, table.pairwise)


def matching_names(written_names: NameColumn, image_ids: Sequence[str], prefixed: bool = False) -> NameColumn:
    """Return the ids of block images for names that are ids, file names or paths; unknown names are unchanged."""
    # Windows ignores the case of names; the files of a product begin with the names of their kinds
    keys = [(key, image) for image in image_ids for key in {image.casefold(), _product_name(image)}]
    count = Counter(key for key, _ in keys)
    similar = {key: image for key, image in keys if count[key] == 1}
    block_ids = set(image_ids)
    ids = np.array(
        [_matching_id(name, block_ids, similar, prefixed) for name in written_names.names.tolist()], dtype=str
    )
    if np.char.isdecimal(ids).all():  # images named by numbers, each a word of one id
        numbers = {image: set(map(int, re.findall(r"\d+", image))) for image in image_ids}
        owners = [[image for image in image_ids if int(name) in numbers[image]] for name in ids.tolist()]
        ids = np.array([images[0] for images in owners], str) if all(len(images) == 1 for images in owners) else ids
    names, place = np.unique(ids, return_inverse=True)  # two names may be one image
    return NameColumn(names, place.astype(np.int32)[written_names.number])


def _matching_id(name: str, image_ids: set[str], similar: Mapping[str, str], prefixed: bool) -> str:
    """Return the id of the image for a name that is an id, file name or path; the name itself if no id matches.

    ``similar`` has the image ids that are unique in lower case or as names of products, by these names.
    """
    stem = image_id(name.replace("\\", "/"))
    for called in (name, stem):
        if called in image_ids:
            return called
    for called in (name.casefold(), stem.casefold(), _product_name(stem)):
        if called in similar:
            return similar[called]
    # ``PREFIX-IMAGE``, as matchers name their files: the longest id that matches
    behind = [image for image in image_ids if name.endswith(f"-{image}")] if prefixed else []
    return max(behind, key=len, default=name)


def _product_name(name: str) -> str:
    """Return the common name, in lower case, of ``DIM_x``, ``RPC_x``, ``IMG_x`` and its first tile ``IMG_x_R1C1``."""
    return re.sub(r"^(dim|img|rpc)_|_r1c1$", "", name.casefold())


def _ground_points(table: PointTable, reference: Reference) -> tuple[GroundPoints | None, list[str]]:
    """Return one ground point for each id with a position; raise `InputError` for an id with two positions."""
    placed = ground_positions(table, reference)
    ground, warnings = placed.ground, placed.warnings
    require_heights(ground[:, 2], table.name_row)
    role = _roles(table)
    sigma, covariance = survey_accuracy(table)
    if reference.adjusted and ADJUSTED_SIGMA in table.columns:
        sigma, covariance = np.column_stack([sigma[:, 0], table.columns[ADJUSTED_SIGMA]]), None
    rows = np.flatnonzero(~np.isnan(ground[:, 0]))
    ids, first, inverse = np.unique(table.columns["id"][rows], return_index=True, return_inverse=True)
    distinct = rows[first]
    if len(ids) < len(rows):
        # An id may occur more than once, as in a table of measurements, with one position
        previous = distinct[inverse]
        is_elsewhere = are_apart(ground[rows], ground[previous])
        if is_elsewhere.any():
            position = np.flatnonzero(is_elsewhere)[0]
            raise InputError(
                f"{table.name_row(rows[position])}: occurs in {table.row_name(int(previous[position]))} already, "
                "here with another position: keep one, or rename it"
            )
    if not len(ids):
        return None, warnings
    order = np.sort(distinct)
    points = GroundPoints(
        table.columns["id"],
        ground,
        role,
        sigma_m=sigma,
        source=table.source,
        covariance_m2=covariance,
        operation=placed.operation,
        operations=placed.operations,
    )
    points = points.select(order)
    return with_operations(points, table.operations) if table.operations and not placed.operations else points, warnings


#: Roles of the points whose flag is set, and of the others, by the field of the flag.
_FLAG_ROLES = {"check": (Role.CHECK, Role.GCP), "use": (UNSET, Role.OFF)}
_FLAGS = {"1": True, "yes": True, "true": True, "y": True, "0": False, "no": False, "false": False, "n": False}


def _roles(table: PointTable) -> np.ndarray:
    """Return the roles (n,) by the field `role`, or by flags of points that are used, or are check points.

    Raises `InputError` for an unknown word in `role`; other fields with other words than flags have another meaning.
    """
    role = np.full(len(table), UNSET, dtype=np.int8)
    for field, (if_set, otherwise) in _FLAG_ROLES.items():
        words, index = find_unique_ids(np.char.lower(table.columns.get(field, np.zeros(0, dtype="U1"))))
        flags = [_FLAGS.get(str(word)) for word in words]
        if flags and None not in flags:
            of_flag = np.where(np.array(flags, dtype=bool), if_set, otherwise)[index]
            role = np.where(of_flag == UNSET, role, of_flag).astype(np.int8)
    names, index = find_unique_ids(table.columns.get("role", np.zeros(len(table), dtype="U1")))
    for number, name in enumerate(names):
        try:
            parsed = Role.parse(str(name))
        except KeyError:
            table.refuse(index == number, f"role {str(name)!r} is unknown: use gcp, check, tie or off")
            continue
        if parsed is not None:
            role[index == number] = parsed
    return role


#: Names of variance and standard deviation of each axis, and of covariance and correlation of each pair of axes.
_AXES = (("cov_ee", "sigma_east"), ("cov_nn", "sigma_north"), ("cov_hh", "sigma_h"))
_PAIRS = ((0, 1, "cov_en", "corr_en"), (0, 2, "cov_eh", "corr_eh"), (1, 2, "cov_nh", "corr_nh"))


def survey_accuracy(table: PointTable) -> tuple[np.ndarray, np.ndarray | None]:
    """Return sigmas ``(n, 2)`` of plan and height, and covariances ``(n, 3, 3)`` if the table has more than those.

    Missing values are NaN. Raises `InputError` with row and field of impossible values.
    """
    horizontal, height = positive(table, "sigma_xy"), positive(table, "sigma_h")
    beyond = {name for names in (*_AXES, *_PAIRS) for name in names[-2:]} - {"sigma_h"}
    if not table.columns.keys() & beyond:
        return np.column_stack([horizontal, height]), None
    # The standard deviations of east, north and height ``(n, 3)``
    columns = []
    for axis, (variance, name) in enumerate(_AXES):
        sigma = positive(table, name)
        sigma = np.where(np.isnan(sigma) & (axis < 2), horizontal, sigma)
        stated = np.sqrt(positive(table, variance))
        columns.append(np.where(np.isnan(stated), sigma, stated))
    sigma = np.column_stack(columns)
    covariance = np.full((len(table), 3, 3), np.nan)
    covariance[:, range(3), range(3)] = sigma**2
    for row, column, element, correlation in _PAIRS:
        value = _covariance(table, sigma[:, row], sigma[:, column], element, correlation)
        covariance[:, row, column] = covariance[:, column, row] = value
    pair = np.sqrt((sigma[:, 0] ** 2 + sigma[:, 1] ** 2) / 2.0)
    return np.column_stack([np.where(np.isnan(pair), horizontal, pair), sigma[:, 2]]), covariance


def positive(table: PointTable, field: str) -> np.ndarray:
    """Return a column of standard deviations or variances, NaN if missing; raise `InputError` if one is not above 0."""
    values = table.columns.get(field)
    if values is None:
        return np.full(len(table), np.nan)
    is_negative = values <= 0.0  # NaN: not given
    table.refuse(
        is_negative, lambda row: f"field {field!r} is {values[row]:g}: give a number above 0 or leave it empty"
    )
    return values


def _covariance(table: PointTable, first: np.ndarray, second: np.ndarray, element: str, correlation: str) -> np.ndarray:
    """Return the covariances of two coordinates with these sigmas ``(n,)``, NaN if none is given."""
    nothing = np.full(len(table), np.nan)
    value, share = table.columns.get(element, nothing), table.columns.get(correlation, nothing)
    is_stated = ~(np.isnan(value) & np.isnan(share))
    with np.errstate(invalid="ignore"):
        share = np.where(np.isnan(value), share, value / (first * second))
    field = element if element in table.columns else correlation
    alone, impossible = is_stated & np.isnan(first * second), is_stated & ~(np.abs(share) < 1.0)
    table.refuse(alone, f"field {field!r} needs the standard deviations of both coordinates: add them")
    advice = "correct it or its standard deviations"
    table.refuse(impossible, f"field {field!r} is no correlation between -1 and 1: {advice}")
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(first * second), 0.0, share * first * second)

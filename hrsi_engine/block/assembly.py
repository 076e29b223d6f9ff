"""Assembly of a block: tables of ground and image points of several files become one `Block`.

Ids are resolved to indices, roles assigned, default standard deviations filled in, and contradictions reported.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from ..foundation.errors import InputError, list_ids
from ..foundation.large_arrays import any_of_rows, finite_rows
from .block import Block, Image, find_image_indices
from .columns import find_unique_ids, isin, join_names
from .default_sigmas import DefaultSigmas
from .points import UNSET, GroundPoints, ImagePoints, Measurements, Role, are_apart, stack_ground_points

UNSURVEYED = (Role.TIE, Role.HELD_OUT)


def assemble(
    images: Sequence[Image],
    ground_points: Iterable[GroundPoints],
    image_points: Iterable[ImagePoints],
    gcp_ids: Sequence[str] | None = None,
    check_ids: Sequence[str] | None = None,
    defaults: DefaultSigmas | None = None,
) -> Block:
    """Combine images, ground points and measurements to a block.

    A known point is a GCP unless its role differs. With ``gcp_ids``, these are the GCPs and all other known points are
    check points; ``check_ids`` are always check points; if both are given, all other known points are excluded. Points
    with the role ``outside`` are also excluded, unless they are named. Measured points without position are tie points.

    Parameters
    ----------
    images : sequence of Image
        The images.
    ground_points : iterable of GroundPoints
        Tables of known points.
    image_points : iterable of ImagePoints
        Tables of measurements.
    gcp_ids, check_ids : sequence of str, optional
        Ids of the GCPs and of the check points.
    defaults : DefaultSigmas, optional
        Standard deviations for points and measurements without their own.

    Returns
    -------
    Block
        The block with consistent indices; every sigma is set.

    Raises
    ------
    InputError
        Ids that do not exist or contradict each other.
    """
    defaults = defaults or DefaultSigmas()
    repeated = sorted(name for name, count in Counter([image.id for image in images]).items() if count > 1)
    if repeated:
        raise InputError(f"image id {list_ids(repeated)} occurs more than once: rename one of the files")
    surveyed = _merge_ground(list(ground_points))
    rows = stack_image_points([table for table in image_points if len(table)])
    # Exclude points with the role off unless they are named; their measurements are not used as tie points either
    outside = (surveyed.role == Role.OFF) & ~np.isin(surveyed.ids, [*(gcp_ids or ()), *(check_ids or ())])
    surveyed, rows = (
        (surveyed.select(~outside), rows.select(~isin(rows.ids, surveyed.ids[outside])))
        if outside.any()
        else (surveyed, rows)
    )
    if gcp_ids and check_ids:
        # Exclude surveyed points that are not selected; their measurements are not used as tie points either
        is_excluded = (
            ~np.isin(surveyed.ids, [*gcp_ids, *check_ids])
            & ~np.isin(surveyed.role, UNSURVEYED)
            & finite_rows(surveyed.ground)
        )
        surveyed, rows = surveyed.select(~is_excluded), rows.select(~isin(rows.ids, surveyed.ids[is_excluded]))
    warnings: list[str] = []
    image_index = find_image_indices(rows, images)
    ids, point_index = find_unique_ids(rows.ids)
    warnings += _warn_of_similar_ids(ids, rows, surveyed)
    measured = np.isin(surveyed.ids, ids)
    surveyed, unmeasured = surveyed.select(measured), surveyed.select(~measured)
    if len(unmeasured):
        warnings_text = f"{len(surveyed)} of {len(measured)} ground points are measured on images; "
        warnings_text += f"{len(unmeasured)} are not used: {list_ids(unmeasured.ids)}"
        single = ids[(np.bincount(point_index, minlength=len(ids)) == 1) & ~np.isin(ids, surveyed.ids)]
        if len(single):
            warnings_text += f"; {len(single)} points measured on one image have no ground position: {list_ids(single)}"
        warnings.append(warnings_text)
    points = _make_points(ids, surveyed, _assign_roles(surveyed, gcp_ids, check_ids), defaults)
    order = np.lexsort((image_index, point_index))
    sigma = np.where(np.isnan(rows.sigma_px), defaults.sigma_image_px, rows.sigma_px)
    measurements = Measurements(point_index, image_index, rows.xy, sigma, rows.kind, rows.quality).select(order)
    measurements = _drop_repetitions(measurements, ids, warnings)
    is_bad = ~(finite_rows(measurements.xy) & (measurements.sigma_px > 0.0))
    if is_bad.any():
        row = np.flatnonzero(is_bad)[0]
        raise InputError(
            f"point {ids[measurements.point[row]]!s} on image {images[measurements.image[row]].id} has sample, line "
            f"{measurements.xy[row].tolist()} and sigma {measurements.sigma_px[row]}: numbers are needed, and a sigma "
            "above 0"
        )
    unmeasured = replace(unmeasured, role=_assign_roles(unmeasured, None, None))
    return Block(tuple(images), points, measurements, tuple(warnings), unmeasured)


def _warn_of_similar_ids(ids: np.ndarray, rows: ImagePoints, valid: GroundPoints) -> list[str]:
    """Return a warning about measured ids without a ground point that differ only by spelling from one that has one.

    Ids that are measured in the same image are different points.
    """
    surveyed = valid.ids[finite_rows(valid.ground)]
    result = []
    for tie, similar in find_similar_ids(ids[~np.isin(ids, surveyed)], surveyed).items():
        images = rows.image_ids[rows.ids == tie]
        result += [
            f"{tie!r} ({name!r} has one)"
            for name in similar
            if not np.isin(images, rows.image_ids[rows.ids == name]).any()
        ]
    if not result:
        return []
    return [
        f"measured, but without a ground point: {list_ids(result)}: ids are compared as text, so these are different "
        "points; if two of them are the same point, use the same id"
    ]


def _merge_ground(tables: list[GroundPoints]) -> GroundPoints:
    """Concatenate tables; an id that occurs twice must have the same position."""
    if not tables:
        return GroundPoints([], np.empty((0, 3)))
    merged = stack_ground_points(tables)
    _, first, inverse = np.unique(merged.ids, return_index=True, return_inverse=True)
    repeated = np.flatnonzero(first[inverse] != np.arange(len(inverse)))
    contradicts = repeated[are_apart(merged.ground[repeated], merged.ground[first[inverse[repeated]]])]
    if len(contradicts):
        raise InputError(
            f"ground point {list_ids(np.unique(merged.ids[contradicts]))} has different positions in {merged.source}: "
            "keep one"
        )
    return merged.select(first)


def stack_image_points(tables: Sequence[ImagePoints]) -> ImagePoints:
    """Return tables of measurements concatenated."""
    if not tables:
        return ImagePoints([], [], np.empty((0, 2)))
    if len(tables) == 1:
        return tables[0]
    columns = {
        name: join([getattr(table, name) for table in tables])
        for join, names in ((join_names, ("ids", "image_ids")), (np.concatenate, ("xy", "sigma_px", "kind", "quality")))
        for name in names
    }
    return ImagePoints(**columns, source=tables[0].source)


def _assign_roles(surveyed: GroundPoints, gcp_ids: Sequence[str] | None, check_ids: Sequence[str] | None) -> np.ndarray:
    for option, given_ids in (("gcp_ids", gcp_ids), ("check_ids", check_ids)):
        missing = sorted(set(given_ids).difference(surveyed.ids.tolist())) if given_ids else []
        if missing:
            similar = [repr(name) for names in find_similar_ids(missing, surveyed.ids).values() for name in names]
            raise InputError(
                f"`{option}` names {list_ids(missing)}, not among the measured ground points"
                f"{f' of {surveyed.source}' if surveyed.source else ''}: correct the ids"
                f"{f'; there is {list_ids(similar)}' if similar else ''}"
            )
    pair = sorted(set(gcp_ids or ()) & set(check_ids or ()))
    if pair:
        raise InputError(f"{list_ids(pair)} is in `gcp_ids` and in `check_ids`: a point is control or check, not both")
    role = np.where(surveyed.role == UNSET, Role.GCP, surveyed.role)
    if gcp_ids:
        role = np.where(
            np.isin(surveyed.ids, list(gcp_ids)), Role.GCP, np.where(np.isin(role, UNSURVEYED), role, Role.CHECK)
        )
    if check_ids:
        role = np.where(np.isin(surveyed.ids, list(check_ids)), Role.CHECK, role)
    return np.where(any_of_rows(np.isnan(surveyed.ground)), Role.TIE, role)


def _make_points(ids: np.ndarray, surveyed: GroundPoints, role: np.ndarray, defaults: DefaultSigmas) -> GroundPoints:
    """Return one row for every measured id; ids without ground point become tie points at NaN."""
    empty = np.full((len(ids), 3, 3), np.nan) if surveyed.covariance_m2 is not None else None
    points = GroundPoints(
        ids.tolist(), np.full((len(ids), 3), np.nan), Role.TIE, source=surveyed.source, covariance_m2=empty
    )
    points = replace(points, operations=surveyed.operations)
    row = np.searchsorted(ids, surveyed.ids)
    if points.covariance_m2 is not None and surveyed.covariance_m2 is not None:
        # A covariance must be positive definite; NaN are variances that follow from default sigmas
        stated = surveyed.survey_covariance_m2()
        stated = np.where(np.isnan(stated), np.eye(3), stated)
        open_axis = np.isinf(stated.diagonal(axis1=1, axis2=2))
        finite = np.where(open_axis[:, :, None] | open_axis[:, None, :], np.eye(3), stated)
        scale = np.sqrt(np.abs(finite.diagonal(axis1=1, axis2=2)))
        with np.errstate(divide="ignore", invalid="ignore"):
            correlation = np.nan_to_num(finite / (scale[:, :, None] * scale[:, None, :]))
        invalid = surveyed.ids[~(np.linalg.eigvalsh(correlation).min(axis=1, initial=1.0) > 1e-9)]
        if len(invalid):
            raise InputError(
                f"ground point {list_ids(invalid)} has a covariance that is not positive definite: correlations "
                "must lie between -1 and 1 and agree with each other"
            )
        points.covariance_m2[row] = surveyed.covariance_m2
    points.ground[row], points.role[row], points.sigma_m[row] = surveyed.ground, role, surveyed.sigma_m
    points.operation[row] = surveyed.operation
    for column, default in enumerate((defaults.sigma_gcp_xy_m, defaults.sigma_gcp_h_m)):
        sigma = points.sigma_m[:, column]
        sigma[np.isnan(sigma)] = default
    invalid = ids[~(points.sigma_m > 0.0).all(axis=1)]
    if len(invalid):
        raise InputError(
            f"ground point {list_ids(invalid)} has a sigma that is not positive: give metres above 0, or leave it empty"
        )
    return points


def _drop_repetitions(rows: Measurements, ids: np.ndarray, warnings: list[str]) -> Measurements:
    """Drop exact duplicates of a measurement (copied rows); repeated measurements with other coordinates are kept."""
    if len(rows) < 2:
        return rows
    same_point = (rows.point[1:] == rows.point[:-1]) & (rows.image[1:] == rows.image[:-1])
    repeated = np.r_[False, same_point & np.all(rows.xy[1:] == rows.xy[:-1], axis=1)]
    if not repeated.any():
        return rows
    warnings.append(
        f"{repeated.sum()} image points occur twice and are used once: {list_ids(ids[rows.point[repeated]])}"
    )
    return rows.select(~repeated)


_APART = "\x01"  # separates ids that are normalised together; it is not whitespace, and does not occur in ids
_AT_ONCE = 50_000  # number of ids in memory together: as texts they need a hundred times the memory of the table
_DASHES = dict.fromkeys(map(ord, "‐‑‒–—―−⁃﹘﹣－"), "-")
_INVISIBLE = dict.fromkeys(map(ord, "\u00ad\u200b\u200c\u200d\u2060\ufeff"), None)
#: Differences of spelling and their replacements, applied in this order.
_SPELLINGS = (
    (r"[\s_-]+", "-"),
    (rf"(?<![^{_APART}])-|-(?![^{_APART}])", ""),  # at both ends
    (r"(?<=[^\W\d])-(?=\d)", ""),  # GCP-7, GCP 7: GCP7
    (r"(?<=\d)\.0+(?![\d.])", ""),  # 7.0: 7
    (r"(?<![\d.])0+(?=\d)", ""),  # 007: 7
)


#: All characters that the differences of spelling consist of.
_SLIGHT = dict.fromkeys([*map(ord, "-_.0"), *(code for code in range(0x3001) if chr(code).isspace())])


def normalise_spellings(ids: Iterable[str]) -> list[str]:
    """Return a normalised spelling of each id, equal for similar ids."""
    names = list(ids)
    text = _join_lower_case(names)
    for pattern, plain in _SPELLINGS:
        text = re.sub(pattern, plain, text)
    return text.split(_APART) if names else []


def _join_lower_case(ids: Iterable[str]) -> str:
    """Return all ids as one lower-case text, since a call for each of a million ids would take seconds."""
    text = _APART.join(str(name).replace(_APART, "") for name in ids)
    if not text.isascii():
        text = unicodedata.normalize("NFKC", text).translate(_DASHES | _INVISIBLE)
    return text.casefold()


def _strip_separators(ids: Iterable[str]) -> list[str]:
    """Return the ids without separators, zeros and blanks: a pre-test, ten times as fast as `normalise_spellings`."""
    return _join_lower_case(ids).translate(_SLIGHT).split(_APART)


def find_similar_ids(strangers: Iterable[str], known_ids: Iterable[str]) -> dict[str, list[str]]:
    """Return the known ids that are similar to each of ``strangers``, without those that have no similar ones."""
    by_spelling: dict[str, list[str]] = {}
    waiting = map(str, strangers)
    names = list(islice(waiting, _AT_ONCE))
    known_ids = (
        list(map(str, known_ids)) if names else []
    )  # if all ids of a large block are known, nothing is normalised
    if not known_ids:
        return {}
    for name, spelling in zip(known_ids, normalise_spellings(known_ids), strict=True):
        by_spelling.setdefault(spelling, []).append(name)
    result, bones = dict[str, list[str]](), set(_strip_separators(known_ids))
    while names:
        names = [name for name, bone in zip(names, _strip_separators(names), strict=True) if bone in bones]
        spellings = zip(names, normalise_spellings(names), strict=True)
        result |= {name: by_spelling[spelling] for name, spelling in spellings if spelling in by_spelling}
        names = list(islice(waiting, _AT_ONCE))
    return result

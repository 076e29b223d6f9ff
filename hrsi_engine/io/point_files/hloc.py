"""Matches and features of hloc (Hierarchical-Localization) in HDF5, read by GDAL.

A file of matches has a group ``NAME1/NAME2`` a pair, slashes in names replaced by hyphens, with ``matches0 (n,)``: the
number of the keypoint of the second image that each of the first image's matches, -1 for none. The keypoints stand in
the file of features, a group an image by its name, ``keypoints (n, 2)``: x, y from the CENTRE of the first pixel, as
HRSI counts (hloc adds 0.5 when it hands them to COLMAP). Dense matchers (``match_dense``) write ``keypoints0`` and
``keypoints1`` of the pair beside the matches; then no file of features is needed.

hloc calls a file of matches ``FEATURES_MATCHER_PAIRS.h5`` after ``FEATURES.h5`` beside it; another one is named by
``|features=FILE``. hloc keeps keypoints in half precision unless told otherwise: beyond 2048 px they are whole pixels,
beyond 4096 px even ones.
"""

import os

import numpy as np
from osgeo import gdal

from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.budgets import require_size
from ..opening.datasets import gdal_messages
from .matched_keypoints import KeypointMatches, table_of_matches
from .table import PointReader, PointTable

_MAGIC = b"\x89HDF\r\n\x1a\n"
_KEYPOINTS, _MATCHES = "keypoints", "matches0"


@thresholds
class HLOC:
    """What a file of hloc may claim to hold."""

    numbers: float = threshold(1e8, "values", "most numbers of an array")
    groups: int = threshold(10_000_000, "groups", "most groups of a file")


def read(path: str, features: str = "") -> PointTable:
    """Return two rows a match; ``features`` names the file of keypoints, by default the one that hloc's names tell."""
    pairs = {name: group for name, group in _list_groups(path) if _has_item(group, _MATCHES)}
    if not pairs:
        raise InputError(
            f"{path}: holds no matches of hloc (groups NAME1/NAME2 with {_MATCHES!r}): name the file of matches, and "
            "that of the features as FILE|features=FILE"
        )
    known = {} if all(_has_item(group, "keypoints0") for group in pairs.values()) else _find_features(path, features)
    return table_of_matches(path, [_read_pair(path, name, group, known) for name, group in pairs.items()])


def _read_pair(path: str, name: str, group: gdal.Group, known: dict[str, tuple[str, gdal.Group]]) -> KeypointMatches:
    """Return the matches of a group ``NAME1/NAME2``."""
    first, _, second = name.partition("/")
    other = _read_array(path, group, _MATCHES).ravel().astype(np.int64)
    here = np.flatnonzero(other >= 0)
    rows = np.column_stack([here, other[here]])
    if _has_item(group, "keypoints0") and _has_item(group, "keypoints1"):
        return KeypointMatches(
            first, second, _read_positions(path, group, "keypoints0"), _read_positions(path, group, "keypoints1"), rows
        )
    for image in (first, second):
        if image not in known:
            raise InputError(f"{path}: matches image {image}, of which there are no features: name their file "
                             "as FILE|features=FILE")  # fmt: skip
    (one, features_one), (two, features_two) = known[first], known[second]
    return KeypointMatches(
        one, two, _read_positions(path, features_one, _KEYPOINTS), _read_positions(path, features_two, _KEYPOINTS), rows
    )


def _find_features(path: str, features: str) -> dict[str, tuple[str, gdal.Group]]:
    """Return images' names and groups by the name that pairs have for them."""
    file = features or _features_beside(path)
    found = {name.replace("/", "-"): (name, at) for name, at in _list_groups(file) if _has_item(at, _KEYPOINTS)}
    if not found:
        raise InputError(f"{file}: holds no features of hloc (groups with {_KEYPOINTS!r}): name another file")
    return found


def _features_beside(path: str) -> str:
    """Return the file of features that a file of matches is named after: the longest name that its own begins with."""
    folder, name = os.path.split(path)
    others = [other for other in os.listdir(folder or ".") if other.endswith(".h5") and other != name]
    fitting = [other for other in others if name.startswith(f"{other[: -len('.h5')]}_")]
    if not fitting:
        raise InputError(f"{path}: the file of its features is not beside it: name it as {name}|features=FILE")
    return os.path.join(folder, max(fitting, key=len))


def _list_groups(path: str) -> list[tuple[str, gdal.Group]]:
    """Return all groups of an HDF5 file with their names; raise `InputError` where it cannot be read."""
    if not os.path.isfile(path):
        raise InputError(f"{path}: no such file: check the path")
    require_size(path, "matches")
    if gdal.GetDriverByName("HDF5") is None:
        raise InputError(f"{path}: this GDAL reads no HDF5: install its HDF5 driver, or write the matches as text")
    groups: list[tuple[str, gdal.Group]] = []
    with gdal_messages() as messages:
        dataset = gdal.OpenEx(path, gdal.OF_MULTIDIM_RASTER, allowed_drivers=["HDF5"])
        waiting = [] if dataset is None else [("", dataset.GetRootGroup())]
        while waiting:
            name, group = waiting.pop()
            if group is None or len(groups) > HLOC.groups:
                groups = []
                break
            groups.append((name, group))
            inner = group.GetGroupNames() or ()
            waiting += [(f"{name}/{part}".lstrip("/"), group.OpenGroup(part)) for part in reversed(inner)]
    if not groups:
        said = messages[0] if messages else "no sound HDF5 file"
        raise InputError(f"{path}: cannot be read ({said}): get the file again")
    return groups


def _has_item(group: gdal.Group, name: str) -> bool:
    return name in (group.GetMDArrayNames() or ())


def _read_positions(path: str, group: gdal.Group, name: str) -> np.ndarray:
    """Return keypoints ``(n, 2)``, float64."""
    values = _read_array(path, group, name)
    if values.ndim != 2 or values.shape[1] < 2:
        raise InputError(f"{path}: {name!r} is {values.shape}, not (n, 2): get the file again")
    return values[:, :2].astype(np.float64)


def _read_array(path: str, group: gdal.Group, name: str) -> np.ndarray:
    """Return the numbers of an array of a group."""
    values: np.ndarray | None = None
    with gdal_messages() as messages:
        array = group.OpenMDArray(name)
        sizes = [dimension.GetSize() for dimension in array.GetDimensions()]
        if 0 in sizes:
            return np.zeros(sizes)
        if np.prod(sizes, dtype=float) > HLOC.numbers:
            raise InputError(f"{path}: {name!r} claims {sizes} numbers, more than any image has: get the file again")
        values = array.ReadAsArray()
    if values is None or values.dtype.kind not in "iuf":
        raise InputError(f"{path}: {name!r} cannot be read ({'; '.join(messages) or 'no numbers'}): get the file again")
    return values


READER = PointReader("hloc matches", lambda _path, _name, head: head.startswith(_MAGIC), read)

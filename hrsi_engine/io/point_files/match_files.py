"""Matches and tie points in the formats of other programs: two rows for each match, one in each image.

* ``PREFIX-IMAGE1__IMAGE2.match`` of the Ames Stereo Pipeline, little-endian: the numbers of interest points of both
  images (uint64), then their records, the first image first: x, y (float32, from the centre of the first pixel), their
  integer parts (int32), orientation, scale, interest (float32), polarity (1 byte), octave, level (uint32), length of
  the descriptor (uint64), descriptor (float32). The k-th records of both images match. As plain text,
  ``PREFIX-IMAGE1__IMAGE2.txt``, which external matchers write too: six numbers a match, x, y and uncertainty in the
  first image, then in the second. The uncertainties are scales of the detector or 1, not standard deviations, and are
  not used.
* The database of COLMAP (SQLite, https://colmap.github.io/database.html): tables ``images`` (image_id, name),
  ``keypoints`` (image_id, rows, cols, data: float32, x and y first) and ``two_view_geometries``, the matches that
  COLMAP verified, or, where there are none, ``matches`` (pair_id, rows, cols, data: uint32 pairs of keypoint numbers
  from 0). ``pair_id`` is 2147483647 times the smaller image_id plus the larger. Pixel coordinates refer to the corner,
  the centre of the upper left pixel is (0.5, 0.5): 0.5 is subtracted.
* HDF5 of hloc (Hierarchical-Localization), read by GDAL. A file of matches has a group ``NAME1/NAME2`` for each pair,
with slashes in names replaced by hyphens, and in it ``matches0 (n,)``: for each keypoint of the first image the number
of its match in the second, -1 for none. The keypoints are in the file of features, one group per image by its name,
  ``keypoints (n, 2)``: x, y from the CENTRE of the first pixel, as in HRSI (hloc adds 0.5 when it passes them to
  COLMAP). Dense matchers (``match_dense``) write ``keypoints0`` and ``keypoints1`` of the pair with the matches; then
  no file of features is needed. hloc names a file of matches ``FEATURES_MATCHER_PAIRS.h5`` after ``FEATURES.h5`` in
  the same folder; ``|features=FILE`` names another one. By default hloc stores keypoints as float16: beyond 2048 px
  they are integers, beyond 4096 px even ones.
* Matches of sat-bundleadjust: a folder with ``matches.npy (n, 4)``, numbers of the keypoints in two images and of
  these images in ``filenames.txt``, and ``keypoints/ID.npy`` or ``features/ID.npy`` for each image, x and y first, from
  the CENTRE of the first pixel. Its adjusted RPCs, ``ID.rpc_adj``, are RPC texts.

Tie points of MicMac: one file for each image (MMVII), or a folder with one file for each pair (``Homol``).

* ``PMUL-IMAGE.csv`` with the fields Pt.x, Pt.y, Id. The same Id in other images is the same point.
* ``Homol…/PastisIMAGE1/IMAGE2.dat`` or ``.txt`` (Tapioca, ``ElPackHomologue``). Text: x and y in the first image, then
  in the second, and a weight, one match in each line. Binary: 2 and the number of matches (int32), then for each 2
  (int32), its weight and four coordinates (float64), in the byte order of the machine. Most pairs are written twice,
  once for each first image; matches are read once. The weights are 1 or those of a filter, and are not used.

Pixel coordinates refer to the corner of the first pixel, as everywhere in MicMac, and MMVII uses those of ``Homol``
unchanged: 0.5 is subtracted. (micmacIGN/micmac: ``ElPackHomologue``, ``cMMVII_Implem_V1ImportHom``.)
"""

import glob
import os
import re
import struct
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from osgeo import gdal

from ...foundation.errors import InputError
from ...foundation.thresholds import MEMORY
from ..opening.databases import require_sound, sound_database
from ..opening.files import read_bytes, require_size
from ..opening.hdf5 import HDF5_HEAD, open_hdf5, read_array
from . import csv_text
from .table import PointReader, PointTable

#: Names of two images, and the positions of their matches ``(2 k, 2)``, those in the first image first.
_Matches = tuple[str, str, np.ndarray]


def tabulate_matches(path: str, pairs: Sequence[_Matches], field_names: tuple[str, ...]) -> PointTable:
    """Return two rows for each match of pairs ``(image, image, positions)``, those in the first image first."""
    counts = [len(xy) // 2 for _, _, xy in pairs]
    numbers = [np.arange(count).astype(str) for count in counts]
    ids = [np.char.add(f"{first}__{second}:", n) for (first, second, _), n in zip(pairs, numbers, strict=True)]
    xy = np.concatenate([xy for _, _, xy in pairs])
    columns = {
        "id": np.concatenate([np.tile(pair_ids, 2) for pair_ids in ids]),
        "image": np.concatenate([np.repeat(pair[:2], count) for pair, count in zip(pairs, counts, strict=True)]),
        "sample": xy[:, 0],
        "line": xy[:, 1],
    }
    match = np.concatenate([np.tile(np.arange(count) + 1, 2) for count in counts])
    return PointTable(path, columns, field_names, lambda row: f"match {match[row]}", pairwise=True)


def _match_keypoints(
    path: str, names: tuple[str, str], keypoints: tuple[np.ndarray, np.ndarray], rows: np.ndarray
) -> _Matches:
    """Return the matches of two images by keypoint numbers ``(k, 2)``; raise `InputError` for an invalid number."""
    (first, second), (first_xy, second_xy) = names, keypoints
    counts = len(first_xy), len(second_xy)
    if len(rows) and ((rows < 0) | (rows >= counts)).any():
        raise InputError(
            f"{path}: matches of {first} and {second} point at keypoints that are not there "
            f"({counts[0]} and {counts[1]} are): name the keypoints that these matches were made of"
        )
    xy = np.concatenate([first_xy[rows[:, 0]], second_xy[rows[:, 1]]])
    if not np.isfinite(xy).all():
        raise InputError(f"{path}: keypoints of {first} or {second} are no numbers: obtain the file again")
    return first, second, xy


# ---- Ames Stereo Pipeline ------------------------------------------------------------------------------------------

_COUNTS, _RECORD = struct.Struct("<QQ"), struct.Struct("<ffiifffBIIQ")
_PAIR_NAME = re.compile(r"(.+)__(.+?)(-clean)?\.(match|txt)$", re.IGNORECASE)
_NUMBERS = 6  # numbers in a line of a text file


def read_asp_matches(path: str, _layer: str = "") -> PointTable:
    """Return two rows for each match; raise `InputError` if the file is damaged or its name has no images."""
    names = _PAIR_NAME.match(os.path.basename(path))
    if names is None:
        raise InputError(f"{path}: its name does not contain the images: rename it to PREFIX-IMAGE1__IMAGE2.match")
    parse = _parse_records if path.lower().endswith(".match") else _parse_text
    return tabulate_matches(path, [(names[1], names[2], parse(path, read_bytes(path, "matches")))], ("x", "y"))


def _parse_text(path: str, content: bytes) -> np.ndarray:
    """Return x and y ``(2 k, 2)`` of a text file, those in the first image first."""
    rows = [line.split() for line in content.decode("latin-1").splitlines() if line.strip() and line.lstrip()[0] != "#"]
    try:
        numbers = np.array([[float(text) for text in row] for row in rows]).reshape(-1, _NUMBERS)
    except ValueError:
        numbers = np.full((1, _NUMBERS), np.nan)
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: a match is six numbers a line, x, y and uncertainty in both images: obtain it again")
    return np.concatenate([numbers[:, 0:2], numbers[:, 3:5]])


def _parse_records(path: str, content: bytes) -> np.ndarray:
    """Return x and y of all records ``(2 k, 2)`` of a binary file."""
    try:
        first, second = _COUNTS.unpack_from(content)
        if first != second or _COUNTS.size + 2 * first * _RECORD.size > len(content):
            raise ValueError(f"it declares {first} and {second} interest points")
        xy, offset = np.empty((2 * first, 2)), _COUNTS.size
        for row in range(2 * first):
            record = _RECORD.unpack_from(content, offset)
            xy[row] = record[:2]
            offset += _RECORD.size + 4 * record[-1]
        if offset != len(content):
            raise ValueError(f"{len(content)} bytes instead of {offset}")
    except (struct.error, ValueError, OverflowError) as error:
        raise InputError(f"{path}: is no complete match file ({error}): obtain it again") from None
    if not np.isfinite(xy).all():
        raise InputError(f"{path}: contains positions that are no numbers: obtain it again")
    return xy


def _is_text(_path: str, name: str, head: bytes) -> bool:
    lines = [line for line in head.splitlines() if line.strip() and not line.lstrip().startswith(b"#")]
    if not (name.endswith(".txt") and _PAIR_NAME.match(name) and lines):
        return False
    try:
        return len([float(text) for text in lines[0].split()]) == _NUMBERS
    except ValueError:
        return False


ASP_MATCHES = PointReader(
    "Ames Stereo Pipeline matches", lambda _path, name, _head: name.endswith(".match"), read_asp_matches
)
ASP_TEXT_MATCHES = PointReader("Ames Stereo Pipeline matches as text", _is_text, read_asp_matches)

# ---- COLMAP --------------------------------------------------------------------------------------------------------

_MATCHED = "SELECT pair_id, rows, cols, data FROM matches WHERE rows > 0"
_VERIFIED = "SELECT pair_id, rows, cols, data FROM two_view_geometries WHERE rows > 0"


def read_colmap(path: str, _layer: str = "") -> PointTable:
    """Return two rows for each match; raise `InputError` if the database is damaged or contains no matches."""
    require_size(path, "matches")
    require_sound(path)
    with sound_database(path) as database:
        tables = {str(name) for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        missing = {"images", "keypoints", "matches"} - tables
        if missing:
            raise InputError(f"{path}: is no database of COLMAP, it has no table {min(missing)!r}: name another file")
        names = {int(number): str(name) for number, name in database.execute("SELECT image_id, name FROM images")}
        stored = database.execute("SELECT image_id, rows, cols, data FROM keypoints").fetchall()
        verified = database.execute(_VERIFIED).fetchall() if "two_view_geometries" in tables else []
        pairs = verified or database.execute(_MATCHED).fetchall()
    if not pairs:
        raise InputError(f"{path}: contains no matches: run a matcher of COLMAP first")
    keypoints = {
        int(number): _parse_blob(path, "keypoints", data, rows, cols, "<f4")[:, :2].astype(np.float64) - 0.5
        for number, rows, cols, data in stored
    }
    result: list[_Matches] = []
    for pair_id, rows, cols, data in pairs:
        first, second = divmod(int(pair_id), 2147483647)
        for number in (first, second):
            if number not in names or number not in keypoints:
                raise InputError(f"{path}: has matches of image {number} and no keypoints of it: obtain the file again")
        index = _parse_blob(path, "matches", data, rows, cols, "<u4")[:, :2].astype(np.int64)
        between = (names[first], names[second]), (keypoints[first], keypoints[second])
        result.append(_match_keypoints(path, *between, index))
    return tabulate_matches(path, result, ("keypoints", "matches"))


def _parse_blob(path: str, table: str, data: object, rows: object, cols: object, dtype: str) -> np.ndarray:
    """Return a blob as an array ``(rows, cols)``; raise `InputError` if its size differs."""
    content = data if isinstance(data, bytes) else b""
    is_valid = isinstance(rows, int) and isinstance(cols, int) and rows >= 0 and cols >= 2
    if not is_valid or len(content) != rows * cols * np.dtype(dtype).itemsize:  # type: ignore[operator]
        raise InputError(f"{path}: a row of {table!r} has {len(content)} bytes for {rows} x {cols}: obtain it again")
    return np.frombuffer(content, dtype).reshape(rows, cols)  # type: ignore[call-overload]


COLMAP_DATABASE = PointReader(
    "COLMAP database",
    lambda _path, name, head: (
        head.startswith(b"SQLite format 3\0") and (name.endswith(".db") or b"two_view_geometries" in head)
    ),  # its table definitions are on the first page
    read_colmap,
)

# ---- hloc ----------------------------------------------------------------------------------------------------------

_MATCHES = "matches0"


def read_hloc(path: str, features: str = "") -> PointTable:
    """Return two rows for each match; ``features`` is the file of keypoints, by default found by hloc's file names."""
    pairs = {name: group for name, group in _list_groups(path) if _has_item(group, _MATCHES)}
    if not pairs:
        raise InputError(
            f"{path}: contains no matches of hloc (groups NAME1/NAME2 with {_MATCHES!r}): name the file of matches, "
            "and that of the features as FILE|features=FILE"
        )
    features_by_image = (
        {} if all(_has_item(group, "keypoints0") for group in pairs.values()) else _find_features(path, features)
    )
    result = [_read_pair(path, name, group, features_by_image) for name, group in pairs.items()]
    return tabulate_matches(path, result, ("keypoints", "matches"))


def _read_pair(
    path: str, name: str, group: gdal.Group, features_by_image: dict[str, tuple[str, gdal.Group]]
) -> _Matches:
    """Return the matches of a group ``NAME1/NAME2``."""
    first, _, second = name.partition("/")
    partner = np.asarray(read_array(path, group, _MATCHES)).ravel().astype(np.int64)
    indices = np.flatnonzero(partner >= 0)
    rows = np.column_stack([indices, partner[indices]])
    if _has_item(group, "keypoints0") and _has_item(group, "keypoints1"):
        positions = _read_positions(path, group, "keypoints0"), _read_positions(path, group, "keypoints1")
        return _match_keypoints(path, (first, second), positions, rows)
    for image in (first, second):
        if image not in features_by_image:
            raise InputError(
                f"{path}: matches image {image}, of which there are no features: name their file as FILE|features=FILE"
            )
    (one, of_one), (two, of_two) = features_by_image[first], features_by_image[second]
    keypoints = _read_positions(path, of_one, "keypoints"), _read_positions(path, of_two, "keypoints")
    return _match_keypoints(path, (one, two), keypoints, rows)


def _find_features(path: str, features: str) -> dict[str, tuple[str, gdal.Group]]:
    """Return names and groups of images, by the names that pairs use for them.

    The file is ``features``, or else the one whose name the file of matches begins with; of several, the longest.
    """
    if not features:
        folder, name = os.path.split(path)
        files = [second for second in os.listdir(folder or ".") if second.endswith(".h5") and second != name]
        fitting = [second for second in files if name.startswith(f"{second.removesuffix('.h5')}_")]
        if not fitting:
            raise InputError(
                f"{path}: the file of its features is not in the same folder: name it as {name}|features=FILE"
            )
        features = os.path.join(folder, max(fitting, key=len))
    result = {
        name.replace("/", "-"): (name, group) for name, group in _list_groups(features) if _has_item(group, "keypoints")
    }
    if not result:
        raise InputError(f"{features}: contains no features of hloc (groups with 'keypoints'): name another file")
    return result


def _list_groups(path: str) -> list[tuple[str, gdal.Group]]:
    """Return all groups of an HDF5 file with their names; raise `InputError` if it cannot be read."""
    require_size(path, "matches")
    groups: list[tuple[str, gdal.Group]] = []
    waiting = [("", open_hdf5(path))]
    while waiting:
        name, group = waiting.pop()
        if group is None or len(groups) > MEMORY.values:
            raise InputError(f"{path}: its groups cannot be read: obtain the file again")
        groups.append((name, group))
        inner = reversed(group.GetGroupNames() or ())
        waiting += [(f"{name}/{part}".lstrip("/"), group.OpenGroup(part)) for part in inner]
    return groups


def _has_item(group: gdal.Group, name: str) -> bool:
    return name in (group.GetMDArrayNames() or ())


def _read_positions(path: str, group: gdal.Group, name: str) -> np.ndarray:
    """Return keypoints ``(n, 2)``, float64."""
    values = read_array(path, group, name)
    if values is None or values.ndim != 2 or values.shape[1] < 2:
        raise InputError(f"{path}: {name!r} is no array (n, 2): obtain the file again")
    return values[:, :2].astype(np.float64)


HLOC_MATCHES = PointReader("hloc matches", lambda _path, _name, head: head.startswith(HDF5_HEAD), read_hloc)

# ---- sat-bundleadjust ----------------------------------------------------------------------------------------------


def read_sat_bundleadjust(path: str, _layer: str = "") -> PointTable:
    """Return two rows for each match of ``matches.npy``; raise `InputError` if it or one of its files is damaged."""
    folder = os.path.dirname(path)
    with open(os.path.join(folder, _FILENAMES), encoding="utf-8") as file:
        ids = [os.path.splitext(os.path.basename(line.strip()))[0] for line in file if line.strip()]
    table = _load_npy(path, 4).astype(np.int64)
    if len(table) and not ((table[:, 2:] >= 0) & (table[:, 2:] < len(ids))).all():
        raise InputError(f"{path}: names images that {_FILENAMES} does not list: get the files again")
    keypoints = {}
    for row in np.unique(table[:, 2:]).tolist():
        places = [os.path.join(folder, part, f"{ids[row]}.npy") for part in ("keypoints", "features")]
        result = next((place for place in places if os.path.isfile(place)), places[0])
        keypoints[row] = _load_npy(result, 2)[:, :2].astype(np.float64)
    pairs = []
    for one, two in np.unique(table[:, 2:], axis=0).tolist():
        rows = table[(table[:, 2] == one) & (table[:, 3] == two), :2]
        pairs.append(_match_keypoints(path, (ids[one], ids[two]), (keypoints[one], keypoints[two]), rows))
    return tabulate_matches(path, pairs, ("x", "y"))


def _load_npy(path: str, columns: int) -> np.ndarray:
    """Return an array of numbers with at least ``columns`` columns from a file of NumPy's format."""
    try:
        require_size(path, "matches")
        result = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: cannot be read ({error}): obtain the file again") from None
    if result.ndim != 2 or result.shape[1] < columns or result.dtype.kind not in "iuf":
        raise InputError(f"{path}: is no table of {columns} columns of numbers or more: obtain the file again")
    return np.asarray(result)


_FILENAMES = "filenames.txt"
SAT_BUNDLEADJUST = PointReader(
    "sat-bundleadjust matches",
    lambda path, name, _head: name == "matches.npy" and os.path.isfile(os.path.join(os.path.dirname(path), _FILENAMES)),
    read_sat_bundleadjust,
)


def read_micmac(path: str, _layer: str = "") -> PointTable:
    """Return the tie points of one image, which is identified by the file's name."""
    table = csv_text.read(path, chosen={"sample": "Pt.x", "line": "Pt.y"})
    columns = table.columns | {axis: table.columns[axis] - 0.5 for axis in table.columns.keys() & {"sample", "line"}}
    name = os.path.basename(path)
    if name.lower().startswith("pmul-"):
        columns["image"] = np.full(len(table), name[len("pmul-") : -len(".csv")])
    return replace(table, columns=columns)


def _is_micmac(_path: str, name: str, head: bytes) -> bool:
    begin = head.lstrip(b"\xef\xbb\xbf").lower()
    return name.endswith(".csv") and begin.startswith((b"pt.x,pt.y", b"pt.x;pt.y"))


MICMAC_TIE_POINTS = PointReader("MicMac tie points", _is_micmac, read_micmac)

# ---- Homol ---------------------------------------------------------------------------------------------------------

_FOLDER = "Pastis"
_ORDERS = {(2).to_bytes(4, "little"): "<", (2).to_bytes(4, "big"): ">"}  # the first number of a binary file


def read_homol(path: str, _layer: str = "") -> PointTable:
    """Return two rows for each match of a folder or of one of its files; raise `InputError` if a file is damaged."""
    pairs: dict[tuple[str, str], dict[tuple[float, ...], None]] = {}
    for file in _list_homol(path) if os.path.isdir(path) else [path]:
        first, second = os.path.basename(os.path.dirname(os.path.abspath(file))), os.path.basename(file)[: -len(".dat")]
        first, rows = first[len(_FOLDER) :], _parse_homol(file)
        if second < first:
            first, second, rows = second, first, np.roll(rows, 2, axis=1)
        pairs.setdefault((first, second), {}).update(dict.fromkeys(map(tuple, rows.tolist())))
    result = [
        (*names, np.array([row[:2] for row in rows] + [row[2:] for row in rows]).reshape(-1, 2) - 0.5)
        for names, rows in pairs.items()
    ]
    return tabulate_matches(path, result, ("x", "y"))


def _list_homol(path: str) -> list[str]:
    """Return the files of a folder of matches; for a pair with both formats, the binary one."""
    files = {ending: glob.glob(f"{glob.escape(path)}/{_FOLDER}*/*{ending}") for ending in (".dat", ".txt")}
    return sorted({file[: -len(".dat")]: file for file in files[".txt"] + files[".dat"]}.values())


def _parse_homol(path: str) -> np.ndarray:
    """Return x and y in both images ``(k, 4)``, as the file has them."""
    content = read_bytes(path, "matches")
    order = _ORDERS.get(content[:4])
    try:
        if order is None:
            lines = [line.split() for line in content.decode("ascii").splitlines() if line.strip()]
            rows = np.array([[float(text) for text in line[:4]] for line in lines]).reshape(-1, 4)
        else:
            record = np.dtype([("dimension", f"{order}i4"), ("weight", f"{order}f8"), ("xy", f"{order}f8", 4)])
            records = np.frombuffer(content, record, offset=8)
            rows = records["xy"].astype(np.float64)
            if len(rows) != np.frombuffer(content, f"{order}i4", 1, 4)[0] or (records["dimension"] != 2).any():
                raise ValueError("the number of its matches is another one")
        if not np.isfinite(rows).all():
            raise ValueError("positions are no numbers")
    except ValueError as error:
        raise InputError(f"{path}: is no complete file of MicMac's matches ({error}): obtain it again") from None
    return rows


def _is_homol(path: str, name: str, head: bytes) -> bool:
    if os.path.isdir(path):
        return bool(_list_homol(path))
    if not os.path.basename(os.path.dirname(os.path.abspath(path))).startswith(_FOLDER):
        return False
    return (name.endswith(".dat") and head[:4] in _ORDERS) or name.endswith(".txt")


MICMAC_HOMOL = PointReader("MicMac Homol folder", _is_homol, read_homol)

"""What the columns of a text table mean, by their contents: for files whose header, if any, names no fields of points.

Neighbouring columns are a position if they lie on the ground of the images in one of the likely CRSs. A pair is
a measurement in an image if it agrees with the projections of known ground points, except for a common shift, which is
the error of the RPC. Without known ground points, names of columns and files identify the image, and sample and line
have the order in which the rays of the images differ less.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations, product

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.columns import NameColumn
from ...hrsi_engine.foundation.robust_scale import robust_sigma
from ...hrsi_engine.foundation.thresholds import EQUALITY, SAMPLES
from ...hrsi_engine.ground.geodesy import ground_difference_m, metres_per_degree
from ...hrsi_engine.ground.map_crs import LOCAL_CRS
from ...hrsi_engine.io.geopackage.layer_tables import layer_names, text_columns
from ...hrsi_engine.io.point_files import PointTables
from ...hrsi_engine.io.point_files.csv_text import ENDINGS, count_header_rows, parse_field, read_lines, split_rows
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.point_files.interpret import matching_names
from ...hrsi_engine.io.point_files.table import match_fields

SPREADSHEETS = (".xlsx", ".ods")
UNUSED = "-"  #: name of a column that is not read
POSITION_NAMES = (("lon", "lat"), ("lat", "lon"), ("x", "y"), ("y", "x"))  #: meanings of two neighbouring columns
LINE_NAMES = re.compile(r"line|lig|row|zeile|y|fila|reng", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class TextTable:
    """First rows of a table: names of its columns ('' without header), texts by column, numbers (rows, columns)."""

    names: tuple[str, ...]
    columns: tuple[tuple[str, ...], ...]
    numbers: np.ndarray

    @property
    def numeric(self) -> list[int]:
        """Columns that contain only numbers."""
        return np.flatnonzero(np.isfinite(self.numbers).all(axis=0)).tolist()

    @property
    def id_column(self) -> int | None:
        """The column of ids: named so, else the first column with texts or whole numbers that are not repeated."""
        named = match_fields(self.names).get("id")
        whole = [k for k in range(len(self.columns)) if not (np.mod(self.numbers[:, k], 1.0) > 0.0).any()]
        unique = (k for k in whole if len(set(self.columns[k])) == len(self.columns[k]))
        return next(unique, whole[0] if whole else None) if named is None else named


def is_text(path: str) -> bool:
    """Return whether a file is a text table by its name."""
    return path.lower().removesuffix(".gz").endswith(ENDINGS)


def read_text_table(path: str) -> TextTable | None:
    """Return the first rows of a text, or of the one sheet of a spreadsheet; None if it has no rows of equal length."""
    if path.lower().endswith(SPREADSHEETS):
        sheets = [name for name, rows in layer_names(path).items() if rows]
        names = read_table(path).field_names if len(sheets) == 1 else ()
        columns = tuple(map(tuple, text_columns(path, sheets[0], names).values())) if len(names) > 2 else ()
        return _make_text_table(names, list(zip(*columns, strict=True)), ",") if columns else None
    lines = read_lines(path, SAMPLES.large)
    if len(lines) > 1 and lines[0].isdigit():  # the number of points
        lines = lines[1:]
    separator, rows = split_rows(lines)
    titles = count_header_rows(rows, separator)
    names = tuple(rows[titles - 1]) if titles else ("",) * (len(rows[0]) if rows else 0)
    rows = rows[titles:]
    if len(names) < 3 or not rows or any(len(row) != len(names) for row in rows):
        return None
    return _make_text_table(names, rows, separator)


def _make_text_table(names: tuple[str, ...], rows: Sequence[Sequence[str]], separator: str | None) -> TextTable:
    numbers = [[np.nan if (value := parse_field(text, separator)) is None else value for text in row] for row in rows]
    return TextTable(names, tuple(zip(*rows, strict=True)), np.array(numbers))


def name_columns(path: str, table: TextTable, roles: Sequence[str]) -> str:
    """Return the text that reads a file with its columns named by their roles; columns of spreadsheets have names."""
    if path.lower().endswith(SPREADSHEETS):
        roles = [f"{role}={name}" for role, name in zip(roles, table.names, strict=True) if role != UNUSED]
    return f"{path}|columns={','.join(roles)}"


# ---- ground positions -----------------------------------------------------------------------------------------------


def share_near(lonlat: np.ndarray, region: np.ndarray) -> float:
    """Return the share of positions ``(n, 2)`` near the ground of the images, ``region`` (2, 2) lowest and highest."""
    margin_deg = LOCAL_CRS.margin_m / metres_per_degree(np.append(region.mean(axis=0), 0.0)[None])[0, :2]
    near = (lonlat > region[0] - margin_deg) & (lonlat < region[1] + margin_deg)
    inside = (lonlat > region[0]) & (lonlat < region[1])
    return float(near.all(axis=1).mean() + inside.all(axis=1).mean()) / 2.0 if len(lonlat) else 0.0


def list_ground_columns(table: TextTable) -> Iterator[list[str]]:
    """Yield names of the columns in which neighbours are a position, with the height next to them and without."""
    name, numeric = table.id_column, [k for k in table.numeric if k != table.id_column]
    for first, second in pairwise(numeric):
        for axes in POSITION_NAMES:
            for height in (*(k for k in (second + 1, first - 1) if k in numeric), None):
                roles = {first: axes[0], second: axes[1], height: "height", name: "id"}
                yield [roles.get(k, UNUSED) for k in range(len(table.names))]


# ---- measurements ---------------------------------------------------------------------------------------------------


def match_image(name: str, image_ids: Sequence[str]) -> str | None:
    """Return the id of the image that a file or column name names: the id itself, or words that no other id has."""
    text = name.lower()
    whole = [one for one in image_ids if one.lower() in text or (len(text) > 2 and text in one.lower())]
    if len(whole) == 1:
        return whole[0]
    words = {one: set(re.split(r"[^a-z0-9]+", one.lower())) for one in image_ids}
    named = set(re.split(r"[^a-z0-9]+", text))
    others = {one: set().union(*(words[two] for two in image_ids if two != one)) for one in image_ids}
    own = [one for one in image_ids if (words[one] - others[one]) & named]
    return own[0] if len(own) == 1 else None


@dataclass(frozen=True)
class ImageColumns:
    """Columns with the measurements in an image; ``scatter_px`` of their differences from known points, or NaN."""

    image: str
    sample: int
    line: int
    scatter_px: float = np.nan

    def roles(self, table: TextTable) -> list[str]:
        """Return the names of all columns, for reading these."""
        roles = {table.id_column or 0: "id", self.sample: "sample", self.line: "line"}
        return [roles.get(k, UNUSED) for k in range(len(table.names))]


def find_image_columns(
    table: TextTable, path: str, images: Mapping[str, Image], known: Mapping[str, np.ndarray]
) -> list[ImageColumns]:
    """Return the columns of each image that is measured in a table with one row for each point; empty if unknown.

    ``known`` has positions (3,) of ground points by id.
    """
    name = table.id_column
    if name is None or len(set(table.columns[name])) < len(table.columns[name]):
        return []
    columns = [k for k in range(len(table.names)) if k != name and np.isfinite(table.numbers[:, k]).any()]
    half = len(columns) // 2
    layouts = [list(zip(columns[k::2], columns[k + 1 :: 2], strict=False)) for k in (0, 1)]
    layouts.append([(columns[k], columns[half + k]) for k in range(half)])
    by_name = _name_columns(table, path, images, layouts)
    if len(by_name) > 1:
        return by_name
    ids = np.array(table.columns[name])
    rows = np.flatnonzero([one in known for one in ids])
    if len(rows) < SAMPLES.plane:
        return by_name
    ground = np.array([known[one] for one in ids[rows]])
    fits = [_assign_columns(table.numbers[rows], ground, layout, images) for layout in layouts]
    return max(fits, key=lambda one: (len(one), -sum(fit.scatter_px for fit in one)))


def find_measurement_columns(
    table: TextTable, images: Mapping[str, Image], known: Mapping[str, np.ndarray]
) -> list[str] | None:
    """Return the names of the columns of a table with one row for each measurement, and the image in a column.

    Sample and line are the neighbouring columns that agree best with known ground points; without these, with names
    and with each other. None if no column names images, or no other one points.
    """
    columns = range(len(table.names))
    places = {k: place_images(table.columns[k], list(images)) for k in columns}
    image = next((k for k in columns if np.mean(places[k] >= 0) >= EQUALITY.majority), None)
    if image is None:
        return None
    whole = [k for k in columns if k != image and not (np.mod(table.numbers[:, k], 1.0) > 0.0).any()]
    distinct = (k for k in whole if len({*zip(table.columns[k], places[image], strict=True)}) == len(table.numbers))
    name = next(distinct, None)
    pairs = [(k, k + 1) for k in table.numeric if k + 1 in table.numeric and not {k, k + 1} & {image, name}]
    if name is None or not pairs:
        return None
    rated = [
        (_rate_pair(table, pair, name, places[image], images, known), pair)
        for first, second in pairs
        for pair in ((first, second), (second, first))
    ]
    cost, (sample, line) = min(rated)
    roles = {image: "image", name: "id", sample: "sample", line: "line"}
    return [roles.get(k, UNUSED) for k in columns] if np.isfinite(cost) else None


def _rate_pair(
    table: TextTable,
    pair: tuple[int, int],
    name: int,
    places: np.ndarray,
    images: Mapping[str, Image],
    known: Mapping[str, np.ndarray],
) -> float:
    """Return how badly two columns are sample and line: px from known points, else m between images; inf if never."""
    ids, row = np.unique(table.columns[name], return_inverse=True)
    measured = {number: one for number, one in enumerate(images) if (places == number).any()}
    wide = np.full((len(ids), 2 * len(measured)), np.nan)  # a row for each point, as other tables have them
    for k, number in enumerate(measured):
        rows = places == number
        wide[row[rows], 2 * k : 2 * k + 2] = table.numbers[rows][:, pair]
    order = [ImageColumns(one, 2 * k, 2 * k + 1) for k, one in enumerate(measured.values())]
    surveyed = np.flatnonzero([one in known for one in ids])
    if len(surveyed) < SAMPLES.plane:
        return _disagreement_m(wide, order, images) + (LINE_NAMES.match(table.names[pair[0]]) is not None)
    ground = np.array([known[one] for one in ids[surveyed]])
    scatter = [
        fit.scatter_px
        for one in order
        for fit in _fit_columns(wide[surveyed], ground, [(one.sample, one.line)], {one.image: images[one.image]})
        if fit.sample < fit.line
    ]
    return float(np.mean(scatter)) if scatter else np.inf


def place_images(texts: Sequence[str], image_ids: Sequence[str]) -> np.ndarray:
    """Return the place of the image that each text names in a list of ids, -1 for others."""
    unique, row = np.unique(texts, return_inverse=True)
    ids = matching_names(NameColumn(unique, np.arange(len(unique), dtype=np.int32)), image_ids)
    places = [image_ids.index(one) if one in image_ids else -1 for one in np.asarray(ids).tolist()]
    return np.array(places)[row]


def _assign_columns(
    numbers: np.ndarray, ground: np.ndarray, pairs: Sequence[tuple[int, int]], images: Mapping[str, Image]
) -> list[ImageColumns]:
    """Return the pairs of columns that fit images best, each pair and each image once."""
    chosen: dict[str, ImageColumns] = {}
    for fit in sorted(_fit_columns(numbers, ground, pairs, images), key=lambda one: one.scatter_px):
        if fit.image not in chosen and all(fit.sample not in (one.sample, one.line) for one in chosen.values()):
            chosen[fit.image] = fit
    return list(chosen.values())


def _fit_columns(
    numbers: np.ndarray, ground: np.ndarray, pairs: Sequence[tuple[int, int]], images: Mapping[str, Image]
) -> Iterator[ImageColumns]:
    """Yield the column pairs that agree with the projections of ground points (n, 3), for each image.

    Lines that are counted upwards agree too: the adjustment reports them.
    """
    for image in images.values():
        projected = image.rpc.project(ground)
        size = 2.0 * float(image.half_size_px.max())
        for first, second in pairs:
            for (sample, line), upwards in product(permutations((first, second)), (False, True)):
                difference = numbers[:, [sample, line]] * (1.0, -1.0 if upwards else 1.0) - projected
                difference = difference[np.isfinite(difference).all(axis=1)]
                if len(difference) < SAMPLES.plane:
                    continue
                middle = np.median(difference, axis=0)
                scatter = float(np.hypot(*(robust_sigma(part) for part in (difference - middle).T)))
                if scatter < EQUALITY.negligible * size and np.abs(middle).max() < size * (1.5 if upwards else 0.5):
                    yield ImageColumns(image.id, sample, line, scatter)


def agrees(tables: PointTables, images: Mapping[str, Image]) -> bool:
    """Return whether the measurements of points agree with the projections of their ground positions, in each image."""
    if tables.ground is None or tables.image is None:
        return False
    place = dict(zip(tables.ground.ids.tolist(), tables.ground.ground, strict=True))
    ground = np.array([place[name] for name in tables.image.ids.tolist()])
    image_of_row = np.asarray(tables.image.image_ids)
    rows_of = {name: image_of_row == name for name in set(image_of_row.tolist()) & images.keys()}
    fits = (
        _fit_columns(tables.image.xy[rows], ground[rows], [(0, 1)], {name: images[name]})
        for name, rows in rows_of.items()
    )
    return bool(rows_of) and all(any(fit.sample == 0 for fit in found) for found in fits)


def _name_columns(
    table: TextTable, path: str, images: Mapping[str, Image], layouts: Sequence[Sequence[tuple[int, int]]]
) -> list[ImageColumns]:
    """Return the columns that their names, or the name of the file, assign to images."""
    ids = list(images)
    named = {k: match_image(text, ids) for k, text in enumerate(table.names) if text}
    found = [(named[a], a, b) for layout in layouts for a, b in layout if named.get(a) and named.get(a) == named.get(b)]
    if not found and (image := match_image(path, ids) or (ids[0] if len(ids) == 1 else None)) and layouts[0]:
        found = [(image, *layouts[0][0])]
    assigned = {image: (a, b) for image, a, b in found if image is not None}
    orders = [[ImageColumns(image, *pair[::step]) for image, pair in assigned.items()] for step in (1, -1)]
    costs = [_disagreement_m(table.numbers, order, images) for order in orders]
    return orders[int(costs[1] < costs[0])]


def _disagreement_m(numbers: np.ndarray, order: Sequence[ImageColumns], images: Mapping[str, Image]) -> float:
    """Return the scatter (m) between the images of the points' positions at a mean height, and 1e9 m outside images."""
    ground, outside = [], 0.0
    for one in order:
        image, xy = images[one.image], numbers[:, [one.sample, one.line]]
        ground.append(image.rpc.localize(xy, image.middle_height_m).ground)
        low, high = np.array(image.domain_px[::2]), np.array(image.domain_px[1::2])
        outside += float(np.nanmean((xy < low - 1.0) | (xy > high + 1.0)))
    differences = [part for first, second in pairwise(ground) for part in ground_difference_m(second, first)[:, :2].T]
    return 1e9 * outside + sum(float(robust_sigma(part[np.isfinite(part)])) for part in differences)

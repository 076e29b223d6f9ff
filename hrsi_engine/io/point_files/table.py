"""Table of a point file as its reader returns it, the names of its fields, and the description of a reader.

Case is ignored when names are matched; of several aliases in a file, the first in the list of HRSI is used. ``pixel``
is no alias of ``sample``, because programs that write it disagree on the position of pixel 0.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...foundation.errors import InputError
from ..opening.budgets import require_texts
from ..opening.files import parse_angle, parse_finite


@dataclass(frozen=True, eq=False)
class PointTable:
    """Rows of a point file under the field names of `FIELDS`.

    source : file and layer, as messages name them
    columns : text columns (n,) str, '' where empty; number columns (n,) float64, NaN where empty
    field_names : all fields of the file as spelled there
    row_name : name of a row in messages (``line 12``, ``feature 3``)
    geometry : (n, 3) x, y, z in ``crs``, NaN where missing; None if the file has no geometry
    crs : anything PROJ reads; empty if the file states none
    pairwise : matches of two images; the same point may be in other files under another id
    operations : in HRSI's own layers, operations of the surveys to WGS84 (`block.points.describe_operations`)
    """

    source: str
    columns: dict[str, np.ndarray]
    field_names: tuple[str, ...]
    row_name: Callable[[int], str]
    geometry: np.ndarray | None = None
    crs: str = ""
    notes: tuple[str, ...] = ()
    pairwise: bool = False
    operations: str = ""

    def __len__(self) -> int:
        columns = [*self.columns.values(), *([] if self.geometry is None else [self.geometry])]
        return len(columns[0]) if columns else 0

    def select(self, rows: np.ndarray) -> "PointTable":
        """Return the table of the rows of a mask ``(n,)``."""
        selected = np.flatnonzero(rows)
        geometry = None if self.geometry is None else self.geometry[selected]
        columns = {name: column[selected] for name, column in self.columns.items()}
        return replace(self, columns=columns, geometry=geometry, row_name=lambda row: self.row_name(int(selected[row])))

    def name_row(self, row: int) -> str:
        """Return file, layer, row and id for a message."""
        ids = self.columns.get("id")
        point = f" (id {str(ids[row])!r})" if ids is not None and ids[row] else ""
        return f"{self.source}, {self.row_name(int(row))}{point}"

    def refuse(self, rows: np.ndarray, reason: str | Callable[[int], str]) -> None:
        """Raise `InputError` if a mask of rows ``(n,)`` is set anywhere: the first such row, and the reason."""
        if rows.any():
            row = int(rows.argmax())
            raise InputError(f"{self.name_row(row)}: {reason if isinstance(reason, str) else reason(row)}")


@dataclass(frozen=True)
class PointReader:
    """How to recognise and read one format of point files.

    title : name of the format in messages
    recognises : returns whether a file is of this format, by its path, its name (lower case) and its first bytes
    read : returns the rows of a file; the second argument is the layer (name, ``#number`` or empty)
    is_named_by : returns whether column names that a user gives are those of this format, for any file
    chooses_fields : whether ``read`` has a third argument, the fields that the user chose, see `match_fields`
    """

    title: str
    recognises: Callable[[str, str, bytes], bool]
    read: Callable[..., PointTable]
    is_named_by: Callable[[Sequence[str]], bool] = lambda _columns: False
    chooses_fields: bool = False


#: Text fields and their aliases.
TEXT_FIELDS: dict[str, tuple[str, ...]] = {
    "id": ("id", "point_id", "pointid", "gcp_id", "point", "name", "fid"),
    "image": ("image", "image_id", "filename", "file"),
    "role": ("role",),
    "check": ("check", "is_check", "checkpoint"),
    "use": ("use", "enabled", "enable", "active"),
    "kind": ("kind",),
    "track": ("track",),
    "photo": ("photo",),
}
#: Number fields and their aliases.
NUMBER_FIELDS: dict[str, tuple[str, ...]] = {
    "lon": ("lon", "longitude", "long"),
    "lat": ("lat", "latitude"),
    "x": ("x", "easting", "east"),
    "y": ("y", "northing", "north"),
    "height": ("height", "h", "z", "elev", "elevation", "altitude", "ele", "h_mean", "h_li"),
    "sigma_h": ("sigma_h", "sigma_z", "h_sigma", "h_li_sigma"),
    "sigma_east": ("sigma_east", "sigma_e", "sigma_x"),
    "sigma_north": ("sigma_north", "sigma_n", "sigma_y"),
    "sample": ("sample", "samp", "column", "col", "sample_px", "x_px"),
    "line": ("line", "row", "line_px", "y_px"),
    "sigma": ("sigma", "sigma_px"),
    # fields of laser heights with the names of SlideRule
    "slope": ("dh_fit_dx",),
    "misfit": ("rms_misfit",),
    "photons": ("n_fit_photons",),
    "canopy": ("h_canopy",),
} | {
    name: (name,)  # fields without aliases
    for name in (
        "survey_lon", "survey_lat", "survey_height", "sigma_xy", "sigma_height_m", "corr_en", "corr_eh", "corr_nh",
        "cov_ee", "cov_nn", "cov_hh", "cov_en", "cov_eh", "cov_nh", "quality", "rgt", "cycle",
    )
}  # fmt: skip
FIELDS = TEXT_FIELDS | NUMBER_FIELDS
#: Fields where ``inf`` is allowed: the coordinate was not surveyed.
MAY_BE_INFINITE = frozenset({"sigma_xy", "sigma_h", "sigma_east", "sigma_north"})


def match_fields(
    names: Sequence[str], fields_given: Mapping[str, str] | None = None, source: str = ""
) -> dict[str, int]:
    """Return the column number of each known field that a file has.

    ``fields_given`` has the names in the file of some fields,
    which are then used for these fields only. Raises `InputError`
    with ``source`` if the file has no such name.
    """
    stripped = [name.strip() for name in names]
    result = {}
    for field, name in (fields_given or {}).items():
        spelled = [index for index, second in enumerate(stripped) if second == name]
        similar = spelled or [index for index, second in enumerate(stripped) if second.lower() == name.lower()]
        if not similar:
            raise InputError(
                f"{source}: has no field {name!r}; its fields are {', '.join(filter(None, stripped)) or 'none'}: "
                f"correct |columns={field}={name}"
            )
        result[field] = similar[0]
    position: dict[str, int] = {}
    for index, name in enumerate(stripped):
        if index not in result.values():
            position.setdefault(name.lower(), index)
    for field, aliases in FIELDS.items():
        if field in result:
            continue
        alias = next((alias for alias in aliases if alias in position), None)
        if alias is not None:
            result[field] = position[alias]
    return result


def strip_texts(texts: Sequence[str], source: str, name: str) -> np.ndarray:
    """Return a text column without surrounding blanks, ``(n,)`` str.

    Raises `InputError` with file and field if a text is longer than any name.
    """
    stripped = list(map(str.strip, texts))
    require_texts(source, name, len(stripped), max(map(len, stripped), default=0))
    return np.array(stripped, dtype=str)


def parse_column(
    field: str, texts: Sequence[str], source: str, place_of: Callable[[int], str], decimal_comma: bool = False
) -> np.ndarray:
    """Return the column of a field of `FIELDS` from its texts: numbers by `parse_numbers`, or texts without blanks."""
    if field in NUMBER_FIELDS:
        return parse_numbers(texts, place_of, decimal_comma, field in MAY_BE_INFINITE)
    return strip_texts(texts, source, field)


def parse_numbers(
    texts: Sequence[str], place_of: Callable[[int], str], decimal_comma: bool = False, infinite: bool = False
) -> np.ndarray:
    """Return a number column, ``(n,)`` float64, NaN where the text is empty.

    ``place_of`` returns field and row of an index for messages. Raises `InputError` for a text that is no number, or is
    infinite without ``infinite`` being set.
    """
    try:
        values = np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
    except ValueError:
        pass
    else:
        all_text = "".join(texts)  # ``float`` also accepts 1_000 and full-width digits
        if np.isfinite(values).all() and all_text.isascii() and "_" not in all_text:
            return values
    one_by_one = [_parse_number(text, index, place_of, decimal_comma, infinite) for index, text in enumerate(texts)]
    return np.array(one_by_one, dtype=np.float64)


def _parse_number(text: str, index: int, place_of: Callable[[int], str], decimal_comma: bool, infinite: bool) -> float:
    text = text.strip()
    if text.lower() in ("", "-", "null", "none", "na", "n/a", "nan"):
        return np.nan
    if infinite and text.lower() in ("inf", "+inf", "infinity"):
        return np.inf
    value = parse_finite(text.replace(",", ".") if decimal_comma else text)
    value = parse_angle(text) if value is None else value
    if value is None:
        advice = "correct it, or leave an optional field empty"
        if any(sign in text for sign in "°º'′\""):
            advice = "write degrees as 43.525 or 43°31'30\"N"
        elif "," in text and parse_finite(text.replace(",", ".")) is not None:
            advice = "write decimals with a point, or let semicolons part the columns"
        raise InputError(f"{place_of(index)}: {text[:40]!r} is not a number: {advice}")
    return value

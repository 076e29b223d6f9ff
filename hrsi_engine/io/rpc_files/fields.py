"""The 90 numbers of an RPC and their names; construction of an RPC from the text of a file, with checks.

``ERR_BIAS`` and ``ERR_RAND`` are optional in all formats. A missing, empty or negative value means unknown (None): in
GeoTIFF, -1 is the only way to omit them. Zero is kept as in the file, except in OTB ``.geom``, where the program writes
0 for an unknown error.

At the end: the result of a reader of one format, the description of a reader, and the RPC found for an image.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...block.block import Tile
from ...block.placement import PlacementDoubt
from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ..opening.budgets import RPC_BUDGETS, RPC_RANGES

#: Fields of `RPC` with one number each, in the order of GeoTIFF tag 50844 (after ERR_BIAS and ERR_RAND).
SCALARS = (
    "line_off", "samp_off", "lat_off", "long_off", "height_off",
    "line_scale", "samp_scale", "lat_scale", "long_scale", "height_scale",
)  # fmt: skip
#: Fields of `RPC` with twenty numbers each, in the order of the tag.
POLYNOMIALS = ("line_num", "line_den", "samp_num", "samp_den")
ERRORS = ("err_bias", "err_rand")
#: RPC field -> its name in GDAL's RPC metadata domain.
GDAL_NAMES = {key: key.upper() for key in (*ERRORS, *SCALARS)} | {key: f"{key.upper()}_COEFF" for key in POLYNOMIALS}
#: RPC field -> its name in a STAC item: GDAL's names, as a field with a prefix.
STAC_NAMES = {name: f"rpc:{title.lower()}" for name, title in GDAL_NAMES.items()}
_PLAIN_NUMBER = re.compile(r"[+-]?\d+\.?\d*(?:e[+-]?\d+)?", re.ASCII)  # nearly all numbers
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?", re.ASCII)

Text = str | Sequence[str]


def rpc_from_text(source: str, values: Mapping[str, Text | None], names: Mapping[str, str] | None = None) -> RPC:
    """Return an RPC from numbers in text form.

    source : the file, in error messages
    values : RPC field name -> text of the number (a unit may follow), or the 20 texts of a polynomial; ``err_bias`` and
    ``err_rand`` may be missing
    names : RPC field name -> its name in the file, for messages (default: GDAL's names)

    Raises `InputError` if a field is missing or is not a finite number, a polynomial does not have 20 coefficients,
    or a scale is zero.
    """
    names = names or GDAL_NAMES
    numbers: dict[str, float | np.ndarray | None] = {
        field: _parse_number(source, names[field], values.get(field)) for field in SCALARS
    }
    for field in POLYNOMIALS:
        name = names[field]
        texts = values.get(field)
        count = 0 if texts is None else len(texts)
        if texts is None or isinstance(texts, str) or count != 20:
            raise InputError(f"{source}: {name} has {count} coefficients, 20 are needed: obtain the file again")
        if all(map(_PLAIN_NUMBER.fullmatch, texts)):  # nearly always, and faster than one by one
            numbers[field] = np.array([*map(float, texts)])
        else:
            numbers[field] = np.array([_parse_number(source, f"{name} {i}", text) for i, text in enumerate(texts, 1)])
    for field in ERRORS:
        text = values.get(field)
        is_told = isinstance(text, str) and text.strip()
        numbers[field] = _error_or_none(_parse_number(source, names[field], text)) if is_told else None
    return check_rpc(source, RPC(**numbers), names)  # type: ignore[arg-type]


def rpc_from_json(source: str, members: Mapping[str, Any], names: Mapping[str, str]) -> RPC:
    """Return the RPC of a JSON object, whose members have these ``names`` by RPC field; raises as `rpc_from_text`."""
    return rpc_from_text(source, {name: _json_text(members.get(key)) for name, key in names.items()}, names)


def _json_text(value: Any) -> Text | None:
    """Return numbers as text that gives the same doubles (17 digits); anything else as text that is no number."""
    if isinstance(value, list):
        return [str(_json_text(item)) for item in value]
    return None if value is None else repr(value) if isinstance(value, float) else str(value)


def json_members(rpc: RPC, names: Mapping[str, str]) -> dict[str, Any]:
    """Return an RPC as members of a JSON object, with all digits; unknown errors are omitted."""
    members = {names[name]: getattr(rpc, name) for name in (*SCALARS, *ERRORS) if getattr(rpc, name) is not None}
    return members | {names[name]: getattr(rpc, name).tolist() for name in POLYNOMIALS}


def rpc_from_numbers(source: str, numbers: Sequence[float]) -> RPC:
    """Return the RPC of the 92 doubles of GeoTIFF tag 50844; raise `InputError` if they are no valid RPC."""
    scalars = dict(zip(SCALARS, numbers[2:12], strict=True))
    polynomials = {name: np.array(numbers[12 + 20 * i : 32 + 20 * i]) for i, name in enumerate(POLYNOMIALS)}
    errors = {name: _error_or_none(value) for name, value in zip(ERRORS, numbers[:2], strict=True)}
    return check_rpc(source, RPC(**scalars, **polynomials, **errors), GDAL_NAMES)  # type: ignore[arg-type]


def numbers_of(rpc: RPC) -> list[float]:
    """Return the 92 doubles of GeoTIFF tag 50844; unknown errors are -1."""
    errors = [-1.0 if value is None else value for value in (rpc.err_bias, rpc.err_rand)]
    scalars = [getattr(rpc, name) for name in SCALARS]
    return errors + scalars + [value for name in POLYNOMIALS for value in getattr(rpc, name).tolist()]


def gdal_metadata(rpc: RPC) -> dict[str, str]:
    """Return GDAL's RPC metadata domain, with 17 digits, so that reading gives the same doubles."""
    metadata = {GDAL_NAMES[name]: repr(value) for name in ERRORS if (value := getattr(rpc, name)) is not None}
    metadata |= {GDAL_NAMES[name]: repr(getattr(rpc, name)) for name in SCALARS}
    return metadata | {GDAL_NAMES[name]: " ".join(map(repr, getattr(rpc, name).tolist())) for name in POLYNOMIALS}


def rpc_from_entries(
    where: str,
    entries: Mapping[str, str],
    names: Mapping[str, str] = GDAL_NAMES,
    numbers: Sequence[str] = (),
    zero_is_unknown: bool = False,
) -> RPC:
    """Return the RPC of texts by their names in a file, or in GDAL's metadata domain; raises as `rpc_from_text`.

    names : RPC field name -> its name in the file
    numbers : endings of a polynomial's name for its coefficients; without them, all are behind the name
    zero_is_unknown : whether a program writes 0 for an unknown error
    """
    values: dict[str, Text | None] = {name: entries.get(names[name]) for name in (*ERRORS, *SCALARS)}
    if zero_is_unknown:
        values |= {name: None for name in ERRORS if not (entries.get(names[name]) or "").strip("0. ")}
    for name in POLYNOMIALS:
        numbered = [entries[key] for number in numbers if (key := f"{names[name]}{number}") in entries]
        values[name] = numbered or entries.get(names[name], "").replace(",", " ").split() or None
    return rpc_from_text(where, values, names)


def check_rpc(source: str, rpc: RPC, names: Mapping[str, str]) -> RPC:
    """Return ``rpc``; raise `InputError` for numbers by which no point can be projected."""
    for field, (low, high) in RPC_RANGES.items():
        value = getattr(rpc, field)
        if not low <= abs(value) <= high:
            raise InputError(
                f"{source}: {names[field]} is {value:g}, which is not possible for an RPC: obtain the file again"
            )
    for field in POLYNOMIALS:
        values = getattr(rpc, field)
        largest, first = float(np.abs(values).max()), float(values[0])  # a maximum keeps NaN
        if not largest <= RPC_BUDGETS.coefficient:
            raise InputError(
                f"{source}: {names[field]} has {values[np.abs(values).argmax()]:g}, which is not possible for an RPC: "
                "obtain the file again"
            )
        if field.endswith("_den") and not 0.0 < largest <= RPC_BUDGETS.denominator * abs(first):
            raise InputError(
                f"{source}: {names[field]} starts with {first:g}, and its largest coefficient is {largest:g}, which is "
                "not possible for an RPC: obtain the file again"
            )
    # At the centre of the RPC all terms except the constant ones are 0.
    samp = float(rpc.samp_num[0]) / float(rpc.samp_den[0]) * rpc.samp_scale + rpc.samp_off
    line = float(rpc.line_num[0]) / float(rpc.line_den[0]) * rpc.line_scale + rpc.line_off
    if not (math.isfinite(samp) and math.isfinite(line)):
        raise InputError(f"{source}: has no image position for the centre of its area: obtain the file again")
    return rpc


def _parse_number(source: str, name: str, text: Text | None) -> float:
    """Return the number at the start of ``text``; a unit (``pixels``, ``degrees``) may follow it."""
    if not isinstance(text, str) or not text.strip():
        raise InputError(f"{source}: {name} is missing: this is not a whole RPC, obtain the file again")
    match, unit = _NUMBER.match(text.strip()), r"\s*[,;]?(\s+[^\d\s.+-].*)?"
    is_number = match is not None and re.fullmatch(unit, text.strip()[match.end() :], re.ASCII)
    value = _parse_double(match.group()) if match is not None and is_number else math.nan
    if not math.isfinite(value):
        advice = ", with a point before its decimals" if "," in text else ""
        raise InputError(f"{source}: {name} is {shorten(text)!r}: a number is needed{advice}")
    return value


def _error_or_none(value: float) -> float | None:
    return value if math.isfinite(value) and value >= 0.0 else None


def entries_of(source: str, pairs: Iterable[tuple[str, str]], names: Collection[str]) -> dict[str, str]:
    """Return name -> text of its value; of a repeated name the first one.

    A name among ``names`` (coefficients without their number) may be repeated with the same numbers only: which of two
    is right is unknown, and programs differ in which they use. Otherwise `InputError` is raised.
    """
    entries: dict[str, str] = {}
    for name, value in pairs:
        first_value = entries.setdefault(name, value)
        if (
            first_value is value
            or re.sub(r"_\d+$", "", name) not in names
            or _find_numbers(first_value) == _find_numbers(value)
        ):
            continue
        raise InputError(
            f"{source}: {name} occurs twice, as {shorten(first_value)} and as {shorten(value)}: obtain the file again"
        )
    return entries


def _find_numbers(text: str) -> list[float]:
    """Return the numbers among the words of a text, without units."""
    return [_parse_double(word) for word in re.split(r"[,;\s]+", text) if _NUMBER.fullmatch(word)]


def _parse_double(number: str) -> float:
    """Return the value of a number; Fortran writes its exponent with a D."""
    return float(number.replace("d", "e").replace("D", "e"))


def shorten(text: object, limit: int = 40) -> str:
    """Return ``text`` shortened for an error message of one line."""
    line = " ".join(str(text).split())
    return line if len(line) <= limit else line[: limit - 1] + "…"


# ---- readers -------------------------------------------------------------------------------------------------------

Origin = tuple[float, float]  # (sample, line)


@dataclass(frozen=True)
class RpcReader:
    """Description of a reader: how one format of RPC files is recognised and read.

    title : name of the format in logs and reports
    beside : returns the file names, in lower case, of this format next to an image of a given stem (lower case)
    recognises : returns whether a file is of this format, by its name (lower case) and its first bytes
    read : returns the file's RPC, for the pixels of *its* image, with what the file states of that image; raises
    `InputError` only
    tile_origin : returns (sample, line) of an image's first pixel in the file's scene, if the image is a tile of it
    is_product : returns whether a file describes a product, by its first bytes; GDAL may open that as an image
    read_beside : returns the file's RPC for an image, if it depends on the image; otherwise ``read`` is used
    """

    title: str
    beside: Callable[[str], tuple[str, ...]]
    recognises: Callable[[str, bytes], bool]
    read: Callable[[str], FoundRpc]
    tile_origin: Callable[[str, str], Origin | None] = lambda _image_path, _side_file: None
    is_product: Callable[[bytes], bool] = lambda _head: False
    read_beside: Callable[[str, str], FoundRpc] | None = None


@dataclass(frozen=True)
class FoundRpc:
    """The RPC of an image and its source.

    Parameters
    ----------
    rpc : RPC
        The camera.
    source : str
        Format and file, and how the RPC was changed (crop origin, ICHIPB).
    ignored : tuple of str
        Other sources that were not used, with their differences if they have other RPCs.
    size : tuple of int, optional
        Samples and lines, if known.
    tile : Tile, optional
        Position of the image in its scene, if it is a part of one.
    height_m : float, optional
        Ellipsoidal height of the scene's centre, if the delivery states it.
    sensor : str
        Name of the satellite in the source; empty if it has none.
    stated_size : tuple of int, optional
        Samples and lines that the source states for the image of the RPC, if the RPC was not moved.
    is_placed : bool
        Whether the position of the image in that of the source's RPC is known; then ``rpc`` is that of its pixels.
    doubt : PlacementDoubt, optional
        Contradiction in the position of the image, found when the RPC was read.
    """

    rpc: RPC
    source: str = ""
    ignored: tuple[str, ...] = ()
    size: tuple[int, int] | None = None
    tile: Tile | None = None
    height_m: float | None = None
    sensor: str = ""
    stated_size: tuple[int, int] | None = None
    is_placed: bool = False
    doubt: PlacementDoubt | None = None

    @property
    def summary(self) -> str:
        """One line for the log: the source that was used, and those that were not."""
        return f"RPC from {self.source}" + (f"; not used: {', '.join(self.ignored)}" if self.ignored else "")

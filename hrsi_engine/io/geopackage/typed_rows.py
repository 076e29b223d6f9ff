"""Columns of layers, each declared once: name, type, unit and description are in a class of `declared_layers`.

The rows of a layer are an object of its class, with one argument for each column::

    rows = TiePointRows(id=ids, views=views, height=height_m, ...)

A column that is given and not declared, or declared and not given, is an error for mypy and at run time. The object is
the mapping of columns that a `Layer` takes; the writer gets types and descriptions of the fields from it, the styles
their titles, and `scripts/list_layers.py` the tables of the documentation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self, dataclass_transform, get_args, get_type_hints

import numpy as np

#: Types of columns, as annotations in a class of rows: the second argument is the type of one value.
TextColumn = Annotated[np.ndarray, str]
FloatColumn = Annotated[np.ndarray, float]
IntegerColumn = Annotated[np.ndarray, int]
FlagColumn = Annotated[np.ndarray, bool]
#: NumPy's dtype kinds that a column of each type may have.
DTYPES: dict[type, str] = {str: "UO", float: "f", int: "iu", bool: "b"}
#: How units are written in titles.
UNIT_SIGNS = {"m": "m", "px": "px", "deg": "°", "m2": "m²"}


@dataclass(frozen=True)
class DeclaredColumn:
    """Declaration of a column: description, unit, level, name and type of its values; see `column`."""

    description: str
    unit: str = ""
    level: str = ""
    name: str = ""
    kind: type = object

    @property
    def text(self) -> str:
        """Description with unit, as in files."""
        return f"{self.description}, {self.unit}" if self.unit else self.description

    @property
    def title(self) -> str:
        """Title of the field in a form: ``Residual east (m)``."""
        return write_title(self.name, self.unit)


def write_title(name: str, unit: str = "") -> str:
    """Return a column's name as words with its unit, ``Residual east (m)``; the default is the unit in the name."""
    words = name.split("_")
    ending = words[-1] if len(words) > 1 and words[-1] in UNIT_SIGNS else ""
    text, sign = " ".join(words[:-1] if ending else words), UNIT_SIGNS.get(unit or ending, unit)
    return f"{text[:1].upper()}{text[1:]}{f' ({sign})' if sign else ''}"


def column(description: str = "", unit: str = "", *, level: str = "") -> Any:
    """Declare a column of a class of `LayerRows`; for type checkers it is a field of the annotated type.

    description : content; by default the text of `SHARED_COLUMNS` under its name, for a column of several layers
    unit : of a number; level : in a layer with rows of several levels, the level that has the column; empty: all
    """
    return DeclaredColumn(description, unit, level)


@dataclass_transform(kw_only_default=True, field_specifiers=(column,))
class LayerRows(Mapping[str, np.ndarray]):
    """Columns of a layer by name, of equal length: exactly those that the class declares.

    A class names its layer (``class TiePointRows(LayerRows, layer="tie_points")``); the first line of its docstring
    describes it. Columns of a base class come first. Raises `TypeError` if a column is not declared, not given, of
    another length or of another kind than declared.
    """

    layer: ClassVar[str] = ""
    declared: ClassVar[Mapping[str, DeclaredColumn]] = {}

    def __init_subclass__(cls, layer: str = "") -> None:
        cls.layer = layer or cls.layer
        individual = {name: value for name, value in vars(cls).items() if isinstance(value, DeclaredColumn)}
        hints = get_type_hints(cls, include_extras=True)
        bases = (base for base in reversed(cls.__mro__[1:]) if issubclass(base, LayerRows))
        inherited = {name: part for base in bases for name, part in base.declared.items()}
        cls.declared = inherited | {
            name: replace(_complete_description(cls, name, part), name=name, kind=get_args(hints[name])[1])
            for name, part in individual.items()
        }

    def __init__(self, **columns: np.ndarray) -> None:
        location = f"layer {self.layer}: `{type(self).__name__}` of {type(self).__module__.rpartition('.')[2]}.py"
        unknown = [name for name in columns if name not in self.declared]
        missing = [name for name in self.declared if name not in columns]
        if unknown:
            raise TypeError(f"{location} does not declare the column {unknown[0]!r}: declare it there, or leave it out")
        if missing:
            raise TypeError(
                f"{location} declares the column {missing[0]!r}, which is not given: give it where the rows are made, "
                "or take it out of the class"
            )
        lengths = {name: len(values) for name, values in columns.items()}
        if len(set(lengths.values())) > 1:
            raise TypeError(f"{location}: the columns differ in length: {lengths}")
        for name, said in self.declared.items():
            values = columns[name]
            if len(values) and values.dtype.kind not in DTYPES[said.kind]:
                raise TypeError(
                    f"{location} declares {name!r} as {said.kind.__name__}, and {values.dtype} is given: convert it, "
                    "or declare the other kind"
                )
            self.__dict__[name] = values

    @classmethod
    def of_level(cls, level: str, count: int, **columns: np.ndarray) -> Self:
        """Return ``count`` rows of one level: the columns of other levels are NaN."""
        omitted = [name for name, said in cls.declared.items() if said.level not in ("", level)]
        superfluous = [name for name in omitted if name in columns]
        if superfluous:
            raise TypeError(
                f"`{cls.__name__}` declares {superfluous[0]!r} for another level than {level!r}: do not give it"
            )
        return cls(**columns, **dict.fromkeys(omitted, np.full(count, np.nan)), level=np.full(count, level))

    @classmethod
    def of_entries(cls, entries: Sequence[Mapping[str, Any]]) -> Self:
        """Return rows from entries of a report, which may have more than the columns; None becomes NaN."""
        columns = {name: [entry[name] for entry in entries] for name in cls.declared}
        return cls(**{name: np.array(values, cls.declared[name].kind) for name, values in columns.items()})

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.declared:
            raise KeyError(name)
        return self.__dict__[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.declared)

    def __len__(self) -> int:
        return len(self.declared)

    def select(self, rows: Any) -> Self:
        """Return an object with some of the rows (slice, mask or indices)."""
        return type(self)(**{name: values[rows] for name, values in self.items()})

    def concatenate(self, second: Self) -> Self:
        """Return these rows followed by others."""
        return type(self)(**{name: np.concatenate([values, second[name]]) for name, values in self.items()})


def _complete_description(cls: type, name: str, part: DeclaredColumn) -> DeclaredColumn:
    """Return a declaration with the description of `SHARED_COLUMNS` if it has none of its own."""
    if part.description:
        return part
    if name not in SHARED_COLUMNS:
        raise TypeError(
            f"`{cls.__name__}.{name}`: describe its content, or enter a text for all layers in SHARED_COLUMNS"
        )
    description, unit = SHARED_COLUMNS[name]
    return replace(part, description=description, unit=unit)


def describe_columns(fields: Mapping[str, np.ndarray]) -> dict[str, DeclaredColumn]:
    """Return the declarations of a layer's fields; for undeclared columns the entry of `SHARED_COLUMNS`, if any."""
    if isinstance(fields, LayerRows):
        return dict(fields.declared)
    return {name: DeclaredColumn(*SHARED_COLUMNS[name], name=name) for name in fields if name in SHARED_COLUMNS}


def write_titles(fields: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Return the titles of a layer's fields, ``fid`` the first, by name."""
    descriptions = describe_columns(fields)
    return {name: descriptions[name].title if name in descriptions else write_title(name) for name in ("fid", *fields)}


#: Descriptions and units of columns that mean the same in every layer that has them, by name.
SHARED_COLUMNS: dict[str, tuple[str, str]] = {
    "id": ("Id of the point or image", ""),
    "path": ("File of the image", ""),
    "samples": ("Columns of the image", "px"),
    "lines": ("Rows of the image", "px"),
    "role": (
        "gcp: control point; check: check point, not used; tie: tie point; held_out: tie point that was not used",
        "",
    ),
    "height": ("Height above the WGS84 ellipsoid", "m"),
    "views": ("Images on which the point was found", ""),
    "image": ("Id of the image", ""),
    "first": ("Id of the first image", ""),
    "second": ("Id of the second image", ""),
    "sample": ("Column; 0 is the CENTRE of the first pixel", "px"),
    "line": ("Row; 0 is the CENTRE of the first pixel", "px"),
    "first_sample": ("Column in the first image; 0 is the CENTRE of the first pixel", "px"),
    "first_line": ("Row in the first image; 0 is the CENTRE of the first pixel", "px"),
    "second_sample": ("Column in the second image; 0 is the CENTRE of the first pixel", "px"),
    "second_line": ("Row in the second image; 0 is the CENTRE of the first pixel", "px"),
    "lon": ("Longitude", "degrees"),
    "lat": ("Latitude", "degrees"),
    "survey_lon": ("Longitude as surveyed", "degrees"),
    "survey_lat": ("Latitude as surveyed", "degrees"),
    "survey_height": ("Ellipsoidal height as surveyed", "m"),
    "sigma_xy": ("Standard deviation of each horizontal coordinate as surveyed", "m"),
    "sigma_h": ("Standard deviation of the height as surveyed", "m"),
    "sigma_px": ("Standard deviation of the measurement along each axis", "px"),
    "sigma": ("Standard deviation of the measurement along each axis", "px"),
    "kind": ("What was measured, or how", ""),
    "quality": ("Quality of the measurement, 0 to 1", ""),
    "level": ("ground: residual of a known point on the ground; image: of a measurement in an image", ""),
    "residual_sample_px": ("Observed - computed along the rows", "px"),
    "residual_line_px": ("Observed - computed along the columns", "px"),
    "residual_east_m": ("Surveyed - computed to the east", "m"),
    "residual_north_m": ("Surveyed - computed to the north", "m"),
    "residual_height_m": ("Surveyed - computed height", "m"),
    "sigma_east_m": ("Standard deviation of the coordinate or residual to the east", "m"),
    "sigma_north_m": ("Standard deviation of the coordinate or residual to the north", "m"),
    "sigma_height_m": ("Standard deviation of the height or its residual", "m"),
    "sigma_sample_px": ("Standard deviation of residual_sample_px, from whose quotient the flag is made", "px"),
    "sigma_line_px": ("Standard deviation of residual_line_px, from whose quotient the flag is made", "px"),
    "flag": ("ok, or a remark on the residual", ""),
    "used": ("Whether it is used", ""),
    "rmse_px": ("Root mean square of the residuals", "px"),
    "correlation": ("Correlation of the grey values after matching", ""),
}

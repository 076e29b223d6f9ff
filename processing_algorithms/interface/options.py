"""Options from a user or a script, checked against their declaration; used by the command line and `run`.

`KINDS` has one entry for each `Kind`: its values, and their names in the interfaces.
"""

import difflib
import math
import numbers
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ...hrsi_engine.foundation.errors import InputError
from .declare import Algorithm, Kind, Param, option_label


@dataclass(frozen=True)
class OptionSource:
    """Options of a run that were not typed, for example of a repeated run, and their origin.

    given : options by key; typed options take precedence
    messages : printed first; record : further entries of the report
    """

    given: Mapping[str, Any] = field(default_factory=dict)
    messages: Sequence[str] = ()
    record: Mapping[str, Any] = field(default_factory=dict)


TYPED = OptionSource()  #: all options are typed


@dataclass(frozen=True)
class OptionSpelling:
    """Spelling of options in an interface, and where they are described (``{name}`` is the algorithm)."""

    label: Callable[[Param], str] = option_label
    help: str = "hrsi {name} --help"


COMMAND_LINE = OptionSpelling()


def check_options(
    algorithm: Algorithm, given: Mapping[str, Any], face: OptionSpelling = COMMAND_LINE
) -> dict[str, Any]:
    """Return all options of an algorithm by keyword: the given ones checked, the others with their defaults.

    Messages name the options as in ``face``. Raises `InputError` if an option is unknown or missing, or its value is
    not of its kind, choices or range.
    """
    known = algorithm.defaults()
    for key in given:
        if key not in known:
            raise InputError(f"{algorithm.name} has no option {key}{suggestion(key, known)}")
    values: dict[str, Any] = {}
    for param in algorithm.params:
        value, label, kind = given.get(param.key), face.label(param), KINDS[param.kind]
        if value is None:
            values[param.key] = param.default
            continue
        try:
            converted = kind.parse(value)
        except (TypeError, ValueError):
            raise InputError(f"{label} {value!r} is not {kind.expected}") from None
        if param.kind is Kind.CHOICE and param.choices and converted not in param.choices:
            near = suggestion(converted, param.choices)
            raise InputError(f"{label} {converted!r} is not one of {', '.join(param.choices)}{near}")
        if param.kind in (Kind.INTEGER, Kind.NUMBER, Kind.RANGE):
            low, high = converted if isinstance(converted, tuple) else (converted, converted)
            unit = f" {param.unit}" if param.unit else ""
            if param.minimum is not None and low < param.minimum:
                raise InputError(f"{label} {low:g} is below its minimum {param.minimum:g}{unit}")
            if param.maximum is not None and high > param.maximum:
                raise InputError(f"{label} {high:g} is above its maximum {param.maximum:g}{unit}")
        values[param.key] = converted
    missing = [
        face.label(param) for param in algorithm.params if param.required and values[param.key] in (None, "", ())
    ]
    if missing:
        raise InputError(f"{algorithm.name} needs {' and '.join(missing)}; see {face.help.format(name=algorithm.name)}")
    return values


def find_algorithm(registry: Mapping[str, Algorithm], name: str, commands: Iterable[str] = ()) -> Algorithm:
    """Return the algorithm of a name; if it is unknown, raise `InputError` with similar names, also of ``commands``."""
    if name not in registry:
        near = suggestion(name, [*registry, *commands])
        raise InputError(f"there is no algorithm {name!r}{near}; hrsi --help lists them")
    return registry[name]


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a suggestion for a misspelt word: ``; did you mean gcps?``, or an empty text."""
    near = difflib.get_close_matches(word, list(known), n=2)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _parse_text(value: Any) -> str:
    """Return a text; raise `TypeError` for anything else, `ValueError` for an empty one."""
    if not isinstance(value, str):
        raise TypeError
    if not value:  # probably an empty variable of a script
        raise ValueError
    return value


def _parse_path(value: Any) -> str:
    """Return the path of a text or path object."""
    return _parse_text(os.fspath(value))


def _parse_paths(value: Any) -> tuple[str, ...]:
    """Return the paths of one path, or of a sequence of them."""
    return tuple(_parse_path(item) for item in ([value] if isinstance(value, (str, os.PathLike)) else value))


def _parse_items(value: Any, separator: str = ",") -> tuple[str, ...]:
    """Return the items of ``"A,B"`` or of a sequence, without blanks and empty ones; numbers are allowed as ids."""
    items = value.split(separator) if isinstance(value, str) else value
    return tuple(text for item in items if (text := str(item).strip()))


def _parse_groups(value: Any) -> tuple[tuple[str, ...], ...]:
    """Return the groups of ``"A+B,C"``, of a sequence of such groups, or of sequences of ids."""
    items = value.split(",") if isinstance(value, str) else value
    return tuple(_parse_items(item, "+") for item in items if isinstance(item, str) or item)


def _parse_folders(value: Any) -> tuple[str, ...]:
    """Return ``NAME=DIR`` texts of ``"A=DIR;B=DIR"``, of a sequence of such texts, or of directories by name."""
    if isinstance(value, Mapping):
        value = [f"{name}={os.fspath(folder)}" for name, folder in value.items()]
    folders = _parse_items(value, ";")
    if not all(
        name.strip() and equals and folder.strip() for name, equals, folder in (t.partition("=") for t in folders)
    ):
        raise ValueError
    return folders


def _parse_range(value: Any) -> tuple[float, float]:
    """Return the limits of ``"LOW,HIGH"``, of two numbers, or of one number for both."""
    items = value.split(",") if isinstance(value, str) else value
    numbers = [_parse_number(item) for item in (items if isinstance(items, (list, tuple)) else [items])]
    low, high = numbers * 2 if len(numbers) == 1 else numbers
    if low > high:
        raise ValueError
    return low, high


def _parse_integer(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (str, numbers.Integral)):
        raise TypeError
    return int(value)


def _parse_number(value: Any) -> float:
    """Return a finite number; raise `TypeError` or `ValueError` for anything else."""
    if isinstance(value, bool):
        raise TypeError
    number = float(value)
    if not math.isfinite(number):
        raise ValueError
    return number


def _parse_flag(value: Any) -> bool:
    if value not in (True, False):
        raise ValueError
    return bool(value)


class KindFacts(NamedTuple):
    """Properties of options of a kind, for all interfaces.

    parse : converts a value, a text or a Python object; raises `TypeError` or `ValueError`
    expected : description of valid values in messages: ``--threads 'x' is not a whole number``
    metavar : placeholder of the value in the help, if the declaration has none
    annotation, described : type in Python's stubs (without choices), and in descriptions of functions
    """

    parse: Callable[[Any], Any]
    expected: str
    metavar: str
    annotation: str = "str"
    described: str = "str"


_FILE_NAME = "a file name"
_TABLES = "path | table | array | GroundPoints | ImagePoints"
_RANGE_EXPECTED = "a number, or a range LOW,HIGH with the lower one first"
_GROUPS_TYPE = "str | Iterable[str | Iterable[str]]"
_FOLDERS_TYPE = "Mapping[str, Path] | Iterable[str]"
KINDS = {
    Kind.IMAGES: KindFacts(_parse_paths, "a list of file names", "IMAGE", "Images", "path | Image | sequence of them"),
    Kind.RASTER: KindFacts(_parse_path, _FILE_NAME, "FILE", "RasterSource", "path | rasterio dataset"),
    Kind.POINTS: KindFacts(_parse_path, _FILE_NAME, "FILE[|layername=L]", "Points", _TABLES),
    Kind.FILE: KindFacts(_parse_path, _FILE_NAME, "FILE", "Path", "path"),
    Kind.CRS: KindFacts(_parse_text, "the name of a CRS", "CRS"),
    Kind.EXTENT: KindFacts(_parse_text, "a text", "W,S,E,N"),
    Kind.TEXT: KindFacts(_parse_text, "a text", "TEXT"),
    Kind.IDS: KindFacts(
        _parse_items, "a list of ids separated by commas", "A,B,...", "str | Iterable[str]", "sequence of str"
    ),
    Kind.GROUPS: KindFacts(
        _parse_groups, "a list of groups of ids: A+B,C+D", "A+B,C+D,...", _GROUPS_TYPE, "sequence of sequences of str"
    ),
    Kind.RANGE: KindFacts(
        _parse_range, _RANGE_EXPECTED, "LOW,HIGH", "str | float | tuple[float, float]", "(float, float)"
    ),
    Kind.CHOICE: KindFacts(_parse_text, "a text", "NAME"),
    Kind.INTEGER: KindFacts(_parse_integer, "a whole number", "N", "int", "int"),
    Kind.NUMBER: KindFacts(_parse_number, "a number", "X", "float", "float"),
    Kind.FLAG: KindFacts(_parse_flag, "true or false", "", "bool", "bool"),
    Kind.FOLDERS: KindFacts(
        _parse_folders, "a directory with its name: NAME=DIR", "NAME=DIR", _FOLDERS_TYPE, "dict of str to path"
    ),
    Kind.RESULT: KindFacts(_parse_path, "the name of a directory", "RESULT", "Path", "path"),
    Kind.PROJECT: KindFacts(_parse_path, _FILE_NAME, "PROJECT", "Path", "path"),
    Kind.OUTPUT_DIR: KindFacts(_parse_path, "the name of a directory", "DIR", "Path", "path"),
}

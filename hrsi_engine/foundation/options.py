"""An option is a field of a typed dataclass that contains its complete description for users.

`option` makes the field, `options` the dataclass. Functions take the dataclass as argument; its fields declare the
options of the command line, of the QGIS dialogs and of the documentation (`processing_algorithms.interface.declare`
reads them), so that all have the same default. A field without `option` is for callers in Python only. `nest_options`
includes options in others.

Texts name other options as arguments in backticks, ```sigma_dem_m```: each interface converts them to its own form.
"""

import inspect
import re
from dataclasses import MISSING, Field, FrozenInstanceError, dataclass, field, fields
from enum import Enum
from functools import partial
from typing import Any, TypeVar, dataclass_transform

_OPTION, _NESTED = "option", "nested options"
Described = TypeVar("Described")


@dataclass(frozen=True)
class Option:
    """Description of an option, stored with its field.

    help : one sentence without a closing full stop
    name : name of the option, if it is not the field's own with ``-`` for ``_``: ``sigma-dem`` of ``sigma_dem_m``
    unit : unit of a number
    choices : the permitted words
    minimum, maximum : limits of a number
    advanced : whether only few users need it
    metavar : placeholder of the value in the help: ``auto|none|FILE``
    kind : kind of value, if it does not follow from the field's type (kinds of files)
    piped : standard input is read if the option is not given
    """

    help: str
    name: str = ""
    unit: str = ""
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    advanced: bool = False
    metavar: str = ""
    kind: Enum | None = None
    piped: bool = False


def option(default: Any = MISSING, help: str = "", **described: Any) -> Any:
    """Return a dataclass field that is an option, ``described`` by `Option`; without a default it is required."""
    return field(default=default, metadata={_OPTION: Option(help, **described)})


def nest_options(options: type) -> Any:
    """Return a dataclass field that contains other options with their defaults; each is an option of the outer one."""
    required = [part.name for part in fields(options) if part.default is MISSING and part.default_factory is MISSING]
    factory: Any = MISSING if required else options
    return field(default_factory=factory, metadata={_NESTED: options})


def option_of(part: Field[Any]) -> Option | None:
    """Return the description of an option's dataclass field; None if the field is not an option."""
    return part.metadata.get(_OPTION)


def inner_options_of(part: Field[Any]) -> type | None:
    """Return the dataclass of options that a field contains; None if it contains none."""
    return part.metadata.get(_NESTED)


def threads_option() -> Any:
    """Return the option field for the number of threads, which many dataclasses share."""
    return option(0, "Number of threads; 0 takes all cores", minimum=0, advanced=True, metavar="N")


@dataclass_transform(frozen_default=True)
def options(cls: type[Described] | None = None, /, *, kw_only: bool = False) -> Any:
    """Make a frozen dataclass of options, described by its fields; a decorator.

    `dataclasses.dataclass` compiles six methods for each class, which for all declared classes takes as long as the
    rest of the command line's start; here it compiles only ``__init__``, and the others are shared. The fields also
    fill the section Parameters of the docstring; fields for callers in Python only keep their own entries there.

    ``kw_only`` is whether fields are keyword arguments; needed if an option without default follows one with a default.
    """
    if cls is None:
        return partial(options, kw_only=kw_only)
    options_class = dataclass(repr=False, eq=False, kw_only=kw_only)(cls)
    for method in (_OptionsBase.__repr__, _OptionsBase.__eq__, _OptionsBase.__hash__, _OptionsBase.__setattr__):
        setattr(options_class, method.__name__, method)
    # Add the section Parameters to the docstring, from the descriptions of the fields
    doc = inspect.cleandoc(options_class.__doc__ or "")
    heading = "Parameters\n----------\n"
    opening, _, annotations = doc.partition(heading)
    fields_here = {entry.partition(" :")[0]: entry for entry in re.split(r"\n(?=\S)", annotations.strip()) if entry}
    entries: list[str] = []
    for part in fields(options_class):  # type: ignore[arg-type]
        said, inner = option_of(part), inner_options_of(part)
        if said is not None:
            entries.append(_describe_field(part, f"{said.help}{f' ({said.unit})' if said.unit else ''}."))
        elif inner is not None:
            entries.append(_describe_field(part, (inner.__doc__ or "").partition("\n")[0]))
        else:
            entries += [
                text for names, text in fields_here.items() if part.name in names.split(", ") and text not in entries
            ]
    options_class.__doc__ = f"{opening.rstrip()}\n\n{heading}{chr(10).join(entries)}\n"
    return options_class


def _values_of(individual: Any) -> dict[str, Any]:
    return {part.name: getattr(individual, part.name) for part in fields(individual)}


class _OptionsBase:
    """Methods that all dataclasses of options share."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in _values_of(self).items())})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and _values_of(self) == _values_of(other)

    def __hash__(self) -> int:
        return hash(tuple(_values_of(self).values()))

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self.__dict__:
            raise FrozenInstanceError(f"{name} of {type(self).__name__} is set already: use dataclasses.replace")
        object.__setattr__(self, name, value)


def _describe_field(part: Field[Any], text: str) -> str:
    required = part.default is MISSING and part.default_factory is MISSING
    kind = str(part.type).removesuffix(" | None")
    return f"{part.name} : {kind}{'' if required else ', optional'}\n    {text}"


class InMemory(str):
    """The name of an object in memory, for messages and reports; the object itself is an attribute of the subclass.

    An option that names a file can thus also take an object in memory, and all code between the caller and the reader
    passes it on like the name of a file.
    """

    __slots__ = ()

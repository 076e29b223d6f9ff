"""An option is a field of a typed dataclass: what a person has to know of it stands with it, once.

`option` makes the field, `options` the dataclass. That is what functions take; its fields declare the options of the
command line, of the QGIS dialogs and of the documentation (`processing_algorithms.interface.declare` reads them), so
that all have the same default. A field without `option` is for callers in Python only. `nested` makes options part of
others.

Texts name other options as arguments in backticks, ```sigma_dem_m```: each face writes them in its own manner.
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
    """What stands with a field.

    help : one sentence without a closing full stop
    name : of the option, where it is not the field's own with ``-`` for ``_``: ``sigma-dem`` of ``sigma_dem_m``
    unit : of a number
    choices : the words that it takes
    minimum, maximum : of a number
    advanced : whether only few users need it
    metavar : what stands for its value: ``auto|none|FILE``
    kind : what kind of value it is, where the field's type does not tell (kinds of files)
    piped : where it is not given, standard input is read
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
    """Return a dataclass field that holds other options, at their defaults; each is an option of the whole."""
    required = [part.name for part in fields(options) if part.default is MISSING and part.default_factory is MISSING]
    factory: Any = MISSING if required else options
    return field(default_factory=factory, metadata={_NESTED: options})


def option_of(part: Field[Any]) -> Option | None:
    """Return the description of an option's dataclass field; None where the field is no option."""
    return part.metadata.get(_OPTION)


def inner_options_of(part: Field[Any]) -> type | None:
    """Return the dataclass of options that a field holds; None where it holds none."""
    return part.metadata.get(_NESTED)


def threads_option() -> Any:
    """Return the field of the number of threads, which many options have."""
    return option(0, "Number of threads; 0 takes all cores", minimum=0, advanced=True, metavar="N")


@dataclass_transform(frozen_default=True)
def options(cls: type[Described] | None = None, /, *, kw_only: bool = False) -> Any:
    """Make a frozen dataclass of options, described by what stands with its fields; a decorator.

    `dataclasses.dataclass` compiles six methods for a class, which for all that is declared takes as long as the rest
    of the command line's start; here it compiles the first, and the others are shared. The section Parameters of the
    docstring is made from the fields; fields for callers in Python only have their entries in the class's own.

    ``kw_only`` is whether all fields are named in a call; needed where one is required.
    """
    if cls is None:
        return partial(options, kw_only=kw_only)
    made = dataclass(repr=False, eq=False, kw_only=kw_only)(cls)
    for method in (_OptionsBase.__repr__, _OptionsBase.__eq__, _OptionsBase.__hash__, _OptionsBase.__setattr__):
        setattr(made, method.__name__, method)
    # The docstring with the section Parameters that the fields tell
    doc = inspect.cleandoc(made.__doc__ or "")
    heading = "Parameters\n----------\n"
    opening, _, rest = doc.partition(heading)
    own = {entry.partition(" :")[0]: entry for entry in re.split(r"\n(?=\S)", rest.strip()) if entry}
    entries: list[str] = []
    for part in fields(made):  # type: ignore[arg-type]
        said, inner = option_of(part), inner_options_of(part)
        if said is not None:
            entries.append(_describe_field(part, f"{said.help}{f' ({said.unit})' if said.unit else ''}."))
        elif inner is not None:
            entries.append(_describe_field(part, (inner.__doc__ or "").partition("\n")[0]))
        else:
            entries += [text for names, text in own.items() if part.name in names.split(", ") and text not in entries]
    made.__doc__ = f"{opening.rstrip()}\n\n{heading}{chr(10).join(entries)}\n"
    return made


def _values_of(own: Any) -> dict[str, Any]:
    return {part.name: getattr(own, part.name) for part in fields(own)}


class _OptionsBase:
    """Methods of all dataclasses of options."""

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
    """The name of something in memory, for messages and reports; what it stands for is an attribute of the subclass.

    So an option that names a file also takes the thing itself, and everything between the caller and the reader
    passes it on as it passes the name of a file.
    """

    __slots__ = ()

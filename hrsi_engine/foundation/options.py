"""An option is a field of a typed dataclass: what a person has to know of it stands with it, once.

`option` makes the field. The dataclass is what functions take; its fields declare the options of the command line, of
the QGIS dialogs and of the documentation (`processing_algorithms.interface.declare` reads them), so that all have the
same default. A field without `option` is for callers in Python only. `nested` makes options part of others.

Texts name other options as arguments in backticks, ```sigma_dem_m```: each face writes them in its own manner.
"""

from __future__ import annotations

from dataclasses import MISSING, Field, dataclass, field, fields
from enum import Enum
from typing import Any

_OPTION, _NESTED = "option", "nested options"


@dataclass(frozen=True)
class Option:
    """What stands with a field.

    Parameters
    ----------
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


def option(
    default: Any = MISSING,
    help: str = "",
    *,
    name: str = "",
    unit: str = "",
    choices: tuple[str, ...] = (),
    minimum: float | None = None,
    maximum: float | None = None,
    advanced: bool = False,
    metavar: str = "",
    kind: Enum | None = None,
    piped: bool = False,
) -> Any:
    """Return a dataclass field that is an option; without a default it is required. For the others see `Option`."""
    said = Option(help, name, unit, choices, minimum, maximum, advanced, metavar, kind, piped)
    return field(default=default, metadata={_OPTION: said})


def nested(options: type) -> Any:
    """Return a dataclass field that holds other options, at their defaults; each is an option of the whole."""
    required = [part.name for part in fields(options) if part.default is MISSING and part.default_factory is MISSING]
    factory: Any = MISSING if required else options
    return field(default_factory=factory, metadata={_NESTED: options})


def option_of(part: Field[Any]) -> Option | None:
    """Return what stands with a field; None where it is no option."""
    found: Option | None = part.metadata.get(_OPTION)
    return found


def nested_in(part: Field[Any]) -> type | None:
    """Return the dataclass of options that a field holds; None where it holds none."""
    found: type | None = part.metadata.get(_NESTED)
    return found


def threads_option() -> Any:
    """Return the field of the number of threads, which many options have."""
    return option(0, "Number of threads; 0 takes all cores", minimum=0, advanced=True, metavar="N")

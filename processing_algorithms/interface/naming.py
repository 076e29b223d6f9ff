"""How messages name options: the engine names arguments in backticks, and each face writes them as its users do."""

import re
from collections.abc import Callable, Iterable

from .declare import Kind, Param

_ARGUMENT = re.compile(r"`([a-z][a-z0-9_]*)`")


def option_label(param: Param) -> str:
    """Return an option as it stands on the command line: ``--sigma-image``, ``IMAGE``."""
    return (param.metavar or "IMAGE") if param.kind is Kind.IMAGES else f"--{param.name}"


def spell_arguments(text: str, params: Iterable[Param], spelling: Callable[[Param], str] = option_label) -> str:
    """Return a text with the arguments that it names as options: ```sigma_dem_m``` becomes ``--sigma-dem``.

    An argument that is no option of the algorithm keeps its name, without the backticks.
    """
    listed = list(params)
    known = {param.argument: param for param in listed} | {param.key: param for param in listed}
    return _ARGUMENT.sub(
        lambda found: spelling(known[found[1]]) if found[1] in known else found[1].replace("_", " "), text
    )

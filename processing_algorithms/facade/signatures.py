"""Signatures, descriptions and type stubs of the facade's functions, made from the declarations."""

import inspect
import textwrap
from collections.abc import Iterator
from typing import Any

from ..interface.command_parser import value_facts
from ..interface.declare import Algorithm, Kind, Param
from ..interface.naming import spell_arguments

#: Functions that are called otherwise than their algorithm.
RENAMED = {"refine-rpc": "refine"}
#: Types of values in stubs, by kind; choices are literals.
TYPES = {
    Kind.IMAGES: "Images",
    Kind.RASTER: "RasterSource",
    Kind.POINTS: "Points",
    Kind.FILE: "Path",
    Kind.CRS: "str",
    Kind.EXTENT: "str",
    Kind.TEXT: "str",
    Kind.IDS: "str | Iterable[str]",
    Kind.GROUPS: "str | Iterable[str | Iterable[str]]",
    Kind.RANGE: "str | float | tuple[float, float]",
    Kind.FOLDERS: "Mapping[str, Path] | Iterable[str]",
    Kind.INTEGER: "int",
    Kind.NUMBER: "float",
    Kind.FLAG: "bool",
    Kind.OUTPUT_DIR: "Path",
}
PROGRESS = "progress"


def function_name(algorithm: str) -> str:
    """Return what the function of an algorithm is called."""
    return RENAMED.get(algorithm, algorithm.replace("-", "_"))


def signature_of(algorithm: Algorithm) -> inspect.Signature:
    """Return the signature: what is needed may stand without its name, all else is named."""
    parameters = [
        inspect.Parameter(
            param.key,
            inspect.Parameter.POSITIONAL_OR_KEYWORD if _is_first(param) else inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if _is_needed(param) else param.default,
        )
        for param in _sort_parameters(algorithm)
    ]
    progress = inspect.Parameter(PROGRESS, inspect.Parameter.KEYWORD_ONLY, default=None)
    return inspect.Signature([*parameters, progress])


def _sort_parameters(algorithm: Algorithm) -> list[Param]:
    """Return the options with those first that may stand without their names, the needed ones before the others."""
    return sorted(
        algorithm.params, key=lambda param: (not _is_first(param), not (_is_first(param) and _is_needed(param)))
    )


def _is_first(param: Param) -> bool:
    return _is_needed(param) or param.kind is Kind.IMAGES


def _is_needed(param: Param) -> bool:
    return param.required and param.kind is not Kind.OUTPUT_DIR


def describe_call(algorithm: Algorithm) -> str:
    """Return the docstring of an algorithm's function, in NumPy's sections."""
    told = spell_arguments(algorithm.help, algorithm.params, lambda param: f"``{param.key}``")
    entries = [entry for param in _sort_parameters(algorithm) for entry in _parameter_entry(param, algorithm)]
    given = any(param.key == "output_dir" for param in algorithm.params)
    folder_note = "Without ``output_dir`` they go when the result does." if given else ""
    return "\n".join([
        f"{algorithm.summary}.",
        "",
        *_wrap_text(told, ""),
        "",
        "Parameters",
        "----------",
        *entries,
        f"{PROGRESS} : callable, optional",
        "    Called with a fraction and a message; False cancels.",
        "",
        "Returns",
        "-------",
        "Result",
        "    The report, its tables and files. " + folder_note,
        "",
        "Raises",
        "------",
        "HrsiError",
        "    What is wrong with the input, and what to do about it.",
        "",
    ])  # fmt: skip


def _parameter_entry(param: Param, algorithm: Algorithm) -> Iterator[str]:
    text = spell_arguments(param.help, algorithm.params, lambda other: f"``{other.key}``")
    facts = [fact for fact in value_facts(param) if fact != "required"]
    kind = " or ".join(PLAIN_TYPES.get(param.kind, "str").split(" | "))
    yield f"{param.key} : {kind}{'' if _is_needed(param) else ', optional'}"
    stated = f" ({'; '.join(facts)})" if facts else ""
    yield from _wrap_text(f"{text}{stated}.", "    ")


#: How the description calls a value, by kind.
PLAIN_TYPES = {
    Kind.IMAGES: "path | Image | sequence of them",
    Kind.RASTER: "path | rasterio dataset",
    Kind.POINTS: "path | table | array | GroundPoints | ImagePoints",
    Kind.FILE: "path",
    Kind.IDS: "sequence of str",
    Kind.GROUPS: "sequence of sequences of str",
    Kind.RANGE: "(float, float)",
    Kind.FOLDERS: "dict of str to path",
    Kind.INTEGER: "int",
    Kind.NUMBER: "float",
    Kind.FLAG: "bool",
    Kind.OUTPUT_DIR: "path",
}


def _wrap_text(text: str, indent: str) -> list[str]:
    lines: list[str] = []
    for paragraph in text.split("\n\n"):
        lines += ["", *textwrap.wrap(paragraph, 100, initial_indent=indent, subsequent_indent=indent)]
    return lines[1:]


def stub_of(algorithm: Algorithm) -> str:
    """Return the function as a stub (``.pyi``) has it, with types and description."""
    parts: list[str] = []
    parameters = signature_of(algorithm).parameters
    for param in _sort_parameters(algorithm):
        if parameters[param.key].kind is inspect.Parameter.KEYWORD_ONLY and "*" not in parts:
            parts.append("*")
        needed = parameters[param.key].default is inspect.Parameter.empty
        kind = f"Literal[{', '.join(map(_quote_text, param.choices))}]" if param.choices else TYPES[param.kind]
        parts.append(f"{param.key}: {kind}" if needed else f"{param.key}: {_optional_type(kind, param.default)}")
    parts += ([] if "*" in parts else ["*"]) + [f"{PROGRESS}: Progress | None = None"]
    body = textwrap.indent(f'"""{describe_call(algorithm)}"""', "    ", lambda line: line.strip() != "")
    listed = "".join(f"    {part},\n" for part in parts)
    return f"def {function_name(algorithm.name)}(\n{listed}) -> Result:\n{body}\n    ...\n"


def _optional_type(kind: str, default: Any) -> str:
    return f"{kind} | None = None" if default is None else f"{kind} = {_write_default(default)}"


def _write_default(default: Any) -> str:
    return _quote_text(default) if isinstance(default, str) else repr(default)


def _quote_text(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

"""Signatures and descriptions of the facade's functions, made from the declarations."""

import inspect
import textwrap

from ..interface.command_parser import value_facts
from ..interface.declare import Algorithm, Kind, Param
from ..interface.naming import spell_arguments
from ..interface.options import KINDS

#: Functions that are called otherwise than their algorithm.
RENAMED = {"refine-rpc": "refine"}
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
        for param in sort_parameters(algorithm)
    ]
    progress = inspect.Parameter(PROGRESS, inspect.Parameter.KEYWORD_ONLY, default=None)
    return inspect.Signature([*parameters, progress])


def sort_parameters(algorithm: Algorithm) -> list[Param]:
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
    entries: list[str] = []
    for param in sort_parameters(algorithm):
        text = spell_arguments(param.help, algorithm.params, lambda other: f"``{other.key}``")
        facts = [fact for fact in value_facts(param) if fact != "required"]
        kind = " or ".join(KINDS[param.kind].described.split(" | "))
        entries.append(f"{param.key} : {kind}{'' if _is_needed(param) else ', optional'}")
        stated = f" ({'; '.join(facts)})" if facts else ""
        entries += _wrap_text(f"{text}{stated}.", "    ")
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


def _wrap_text(text: str, indent: str) -> list[str]:
    lines: list[str] = []
    for paragraph in text.split("\n\n"):
        lines += ["", *textwrap.wrap(paragraph, 100, initial_indent=indent, subsequent_indent=indent)]
    return lines[1:]

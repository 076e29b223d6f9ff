"""From a declaration to an argument parser and its help page.

The parser only assigns words to options; `options.check_options` checks their values.
"""

import argparse
import re
import shutil
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ...hrsi_engine.foundation.errors import InputError
from ..interface.declare import COMMON_PARAMS, POSITIONAL_KINDS, Algorithm, Kind, Param, spell_arguments, value_facts
from ..interface.option_groups import LINE_PARAMS, OUTPUT_PARAMS
from ..interface.options import KINDS, suggestion

_NEGATIVE_VALUE = re.compile(r"-[.\d]")
#: Commands that are no algorithms, with their help.
COMMANDS = {
    "help": "Show the page of an algorithm",
    "rerun": "Repeat a run from its report.json, with other options where they are given",
    "completion": "Print what a shell needs to complete hrsi: bash, zsh or fish",
}
SHORT = {
    "output_dir": ["-o"],
    "output": ["-o"],
    "quiet": ["-q"],
    "format": ["-f"],
}  #: options with one letter, as in GDAL and POSIX
MOST_SHOWN = 12  #: most options that ``--help`` shows, with images, output directory and quiet
#: Headings of help pages.
IMAGES_TITLE, MAIN_TITLE, OUTPUT_TITLE, ADVANCED_TITLE, COMMON = (
    "images",
    "options",
    "output",
    "advanced options",
    "common options",
)
_LONG_OPTION = re.compile(r"--[a-z][a-z0-9-]*$")

#: Settings of argparse for options of a kind; options of every other kind take one word.
SPELLING: dict[Kind, dict[str, Any]] = {
    Kind.IMAGES: {"nargs": "*"},
    Kind.RESULT: {"nargs": "?"},
    Kind.PROJECT: {"nargs": "?"},
    Kind.FLAG: {"action": argparse.BooleanOptionalAction},
    Kind.FOLDERS: {"action": "append"},
}


class CommandParser(argparse.ArgumentParser):
    """An argument parser that raises `InputError`, and accepts options between the images."""

    def __init__(self, prog: str, **settings: Any) -> None:
        def formatter(prog: str) -> argparse.HelpFormatter:
            return argparse.RawDescriptionHelpFormatter(prog, max_help_position=30, width=_help_width())

        super().__init__(prog=prog, allow_abbrev=False, add_help=False, formatter_class=formatter, **settings)

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message.replace('argument ', '', 1)}; see {self.prog} --help")

    def parse_words(self, words: Sequence[str]) -> dict[str, Any]:
        """Return the given options as text; raise `InputError` for unknown options."""
        joined: list[str] = []
        for word in words:  # ``--height -3e1`` as ``--height=-3e1``: the parser takes some negative values for options
            if joined and _NEGATIVE_VALUE.match(word) and _LONG_OPTION.match(joined[-1]):
                joined[-1] += f"={word}"
            else:
                joined.append(word)
        namespace, unknown = self.parse_known_intermixed_args(joined)
        if unknown:
            word = unknown[0].partition("=")[0]
            near = suggestion(word, self._option_string_actions)
            raise InputError(f"unknown option {word}{near}; see {self.prog} --help")
        return vars(namespace)


def algorithm_parser(algorithm: Algorithm, groups: Mapping[str, Sequence[Param]] | None = None) -> CommandParser:
    """Return the parser of an algorithm's command line; for a help page with only some ``groups`` of its options."""
    prog = f"hrsi {algorithm.name}"
    words = [(value_name(param), param.kind) for param in algorithm.params if param.kind in POSITIONAL_KINDS]
    images = "".join(f" {word}{'...' if kind is Kind.IMAGES else ''}" for word, kind in words)
    # The examples for a shell, with line breaks before options
    lines = [f"example{'s' * (len(algorithm.examples) > 1)}:"] if algorithm.examples else []
    for example in algorithm.examples:
        lines.append("  ")
        for part in re.split(r" (?=--)", example):
            if len(lines[-1]) + len(part) > _help_width() - 3 and lines[-1].strip():
                lines[-1] += "\\"
                lines.append("    ")
            lines[-1] += f"{part} "
    paragraphs = [algorithm.summary, "\n".join(line.rstrip() for line in lines)]
    texts = spell_arguments(algorithm.help, algorithm.params).split("\n\n")
    paragraphs += [textwrap.fill(" ".join(text.split()), _help_width()) for text in texts]
    parser = CommandParser(
        prog,
        usage=f"{prog} [options]{images}",
        description="\n\n".join(filter(None, paragraphs)),
        argument_default=argparse.SUPPRESS,
    )
    for title, params in (groups or sections(algorithm.params)).items():
        section = parser.add_argument_group(title)
        for param in params:
            if param in LINE_PARAMS and param.kind is Kind.FLAG:  # flags that are false by default: no opposite
                section.add_argument(*SHORT.get(param.key, []), f"--{param.name}", action="store_true", help=param.help)
            else:
                add_option(section, param, [*algorithm.params, *LINE_PARAMS])
    return parser


def help_page(algorithm: Algorithm, whole: bool = False) -> str:
    """Return the page of ``--help``: examples and the most common options; with ``whole`` all options, in groups."""
    groups: dict[str, Sequence[Param]] = {**sections(algorithm.params)}
    if not whole:
        quiet = [param for param in LINE_PARAMS if param.key == "quiet"]
        images, output = groups.pop(IMAGES_TITLE, ()), [*groups.pop(OUTPUT_TITLE, ()), *quiet]
        others = [param for title, params in groups.items() if title != COMMON for param in params]
        chosen = [param for name in algorithm.main for param in others if param.name == name]
        shown = chosen or sorted((one for one in others if not one.advanced), key=lambda one: not one.required)
        groups = {
            IMAGES_TITLE: images,
            MAIN_TITLE: shown[: MOST_SHOWN - len(images) - len(output)],
            OUTPUT_TITLE: output,
        }
    page = algorithm_parser(algorithm, {title: params for title, params in groups.items() if params}).format_help()
    count = len(algorithm.params) + len(LINE_PARAMS)
    more = "for programs: --json-usage" if whole else f"all {count} options: hrsi {algorithm.name} --help-all"
    return f"{page}\n{more}\n"


def json_usage(algorithm: Algorithm) -> dict[str, Any]:
    """Return the declaration of an algorithm for programs: ``--json-usage``."""
    listed = [*algorithm.params, *LINE_PARAMS]
    changed = [{"kind": one.kind.value, "help": spell_arguments(one.help, listed), "short": SHORT.get(one.key),
                "positional": one.kind in POSITIONAL_KINDS, "metavar": value_name(one)} for one in listed]  # fmt: skip
    return {
        "name": algorithm.name,
        "summary": algorithm.summary,
        "examples": list(algorithm.examples),
        "description": " ".join(spell_arguments(algorithm.help, listed).split()),
        "options": [{**vars(one), **said} for one, said in zip(listed, changed, strict=True)],
    }


def add_option(section: argparse._ArgumentGroup, param: Param, params: Sequence[Param]) -> None:
    """Add a declared option to the parser; the parsed result contains its key only if the option is given."""
    settings = {"help": option_help(param, params), **SPELLING.get(param.kind, {})}
    if param.kind is not Kind.FLAG:
        settings["metavar"] = value_name(param)
    words = [param.key]
    if param.kind not in POSITIONAL_KINDS:
        words, settings["dest"] = [*SHORT.get(param.key, []), f"--{param.name}"], param.key
    section.add_argument(*words, default=argparse.SUPPRESS, **settings)


def option_help(param: Param, params: Sequence[Param]) -> str:
    """Return the help of an option, one of ``params``, with its choices, unit, range and default."""
    stated = "; ".join(value_facts(param))
    return (spell_arguments(param.help, params) + (f" [{stated}]" if stated else "")).replace("%", "%%")


def registry_help(registry: Mapping[str, Algorithm]) -> str:
    """Return the page of ``hrsi --help``: the algorithms by group, each with its summary."""
    width = max(map(len, registry), default=0)
    groups: dict[str, list[str]] = {}
    for name, algorithm in registry.items():
        first = f"  {name:{width}}  "
        text = textwrap.fill(algorithm.summary, _help_width(), initial_indent=first, subsequent_indent=" " * len(first))
        groups.setdefault(algorithm.group, []).append(text)
    listing = "\n\n".join("\n".join([f"{group}:", *texts]) for group, texts in groups.items())
    return read_template("hrsi.txt").format(listing=listing)


def read_template(name: str) -> str:
    """Return a text from the folder ``templates``."""
    return Path(__file__).with_name("templates").joinpath(name).read_text(encoding="utf-8")


def value_name(param: Param) -> str:
    """Return the placeholder of an option's value in the help: ``PX``."""
    return param.metavar or KINDS[param.kind].metavar


def sections(params: Iterable[Param]) -> dict[str, list[Param]]:
    """Return the options by headings of the help page: titles of dataclasses; at the end those of every algorithm."""
    listed: dict[str, list[Param]] = {IMAGES_TITLE: [], MAIN_TITLE: [], OUTPUT_TITLE: []}
    common: list[Param] = []
    outputs = {output.name for output in OUTPUT_PARAMS}  # a folder may be optional
    for param in params:
        group = param.group[:1].lower() + param.group[1:] or (ADVANCED_TITLE if param.advanced else MAIN_TITLE)
        heading = IMAGES_TITLE if param.kind in POSITIONAL_KINDS else OUTPUT_TITLE if param.name in outputs else group
        (common if param in COMMON_PARAMS else listed.setdefault(heading, [])).append(param)
    return {title: members for title, members in listed.items() if members} | {COMMON: [*common, *LINE_PARAMS]}


def split_log(words: Sequence[str]) -> tuple[str | None, list[str]]:
    """Return the file of ``--log``, and the other words; read before these are parsed, whose errors are logged too."""
    for place, word in enumerate(words):
        name, equals, value = word.partition("=")
        if name == "--log" and equals:
            return value or None, [*words[:place], *words[place + 1 :]]
        if name == "--log" and place + 1 < len(words):
            return words[place + 1], [*words[:place], *words[place + 2 :]]
    return None, list(words)


def _help_width() -> int:
    return min(shutil.get_terminal_size().columns, 100)

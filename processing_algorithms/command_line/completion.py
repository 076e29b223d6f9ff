"""Completion for shells: scripts made from the declarations, so that completion starts no Python.

The possible completions of a word are an `Offer`: words, files, folders, or nothing (a number, a text). The shell's own
completion does the rest: quoting, `~`, descending into folders.
"""

import shlex
from collections.abc import Callable, Mapping
from typing import NamedTuple

from ...hrsi_engine.foundation.errors import InputError
from ..interface.declare import POSITIONAL_KINDS, READ_KINDS, Algorithm, Kind, Param
from ..interface.options import suggestion
from .command_parser import COMMANDS, LINE_PARAMS, OUTPUT_PARAMS, option_help, read_template, value_name

_FOLDER_KINDS = (Kind.OUTPUT_DIR, Kind.FOLDERS)
_DESCRIPTION = 72  # characters of a help text that are shown with a word


class Offer(NamedTuple):
    """Possible words at the cursor, and whether names of files or of folders are possible there."""

    words: tuple[str, ...]
    files: bool
    folders: bool


def completion_script(shell: str, registry: Mapping[str, Algorithm]) -> str:
    """Return the completion script of ``hrsi`` for a shell; raise `InputError` for an unknown shell."""
    if shell not in SHELLS:
        raise InputError(f"there is no completion for {shell!r}{suggestion(shell, SHELLS)}: give {', '.join(SHELLS)}")
    return SHELLS[shell](registry)


def offer_of(param: Param) -> Offer:
    """Return the completions of an option's value."""
    files = param.kind in READ_KINDS or bool(set(param.metavar.split("|")) & {"FILE", "DIR"})
    return Offer((*param.choices, *param.words), files, param.kind in _FOLDER_KINDS)


def _option_words(param: Param) -> tuple[str, ...]:
    """Return the spellings of an option; for a flag of an algorithm also that with ``no-``."""
    if param.kind is Kind.FLAG and param not in LINE_PARAMS:
        return f"--{param.name}", f"--no-{param.name}"
    return () if param.kind in POSITIONAL_KINDS else (f"--{param.name}",)


def _params_by_command(registry: Mapping[str, Algorithm]) -> dict[str, tuple[Param, ...]]:
    """Return the options of each algorithm, and of ``rerun``, with the command line's own options."""
    commands = {name: (*algorithm.params, *LINE_PARAMS) for name, algorithm in registry.items()}
    return commands | {"rerun": (*OUTPUT_PARAMS, *LINE_PARAMS)}


def _summaries_of(registry: Mapping[str, Algorithm]) -> dict[str, str]:
    return {name: algorithm.summary.replace("`", "") for name, algorithm in registry.items()} | COMMANDS


def _short_help(param: Param, params: tuple[Param, ...]) -> str:
    """Return the beginning of an option's help, for one line."""
    text = " ".join(option_help(param, params).replace("%%", "%").partition(" [")[0].split())
    return text if len(text) <= _DESCRIPTION else f"{text[: _DESCRIPTION - 1].rstrip()}…"


# ---- bash ------------------------------------------------------------------------------------------------------------


def _bash_script(registry: Mapping[str, Algorithm]) -> str:
    options, values = [], []
    for name, params in _params_by_command(registry).items():
        words = " ".join(word for param in params for word in _option_words(param))
        options.append(f"    {name}) echo {shlex.quote(words)} ;;")
        for param in params:
            if param.kind not in (*POSITIONAL_KINDS, Kind.FLAG):
                offer = offer_of(param)
                given = " ".join([*offer.words, *["FILES"] * offer.files, *["FOLDERS"] * offer.folders]) or "NOTHING"
                values.append(f'    "{name} --{param.name}") echo {shlex.quote(given)} ;;')
    return read_template("hrsi.bash").format(
        options="\n".join(options),
        values="\n".join(values),
        commands=" ".join([*registry, *COMMANDS]),
        algorithms=" ".join(registry),
        shells=" ".join(SHELLS),
    )


# ---- zsh -------------------------------------------------------------------------------------------------------------


def _zsh_script(registry: Mapping[str, Algorithm]) -> str:
    commands = [f"    {shlex.quote(f'{name}:{_zsh_text(text)}')}" for name, text in _summaries_of(registry).items()]
    cases = []
    for name, params in _params_by_command(registry).items():
        specs = []
        for param in params:
            text = _zsh_text(_short_help(param, params))
            offer, words = offer_of(param), " ".join(offer_of(param).words)
            action = "_files" if offer.files else "_files -/" if offer.folders else " "
            if words:
                action = f" _hrsi_words_or_files {words}" if offer.files else f"({words})"
            value = "" if param.kind is Kind.FLAG else f":{_zsh_text(value_name(param))}:{action}"
            specs += [f"{word}[{text}]{value}" for word in _option_words(param)]
        specs.append("*:file:_files")
        cases.append(" \\\n      ".join([f"    {name}) _arguments", *map(shlex.quote, specs)]) + " ;;")
    return read_template("hrsi.zsh").format(
        commands="\n".join(commands), cases="\n".join(cases), algorithms=" ".join(registry), shells=" ".join(SHELLS)
    )


def _zsh_text(text: str) -> str:
    return text.replace("[", "(").replace("]", ")").replace(":", "\\:")


# ---- fish ------------------------------------------------------------------------------------------------------------


def _fish_script(registry: Mapping[str, Algorithm]) -> str:
    first = "complete -c hrsi -n __fish_use_subcommand"
    lines = [f"{first} -a {name} -d {_fish_text(text)}" for name, text in _summaries_of(registry).items()]
    lines += [f"{first} -l {name}" for name in ("help", "version")]
    words = {"help": registry, "completion": SHELLS}
    lines += [f"{_fish_behind(name)} -a {_fish_text(' '.join(known))}" for name, known in words.items()]
    for name, params in _params_by_command(registry).items():
        behind = _fish_behind(name)
        lines.append(f"{behind} -F")
        for param in params:
            offer, text = offer_of(param), _fish_text(_short_help(param, params))
            value = "-a '(__fish_complete_directories)' " if offer.folders else ""
            if offer.words and not offer.folders:
                value = f"-a {_fish_text(' '.join(offer.words))} "
            value = "" if param.kind is Kind.FLAG else ("-r -F " if offer.files else "-x ") + value
            lines += [f"{behind} -l {word.removeprefix('--')} {value}-d {text}" for word in _option_words(param)]
    return read_template("hrsi.fish").format(lines="\n".join(lines))


def _fish_behind(command: str) -> str:
    return f"complete -c hrsi -n '__fish_seen_subcommand_from {command}'"


def _fish_text(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


SHELLS: dict[str, Callable[[Mapping[str, Algorithm]], str]] = {
    "bash": _bash_script,
    "zsh": _zsh_script,
    "fish": _fish_script,
}

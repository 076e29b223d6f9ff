"""The command ``hrsi ALGORITHM [options] IMAGE...``: results on stdout, progress and one-line errors on stderr."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from ...hrsi_engine.foundation.errors import Cancelled, HrsiError, InputError, SolveError
from ...hrsi_engine.foundation.interruption import ending, quit_on_signals, signals_as_exceptions
from ...hrsi_engine.foundation.version import VERSION
from .. import REGISTRY
from .command_parser import algorithm_parser, registry_help
from .declare import Algorithm, Context, is_unusable, unusable_text
from .naming import spell_arguments
from .options import checked_options, find_algorithm
from .terminal import SilentTerminal, TerminalProgress

UNUSABLE = 3  #: exit code of a result that was written for looking only
_OWN_PACKAGE = __name__.partition(".")[0]
_DEBUG = "HRSI_DEBUG"  #: environment variable: any text but 0 shows tracebacks


def main(words: Sequence[str] | None = None, registry: Mapping[str, Algorithm] = REGISTRY) -> int:
    """Run the command line and return its exit code.

    0 done, 1 not solved, 2 wrong input, 3 the result is unusable, 130 interrupted, 143 terminated.
    """
    try:
        with signals_as_exceptions():
            return _main(words, registry)
    except KeyboardInterrupt as error:  # outside the work: before it, after it, or while its error was being told
        if ending() is None:  # none of ours
            raise
        message, code = describe(error)
        print(f"ERROR: {message}", file=sys.stderr)
        return code


def _main(words: Sequence[str] | None, registry: Mapping[str, Algorithm]) -> int:
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # terminals that lack a letter of a name or a unit
    given = list(sys.argv[1:] if words is None else words)
    try:
        code = _dispatch(given, registry)
        sys.stdout.flush()  # a reader that has gone is noticed here, not at exit
        return code
    except BrokenPipeError:  # the reader of our output has gone: `hrsi ... | head`
        _silence_stdout()
        return 1
    except (Exception, KeyboardInterrupt) as error:
        message, code = describe(error)
        algorithm = registry.get(given[0]) if given else None
        print(f"ERROR: {spell_arguments(message, algorithm.params if algorithm else ())}", file=sys.stderr)
        if os.environ.get(_DEBUG, "0") not in ("", "0"):
            traceback.print_exception(error)
        return code


def describe(error: BaseException) -> tuple[str, int]:
    """Return what the user reads of an error, on one line, and the exit code.

    Once a signal has come, every error that ends the work is taken for its consequence.
    """
    if (signalled := ending()) is not None:
        code, message = signalled
        return message, code
    for kind, description in DESCRIPTIONS.items():
        if isinstance(error, kind):
            message, code = description(error)
            return " ".join(message.split()), code
    raise error


def _dispatch(words: list[str], registry: Mapping[str, Algorithm]) -> int:
    if not words:
        raise InputError("no algorithm given; hrsi --help lists them")
    first, *rest = words
    if first in PAGES:
        print(PAGES[first](registry))
    elif first.startswith("-"):
        raise InputError(f"{first} stands before the algorithm; write hrsi ALGORITHM [options] IMAGE...")
    elif HELP & set(rest):
        print(algorithm_parser(find_algorithm(registry, first)).format_help(), end="")
    else:
        return _run_algorithm(find_algorithm(registry, first), rest)
    return 0


def _run_algorithm(algorithm: Algorithm, words: list[str]) -> int:
    """Run an algorithm and print what came out; return 1 where it found no solution, 3 where none can be used."""
    given = algorithm_parser(algorithm).parse_words(words)
    quiet, as_json = given.pop("quiet", False), given.pop("json", False)
    options = checked_options(algorithm, given)
    terminal = (SilentTerminal if quiet else TerminalProgress)(sys.stderr)
    spelt = partial(spell_arguments, params=algorithm.params)
    try:
        with contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext():
            told = Context(
                terminal.progress,
                lambda message: terminal.log(spelt(message)),
                command=shlex.join(["hrsi", algorithm.name, *words]),
            )
            report = algorithm.execute(options, told)
        terminal.finish()
    finally:
        terminal.break_line()
    if as_json:
        from ...hrsi_engine.foundation.json_values import json_text  # loads NumPy, which help does without

        print(json_text(report, indent=2))
    elif not (quiet and options.get("output_dir")):  # what lies in files needs no summary; else stdout is the result
        print(spelt(algorithm.summarise(report)))
    if unsolved := report.get("unsolved"):
        print(f"ERROR: {spelt(unsolved)}", file=sys.stderr)
        return SolveError.exit_code
    if not is_unusable(report):
        return 0
    if quiet or as_json:
        print(f"ERROR: {spelt(unusable_text(report))}", file=sys.stderr)
    return UNUSABLE


def _describe_own(error: BaseException) -> tuple[str, int]:
    return str(error), getattr(error, "exit_code", 1)


def _describe_interrupt(error: BaseException) -> tuple[str, int]:
    return "interrupted; no half-written file is left", Cancelled.exit_code


def _describe_missing_package(error: BaseException) -> tuple[str, int]:
    package = getattr(error, "name", None) or "needed"
    if package.startswith(f"{_OWN_PACKAGE}."):
        return _describe_unexpected(error)
    return f"the Python package {package} cannot be loaded ({error}); see README.md on how to install HRSI", 1


def _describe_system(error: BaseException) -> tuple[str, int]:
    return f"{error}; check the path, the permissions and the free space", 1


def _describe_memory(error: BaseException) -> tuple[str, int]:
    return "out of memory; use fewer --threads or smaller images", 1


def _describe_unexpected(error: BaseException) -> tuple[str, int]:
    frames = traceback.extract_tb(error.__traceback__)
    place = f" in {os.path.basename(frames[-1].filename)}:{frames[-1].lineno}" if frames else ""
    return (
        f"unexpected {type(error).__name__}{place}: {error}; this is a fault of HRSI, please report it "
        f"with the command and what it prints under {_DEBUG}=1",
        1,
    )


#: How errors are told, by class; the first that fits counts.
DESCRIPTIONS: dict[type[BaseException], Callable[[BaseException], tuple[str, int]]] = {
    HrsiError: _describe_own,
    KeyboardInterrupt: _describe_interrupt,
    ImportError: _describe_missing_package,
    MemoryError: _describe_memory,
    OSError: _describe_system,
    Exception: _describe_unexpected,
}
HELP = {"--help", "-h"}
#: What is printed instead of running an algorithm.
PAGES: dict[str, Callable[[Mapping[str, Algorithm]], str]] = {
    **dict.fromkeys(HELP, registry_help),
    "--version": lambda registry: f"hrsi {VERSION}",
}


def _silence_stdout() -> None:
    """Point stdout nowhere, so that Python does not complain about the broken pipe at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    exit_code = main()
    quit_on_signals()
    sys.exit(exit_code)

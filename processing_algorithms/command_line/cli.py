"""The command ``hrsi ALGORITHM [options] IMAGE...``: results on stdout, progress and one-line errors on stderr."""

import contextlib
import gc
import io
import os
import shlex
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from ...hrsi_engine.foundation.errors import Cancelled, HrsiError, InputError, SolveError
from ...hrsi_engine.foundation.interruption import ending, quit_on_signals, signals_as_exceptions
from ...hrsi_engine.foundation.shared_heap import share_one_heap
from ...hrsi_engine.foundation.version import VERSION
from .. import REGISTRY
from ..interface.declare import Algorithm, Context, Report, fill_options, is_unusable, spell_arguments, unusable_text
from ..interface.option_groups import LINE_PARAMS, LineOptions
from ..interface.options import TYPED, OptionSource, check_options, find_algorithm
from .command_parser import COMMANDS, algorithm_parser, help_page, json_usage, read_template, registry_help, split_log
from .terminal import RunLog, TerminalProgress, require_own_file, terminal_of

UNUSABLE = 3  #: exit code of a result that is written but unusable
_OWN_PACKAGE = __name__.partition(".")[0]
FILE_CLOCK_S = 2.0  #: resolution of the times of file systems
_NEW_OBJECTS = 50_000  # objects between two searches for reference cycles; HRSI makes few
_DEBUG = "HRSI_DEBUG"  #: environment variable: any text but 0 shows tracebacks


def run_process() -> int:
    """Run the command line in a process of its own; return its exit code."""
    gc.set_threshold(_NEW_OBJECTS)
    share_one_heap()
    try:
        return main()
    finally:
        gc.freeze()  # the system frees all memory at once
        quit_on_signals()  # signals end the process while the interpreter ends


def main(words: Sequence[str] | None = None, registry: Mapping[str, Algorithm] = REGISTRY) -> int:
    """Run the command line and return its exit code.

    0: done, 1: not solved, 2: wrong input, 3: the result is unusable, 130: interrupted, 143: terminated.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # for terminals that lack a character
    given = list(sys.argv[1:] if words is None else words)
    try:
        with signals_as_exceptions():
            try:
                code = _dispatch_command(given, registry)
                sys.stdout.flush()  # a closed pipe is noticed here, not at exit
            except BrokenPipeError:  # the reader of the output has ended: `hrsi ... | head`
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python prints an error at exit
                return 1
            except (Exception, KeyboardInterrupt) as error:
                message, code = describe(error)
                algorithm = registry.get(given[0]) if given else None
                print(f"ERROR: {spell_arguments(message, algorithm.params if algorithm else ())}", file=sys.stderr)
                if os.environ.get(_DEBUG, "0") not in ("", "0"):
                    traceback.print_exception(error)
            return code
    except KeyboardInterrupt as error:  # before or after the run, or while an error was printed
        if ending() is None:  # not sent as a signal
            raise
        message, code = describe(error)
        print(f"ERROR: {message}", file=sys.stderr)
        return code


def describe(error: BaseException) -> tuple[str, int]:
    """Return the message of an error for the user, on one line, and the exit code.

    After a signal, every error that ends the run is regarded as its consequence.
    """
    if (signalled := ending()) is not None:
        code, message = signalled
        return message, code
    code = 1
    if isinstance(error, HrsiError):
        message, code = str(error), getattr(error, "exit_code", 1)
    elif isinstance(error, KeyboardInterrupt):
        message, code = "interrupted; no half-written file is left", Cancelled.exit_code
    elif isinstance(error, ImportError) and not (error.name or "").startswith(f"{_OWN_PACKAGE}."):
        package = error.name or "needed"
        message = f"the Python package {package} cannot be loaded ({error}); see README.md on how to install HRSI"
    elif isinstance(error, MemoryError):
        message = "out of memory; use fewer --threads or smaller images"
    elif isinstance(error, OSError):
        message = f"{error}; check the path, the permissions and the free space"
    elif isinstance(error, Exception):
        frames = traceback.extract_tb(error.__traceback__)
        place = f" in {os.path.basename(frames[-1].filename)}:{frames[-1].lineno}" if frames else ""
        message = (
            f"unexpected {type(error).__name__}{place}: {error}; this is a fault of HRSI, please report it "
            f"with the command and what it prints under {_DEBUG}=1"
        )
    else:
        raise error
    return " ".join(message.split()), code


def _dispatch_command(words: list[str], registry: Mapping[str, Algorithm]) -> int:
    """Print a page, or run an algorithm; return the exit code. Raises `InputError` for words that are neither."""
    if not words:
        raise InputError("no algorithm given; hrsi --help lists them")
    first, *rest = words
    if first in HELP:
        print(registry_help(registry))
    elif first == "--version":
        print(version_page())
    elif first == "help":
        print(_help_page(rest, registry), end="")
    elif first == "completion":
        from .completion import SHELLS, completion_script

        if len(rest) != 1:
            raise InputError(f"completion needs the name of a shell: hrsi completion {'|'.join(SHELLS)}")
        print(completion_script(rest[0], registry), end="")
    elif first == "rerun" and not HELP & set(rest):
        from .rerun import read_past_run  # loads NumPy, which help does without

        return _run_algorithm(*read_past_run(rest, registry))
    elif first.startswith("-"):
        raise InputError(f"{first} is before the algorithm; write hrsi ALGORITHM [options] IMAGE...")
    elif HELP & set(rest):
        print(_help_page([first], registry), end="")
    elif {HELP_ALL, JSON_USAGE} & set(rest):
        algorithm = find_algorithm(registry, first, COMMANDS)
        print(help_page(algorithm, whole=True) if HELP_ALL in rest else _format_json(json_usage(algorithm)), end="")
    else:
        return _run_algorithm(find_algorithm(registry, first, COMMANDS), rest)
    return 0


def _help_page(words: list[str], registry: Mapping[str, Algorithm]) -> str:
    """Return the page of an algorithm or of a command; without a name, or for several, the list of algorithms."""
    if len(words) != 1 or words[0] in HELP:
        return f"{registry_help(registry)}\n"
    if words[0] in COMMANDS:  # no algorithms
        return read_template(f"{words[0]}.txt")
    return help_page(find_algorithm(registry, words[0], COMMANDS))


def _format_json(value: Mapping[str, Any]) -> str:
    from ...hrsi_engine.foundation.json_values import json_text  # loads NumPy, which help does without

    return f"{json_text(value, indent=2)}\n"


def _run_algorithm(algorithm: Algorithm, words: list[str], origin: OptionSource = TYPED) -> int:
    """Run an algorithm with typed options and print its results; ``origin`` has further options.

    Returns 0, or 1 without a solution, 2 if a dry run finds wrong inputs, 3 if the result is unusable.
    """
    spelt = partial(spell_arguments, params=algorithm.params)
    # The log is opened first, so that it contains errors in the options too
    log: RunLog | None = None
    path, others = split_log(words)
    if path is not None:
        given = [item for value in origin.given.values() for item in (value if isinstance(value, list) else [value])]
        require_own_file(path, [*others, *(item for item in given if isinstance(item, str))])
        log = RunLog(path, spelt)
        log.write("START", f"{shlex.join(['hrsi', algorithm.name, *words])} (version {VERSION})")
    try:
        code = _run_words(algorithm, words, origin, log)
    except (Exception, KeyboardInterrupt) as error:
        if log is not None:
            log.write("ERROR", spelt(describe(error)[0]))
        raise
    if log is not None:
        log.write("END", f"exit code {code}")
    return code


def _run_words(algorithm: Algorithm, words: list[str], origin: OptionSource, log: RunLog | None) -> int:
    """Run an algorithm with typed options and print its report; return the exit code.

    Results go to standard output, progress and messages to standard error, each message once; both also to the log.
    """
    spelt = partial(spell_arguments, params=algorithm.params)
    typed = {**origin.given, **algorithm_parser(algorithm).parse_words(words)}
    line = fill_options(LineOptions, typed)
    keys = {param.key for param in LINE_PARAMS}
    options = check_options(algorithm, {key: value for key, value in typed.items() if key not in keys})
    if str(options.get("output_dir") or "").startswith("/vsimem"):
        raise InputError(f"{options['output_dir']} lies in memory, where nothing would remain: name a directory")
    terminal, begun = terminal_of(sys.stderr, line.quiet), time.time()
    listeners: list[TerminalProgress | RunLog] = [terminal, *([log] if log else [])]

    def report_progress(fraction: float, message: str = "") -> bool:
        return all([listener.progress(fraction, message) for listener in listeners])

    told: set[str] = set()

    def tell(message: str) -> None:
        text = spelt(message)
        if text not in told:
            told.add(text)
            for listener in listeners:
                listener.log(text)

    context = Context(
        report_progress,
        tell,
        command="" if origin.given else shlex.join(["hrsi", algorithm.name, *words]),
        record=dict(origin.record),
        dry_run=line.dry_run,
    )
    try:
        for message in origin.messages:
            context.log(message)
        with contextlib.redirect_stdout(sys.stderr) if line.json else contextlib.nullcontext():
            report = algorithm.execute(options, context)
        for listener in listeners:
            listener.finish()
    finally:
        terminal.break_line()
    folder = options.get("output_dir") or report.get("folder")
    summary = "" if line.json and log is None else spelt(algorithm.summarise(report))
    if log is not None:
        for text in filter(None, map(str.strip, summary.splitlines())):
            log.write("RESULT", text)
    if line.json:
        print(_format_json(report), end="")
    elif line.dry_run or not (folder or report.get("outputs")):  # the lines are the result
        print(summary)
    elif not line.quiet:
        outputs = list_outputs(report, folder, begun)
        told.update(outputs)  # summaries may list them too
        print("\n".join(text for text in summary.strip("\n").splitlines() if text not in told), file=sys.stderr)
        print("\n".join(outputs))
    return _judge_report(report, line, spelt, log)


def _judge_report(report: Report, line: LineOptions, spelt: Callable[[str], str], log: RunLog | None) -> int:
    """Return the exit code for a report, and print the reason if it is not 0."""
    if unsolved := report.get("unsolved"):
        code, reason = int(report.get("exit_code", SolveError.exit_code)), str(unsolved)
    elif is_unusable(report):
        code, reason = InputError.exit_code if report.get("dry_run") else UNUSABLE, unusable_text(report)
    else:
        return 0
    if code != UNUSABLE or line.quiet or line.json or line.dry_run:  # a summary ends with the verdict
        print(f"ERROR: {spelt(reason)}", file=sys.stderr)
    if log is not None:
        log.write("ERROR", spelt(reason))
    return code


def list_outputs(report: Mapping[str, Any], folder: str | None, begun: float) -> list[str]:
    """Return the paths of a run's results: those in its report, and files of the folder changed since ``begun`` (s)."""
    from ...hrsi_engine.io.output_dir import find_image_outputs  # loads GDAL

    outputs = report.get("outputs")
    named = [*(outputs.values() if isinstance(outputs, Mapping) else ()), *find_image_outputs(report).values()]
    found = []
    for place, folders, files in os.walk(folder) if folder else ():
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        paths = [os.path.join(place, name) for name in sorted(files) if not name.startswith(".")]
        found += [path for path in paths if os.path.getmtime(path) >= begun - FILE_CLOCK_S]
    known = {os.path.realpath(path): path for path in [*found, *(path for path in named if isinstance(path, str))]}
    return list(known.values())


HELP, HELP_ALL, JSON_USAGE = {"--help", "-h"}, "--help-all", "--json-usage"


def version_page() -> str:
    """Return the version of HRSI, followed by those of the libraries that can be loaded."""
    try:
        from ...hrsi_engine.io.catalogue.lineage import versions

        lines = {name: text for name, text in versions().items() if name != "hrsi"}
    except ImportError as error:
        lines = {"libraries": f"cannot be loaded ({error}); see README.md on how to install HRSI"}
    width = max(map(len, lines))
    return "\n".join([f"hrsi {VERSION}", *(f"{name:{width}} {text}" for name, text in lines.items())])


if __name__ == "__main__":
    sys.exit(run_process())

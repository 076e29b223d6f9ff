"""The declaration of an algorithm, from which the command line, the QGIS dialog and the documentation are made."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from enum import Enum
from functools import cached_property
from importlib import import_module
from typing import Any, TypeVar

from ...hrsi_engine.foundation.interruption import quitting_on_signals
from ...hrsi_engine.foundation.options import InMemory, Option, inner_options_of, option_of, options, threads_option
from ...hrsi_engine.foundation.progress import Progress, stage
from ...hrsi_engine.foundation.reasons import Level

Report = dict[str, Any]
Log = Callable[[str], None]
Filled = TypeVar("Filled")
_ROOT = __name__.removesuffix(".processing_algorithms.interface.declare")
#: Modules of the engine that a run needs, imported when it begins.
_WHEN_RUN = (
    "io.rasters.images",
    "foundation.json_values",
    "io.safety.transactions",
    "io.catalogue.deliveries",
    "io.catalogue.lineage",
    "foundation.workers.threads",
)
POSITIONS_CRS = "EPSG:4979"  #: CRS of all ground positions in results: longitude, latitude, ellipsoidal height
SCHEMA = 1  #: version of the format of reports
#: Folder of quick-looks in that of a result, and ends of their names: by the given and by the refined RPCs.
QUICK_LOOKS, STATES = "quick_looks", ("before", "after")


class Kind(Enum):
    """Type of a parameter, for argument parsing, dialogs and documentation."""

    IMAGES = "images"  #: one or more images or RPC files; the positional arguments
    RASTER = "raster"  #: one raster file
    POINTS = "points"  #: a vector layer or CSV (``FILE`` or ``FILE|layername=L``)
    FILE = "file"
    CRS = "crs"  #: a coordinate reference system: EPSG:code or WKT
    EXTENT = "extent"  #: a word, or a box on the map: ``W,S,E,N``, or ``W,S,E,N [CRS]``
    TEXT = "text"
    IDS = "ids"  #: identifiers, separated by commas
    CHOICE = "choice"
    INTEGER = "integer"
    NUMBER = "number"
    FLAG = "flag"
    GROUPS = "groups of ids"  #: joined by + within a group, separated by commas: ``A+B,C+D``
    RANGE = "range"  #: two numbers ``LOW,HIGH``, or one for both
    RESULT = "result folder"  #: of an earlier run; positional
    FOLDERS = "named folders"  #: ``NAME=DIR``; repeated for each
    PROJECT = "project file"  #: TOML; positional
    OUTPUT_DIR = "output directory"


#: Kind of an option by the type of its field; a text with choices is a choice.
KIND_OF_TYPE = {
    "bool": Kind.FLAG,
    "int": Kind.INTEGER,
    "float": Kind.NUMBER,
    "str": Kind.TEXT,
    "tuple[str, ...]": Kind.IDS,
    "tuple[tuple[str, ...], ...]": Kind.GROUPS,
    "tuple[float, float]": Kind.RANGE,
}


#: Kinds of parameters that name files to read.
READ_KINDS = (Kind.IMAGES, Kind.RASTER, Kind.POINTS, Kind.FILE, Kind.RESULT, Kind.PROJECT)
#: Layer that is used for the folder of a result, by the option's key; other options choose it themselves.
LAYER_OF_RESULT = {"terrain_points": "ground_points", "gcps": "ground_points"}
#: Kinds of parameters that are positional on the command line.
POSITIONAL_KINDS = (Kind.IMAGES, Kind.RESULT, Kind.PROJECT)


@dataclass(frozen=True)
class Param:
    """One option: ``name`` as on the command line (``sigma-dem``), ``help`` without a full stop at the end.

    ``argument`` is the field of the dataclass (``sigma_dem_m``), as in messages; ``group`` is the title of that
    dataclass, under which ``--help-all`` lists the option.
    """

    name: str
    kind: Kind
    help: str
    default: Any = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    required: bool = False
    advanced: bool = False
    minimum: float | None = None
    maximum: float | None = None
    metavar: str = ""
    piped: bool = False  #: if it is not given, standard input is read; dialogs, which have none, require it
    argument: str = ""
    group: str = field(default="", compare=False)

    @property
    def words(self) -> tuple[str, ...]:
        """Words accepted instead of a file or box: the lower-case ones of a metavar like ``auto|none|FILE``."""
        parts = self.metavar.split("|")
        takes_more = "FILE" in parts or self.kind is Kind.EXTENT
        return tuple(part for part in parts if part.isalnum() and part.islower()) if takes_more else ()

    @property
    def key(self) -> str:
        """Name as a Python keyword: ``sigma_image``."""
        return self.name.replace("-", "_")


@dataclass(frozen=True)
class Context:
    """Arguments of an algorithm besides its options.

    progress : callback for the progress; False cancels
    log : callback for messages, one line each
    command : the run as the user typed it; otherwise it is made from the options
    inputs : files that the options name for reading: no result may replace them
    record : entries at the beginning of every report: algorithm, date, options, inputs
    dry_run : whether inputs are only read and checked, and nothing is computed or written
    """

    progress: Progress
    log: Log
    command: str = ""
    inputs: tuple[str, ...] = ()
    record: Report = field(default_factory=dict)
    dry_run: bool = False

    def stage(self, begin: float, end: float) -> Context:
        """Return the context of a part of the work, whose progress is between two fractions of the whole."""
        return replace(self, progress=stage(self.progress, begin, end))


def params_of(options: type) -> tuple[Param, ...]:
    """Return the options that a dataclass declares, nested ones at their place; a shared option is listed once."""
    found: dict[str, Param] = {}
    for part in fields(options):
        inner, said = inner_options_of(part), option_of(part)
        declared = params_of(inner) if inner is not None else (_declare_param(part, said),) if said is not None else ()
        title = re.split(r"[.;:]", inner.__doc__ or "")[0] if inner is not None else ""
        for param in declared if not title else (replace(one, group=one.group or title) for one in declared):
            if found.setdefault(param.name, param).default is not param.default:
                raise TypeError(f"{options.__name__} declares the option {param.name} twice, with different defaults")
    return tuple(found.values())


def _declare_param(part: Field[Any], said: Option) -> Param:
    """Return the declaration of an option from a dataclass field."""
    required = part.default is MISSING
    return Param(
        name=said.name or part.name.replace("_", "-"),
        kind=Kind(said.kind or (Kind.CHOICE if said.choices else KIND_OF_TYPE[str(part.type).removesuffix(" | None")])),
        help=said.help,
        default=None if required else part.default,
        choices=said.choices,
        unit=said.unit,
        required=required,
        advanced=said.advanced,
        minimum=said.minimum,
        maximum=said.maximum,
        metavar=said.metavar,
        piped=said.piped,
        argument=part.name,
    )


def fill_options(options: type[Filled], values: Mapping[str, Any]) -> Filled:
    """Return the dataclass of options with values by key; options without a value keep their default."""
    given: dict[str, Any] = {}
    for part in fields(options):  # type: ignore[arg-type]
        inner, said = inner_options_of(part), option_of(part)
        if inner is not None:
            given[part.name] = fill_options(inner, values)
        elif said is not None and (key := _declare_param(part, said).key) in values:
            given[part.name] = values[key]
    return options(**given)


def settings_of(options: Any) -> dict[str, Any]:
    """Return the options that are given or have a default, by key, as they are stored in a report."""
    found: dict[str, Any] = {}
    for part in fields(options):
        value = getattr(options, part.name)
        said = option_of(part)
        if inner_options_of(part) is not None:
            found |= settings_of(value)
        elif said is not None and value is not None and value != ():
            found[_declare_param(part, said).key] = _plain_value(value)
    return found


def _plain_value(value: Any) -> Any:
    """Return a value for JSON, with groups of ids as they are typed."""
    if not isinstance(value, tuple):
        return value
    return ["+".join(item) if isinstance(item, tuple) else item for item in value]


def format_default(param: Param) -> str | None:
    """Return a default of several words or numbers as a user types it; None if there is none."""
    plain = _plain_value(param.default)
    if not isinstance(plain, list):
        return None if plain is None else str(plain)
    return _join_items(dict.fromkeys(plain)) or None


def value_facts(param: Param) -> list[str]:
    """Return the facts on an option's value for its help: choices, unit, range, and default or ``required``."""
    default = param.default
    if isinstance(default, bool):
        default = "yes" if default else "no"
    elif default is not None:
        default = f"{default:g}" if param.kind is Kind.NUMBER else format_default(param)
    facts = [
        f"one of {', '.join(param.choices)}" if param.choices else "",
        f"unit {param.unit}" if param.unit else "",
        f"at least {param.minimum:g}" if param.minimum is not None else "",
        f"at most {param.maximum:g}" if param.maximum is not None else "",
        "required" if param.required else f"default {default}" if default else "",
    ]
    return [fact for fact in facts if fact]


def _join_items(items: Iterable[Any]) -> str:
    """Return items as they are typed in one word: ``A,B``, ``0.5,2``."""
    return ",".join(f"{item:g}" if isinstance(item, float) else str(item) for item in items)


@options
class Common:
    """Options of every algorithm, which the declarations do not repeat."""

    threads: int = threads_option()


COMMON_PARAMS = tuple(replace(one, group="Options of every algorithm") for one in params_of(Common))


@dataclass(frozen=True)
class Algorithm:
    """A declared algorithm.

    name : as on the command line
    title, group, summary, help : texts for users; they name options as arguments in backticks
    options : dataclass of the options, which are its fields (`params_of`)
    module : with ``run(options, context)``, which returns the report as a dict for JSON (its key ``unsolved`` is a
    line on why there is no solution, if that is no error), and ``summarise(report)``, which returns a few lines for
    the user; it is imported when the algorithm runs, so that it may have heavy imports. By default it has the
    algorithm's name, in the folder above the declarations
    examples : command lines that run on the example data of ``hrsi simulate``
    main : options that ``--help`` shows, besides images and output; by default the first that are not advanced
    layers : layers of the result that are shown on a map, as ``file|layername=…`` below the output directory
    images_made : name of the images that it writes, if any (``images.*.output`` of the report); in a model they are the
    input of the next step; ``are_maps`` if they have map coordinates, so that they are shown on a map
    """

    name: str
    title: str
    group: str
    summary: str
    help: str
    options: type
    module: str = ""
    examples: tuple[str, ...] = ()
    main: tuple[str, ...] = ()
    layers: tuple[str, ...] = ()
    images_made: str = ""
    are_maps: bool = False

    @property
    def work_module(self) -> str:
        """The module with ``run`` and ``summarise``."""
        package = self.options.__module__.partition(".declarations.")[0]
        return self.module or f"{package}.{self.name.replace('-', '_')}"

    @cached_property
    def params(self) -> tuple[Param, ...]:
        """The declared options, in their order; at the end those of every algorithm."""
        declared = params_of(self.options)
        return (*declared, *(param for param in COMMON_PARAMS if param not in declared))

    def execute(self, options: Mapping[str, Any], context: Context) -> Report:
        """Run with checked options, by key, as the only writer in the output directory.

        Folders, archives and lists among the images are replaced by the images in them, folders of results among the
        points by their layers. All images are closed at the end, also after an error.
        """
        modules = (self.work_module, *(f"{_ROOT}.hrsi_engine.{name}" for name in _WHEN_RUN))
        with quitting_on_signals():
            work, rasters, values, transactions, deliveries, lineage, threads = map(import_module, modules)
        given = {param.key: options[param.key] for param in self.params if options[param.key] != param.default}
        images: list[str] = []
        for param in self.params:
            value = options.get(param.key)
            if value and param.kind is Kind.IMAGES:
                images += (found := deliveries.resolve_images(value, context.log))
                options = {**options, param.key: found}
            elif value and param.kind is Kind.POINTS and type(value) is str:
                options = {**options, param.key: deliveries.resolve_points(value, LAYER_OF_RESULT.get(param.key, ""))}
        made: Any = fill_options(self.options, options)
        # Only with an output directory is there a report with a list of inputs
        named = self.files_by_option(options) if options.get("output_dir") else None
        record = {
            "schema": SCHEMA,
            "algorithm": self.name,
            **lineage.run_record(context.command or self.command(given), named),
            "options": {key: _plain_value(value) for key, value in given.items()},
            "settings": settings_of(made) | settings_of(fill_options(Common, options)),
            **context.record,
            "crs": {"positions": POSITIONS_CRS, "heights": "ellipsoidal", "input_heights": options.get("height_datum")},
        }
        context = replace(context, inputs=self.inputs(options), record=lineage.without_secrets_in(record))
        try:
            target = options.get("output_dir")
            if context.dry_run and target:
                transactions.require_writable(target)
            where_they_lie = options.get("restore") or options.get("write") == "in-place" or not target
            locked = [path for path in images if os.path.exists(path)] if "write" in options and where_they_lie else []
            with transactions.only_writer(*((None,) if context.dry_run else (target, locked))):
                if not context.dry_run:  # what a stopped run left in folders of this one
                    folders = {os.path.dirname(path) or "." for path in images} | {target or "."}
                    for notice in transactions.recover_folders(filter(os.path.isdir, folders)):
                        context.log(notice)
                with threads.limit_threads(options.get("threads") or 0):
                    report: Report = values.json_ready(work.run(made, context))
            return report
        finally:
            rasters.close_images()

    def summarise(self, report: Report) -> str:
        """Return the lines of a report for the user."""
        if report.get("dry_run"):
            lines = [f"{count} {name}" for name, count in report["counts"].items()]
            files = [f"{entry['path']}{' (replaced)' if entry['replaces'] else ''}" for entry in report["files"]]
            lines += ["would be written:", *(f"  {file}" for file in files)] if files else ["nothing would be written"]
            lines += [f"warning: {text}" for text in report["warnings"]]
            verdict = report["verdict"]
            lines += reason_lines(verdict)
            return "\n".join([*lines, f"dry run: {verdict['sentence']}. Verdict of the checks: {verdict['level']}"])
        text: str = import_module(self.work_module).summarise(report)
        return text

    def inputs(self, options: Mapping[str, Any]) -> tuple[str, ...]:
        """Return the files that checked options name for reading, without the part after ``|``."""
        files: list[str] = []
        for param in self.params:
            is_read = param.kind in READ_KINDS or "FILE" in param.metavar.split("|")  # a geoid grid is a text option
            value = options.get(param.key) if is_read else None
            named = [value] if isinstance(value, str) else value or ()
            for text in (name for name in named if not isinstance(name, InMemory)):
                files += [part.partition("|")[0].strip() for part in (text, *text.split(";"))]
        return tuple(dict.fromkeys(filter(None, files)))

    def files_by_option(self, options: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
        """Return the files and folders that checked options name for reading, by the option's key."""
        named = {
            param.key: tuple(word.partition("=")[2] for word in options.get(param.key) or ())
            if param.kind is Kind.FOLDERS
            else self.inputs({param.key: options.get(param.key)})
            for param in self.params
        }
        return {key: files for key, files in named.items() if files}

    def command(self, given: Mapping[str, Any]) -> str:
        """Return the command line of checked options; images are last."""
        params = sorted(
            (param for param in self.params if param.key in given), key=lambda p: p.kind in POSITIONAL_KINDS
        )
        words = ["hrsi", self.name]
        for param in params:
            plain = _plain_value(given[param.key])
            if param.kind in POSITIONAL_KINDS:
                words += plain if isinstance(plain, list) else [plain]
            elif param.kind is Kind.FLAG:
                words.append(f"--{param.name}" if plain else f"--no-{param.name}")
            elif param.kind is Kind.FOLDERS:
                words += [word for folder in plain for word in (f"--{param.name}", folder)]
            else:
                text = _join_items(plain) if isinstance(plain, list) else str(plain)
                words += [f"--{param.name}={text}"] if text.startswith("-") else [f"--{param.name}", text]
        return shlex.join(words)

    def defaults(self) -> dict[str, Any]:
        """Return every option at its default, by key."""
        return {param.key: param.default for param in self.params}

    def param(self, key: str) -> Param:
        """Return the parameter of a key."""
        return next(param for param in self.params if param.key == key)


def is_unusable(report: Report) -> bool:
    """Return whether the verdict of a report is that its result is unusable; False for algorithms without a verdict."""
    return bool(report.get("verdict", {}).get("level") == Level.UNUSABLE.label)


def unusable_text(report: Report) -> str:
    """Return one line on why a result is unusable, and the advice."""
    worst = next(iter(report["verdict"]["reasons"]), None)
    what = "the inputs are wrong" if report.get("dry_run") else "the result is unusable"
    return f"{what}: {worst['message']}; {worst['advice']}" if worst else what


_ARGUMENT = re.compile(r"`([a-z][a-z0-9_]*)`")


def reason_lines(verdict: Mapping[str, Any]) -> list[str]:
    """Return the reasons of a verdict with their advice, the worst last."""
    return [
        line
        for reason in reversed(verdict["reasons"])
        for line in (f"{reason['level']}: {reason['message']} [{reason['code']}]", f"    {reason['advice']}")
    ]


def option_label(param: Param) -> str:
    """Return an option as on the command line: ``--sigma-image``, ``IMAGE``."""
    return (param.metavar or "IMAGE") if param.kind in POSITIONAL_KINDS else f"--{param.name}"


def spell_arguments(text: str, params: Iterable[Param], spelling: Callable[[Param], str] = option_label) -> str:
    """Return a text in which arguments are replaced by options: ```sigma_dem_m``` becomes ``--sigma-dem``.

    An argument that is no option of the algorithm is kept as words, without the backticks.
    """
    listed = list(params)
    known = {param.argument: param for param in listed} | {param.key: param for param in listed}
    return _ARGUMENT.sub(
        lambda found: spelling(known[found[1]]) if found[1] in known else found[1].replace("_", " "), text
    )

"""What an algorithm says of itself, once: the command line, the QGIS dialog and the documentation are made from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from ...hrsi_engine.foundation.progress import Progress
from ...hrsi_engine.foundation.reasons import Level

Report = dict[str, Any]
Log = Callable[[str], None]


class Kind(Enum):
    """Type of a parameter, for argument parsing, dialogs and documentation."""

    IMAGES = "images"  #: one or more images or RPC files; the positional arguments
    RASTER = "raster"  #: one raster file
    POINTS = "points"  #: a vector layer or CSV (``FILE`` or ``FILE|layername=L``)
    FILE = "file"
    CRS = "crs"  #: a coordinate reference system: EPSG:code or WKT
    TEXT = "text"
    IDS = "ids"  #: identifiers, separated by commas
    CHOICE = "choice"
    INTEGER = "integer"
    NUMBER = "number"
    FLAG = "flag"
    OUTPUT_DIR = "output directory"


@dataclass(frozen=True)
class Param:
    """One option: ``name`` as on the command line (``sigma-image``), ``help`` without a closing full stop."""

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
    piped: bool = False  #: where it is not given, standard input is read; a dialog has none and asks for it

    @property
    def words(self) -> tuple[str, ...]:
        """Words that it takes besides a file: those in lower case of a metavar like ``auto|none|FILE``."""
        parts = self.metavar.split("|")
        return tuple(part for part in parts if part.isalnum() and part.islower()) if "FILE" in parts else ()

    @property
    def key(self) -> str:
        """Name as a Python keyword: ``sigma_image``."""
        return self.name.replace("-", "_")


def is_unusable(report: Report) -> bool:
    """Return whether a report has the verdict that its result cannot be used; algorithms without one never do."""
    return bool(report.get("verdict", {}).get("level") == Level.UNUSABLE.label)


@dataclass(frozen=True)
class Context:
    """What an algorithm gets besides its options: where to report progress and messages."""

    progress: Progress
    log: Log


Run = Callable[[Mapping[str, Any], Context], Report]


@dataclass(frozen=True)
class Algorithm:
    """A declared algorithm: ``run(options, context)`` returns its report as a JSON-ready dict.

    ``layers`` names the layers of the result that a map should show, as ``file|layername=…`` below the output
    directory. ``summarise`` turns the report into the few lines a person reads on the terminal. ``packages`` are
    Python packages (by import name) for what it does with pixels, which a QGIS may lack.
    """

    name: str
    title: str
    group: str
    summary: str
    help: str
    params: tuple[Param, ...]
    run: Run
    summarise: Callable[[Report], str]
    layers: tuple[str, ...] = field(default=())
    packages: tuple[str, ...] = field(default=())

    def execute(self, options: Mapping[str, Any], context: Context) -> Report:
        """Run with checked options, and close all images afterwards: nothing stays open when the work is done."""
        from ...hrsi_engine.io.rasters import close_images

        try:
            return self.run(options, context)
        finally:
            close_images()

    def defaults(self) -> dict[str, Any]:
        """Return every option at its default, by keyword."""
        return {param.key: param.default for param in self.params}

    def param(self, key: str) -> Param:
        """Return the parameter of a keyword."""
        return next(param for param in self.params if param.key == key)


OUTPUT_PARAMS = (
    Param(
        "output-dir", Kind.OUTPUT_DIR, "Directory for the results; created where missing", required=True, metavar="DIR"
    ),
    Param("overwrite", Kind.FLAG, "Replace the results of an earlier run in the output directory", default=False),
)
COMMON_PARAMS = (
    Param(
        "threads",
        Kind.INTEGER,
        "Number of threads; 0 takes all cores",
        default=0,
        minimum=0,
        advanced=True,
        metavar="N",
    ),
)

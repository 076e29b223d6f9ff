"""A small declared algorithm with an option of every kind; it reports what it was given, or fails as it is told.

``python -m hrsi.tests.sample_algorithm sample ...`` is a command line with this algorithm alone.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError, SolveError
from hrsi.hrsi_engine.foundation.options import nest_options, option
from hrsi.hrsi_engine.foundation.progress import advance
from hrsi.hrsi_engine.foundation.workers.threads import thread_count
from hrsi.hrsi_engine.io.output_dir import stage_folder
from hrsi.processing_algorithms.interface.declare import Algorithm, Context, Kind, Report, settings_of
from hrsi.processing_algorithms.interface.option_groups import ResultFolder


def _fail(error: Exception) -> Callable[[], None]:
    def fail() -> None:
        raise error

    return fail


FAILURES: dict[str, Callable[[], Any]] = {
    "no": lambda: None,
    "input": _fail(InputError("gcps.csv: no field 'id';\n  rename the field that holds the ids")),
    "singular": _fail(SolveError("the shift of image B is not determined; measure points on it")),
    "cancelled": _fail(Cancelled("cancelled; nothing was written")),
    "bug": lambda: {}["a missing key"],
    "disk": _fail(OSError(28, "No space left on device", "out/report.json")),
    "memory": _fail(MemoryError()),
    "package": _fail(ModuleNotFoundError("No module named 'cv2'", name="cv2")),
    "chatter": lambda: print("a library that prints"),
}


@dataclass(frozen=True, kw_only=True)
class SampleOptions:
    """An option of every kind."""

    images: tuple[str, ...] = option(help="Images or RPC files", kind=Kind.IMAGES)
    dem: str | None = option(None, "Heights", kind=Kind.RASTER)
    gcps: str | None = option(None, "Ground points", kind=Kind.POINTS, metavar="FILE[|layername=L]")
    geoid: str | None = option(None, "Geoid grid", kind=Kind.FILE)
    fail: str = option("no", "How to fail")
    gcp_ids: tuple[str, ...] | None = option(None, "Control points")
    strips: tuple[tuple[str, ...], ...] = option((), "Images of one strip")
    scale: tuple[float, float] = option((1.0, 1.0), "Ratio of the pixels", minimum=0.05, maximum=20.0)
    model: str = option("shift", "Model", choices=("shift", "affine"))
    iterations: int = option(10, "Iterations", minimum=1, maximum=99, advanced=True)
    height: float = option(0.0, "Height above the ellipsoid", unit="m", minimum=-500, maximum=9000)
    wait: float = option(0.0, "Time to work", unit="s", minimum=0)
    report: bool = option(True, "Write a report")
    folder: ResultFolder = nest_options(ResultFolder)


def run(options: SampleOptions, context: Context) -> Report:
    """Wait in steps, write ``result.txt``, over that of an earlier run, and report the options."""
    context.log("a message")
    FAILURES[options.fail]()
    with stage_folder(options.folder.output_dir, context.inputs, overwrite=True) as folder:
        (folder / "result.txt").write_text("half")
        for step in range(100):
            advance(context.progress, step / 100)
            time.sleep(options.wait / 100)
    return {"algorithm": "sample", "options": settings_of(options) | {"threads": thread_count()}}


def summarise(report: Report) -> str:
    """Return how many images there were."""
    return f"{len(report['options']['images'])} images"


SAMPLE = Algorithm(
    name="sample",
    title="Sample",
    group="Tests",
    summary="Reports 100 % of its options",
    help="First paragraph.\n\nSecond paragraph.",
    options=SampleOptions,
    module=__name__,
)

if __name__ == "__main__":
    from hrsi.processing_algorithms.command_line.cli import main

    sys.exit(main(registry={SAMPLE.name: SAMPLE}))

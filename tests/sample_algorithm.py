"""A small declared algorithm with an option of every kind; it reports what it was given, or fails as it is told.

``python -m hrsi.tests.sample_algorithm sample ...`` is a command line with this algorithm alone.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError, SolveError
from hrsi.hrsi_engine.foundation.progress import advance
from hrsi.processing_algorithms.interface.declare import (
    COMMON_PARAMS,
    OUTPUT_PARAMS,
    Algorithm,
    Context,
    Kind,
    Param,
    Report,
)


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


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Wait in steps, write ``result.txt`` by way of a temporary name, and report the options."""
    context.log("a message")
    FAILURES[options["fail"]]()
    folder = Path(options["output_dir"])
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".hrsi-", dir=folder) as temporary:
        result = Path(temporary) / "result.txt"
        result.write_text("half")
        for step in range(100):
            advance(context.progress, step / 100)
            time.sleep(options["wait"] / 100)
        os.replace(result, folder / "result.txt")
    return {"algorithm": "sample", "options": dict(options)}


SAMPLE = Algorithm(
    name="sample",
    title="Sample",
    group="Tests",
    summary="Reports 100 % of its options",
    help="First paragraph.\n\nSecond paragraph.",
    declared=(
        Param("images", Kind.IMAGES, "Images or RPC files", required=True),
        Param("dem", Kind.RASTER, "Heights"),
        Param("gcps", Kind.POINTS, "Ground points", metavar="FILE[|layername=L]"),
        Param("geoid", Kind.FILE, "Geoid grid"),
        Param("fail", Kind.TEXT, "How to fail", default="no"),
        Param("gcp-ids", Kind.IDS, "Control points"),
        Param("model", Kind.CHOICE, "Model", default="shift", choices=("shift", "affine")),
        Param("iterations", Kind.INTEGER, "Iterations", default=10, minimum=1, maximum=99, advanced=True),
        Param("height", Kind.NUMBER, "Height above the ellipsoid", default=0.0, unit="m", minimum=-500, maximum=9000),
        Param("wait", Kind.NUMBER, "Time to work", default=0.0, unit="s", minimum=0),
        Param("report", Kind.FLAG, "Write a report", default=True),
        *OUTPUT_PARAMS,
        *COMMON_PARAMS,
    ),
    run=run,
    summarise=lambda report: f"{len(report['options']['images'])} images",
)

if __name__ == "__main__":
    from hrsi.processing_algorithms.interface.cli import main

    sys.exit(main(registry={SAMPLE.name: SAMPLE}))

"""What a run would do, told instead of doing it."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

from ...hrsi_engine.foundation.reasons import Level
from ...hrsi_engine.io.output_dir import exists_anywhere
from ..interface.declare import Context, Report

REPORT_FILE, PAGE_FILE = "report.json", "report.html"


def plan(
    context: Context, folder: str | None, names: Sequence[str], counts: Mapping[str, int], warnings: Sequence[str] = (),
    verdict: Mapping[str, Any] | None = None,
) -> Report:  # fmt: skip
    """Return the report of a dry run: what would be written, how much there is, and what the checks found.

    folder : the output directory; None where the result would be printed only
    names : files that would be written, in the folder or with their own paths
    counts : what was read, by its name in the plural; warnings : what the user should know
    verdict : of the checks of the inputs; by default nothing was found
    """
    files = [os.path.join(folder or "", name) for name in names]
    for text in warnings:
        context.log(f"warning: {text}")
    return {
        **context.record,
        "dry_run": True,
        "files": [{"path": file, "replaces": exists_anywhere(file)} for file in files],
        "counts": dict(counts),
        "warnings": list(warnings),
        "verdict": dict(verdict or {"level": Level.OK.label, "sentence": "nothing wrong was found", "reasons": []}),
    }

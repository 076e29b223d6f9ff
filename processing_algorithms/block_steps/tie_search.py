"""Options of the search for tie points, and the search itself: shared by `tie-points` and `triangulate`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...hrsi_engine.foundation.options import nested, option, threads_option
from ...hrsi_engine.measurement.tie_options import TieOptions
from ..interface.declare import Context

if TYPE_CHECKING:
    from ...hrsi_engine.block.block import Image
    from ...hrsi_engine.io.finished_parts import FinishedParts
    from ...hrsi_engine.measurement.tie_points import TiePoints
    from ...hrsi_engine.surface.dem import HeightSurface

UNFINISHED = "unfinished_tie_points"  #: folder in the output directory, while the search is at work or was stopped


@dataclass(frozen=True)
class SearchOptions:
    """How tie points are found, by whom, and where what is finished is kept."""

    search: TieOptions = nested(TieOptions)
    scheduler: str | None = option(
        None,
        "Address of a Dask scheduler whose workers find the tie points (they must see the images under the same "
        "paths); by default threads of this machine do",
        advanced=True,
        metavar="tcp://HOST:PORT",
    )
    work_dir: str | None = option(
        None,
        "Directory that keeps what is finished, for later runs too; by default a folder in the output directory, "
        "which a run that was stopped leaves behind, and a finished run removes",
        advanced=True,
        metavar="DIR",
    )
    threads: int = threads_option()


def find(
    images: Sequence[Image], options: SearchOptions, surface: HeightSurface | None, output_dir: str, context: Context
) -> tuple[TiePoints, Finished]:
    """Find the tie points of a block as the options say; what is finished is kept until the caller removes it."""
    from ...hrsi_engine.foundation.scheduling import open_scheduler
    from ...hrsi_engine.measurement.tie_points import find_tie_points

    finished = Finished(options.work_dir, output_dir)
    kept = len(finished.parts) if finished.parts is not None else 0
    if kept:
        context.log(f"continues with {kept} finished parts in {finished.parts.folder}")  # type: ignore[union-attr]
    scheduler = open_scheduler(options.scheduler, options.threads)
    found = find_tie_points(
        images, options.search, context.progress, surface=surface, scheduler=scheduler, keeper=finished.parts
    )
    for pair in found.pairs:
        context.log(f"{pair.first} - {pair.second}: {pair.matches} matches")
    return found, finished


class Finished:
    """Where the finished parts of a search are kept: nowhere where the output directory is no local folder."""

    def __init__(self, work_dir: str | None, output_dir: str) -> None:
        from ...hrsi_engine.io.finished_parts import FinishedParts

        self._for_later = bool(work_dir)
        folder = work_dir or os.path.join(output_dir, UNFINISHED)
        self.parts: FinishedParts | None = None if folder.startswith("/vsi") else FinishedParts(folder)

    def remove(self) -> None:
        """Remove what was kept for this run only; call it when the results are written."""
        if self.parts is not None and not self._for_later:
            self.parts.remove()

"""Options of the search for tie points, and the search itself: shared by `tie-points` and `triangulate`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..interface.declare import Context, Kind, Param

if TYPE_CHECKING:
    from ...hrsi_engine.block.block import Image
    from ...hrsi_engine.io.finished_parts import FinishedParts
    from ...hrsi_engine.measurement.tie_points import TiePoints
    from ...hrsi_engine.surface.dem import HeightSurface

UNFINISHED = "unfinished_tie_points"  #: folder in the output directory, while the search is at work or was stopped

SEARCH_PARAMS = (
    Param(
        "search-margin", Kind.NUMBER,
        "How far the RPCs may be off when tie points are searched; the search widens where it finds nothing",
        default=128.0, minimum=0.0, unit="px", advanced=True, metavar="PX",
    ),
    Param(
        "cells", Kind.INTEGER, "Every image is divided into N x N cells, which are filled evenly with tie points",
        default=12, minimum=1, maximum=1000, advanced=True, metavar="N",
    ),
    Param(
        "per-cell", Kind.INTEGER,
        "Tie points of a cell; 0 takes 40 for images up to 2048 px, which are matched everywhere, else 2 from a small "
        "window in the cell",
        default=0, minimum=0, advanced=True, metavar="N",
    ),
    Param(
        "dense", Kind.FLAG,
        "Match all of every image, with small windows first, and keep all tie points: for terrain through them "
        "(orthorectify --terrain-points); some 15 s of one core for a pair's megapixel",
        default=False, advanced=True,
    ),
    Param(
        "partners", Kind.INTEGER, "Match each image with so many others, those with the largest overlap", default=8,
        minimum=1, advanced=True, metavar="N",
    ),
    Param(
        "min-overlap", Kind.NUMBER, "Share of an image that another must show to be matched", default=0.02,
        minimum=0.0, maximum=1.0, advanced=True, metavar="SHARE",
    ),
    Param(
        "scheduler", Kind.TEXT,
        "Address of a Dask scheduler whose workers find the tie points (they must see the images under the same "
        "paths); by default threads of this machine do",
        advanced=True, metavar="tcp://HOST:PORT",
    ),
    Param(
        "work-dir", Kind.TEXT,
        "Directory that keeps what is finished, for later runs too; by default a folder in the output directory, "
        "which a run that was stopped leaves behind, and a finished run removes",
        advanced=True, metavar="DIR",
    ),
)  # fmt: skip


def find(
    images: Sequence[Image], options: Mapping[str, Any], surface: HeightSurface | None, context: Context
) -> tuple[TiePoints, Finished]:
    """Find the tie points of a block as the options say; what is finished is kept until the caller removes it."""
    from ...hrsi_engine.foundation.scheduling import open_scheduler
    from ...hrsi_engine.measurement.tie_points import TieOptions, find_tie_points

    finished = Finished(options)
    kept = len(finished.parts) if finished.parts is not None else 0
    if kept:
        context.log(f"continues with {kept} finished parts in {finished.parts.folder}")  # type: ignore[union-attr]
    search = TieOptions(
        margin_px=options["search_margin"], cells=options["cells"], per_cell=options["per_cell"],
        most_partners=options["partners"], smallest_overlap=options["min_overlap"], dense=options["dense"],
    )  # fmt: skip
    scheduler = open_scheduler(options["scheduler"], options["threads"])
    found = find_tie_points(
        images, search, context.progress, surface=surface, scheduler=scheduler, keeper=finished.parts
    )
    for pair in found.pairs:
        context.log(f"{pair.first} - {pair.second}: {pair.matches} matches")
    return found, finished


class Finished:
    """Where the finished parts of a search are kept: nowhere where the output directory is no local folder."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        from ...hrsi_engine.io.finished_parts import FinishedParts

        self._for_later = bool(options["work_dir"])
        folder = options["work_dir"] or os.path.join(options["output_dir"], UNFINISHED)
        self.parts: FinishedParts | None = None if folder.startswith("/vsi") else FinishedParts(folder)

    def remove(self) -> None:
        """Remove what was kept for this run only; call it when the results are written."""
        if self.parts is not None and not self._for_later:
            self.parts.remove()

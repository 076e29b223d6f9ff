"""Options of the search for tie points, and the search itself: shared by `tie-points` and `triangulate`."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.workers.scheduling import open_scheduler
from ...hrsi_engine.io.safety.finished_parts import PartStore
from ...hrsi_engine.measurement.given_matches import refine_given_matches
from ...hrsi_engine.measurement.tie_points import TiePoints, find_overlapping_pairs, find_tie_points
from ...hrsi_engine.surface.dem import HeightSurface
from ..interface.declare import Context, Report
from ..interface.option_groups import SearchOptions
from .inputs import read_matches

UNFINISHED = "unfinished_tie_points"  #: folder in the output directory, while the search is at work or was stopped


def find_ties(
    images: Sequence[Image], options: SearchOptions, surface: HeightSurface | None, output_dir: str, context: Context,
    earlier: Collection[str] = (),
) -> tuple[TiePoints, SearchStore]:  # fmt: skip
    """Find the tie points of a block as the options say; what is finished is kept until the caller discards it.

    Images with the ids ``earlier`` are not matched with one another again.
    """
    if earlier and options.matches:
        raise InputError("`matches` takes no part where images join a block: leave out `matches` or `add_to`")
    finished = SearchStore(options.work_dir, output_dir)
    if kept := len(finished.parts):
        context.log(f"continues with {kept} finished parts in {finished.parts.folder}")
    scheduler = open_scheduler(options.workers.scheduler, options.threads, options.workers.certificates)
    if options.matches:
        given = read_matches(options.matches, images)
        found = refine_given_matches(images, given, options.search, context.progress, scheduler=scheduler)
    else:
        found = find_tie_points(
            images, options.search, context.progress, surface=surface, scheduler=scheduler, keeper=finished.parts,
            earlier=earlier,
        )  # fmt: skip
    for pair in found.pairs:
        context.log(f"{pair.first} - {pair.second}: {pair.matches} matches")
    for hold in found.holds:
        if hold.image not in earlier:
            context.log(hold.sentence)
    return found, finished


def count_pairs(
    images: Sequence[Image], options: SearchOptions, surface: HeightSurface | None, earlier: Collection[str] = ()
) -> int:
    """Return the number of pairs that overlap; `InputError` where there are none, as in the search itself."""
    return len(find_overlapping_pairs(images, options.search, surface, earlier))


def connection_entries(found: TiePoints) -> Report:
    """Return what holds each image, as reports have it: sound links, images in one block with it, pairs tried."""
    return {
        "held": {
            hold.image: {"links": hold.links, "images": hold.images, "pairs_tried": hold.tried,
                         "reason": hold.reason or None}
            for hold in found.holds
        }
    }  # fmt: skip


class SearchStore:
    """Where the finished parts of a search are kept: a folder on the disk or in an object store."""

    def __init__(self, work_dir: str | None, output_dir: str) -> None:
        self._for_later = bool(work_dir)
        self.parts = PartStore(work_dir or f"{output_dir.rstrip('/')}/{UNFINISHED}")

    @property
    def discarded(self) -> tuple[str, ...]:
        """The folder that was kept for this run only; it goes when the results are written."""
        return () if self._for_later else (str(self.parts.folder),)

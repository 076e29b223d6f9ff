"""The search for tie points for `tie-points` and `triangulate`, also if images join an earlier search."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...hrsi_engine.block.assembly import stack_image_points
from ...hrsi_engine.block.block import Image, ImagePoints
from ...hrsi_engine.block.columns import find_unique_ids, join_names, match_names
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.workers.scheduling import open_scheduler
from ...hrsi_engine.io.catalogue.stac_items import restore_image_paths
from ...hrsi_engine.io.output_dir import read_report
from ...hrsi_engine.io.point_files import measurements_of, read_image_points, read_points, several_specs
from ...hrsi_engine.io.rasters.images import open_image
from ...hrsi_engine.io.safety.array_files import PartStore
from ...hrsi_engine.measurement.given_matches import refine_given_matches
from ...hrsi_engine.measurement.tie_points import TiePoints, find_tie_points
from ...hrsi_engine.surface.dem import HeightSurface
from ..declarations.image_points import TIES_FILE, TIES_LAYER
from ..files.opening import require_ids
from ..interface.declare import Context, Report
from ..interface.option_groups import SearchOptions
from .inputs import join_image_points, of_block

UNFINISHED = "unfinished_tie_points"  #: folder in the output directory, until the search has ended


def find_ties(
    images: Sequence[Image],
    options: SearchOptions,
    surface: HeightSurface | None,
    output_dir: str,
    context: Context,
    earlier: Collection[str] = (),
) -> tuple[TiePoints, tuple[str, ...]]:
    """Find the tie points of a block by the options; also return the folder that is needed for this run only.

    Finished parts are stored in that folder, on the disk or in an object store, until the caller discards it. Images
    with the ids ``earlier`` are not matched with each other again.
    """
    if earlier and options.matches:
        raise InputError("`matches` cannot be combined with `add_to`: remove one of them")
    finished = PartStore(options.work_dir or f"{output_dir.rstrip('/')}/{UNFINISHED}")
    if kept := len(finished):
        context.log(f"continues with {kept} finished parts in {finished.folder}")
    scheduler = open_scheduler(options.workers.scheduler, options.threads, options.workers.certificates)
    if options.matches:
        given = read_matches(options.matches, images)
        found = refine_given_matches(images, given, options.search, context.progress, scheduler=scheduler)
    else:
        found = find_tie_points(
            images,
            options.search,
            context.progress,
            surface=surface,
            scheduler=scheduler,
            keeper=finished,
            earlier=earlier,
        )
    for pair in found.pairs:
        context.log(f"{pair.first} - {pair.second}: {pair.matches} matches")
    for hold in found.holds:
        if hold.image not in earlier:
            context.log(hold.sentence)
    return found, () if options.work_dir else (str(finished.folder),)


def read_matches(spec: str, images: Sequence[Image]) -> ImagePoints:
    """Return the matches of files of another program as tracks; raise `InputError` if they contain none."""
    ids = [image.id for image in images]
    tables = [read_points(measurements_of(file), image_ids=ids) for file in several_specs(spec)]
    pairs = [of_block(table.image, images)[0] for table in tables if table.pairwise and table.image is not None]
    tracks = [of_block(table.image, images)[0] for table in tables if not table.pairwise and table.image is not None]
    if not pairs and not tracks:
        raise InputError(
            f"{spec}: contains no image positions: name matches of two images, or points measured in several images"
        )
    if pairs and tracks:
        raise InputError(f"{spec}: contains both matches of pairs and points with ids: name files of one kind")
    if pairs:
        return join_image_points(pairs)
    return ImagePoints(
        join_names([table.ids for table in tracks]),
        join_names([table.image_ids for table in tracks]),
        np.concatenate([table.xy for table in tracks]),
        source=tracks[0].source,
    )


def connection_entries(found: TiePoints) -> Report:
    """Return the report's entries on the connection of each image: reliable links, images of its part, pairs tried."""
    return {
        "held": {
            hold.image: {
                "links": hold.links,
                "images": hold.images,
                "pairs_tried": hold.tried,
                "reason": hold.reason or None,
            }
            for hold in found.holds
        }
    }


FIRST_LETTER = "T"  # of tie point ids: a number follows


@dataclass(frozen=True, eq=False)
class EarlierTies:
    """Result of an earlier search: images, measurements, positions (tracks, 3) in the order of ids, its report."""

    images: tuple[Image, ...] = ()
    points: ImagePoints | None = None
    ground: np.ndarray | None = None
    report: dict[str, Any] = field(default_factory=dict)

    @property
    def ids(self) -> list[str]:
        """Ids of the images."""
        return [image.id for image in self.images]

    def with_new(self, found: TiePoints) -> TiePoints:
        """Return the earlier points followed by those found now, with continued numbers."""
        if self.points is None or self.ground is None:
            return found
        new, new_ids, track = join_ties(found.image_points, self.points)
        stacked = stack_image_points([self.points, new])
        names = {"ids": np.asarray(stacked.ids), "image_ids": np.asarray(stacked.image_ids)}
        points = replace(stacked, **names, source=found.image_points.source)
        ids = np.concatenate([find_unique_ids(self.points.ids)[0], new_ids])
        placed = np.concatenate([self.ground, found.ground[track]])[np.argsort(ids)]
        return found._replace(image_points=points.select(np.argsort(points.ids, kind="stable")), ground=placed)


def join_ties(new: ImagePoints, earlier: ImagePoints) -> tuple[ImagePoints, np.ndarray, np.ndarray]:
    """Return new tie points without known measurements; those that meet earlier points get the ids of these.

    A track with the position of one earlier point in an earlier image is that point, seen in further images: without
    such points, no tie point would connect an image to pairs of other images along their epipolar lines. A track that
    meets several points, or has another position in an image of the point that it meets, remains a new point; the new
    ids, and the numbers of their tracks, are returned too.
    """
    known, row = _round_positions(earlier), _round_positions(new)
    place, met = match_names(row, known)
    names, track = find_unique_ids(new.ids)
    old_names, old_track = find_unique_ids(earlier.ids)
    first, last = np.full(len(names), len(old_names)), np.full(len(names), -1)
    np.minimum.at(first, track[met], old_track[place[met]])
    np.maximum.at(last, track[met], old_track[place[met]])
    joined = first == last
    # Another position in an image where the earlier point has one already
    images = np.unique(np.concatenate([find_unique_ids(table.image_ids)[0] for table in (earlier, new)]))
    image, old_image = (np.searchsorted(images, np.asarray(table.image_ids)) for table in (new, earlier))
    there = np.isin(first[track] * len(images) + image, old_track * len(images) + old_image)
    joined[track[there & ~met]] = False
    taken = [int(name[1:]) for name in map(str, old_names) if name[:1] == FIRST_LETTER and name[1:].isdecimal()]
    number = max(taken, default=0) + np.cumsum(~joined)
    width = max((len(str(name)) - 1 for name in old_names), default=0)
    own = np.char.add(FIRST_LETTER, np.char.zfill(number.astype(str), width))
    ids = np.where(joined, old_names[np.where(joined, first, 0)], own)
    fresh = ~(met & joined[track])
    renamed = ImagePoints(
        ids[track], new.image_ids, new.xy, sigma_px=new.sigma_px, kind=new.kind, quality=new.quality, source=new.source
    )
    return renamed.select(fresh), own[~joined], np.flatnonzero(~joined)


def _round_positions(points: ImagePoints) -> np.ndarray:
    """Return image and position of each measurement as text, rounded to a thousandth of a pixel."""
    texts = np.char.mod("%.3f", points.xy)
    return np.char.add(
        np.char.add(np.asarray(points.image_ids), " "), np.char.add(np.char.add(texts[:, 0], " "), texts[:, 1])
    )


def read_earlier_ties(folder: str | None, images: Sequence[Image]) -> EarlierTies:
    """Return the result of an earlier search from its output directory; empty if none is named."""
    if folder is None:
        return EarlierTies()
    report = read_report(os.path.join(folder, "report.json"))
    if report is None or report.get("algorithm") != "tie-points" or not isinstance(report.get("images"), dict):
        raise InputError(f"{folder}: is no result of tie-points: name the output directory of an earlier search")
    told = report["images"].items()
    recorded = restore_image_paths((str(name), str(image.get("path")), image.get("item")) for name, image in told)
    paths = dict(zip(map(str, report["images"]), recorded, strict=True))
    require_ids([*paths.values(), *(image.path for image in images)], [*paths, *(image.id for image in images)])
    missing = [path for path in paths.values() if not path.startswith("/vsi") and not os.path.exists(path)]
    if missing:
        raise InputError(f"{missing[0]}: an image of the earlier search is not there any more: put it back")
    layers = os.path.join(folder, TIES_FILE)
    measured = read_image_points(f"{layers}|layername=image_points", image_ids=list(paths)).image
    placed = read_points(f"{layers}|layername={TIES_LAYER}").ground
    if measured is None or placed is None:
        raise InputError(f"{layers}: contains no tie points: search those of the earlier images again")
    ids, _ = find_unique_ids(measured.ids)  # the user may have removed points, or their positions
    ground = np.full((len(ids), 3), np.nan)
    row, same = match_names(ids, placed.ids)
    ground[same] = placed.ground[row[same]]
    return EarlierTies(tuple(open_image(path) for path in paths.values()), measured, ground, report)

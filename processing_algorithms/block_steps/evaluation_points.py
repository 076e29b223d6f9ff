"""The points that evaluate sets of RPCs: tracks and known points, without those from which a set was estimated.

An RPC that was adjusted to a tie point fits it, for any true camera. Points from which an RPC was estimated therefore
do not evaluate it; those that its run held out do. Both are found by the report of the run.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from ...hrsi_engine.adjustment.hold_out import hold_out_ties
from ...hrsi_engine.block.assembly import stack_image_points
from ...hrsi_engine.block.block import Block, Image, ImagePoints, Role
from ...hrsi_engine.foundation.errors import InputError, list_ids
from ...hrsi_engine.foundation.thresholds import EQUALITY, SAMPLES
from ...hrsi_engine.io.catalogue.lineage import read_refinement
from ...hrsi_engine.io.output_dir import find_image_outputs, read_report
from ...hrsi_engine.io.point_files import PointTables, measurements_of, read_points
from ...hrsi_engine.measurement.block_matching.search import count_points_per_cell
from ...hrsi_engine.measurement.block_matching.windows import TIE_WINDOWS
from ...hrsi_engine.surface.dem import HeightSurface
from ...hrsi_engine.surface.grid_surface import GridSurface
from ..declarations.rpcs import AUTOMATIC_TRACKS, NO_TRACKS, EvaluateOptions
from ..files.result_folder import REPORT_FILE
from ..interface.declare import Context
from ..interface.option_groups import SearchOptions
from . import plausibility
from .inputs import read_block
from .outputs import LAYERS_FILE
from .tie_search import find_ties

REFINING_ALGORITHMS = ("triangulate", "adjust", "refine-rpc")  #: algorithms that refine RPCs


@dataclass(frozen=True, eq=False)
class EstimationPoints:
    """Image points of the run that refined a set of RPCs; None if its layers do not exist any more.

    used : measurements of GCPs and tie points, which influenced the cameras
    held_out : measurements of tie points that the run held out
    """

    report: str
    used: ImagePoints | None = None
    held_out: ImagePoints | None = None


def find_estimation_points(files: Sequence[str], image_ids: Sequence[str]) -> EstimationPoints | None:
    """Return the points from which the RPCs of some files were estimated; None if HRSI refined none of them."""
    reports: dict[str, bool] = {}
    for file in files:
        refinement = read_refinement(file)
        told = None if refinement is None else refinement.get("HRSI_REPORT", "")
        beside = os.path.join(os.path.dirname(os.path.abspath(file)), REPORT_FILE)
        found = next((one for one in (beside, told) if one and _names_output(one, file)), None)
        if found or told is not None:
            reports[found or told or ""] = found is not None
    if not reports:
        return None
    if missing := [name for name, there in reports.items() if not there]:
        return EstimationPoints(missing[0])
    tables = []
    for report in reports:
        try:
            layers = os.path.join(os.path.dirname(report), LAYERS_FILE)
            tables.append(read_points(f"{layers}|layername=image_points", image_ids=image_ids))
        except InputError:
            return EstimationPoints(report)
    return EstimationPoints(next(iter(reports)), *split_measurements(tables))


def _names_output(path: str, file: str) -> bool:
    """Return whether a report belongs to a run that wrote a file; its folder may have been moved."""
    report = read_report(path)
    return (
        report is not None
        and report["algorithm"] in REFINING_ALGORITHMS
        and os.path.basename(file) in map(os.path.basename, find_image_outputs(report).values())
    )


def split_measurements(tables: Sequence[PointTables]) -> tuple[ImagePoints, ImagePoints]:
    """Return the image points that influenced cameras, and those of held-out tie points; neither has check points."""
    used, held = list[ImagePoints](), list[ImagePoints]()
    for image, ground in ((one.image, one.ground) for one in tables if one.image is not None):
        passive, out = (
            np.isin(image.ids, [] if ground is None else ground.ids[ground.role == role])
            for role in (Role.CHECK, Role.HELD_OUT)
        )
        used.append(image.select(~passive & ~out))
        held.append(image.select(out))
    return stack_image_points(used), stack_image_points(held)


def find_points_near(block: Block, measured: ImagePoints, apart_px: float) -> np.ndarray:
    """Return the mask of the points of a block within ``apart_px`` of a ``measured`` point in at least one image."""
    rows = block.measurements
    near = np.zeros(len(block.points), dtype=bool)
    image_ids = np.asarray(measured.image_ids)
    for index, image in enumerate(block.images):
        here, there = np.flatnonzero(rows.image == index), measured.xy[image_ids == image.id]
        if len(here) and len(there):
            distance, _ = cKDTree(there).query(rows.xy[here], distance_upper_bound=apart_px * (1.0 + 1e-9))
            near[rows.point[here[distance <= apart_px]]] = True
    return near


@dataclass(eq=False)
class EvaluationPoints:
    """The points that evaluate RPCs.

    block : tracks and known points
    found : tie points that were found in the images for this evaluation
    tracks, held_out : number of tracks that no RPC was estimated from, and how many of them a run held out
    left_out : number of tracks that an RPC was estimated from
    makers : points from which RPCs were estimated, by the names of the sets
    """

    found: list[ImagePoints] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    discarded: tuple[str, ...] = ()
    makers: Mapping[str, EstimationPoints] = field(default_factory=dict)
    tracks: int = 0
    held_out: int = 0
    left_out: int = 0
    block: Block = field(init=False)

    @property
    def are_independent(self) -> bool:
        """Whether no RPC was estimated from the tracks."""
        return self.tracks > 0 and all(maker.used is not None for maker in self.makers.values())

    def find_tracks(
        self,
        search: SearchOptions,
        images: Sequence[Image],
        surface: HeightSurface | None,
        folder: str,
        context: Context,
    ) -> None:
        """Find tie points in the images, and add the warnings of the search."""
        ties, discarded = find_ties(images, search, surface, folder, context)
        self.found, self.discarded = [ties.image_points], (*self.discarded, *discarded)
        self.warnings += ties.warnings

    def exclude_estimation_points(self, block: Block, makers: Mapping[str, EstimationPoints], apart_px: float) -> None:
        """Set the block without points from which RPCs were estimated; with all of them if none remain.

        Tracks found for this evaluation must be ``apart_px`` away from those points, with whom they would share pixels.
        """
        self.makers, self.block = makers, hold_out_ties(block, 0.0)
        used, held = (
            stack_image_points([part for maker in makers.values() if (part := getattr(maker, what)) is not None])
            for what in ("used", "held_out")
        )
        role, tracks = self.block.points.role, self.block.points.role == Role.TIE
        made, kept = (find_points_near(self.block, points, EQUALITY.rpc_px) for points in (used, held))
        if (checks := made & (role == Role.CHECK)).any():
            role[checks] = Role.GCP
            self.warnings.append(
                f"check point {list_ids(self.block.points.ids[checks])} made one of the sets of RPCs: it is control"
            )
        if self.found:
            made |= find_points_near(self.block, used, apart_px) & ~kept
        several = tracks & (self.block.rays_per_point() >= 2)
        self.left_out, self.tracks = int((several & made).sum()), int((several & ~made).sum())
        self.held_out = int((several & ~made & kept).sum())
        if self.tracks:
            self.block = self.block.with_measurements(~(tracks & made)[self.block.measurements.point])


def read_evaluation_points(
    options: EvaluateOptions,
    images: Sequence[Image],
    surface: GridSurface | None,
    files: Mapping[str, Sequence[str]],
    context: Context,
) -> EvaluationPoints:
    """Return the block of all tracks and known points that evaluate the RPCs, with warnings for the user.

    Points from which one of the sets was estimated, whose RPC ``files`` are given, are excluded. If no tracks remain,
    others are found in the images.
    """
    file = None if options.tracks in (AUTOMATIC_TRACKS, NO_TRACKS) else options.tracks
    ids = [image.id for image in images]
    made = {name: find_estimation_points(named, ids) for name, named in files.items()}
    makers = {name: maker for name, maker in made.items() if maker is not None}
    judges = EvaluationPoints()
    if options.tracks == AUTOMATIC_TRACKS:
        judges.find_tracks(options.search, images, surface, options.folder.output_dir, context.stage(0.0, 0.4))
    block, warnings = read_block(images, options.points, surface, file, judges.found)
    judges.warnings += warnings
    points = ", ".join(name for name in (options.points.gcps, options.points.image_points, file) if name)
    for reason in plausibility.input_reasons(block, surface):
        about = options.dem.dem if reason.code == "dem-coverage" else points
        judges.warnings.append(f"{f'{about}: ' if about else ''}{reason.message}: {reason.advice} ({reason.code})")
    if options.used_points is not None:
        used, _ = split_measurements([read_points(measurements_of(options.used_points), image_ids=ids)])
        if not len(used):
            raise InputError(
                f"{options.used_points}: has no image points: name the layer image_points of an adjustment"
            )
        near = find_points_near(block, used, options.apart_px) & np.isin(block.points.role, [Role.TIE, Role.HELD_OUT])
        block = block.with_measurements(~near[block.measurements.point])
        judges.warnings.append(
            f"{near.sum()} tracks are within {options.apart_px:g} px of points that were used: they are not evaluated"
        )
    judges.exclude_estimation_points(block, makers, options.apart_px)
    few = judges.left_out and judges.tracks < SAMPLES.trend
    if few and options.tracks != NO_TRACKS and all(image.raster is not None for image in images):
        # Further tracks in the same images: more in each cell than a run finds by default
        search = options.search.search
        many = TIE_WINDOWS.surplus * max(count_points_per_cell(search, image) for image in images)
        denser = replace(options.search, search=replace(search, per_cell=many), matches=None)
        judges.find_tracks(denser, images, surface, options.folder.output_dir, context.stage(0.4, 0.8))
        block, _ = read_block(images, options.points, surface, None, judges.found)
        judges.exclude_estimation_points(block, makers, options.apart_px)
    judges.warnings += [
        f"RPCs {name}: refined by HRSI, but the layers of that run ({maker.report or 'no report'}) are missing: it is "
        "not known whether that run used these tracks, so no set is named as the best"
        for name, maker in makers.items()
        if maker.used is None
    ]
    told = f"{judges.left_out} tracks were used for RPCs {' or '.join(makers)}"
    if judges.left_out:
        judges.warnings.append(
            f"{told} and are not evaluated; {judges.tracks} others are, {judges.held_out} of them held out in that "
            "adjustment"
            if judges.tracks
            else f"all {told}: their residuals are no independent measure, so no set is named as the best; give other "
            "tracks, or images with pixels"
        )
    return judges

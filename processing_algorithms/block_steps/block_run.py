"""The run of a block: read, search, check, adjust, judge, write; each step is here once, for every face.

The commands `triangulate`, `adjust` and `refine-rpc`, and with them the steps of a project, QGIS and Python, call the
steps in this order with their options; the points panel begins with a block in memory. What a step finds is collected
in the run, so that all faces show the same:

* warnings, texts for the user, in the order in which they were found;
* reasons, the findings in the inputs and in the adjusted block from which the verdict follows;
* entries, additions to the entries of the report that every adjusted block has.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

from ...hrsi_engine.adjustment.hold_out import hold_out_ties
from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.adjustment.solver import adjust
from ...hrsi_engine.block.block import Block, Image, ImagePoints
from ...hrsi_engine.block.laser import LaserPoints
from ...hrsi_engine.block.orthoimage import ReferencePlaces
from ...hrsi_engine.foundation.errors import InputError, SolveError
from ...hrsi_engine.foundation.reasons import Level, Reason
from ...hrsi_engine.measurement.no_match import explain_no_matches
from ...hrsi_engine.measurement.tie_points import find_overlapping_pairs
from ...hrsi_engine.results.block_results import assemble_result
from ...hrsi_engine.results.judged_block import JudgedBlock, judge_block
from ...hrsi_engine.surface.grid_surface import GridSurface
from ..files.opening import dem_surface, open_images
from ..files.result_folder import REPORT_FILE
from ..interface.declare import Context, Report
from ..interface.option_groups import (
    BlockGrowthOptions,
    BlockOutput,
    DemOptions,
    LaserFile,
    PointFiles,
    ReferenceImage,
    ResultFolder,
    SearchOptions,
    SurfaceFile,
)
from .inputs import EarlierBlock, open_joined_images, read_block
from .laser_points import add_height_control, add_laser_points, adjust_at_laser_points, describe_laser, with_surface
from .outputs import Clock, plan_results, require_room, write_results
from .plausibility import explain_failures, ground_reasons, input_reasons, offset_warning, placement_reasons
from .reference_control import read_reference_block, reference_reasons
from .summary import choice_entries, choice_warnings
from .tie_search import connection_entries, find_ties, join_ties

#: Progress after the search for tie points, reading and adjustment; with a search in the images, and without it.
PROGRESS_SHARES = {True: (0.8, 0.84, 0.94), False: (0.0, 0.1, 0.6)}
NO_SURFACE, NO_LASER = SurfaceFile(), LaserFile()


class BlockRun:
    """One run of a block, with what its steps have found so far.

    context : progress, messages, and whether it is a dry run
    output : where the results are written; a run `of_block` has no folder and ends with `judge`
    points : files of ground and image points
    searching : whether tie points are searched in the images, which takes most of the time
    block, result : the block, from `read` on; the adjusted block, from `adjust` or `take_result` on
    """

    block: Block
    result: Adjustment

    def __init__(self, context: Context, output: BlockOutput, points: PointFiles, searching: bool = False) -> None:
        self.context, self.output, self.points = context, output, points
        self.warnings: list[str] = []
        self.reasons: list[Reason] = []
        self.entries: Report = {}
        self.clock = Clock()
        self.images: Sequence[Image] = ()
        self.earlier = EarlierBlock()
        self.options = AdjustOptions()
        self._dem: GridSurface | None = None
        self._ties: list[ImagePoints] = []
        self._pairs_to_match: int | None = None
        self._laser_points: LaserPoints | None = None
        self._places: ReferencePlaces | None = None
        self._temporary_folders: tuple[str, ...] = ()
        found, read, adjusted = PROGRESS_SHARES[searching]
        self._searching, self._reading = context.stage(0.0, found), context.stage(found, read)
        self._adjusting, self._writing = context.stage(read, adjusted), context.stage(adjusted, 1.0)

    @classmethod
    def of_block(cls, block: Block, context: Context) -> BlockRun:
        """Return the run of a block in memory, ready for `check`."""
        block_run = cls(context, BlockOutput(folder=ResultFolder(output_dir="")), PointFiles())
        block_run.images, block_run.block = block.images, block
        return block_run

    # ---- read and search ---------------------------------------------------------------------------------------------

    def open_images(
        self,
        paths: Sequence[str],
        growth: BlockGrowthOptions | None = None,
        tie_points: str | None = None,
        shared_images: Sequence[Sequence[str]] = (),
    ) -> None:
        """Open the images, and the earlier block that they join; raise `InputError` if the results have no place.

        growth : options of that block; None: every image is a camera of its own
        """
        if growth is None:
            self.images = open_images(paths, self.context)
        else:
            self.images, self.earlier = open_joined_images(paths, growth, tie_points, shared_images, self.context)
            self._ties = [*self.earlier.ties]
        require_room(self.output, self.images, self.context)

    def open_dem(self, dem: DemOptions) -> None:
        """Open the DEM, with the height datum and the epoch of the points unless it has its own."""
        self._dem = dem_surface(dem, self.points.height_datum, self.points.gcp_epoch)
        self.clock.lap("read")

    def search(self, search: SearchOptions, output_dir: str) -> None:
        """Find tie points in the images; a dry run counts the pairs that would be matched.

        output_dir : folder of the parts that are finished, so that a stopped search continues
        """
        if self.earlier.joint is not None:
            raise InputError(
                "new images need tie points to the earlier images, which are not available with observed cameras: set "
                "`earlier_cameras` to free, or search `tie_points` first"
            )
        earlier_ids = [image.id for image in self.earlier.images]
        if self.context.dry_run:
            self._pairs_to_match = len(find_overlapping_pairs(self.images, search.search, self._dem, earlier_ids))
            return
        ties, self._temporary_folders = find_ties(
            self.images, search, self._dem, output_dir, self._searching, earlier_ids
        )
        measured = ties.image_points
        has_points = self.points.gcps or self.points.image_points
        if not (len(measured) or self._ties) and (ties.pairs or not has_points):
            cause = explain_no_matches(self.images, ties.pairs, search.search.smallest_overlap)
            if not has_points:
                raise SolveError(cause)
            advice = "look at the pixels: points measured by hand do not show what was done to the images afterwards"
            ids = tuple(image.id for image in self.images)
            self.reasons.append(Reason("few-ties", Level.DOUBTFUL, cause, advice, ids))
        for table in self.earlier.ties:
            measured, *_ = join_ties(measured, table)
        self._ties.append(measured)
        self.warnings += ties.warnings
        self.entries |= connection_entries(ties)
        self.clock.lap("tie_points")

    @property
    def has_points(self) -> bool:
        """False in a dry run whose points would all be found in the images."""
        return not self._pairs_to_match or bool(self.points.gcps or self.points.image_points or self._ties)

    def read(
        self, tie_points: str | None = None, reference: ReferenceImage | None = None, sigma_dem_m: float | None = None
    ) -> None:
        """Read the points, and assemble the block with them and the tie points that were found.

        tie_points : file of tie points
        reference : an orthoimage in which GCPs are measured (not in a dry run); sigma_dem_m : of their heights
        """
        if reference is not None and reference.reference and self.earlier.images:
            raise InputError("`reference` cannot be combined with `add_to`: remove one of them")
        if reference is not None and reference.reference and not self.context.dry_run:
            self.block, self._places, warnings, entries = read_reference_block(
                self.images,
                self.points,
                self._dem,
                tie_points=tie_points,
                ties=self._ties,
                reference=reference,
                sigma_dem_m=sigma_dem_m,
                context=self._reading,
            )
            self.entries |= entries
        else:
            self.block, warnings = read_block(
                self.images, self.points, self._dem, tie_points, self._ties, self.earlier.known
            )
        self.warnings += warnings
        self.clock.lap("read")

    # ---- check -------------------------------------------------------------------------------------------------------

    def check(
        self,
        options: AdjustOptions,
        hold_out: float | None = None,
        surface: SurfaceFile = NO_SURFACE,
        laser: LaserFile = NO_LASER,
    ) -> None:
        """Check the inputs for an adjustment with ``options``.

        hold_out : share of the tie points that are held out; None: as they were read
        surface, laser : a surface and laser points that constrain the block
        """
        block = self.block if hold_out is None else hold_out_ties(self.block, hold_out)
        if self.earlier.joint is not None and self.earlier.model is not None:
            options = replace(options, model=self.earlier.model, earlier=self.earlier.joint)
        options, block, surface_warnings = with_surface(options, surface, self.points, block)
        self.reasons += input_reasons(block, options.dem or self._dem, options.sigma_shift_px, options.sigma_drift)
        self.reasons += reference_reasons(self.entries)
        with explain_failures(self.reasons):
            self._laser_points, self.block, warnings = add_laser_points(block, laser, self.points, self.context)
        self.warnings += [*warnings, *surface_warnings]
        self.options, self._laser = options, laser
        self.clock.lap("check")

    def plan(self, together: bool = True) -> Report:
        """Return the report of a dry run; ``together`` is whether the images would be adjusted in one block."""
        block = getattr(self, "block", None)
        return plan_results(
            self.output,
            self.images,
            block,
            warnings=self.warnings,
            reasons=placement_reasons(self.images) if block is None else self.reasons,
            context=self.context,
            pairs=self._pairs_to_match,
            together=together,
        )

    # ---- adjust, judge, write ----------------------------------------------------------------------------------------

    def adjust(self, laser_threads: int | None = None) -> None:
        """Adjust the block; with ``laser_threads`` tie points are first measured in the images at laser points."""
        with explain_failures(self.reasons):
            self.options = add_height_control(self.options, self._dem, self._laser_points, self._places)
            if laser_threads is None:
                result = adjust(self.block, self.options, self._adjusting.progress)
            else:
                result, warnings = adjust_at_laser_points(self.block, self.options, laser_threads, self._adjusting)
                self.warnings += warnings
        self.take_result(result)

    def take_result(self, result: Adjustment, part: str = "adjust") -> None:
        """Continue with a result; ``part`` is the name of the adjustment among the parts of the report's time."""
        self.result = result
        self.clock.lap(part)

    def judge(self) -> JudgedBlock:
        """Return the adjusted block with residuals, refined RPCs, figures, warnings and verdict."""
        result, surface, sigma_m = self.result, self.options.dem or self._dem, self.options.sigma_dem_m
        entries, warnings = describe_laser(result, self._laser)
        self.warnings += [*choice_warnings(result.choice), *warnings, *offset_warning(result, surface, sigma_m)]
        self.reasons += ground_reasons(result, surface, sigma_m)
        self.entries |= choice_entries(self.options.model, result.choice) | entries
        with explain_failures(self.reasons):
            return judge_block(result, self.warnings, self.reasons, self.clock.lap)

    def write(self) -> Report:
        """Judge the adjusted block, and write the results; return the report."""
        judged, path = self.judge(), os.path.join(self.output.folder.output_dir, REPORT_FILE)
        with explain_failures(self.reasons):
            results = assemble_result(judged, self.context.record, self.entries, path, self.output.stac)
            self.clock.lap("judge")
            return write_results(self.output, results, self.clock, self._writing, self._temporary_folders)

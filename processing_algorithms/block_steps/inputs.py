"""From options to a block: opens the images, reads the points, and joins images to an earlier adjusted block.

If images join a block, either all cameras are free: the earlier measurements are used again with the cameras before any
adjustment, and the result equals one adjustment of all images. Or the earlier cameras are observations: of the earlier
block only the joint estimate and covariance of its cameras are used (`adjustment.priors.earlier_cameras`).
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...hrsi_engine.adjustment.priors.earlier_cameras import JointCameras
from ...hrsi_engine.block.assembly import assemble
from ...hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role, group_tiles
from ...hrsi_engine.block.columns import find_unique_ids, isin, match_names
from ...hrsi_engine.block.exposures import join_exposures, join_named_bands
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import EQUALITY
from ...hrsi_engine.ground.crs_operations import operations_of
from ...hrsi_engine.ground.geodesy import ground_difference_m
from ...hrsi_engine.ground.operation_uses import OperationUse, list_operation_warnings, require_strict_datums
from ...hrsi_engine.io.catalogue.block_records import CAMERAS_FILE, BlockRecord, read_cameras, read_record
from ...hrsi_engine.io.catalogue.stac_items import restore_image_paths
from ...hrsi_engine.io.opening.budgets import require_gcp_rows
from ...hrsi_engine.io.point_files import measurements_of, read_image_points, read_points, several_specs
from ...hrsi_engine.io.rasters.images import open_image
from ...hrsi_engine.io.rasters.sun_angles import read_time
from ...hrsi_engine.measurement.block_matching.joining import build_tracks
from ...hrsi_engine.results.block_record import read_joint_arrays
from ...hrsi_engine.surface.dem import surface_heights
from ...hrsi_engine.surface.grid_surface import GridSurface
from ..files.opening import open_images, require_ids
from ..interface.declare import Context
from ..interface.option_groups import FREE, NO_TIES, BlockGrowthOptions, PointFiles, SearchOptions

ANY_YEAR = 2020.0  # for testing whether PROJ has the motion of a plate
FASTEST_PLATE_M = 0.08  # per year: the Pacific plate's 0.68 degrees in a million years (Altamimi et al. 2017)
IMAGES_ASKED = 10  # most images whose acquisition time is read
GCPS, MEASURED, TIES = "gcps", "image points", "tie points"  #: purposes for which a point file is read


def read_block(
    images: Sequence[Image],
    points: PointFiles,
    dem: GridSurface | None = None,
    tie_points: str | None = None,
    ties: Sequence[ImagePoints] = (),
    known: Sequence[GroundPoints] = (),
) -> tuple[Block, list[str]]:
    """Read point files and assemble the block with tie points and known points; return it with warnings for the user.

    Ground positions are used from the layer of GCPs only: a layer of image points may be one that HRSI wrote, with
    adjusted positions.

    points : the point files, the selection of control, and sigmas for files that have none
    dem : heights of surveyed points without heights; tie_points : file of tie points
    ties, known : tie points and ground points that exist already

    Raises `InputError` if a file cannot be read, or no point is measured in any image.
    """
    warnings: list[str] = []
    ground: list[GroundPoints] = list(known)
    measured: list[ImagePoints] = list(ties)
    of_dem = () if dem is None else dem.operations
    pairs: list[ImagePoints] = []
    held_out: list[str] = []  # in an earlier run
    files = {GCPS: points.gcps, MEASURED: points.image_points, TIES: None if tie_points == NO_TIES else tie_points}
    for purpose, spec in [(purpose, spec) for purpose, file in files.items() if file for spec in several_specs(file)]:
        if purpose == GCPS:
            require_gcp_rows(str(spec).partition("|")[0])
        read = partial(read_points, surface_operations=of_dem) if purpose == GCPS else read_image_points
        tables = read(
            spec if purpose == GCPS else measurements_of(spec),
            ground_crs=points.ground_crs,
            height_datum=points.height_datum,
            epoch=points.gcp_epoch,
            image_ids=[image.id for image in images],
            surface=None if dem is None else partial(surface_heights, dem),
        )
        if tables.ground is not None and purpose == GCPS:
            ground.append(tables.ground)
        elif tables.ground is not None:
            held_out += tables.ground.ids[tables.ground.role == Role.HELD_OUT].tolist()
        if tables.image is not None:
            table, left_out = of_block(tables.image, images) if purpose == TIES else (tables.image, [])
            warnings += left_out
            (pairs if tables.pairwise else measured).append(table)
        if purpose == GCPS or tables.image is None:  # positions of other layers are not used
            warnings += tables.warnings
    if pairs:
        measured.append(join_image_points(pairs))
    measured, left_out = _of_whole_block(measured, images)
    warnings += left_out
    if not any(len(table) for table in measured):
        raise InputError(
            f"{points.gcps}: no point is measured on any image: give `image_points`, or add the fields image, sample "
            "and line to the layer"
            if ground
            else "there are no image points: give `image_points`, or let 'triangulate' find `tie_points`"
        )
    block = assemble(images, ground, measured, points.gcp_ids, points.check_ids, points.sigmas)
    block = replace(block, operations=of_dem)
    block.points.role[(block.points.role == Role.TIE) & np.isin(block.points.ids, held_out)] = Role.HELD_OUT
    told = check_operations(block, block.all_operations, points.strict_datum)
    return block, [*warnings, *block.warnings, *told]


def check_operations(block: Block, uses: Sequence[OperationUse], strict_datum: bool) -> list[str]:
    """Return warnings on coordinate operations; raise `InputError` if ``strict_datum`` forbids one.

    They include the difference from WGS84, at the time of the images, of plate-fixed datums that are used as WGS84.
    """
    require_strict_datums(uses, strict_datum)
    told = list_operation_warnings(uses)
    times = (read_time(image.path) for image in block.images[:IMAGES_ASKED] if image.path)
    time = next((time for time in times if time is not None), None)
    year = None if time is None else round(time.year + (time.timetuple().tm_yday - 1) / 365.25, 1)
    rpc = block.images[0].rpc
    place = np.array([[rpc.long_off, rpc.lat_off, rpc.height_off]])
    for crs in dict.fromkeys(use.crs for use in uses if use.treats_plate_as_wgs84):
        with suppress(InputError):
            motion = operations_of(crs).motion_in(year or ANY_YEAR)
            if motion is None:
                told.append(
                    f"PROJ has no motion of the plate of {crs}, so that `gcp_epoch` does not move it: plates move by "
                    f"up to {FASTEST_PLATE_M:g} m a year"
                )
            elif year is None:
                told.append(f"{crs}: `gcp_epoch` with the year of the images accounts for the motion of its plate")
            else:
                east, north, _ = ground_difference_m(motion.move(place), place)[0].tolist()
                told.append(
                    f"in {year:g}, the year of the images, WGS84 differs from {crs} by {np.hypot(east, north):.2f} m ("
                    f"{east:+.2f} m east, {north:+.2f} m north): `gcp_epoch` {year:g} accounts for it"
                )
    return told


def of_block(ties: ImagePoints, images: Sequence[Image]) -> tuple[ImagePoints, list[str]]:
    """Return the tie measurements in images of the block, and a warning if the file has others: of a larger block.

    If fewer than two images are known, all are kept: then the names are wrong, and the block reports them.
    """
    named = find_unique_ids(ties.image_ids)[0]
    known = np.isin(named, [image.id for image in images])
    if known.all() or known.sum() < 2:
        return ties, []
    return ties.select(isin(ties.image_ids, named[known])), [_omission_warning(ties, named[~known].tolist())]


def _of_whole_block(measured: Sequence[ImagePoints], images: Sequence[Image]) -> tuple[list[ImagePoints], list[str]]:
    """Return the measurements in images of the block: files may be those of a larger block.

    If an image of the block has no measurement, all are kept: then a name may be wrong.
    """
    known = {image.id for image in images}
    named = {str(name) for table in measured for name in find_unique_ids(table.image_ids)[0]}
    if named <= known or not known <= named:
        return list(measured), []
    return [table.select(isin(table.image_ids, list(known))) for table in measured], [
        _omission_warning(table, sorted(others))
        for table in measured
        if (others := {str(name) for name in find_unique_ids(table.image_ids)[0]} - known)
    ]


def _omission_warning(table: ImagePoints, others: Sequence[str]) -> str:
    listed = ", ".join(others[:5]) + (" …" if len(others) > 5 else "")
    return f"{table.source}: measurements on images that are not in the block are not used ({listed})"


def join_image_points(tables: Sequence[ImagePoints]) -> ImagePoints:
    """Return the matches of image pairs as tracks: equal positions in an image are the same point in all pairs.

    A track with two positions in one image is inconsistent and is omitted.
    """
    image = np.concatenate([table.image_ids for table in tables])
    xy = np.concatenate([table.xy for table in tables])
    ids = np.concatenate([np.char.add(f"{number}:", table.ids) for number, table in enumerate(tables)])
    places = np.column_stack([np.unique(image, return_inverse=True)[1], xy])  # image number, sample, line
    nodes, first_row, node = np.unique(places, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(ids, kind="stable")  # the two rows of a match
    pair = node.ravel()[order].reshape(-1, 2)
    track = build_tracks(pair[:, 0], pair[:, 1], nodes[:, 0].astype(np.int64))
    kept = track >= 0
    rows = first_row[kept]
    names = np.char.add("M", np.char.zfill(track[kept].astype(str), 7))
    return ImagePoints(names, image[rows], xy[rows], source=tables[0].source)


def refuse_idle_matches(search: SearchOptions, is_automatic: bool, instead: str) -> None:
    """Raise `InputError` if `matches` is given but not used, because the option ``instead`` is used."""
    if search.matches and not is_automatic:
        raise InputError(f"`matches` {search.matches} is not used if `{instead}` is not auto: remove one of them")


EARLIER = "earlier:"  # prefix of earlier tie point ids if new ones have the same ids


@dataclass(frozen=True, eq=False)
class EarlierBlock:
    """Earlier block that new images join: its images, tie and known points, or the joint estimate of its cameras."""

    images: tuple[Image, ...] = ()
    ties: tuple[ImagePoints, ...] = ()
    known: tuple[GroundPoints, ...] = ()
    model: str | None = None
    joint: JointCameras | None = None


def open_joined_images(
    paths: Sequence[str],
    growth: BlockGrowthOptions,
    tie_points: str | None,
    shared_images: Sequence[Sequence[str]],
    context: Context,
) -> tuple[list[Image], EarlierBlock]:
    """Return the images of a block, those of an earlier block that they join first, and that earlier block.

    The log names images that are tiles or bands of one exposure and are adjusted as one camera.
    """
    new = open_images(paths, context)
    earlier = read_earlier(growth, new, tie_points)
    images = join_exposures([*earlier.images, *new])
    banded = {image.id for image in images if image.camera_pixel != 1.0}
    for tiles in group_tiles(images, shared_images):
        kind = "bands of one exposure" if banded.intersection(tiles) else "tiles of one scene"
        context.log(f"{', '.join(tiles)}: {kind}, adjusted as one camera (`shared_images` groups them otherwise)")
    return images, earlier


def read_earlier(options: BlockGrowthOptions, images: Sequence[Image], tie_points: str | None = None) -> EarlierBlock:
    """Return the block that the images join; an empty one if the options name none."""
    if options.add_to is None:
        return EarlierBlock()
    record = read_record(options.add_to)
    require_ids(
        [*(one.path for one in record.images), *(image.path for image in images)],
        [*(one.id for one in record.images), *(image.id for image in images)],
    )
    if options.earlier_cameras != FREE:
        # The cameras before any adjustment, and their joint estimate from the earlier one
        source = os.path.join(record.folder, CAMERAS_FILE)
        joint = read_joint_arrays(read_cameras(record.folder), source)
        if set(joint.images) != {one.id for one in record.images}:
            raise InputError(
                f"{source}: belongs to other images than the record in its folder: adjust that block again"
            )
        cameras = [np.flatnonzero(np.equal(joint.camera, number)) for number in np.unique(joint.camera)]
        banded = join_named_bands(
            open_block_images(record), [[joint.images[k] for k in members] for members in cameras]
        )
        return EarlierBlock(tuple(banded), model=record.model, joint=joint)
    earlier = open_block_images(record)
    ids = [one.id for one in record.images]
    ground = read_points(record.layer("ground_points"), image_ids=ids).ground or GroundPoints([], np.empty((0, 3)))
    measured = read_points(record.layer("image_points"), image_ids=ids).image
    if measured is None:
        raise InputError(f"{record.folder}: its block.gpkg has no points: adjust that block again")
    measured, ground = _rename_conflicts(measured, ground, tie_points)
    return EarlierBlock(
        earlier, (measured,), (ground.select(np.isin(ground.role, [Role.GCP, Role.CHECK, Role.HELD_OUT])),)
    )


def open_block_images(record: BlockRecord) -> tuple[Image, ...]:
    """Return the images of a block with their cameras before its adjustment."""
    paths = restore_image_paths((one.id, one.path, one.item) for one in record.images)
    missing = [path for path in paths if not os.path.exists(path) and not path.startswith("/vsi")]
    if missing:
        raise InputError(f"{missing[0]}: an image of the earlier block is not there any more: put it back")
    opened = zip(paths, record.images, strict=True)
    return tuple(join_exposures([replace(open_image(path), id=one.id, rpc=one.rpc) for path, one in opened]))


def _rename_conflicts(
    measured: ImagePoints, ground: GroundPoints, tie_points: str | None
) -> tuple[ImagePoints, GroundPoints]:
    """Return earlier points, with new ids for its tie points if a new file uses the same ids for other points.

    Equal ids are the same points unless the new file has one of them at another position in the same image.
    """
    if not tie_points or tie_points == NO_TIES:
        return measured, ground
    for spec in several_specs(tie_points):
        new = read_image_points(measurements_of(spec), image_ids=find_unique_ids(measured.image_ids)[0].tolist()).image
        if new is None:
            continue
        name, other = (np.char.add(np.char.add(table.ids, "\0"), table.image_ids) for table in (measured, new))
        place, same = match_names(other, name)
        if (np.abs(measured.xy[place[same]] - new.xy[same]) > EQUALITY.file_px).any():
            surveyed = ground.ids[np.isin(ground.role, [Role.GCP, Role.CHECK])]
            of_image, on_ground = (
                np.where(np.isin(table.ids, surveyed), table.ids, np.char.add(EARLIER, table.ids))
                for table in (measured, ground)
            )
            measured, ground = replace(measured, ids=of_image), replace(ground, ids=on_ground)
            break
    return measured, ground

"""Images that join a block that was adjusted before: earlier images, their points, what is known of their cameras.

Either everything is free: the earlier measurements take part again with the cameras as they were before any adjustment,
and the result is that of one adjustment of all. Or the earlier cameras are observations: of the earlier points nothing
is used again but what they say of the cameras together (`adjustment.joint_prior`).
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...hrsi_engine.adjustment.joint_prior import JointCameras
from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.block.block import GroundPoints, Image, ImagePoints, Role
from ...hrsi_engine.block.columns import find_unique_ids, match_names
from ...hrsi_engine.block.exposures import join_exposures, join_named_bands
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.io.catalogue.block_records import CAMERAS_FILE, BlockRecord, read_cameras, read_record
from ...hrsi_engine.io.catalogue.stac_items import restore_image_paths
from ...hrsi_engine.io.point_files import measurements_of, read_image_points, read_points, several_specs
from ...hrsi_engine.io.rasters.images import open_image
from ...hrsi_engine.results.block_record import read_joint_arrays
from ..files.opening import require_ids
from ..interface.option_groups import FREE, NO_TIES, BlockGrowthOptions


@thresholds
class EARLIER_BLOCK:
    """When earlier measurements are those of a new file."""

    same_place_px: float = threshold(
        1e-3, "px", "distance of two measurements of one point on one image that are the same"
    )


EARLIER = "earlier:"  # before ids of earlier tie points where new ones have the same ids


@dataclass(frozen=True, eq=False)
class EarlierBlock:
    """What joins the new images: earlier images, ties and known points, or what is known of the cameras together."""

    images: tuple[Image, ...] = ()
    ties: tuple[ImagePoints, ...] = ()
    known: tuple[GroundPoints, ...] = ()
    model: str | None = None
    joint: JointCameras | None = None

    @property
    def image_ids(self) -> list[str]:
        """Ids of the earlier images."""
        return [image.id for image in self.images]

    def adjust_options(self, options: AdjustOptions) -> AdjustOptions:
        """Return the options with what is known of the earlier cameras."""
        if self.joint is None or self.model is None:
            return options
        return replace(options, model=self.model, earlier=self.joint)


def read_earlier(options: BlockGrowthOptions, images: Sequence[Image], tie_points: str | None = None) -> EarlierBlock:
    """Return the block that the images join; an empty one where the options name none."""
    if options.add_to is None:
        return EarlierBlock()
    record = read_record(options.add_to)
    require_ids([*(one.path for one in record.images), *(image.path for image in images)],
                [*(one.id for one in record.images), *(image.id for image in images)])  # fmt: skip
    if options.earlier_cameras != FREE:
        # The cameras before any adjustment, and what that said of them together
        source = os.path.join(record.folder, CAMERAS_FILE)
        joint = read_joint_arrays(read_cameras(record.folder), source)
        if set(joint.images) != {one.id for one in record.images}:
            raise InputError(f"{source}: is of other images than the record beside it: adjust that block again")
        cameras = [np.flatnonzero(np.equal(joint.camera, number)) for number in np.unique(joint.camera)]
        banded = join_named_bands(
            open_block_images(record), [[joint.images[k] for k in members] for members in cameras]
        )
        return EarlierBlock(tuple(banded), model=record.model, joint=joint)
    earlier = open_block_images(record)
    ids = [one.id for one in record.images]
    tables = [read_points(record.layer(name), image_ids=ids) for name in ("ground_points", "image_points")]
    measured, ground = tables[1].image, tables[0].ground  # no ground points: a block of tie points alone
    ground = GroundPoints.create([], np.empty((0, 3))) if ground is None else ground
    if measured is None:
        raise InputError(f"{record.folder}: its block.gpkg has no points: adjust that block again")
    measured, ground = _rename_conflicts(measured, ground, tie_points)
    return EarlierBlock(
        earlier, (measured,), (ground.select(np.isin(ground.role, [Role.GCP, Role.CHECK, Role.HELD_OUT])),)
    )


def open_block_images(record: BlockRecord) -> tuple[Image, ...]:
    """Return the images of a block with their cameras as they were before its adjustment."""
    paths = restore_image_paths((one.id, one.path, one.item) for one in record.images)
    missing = [path for path in paths if not os.path.exists(path) and not path.startswith("/vsi")]
    if missing:
        raise InputError(f"{missing[0]}: an image of the earlier block is not there any more: put it back")
    opened = zip(paths, record.images, strict=True)
    return tuple(join_exposures([replace(open_image(path), id=one.id, rpc=one.rpc) for path, one in opened]))


def _rename_conflicts(
    measured: ImagePoints, ground: GroundPoints, tie_points: str | None
) -> tuple[ImagePoints, GroundPoints]:
    """Return earlier points with other ids of the tie points where a new file means other points by the same ids.

    They are the same points unless the new file has one of them at another place of the same image.
    """
    if not tie_points or tie_points == NO_TIES:
        return measured, ground
    for spec in several_specs(tie_points):
        new = read_image_points(measurements_of(spec), image_ids=find_unique_ids(measured.image_ids)[0].tolist()).image
        if new is None:
            continue
        name, other = (np.char.add(np.char.add(table.ids, "\0"), table.image_ids) for table in (measured, new))
        place, same = match_names(other, name)
        if (np.abs(measured.xy[place[same]] - new.xy[same]) > EARLIER_BLOCK.same_place_px).any():
            surveyed = ground.ids[np.isin(ground.role, [Role.GCP, Role.CHECK])]
            of_image, on_ground = (
                np.where(np.isin(table.ids, surveyed), table.ids, np.char.add(EARLIER, table.ids))
                for table in (measured, ground)
            )
            measured, ground = replace(measured, ids=of_image), replace(ground, ids=on_ground)
            break
    return measured, ground

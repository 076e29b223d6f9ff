"""From options to a block: opens the images and reads the points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..hrsi_engine.adjustment import AdjustOptions
from ..hrsi_engine.block import Block, Defaults, GroundPoints, Image, ImagePoints, assemble
from ..hrsi_engine.dem import surface_heights
from ..hrsi_engine.errors import InputError
from ..hrsi_engine.io.dems import open_dem
from ..hrsi_engine.io.point_files import read_points
from .terrain import dem_datum

DEM_MARGIN_M = 50.0  # buildings, trees, and the DEM's own errors


def read_block(
    images: Sequence[Image], options: Mapping[str, Any], ties: Sequence[ImagePoints] = ()
) -> tuple[Block, list[str]]:
    """Read the point files named by the options and put the block together with the tie points that are there.

    Ground positions count in the layer of GCPs only: a layer of image points may be one that HRSI wrote, at adjusted
    positions. Returns the block and what the user should know.
    """
    warnings: list[str] = []
    ground: list[GroundPoints] = []
    measured: list[ImagePoints] = list(ties)
    dem = open_dem(options["dem"], dem_datum(options)) if options.get("dem") else None
    for key in ("gcps", "image_points", "tie_points_file"):
        if not options.get(key):
            continue
        tables = read_points(
            options[key],
            ground_crs=options.get("ground_crs"),
            height_datum=options["height_datum"],
            image_ids=[image.id for image in images],
            surface=None if dem is None else partial(surface_heights, dem),
        )
        if tables.ground is not None and key == "gcps":
            ground.append(tables.ground)
        if tables.image is not None:
            measured.append(tables.image)
        if key == "gcps" or tables.image is None:  # positions in other layers are not used, nor is what is said of them
            warnings += tables.warnings
    if ground and not any(len(table) for table in measured):
        raise InputError(
            f"{options['gcps']}: no point is measured on any image: give --image-points, or add the fields image, "
            "sample and line to the layer"
        )
    if not any(len(table) for table in measured):
        raise InputError("there are no image points: give --image-points, or use 'triangulate' with --tie-points auto")
    defaults = Defaults(options["sigma_image"], options["sigma_gcp_xy"], options["sigma_gcp_h"])
    block = assemble(images, ground, measured, options.get("gcp_ids"), options.get("check_ids"), defaults)
    return block, warnings + list(block.warnings)


def terrain_heights(images: Sequence[Image], options: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return the lowest and highest terrain below the images by the DEM, with a margin; None without one."""
    if not options.get("dem"):
        return None
    surface = open_dem(options["dem"], dem_datum(options))
    grids = [image.rpc.localize(image.grid_px(20, 20), image.rpc.height_off).ground for image in images]
    heights = surface_heights(surface, np.concatenate(grids)[:, :2])
    known = heights[np.isfinite(heights)]
    if not len(known):
        raise InputError(f"{options['dem']} has no heights below the images: name a DEM of their area")
    return float(known.min()) - DEM_MARGIN_M, float(known.max()) + DEM_MARGIN_M


def adjust_options(options: Mapping[str, Any]) -> AdjustOptions:
    """Return the engine's options of an adjustment."""
    holds = options.get("sigma_dem") is not None
    if holds and not options.get("dem"):
        raise InputError("--sigma-dem needs a DEM: name it with --dem")
    return AdjustOptions(
        model=options["model"],
        robust=options["robust"],
        sigma_shift_px=options["sigma_shift"],
        sigma_drift=options["sigma_drift"],
        check_as_ties=options["check_as_ties"],
        reject_sigma=options["reject"],
        variance_components=options["variance_components"],
        cross_validate=options["cross_validate"],
        fixed_images=tuple(options["fixed_images"] or ()),
        shared_images=tuple(tuple(group.split("+")) for group in options["shared_images"] or ()),
        dem=open_dem(options["dem"], dem_datum(options)) if holds else None,
        sigma_dem_m=options["sigma_dem"] if holds else AdjustOptions.sigma_dem_m,
        threads=options["threads"],
    )

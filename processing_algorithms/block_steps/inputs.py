"""From options to a block: opens the images and reads the points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...hrsi_engine.adjustment import AdjustOptions
from ...hrsi_engine.block.block import Block, Defaults, GroundPoints, Image, ImagePoints, assemble
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.dems import open_dem
from ...hrsi_engine.io.point_files import measurements_of, read_points, several_specs
from ...hrsi_engine.measurement.tracks import consistent_tracks
from ...hrsi_engine.surface.dem import surface_heights
from ..files.terrain import datum_warning, dem_datum

TIES = "tie_points_file"  #: key of the file of tie points among the options; not an option by itself


def read_block(
    images: Sequence[Image],
    options: Mapping[str, Any],
    ties: Sequence[ImagePoints] = (),
    known: Sequence[GroundPoints] = (),
) -> tuple[Block, list[str]]:
    """Read the point files named by the options and put the block together with ties and known points that are there.

    Ground positions count in the layer of GCPs only: a layer of image points may be one that HRSI wrote, at adjusted
    positions. Returns the block and what the user should know.
    """
    warnings: list[str] = []
    ground: list[GroundPoints] = list(known)
    measured: list[ImagePoints] = list(ties)
    dem = open_dem(options["dem"], dem_datum(options)) if options.get("dem") else None
    pairs: list[ImagePoints] = []
    for key, spec in _point_files(options):
        tables = read_points(
            spec,
            ground_crs=options.get("ground_crs"),
            height_datum=options["height_datum"],
            image_ids=[image.id for image in images],
            surface=None if dem is None else partial(surface_heights, dem),
        )
        if tables.ground is not None and key == "gcps":
            ground.append(tables.ground)
        if tables.image is not None:
            table, left_out = of_block(tables.image, images) if key == TIES else (tables.image, [])
            warnings += left_out
            (pairs if tables.pairwise else measured).append(table)
        if key == "gcps" or tables.image is None:  # positions in other layers are not used, nor is what is said of them
            warnings += tables.warnings
    if dem is not None and len(ground) > len(known):
        warnings += datum_warning(ground[len(known) :], dem, options)
    if pairs:
        measured.append(joined(pairs))
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


def of_block(ties: ImagePoints, images: Sequence[Image]) -> tuple[ImagePoints, list[str]]:
    """Return the tie measurements on images of the block, and a warning where the file has others: a part of a block.

    Where less than two images are known, nothing is left out: then the names are wrong, and the block says so.
    """
    named = np.unique(ties.image_ids)
    known = np.isin(named, [image.id for image in images])
    if known.all() or known.sum() < 2:
        return ties, []
    others = ", ".join(named[~known][:5]) + (" …" if (~known).sum() > 5 else "")
    note = f"{ties.source}: measurements on images that are not in the block are left out ({others})"
    return ties.select(np.isin(ties.image_ids, named[known])), [note]


def _point_files(options: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the option and the name of every point file."""
    keys = ("gcps", "image_points", TIES)
    specs = [(key, spec) for key in keys if options.get(key) for spec in several_specs(options[key])]
    return [(key, spec if key == "gcps" else measurements_of(spec)) for key, spec in specs]


def joined(tables: Sequence[ImagePoints]) -> ImagePoints:
    """Return the matches of image pairs as tracks: the same position on an image is the same point everywhere.

    A track that meets an image at two positions contradicts itself and is left out.
    """
    image = np.concatenate([table.image_ids for table in tables])
    xy = np.concatenate([table.xy for table in tables])
    ids = np.concatenate([np.char.add(f"{number}:", table.ids) for number, table in enumerate(tables)])
    image_number = np.unique(image, return_inverse=True)[1]
    nodes, first_row, node = np.unique(
        np.column_stack([image_number, xy]), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(ids, kind="stable")  # the two rows of a match
    pair = node.ravel()[order].reshape(-1, 2)
    track = consistent_tracks(pair[:, 0], pair[:, 1], nodes[:, 0].astype(np.int64))
    kept = track >= 0
    rows = first_row[kept]
    names = np.char.add("M", np.char.zfill(track[kept].astype(str), 7))
    return ImagePoints.create(names, image[rows], xy[rows], source=tables[0].source)


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
        variance_groups=options["variance_groups"],
        sensor_images=_groups(options["sensor_images"]),
        cross_validate=options["cross_validate"],
        fixed_images=tuple(options["fixed_images"] or ()),
        shared_images=_groups(options["shared_images"]),
        dem=open_dem(options["dem"], dem_datum(options)) if holds else None,
        sigma_dem_m=options["sigma_dem"] if holds else AdjustOptions.sigma_dem_m,
        threads=options["threads"],
    )


def _groups(texts: Sequence[str] | None) -> tuple[tuple[str, ...], ...]:
    """Return groups of image ids from ``A+B``."""
    return tuple(tuple(text.split("+")) for text in texts or ())

"""Pan-sharpened orthoimages: which multispectral image belongs to which panchromatic one, and their jobs."""

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.rasters.ortho_warp import OrthoSource, Warp
from ...hrsi_engine.io.rasters.pansharpening import ExposurePart, Pansharpening, fit_weights, measure_shift
from ..declarations.orthoimages import OrthorectifyOptions
from .orthoimage_plan import BlockPlan, OrthoJob, choose_nodata, identify_image, make_mapping

SHARPENED_ENDING = "_pansharpened.tif"
SAMPLED_WINDOWS = (4, 256)  # windows along each side of the orthoimage from which weights follow, and their side (px)
NOTABLE_SHIFT_PX = 1.0  # above it, a warning is given


def pair_exposures(images: Sequence[Image], colour_paths: Sequence[str]) -> tuple[list[Image], dict[str, Image]]:
    """Return the panchromatic images, and by their ids the multispectral image of each exposure.

    images : all images, those of an exposure as tiles of one scene; colour_paths : files of the multispectral ones
    Raises `InputError` if an image has no multispectral one.
    """
    files = set(colour_paths)
    pan, colour = ([image for image in images if (image.path in files) == wanted] for wanted in (False, True))
    pairs = {}
    for image in pan:
        area, number = max(((_measure_overlap(image, other), k) for k, other in enumerate(colour)), default=(0.0, 0))
        if not area:
            raise InputError(
                f"{image.id}: `pansharpen` names no multispectral image of its exposure: by their RPCs none of the "
                f"{len(files)} files has the same lines of sight and pixels at least 1.5 times as large"
            )
        pairs[image.id] = colour[number]
    return pan, pairs


def _measure_overlap(one: Image, other: Image) -> float:
    """Return the common area of two images of an exposure, which may be parts of it; 0 for different exposures."""
    tiles = one.tile, other.tile
    if tiles[0] is None or tiles[1] is None or tiles[0].scene != tiles[1].scene:
        return 0.0
    first = np.array([tile.first for tile in tiles if tile is not None])
    end = first + [np.multiply(image.known_size, image.tile.pixel) for image in (one, other) if image.tile is not None]
    return float(np.prod(np.maximum(end.min(axis=0) - first.max(axis=0), 0.0)))


def add_colour(job: OrthoJob, image: Image, plan: BlockPlan, options: OrthorectifyOptions) -> OrthoJob:
    """Return the job of the pan-sharpened orthoimage of an exposure."""
    if len(job.source.bands) > 1:
        raise InputError(
            f"{job.image.path}: has {len(job.source.bands)} bands, and `pansharpen` needs a panchromatic image: name "
            "it as an image, and the multispectral one as `pansharpen`"
        )
    source = OrthoSource(image.path)
    # What the panchromatic image hides is masked by it; larger pixels would mask more
    mapping = make_mapping(image, source, plan, job.grid, replace(options, visibility=False), {})
    parts = [
        ExposurePart(
            one.source, one.mapping.chunk, Warp(options.resampling, one.mapping.source_pixels_per_pixel(), None)
        )
        for one in (job, replace(job, source=source, mapping=mapping))
    ]
    nodata = choose_nodata(options.nodata, source)
    count, side = SAMPLED_WINDOWS
    blocks = job.grid.chunks(-(-job.grid.columns // count), -(-job.grid.rows // count))
    windows = [block._replace(columns=min(side, block.columns), rows=min(side, block.rows)) for block in blocks]
    sharpening = Pansharpening(parts[0], parts[1], nodata)
    samples = sharpening.sample(windows)
    if not samples:
        raise InputError(
            f"{image.path}: shows no ground of {job.image.id}: name the multispectral image of the same exposure"
        )
    weights = fit_weights(samples)
    if (shift_px := measure_shift(samples, weights)) > NOTABLE_SHIFT_PX:
        plan.warnings.append(
            f"{image.id}: is displaced by {shift_px:.1f} px against {job.image.id}, and colours too: triangulate the "
            "images of an exposure together"
        )
    return replace(
        job,
        path=os.path.join(options.folder.output_dir, job.image.id + SHARPENED_ENDING),
        source=source,
        warp=replace(job.warp, nodata=nodata),
        made_from={
            **job.made_from,
            "nodata": str(nodata),
            "colour": identify_image(image, mapping),
            "weights": list(weights),
        },
        pansharpening=replace(sharpening, weights=weights),
    )

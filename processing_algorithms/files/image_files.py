"""Images opened for an algorithm, with a word on where each RPC came from."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.rasters.images import open_image_and_source, pixel_doubt
from ...hrsi_engine.io.safety.transactions import finish_interrupted
from ..interface.declare import Context

MOST_LINES = 20  # of a large block only the images with several RPCs are told


def open_images(paths: Sequence[str], context: Context, always: bool = True) -> list[Image]:
    """Open images or RPC files alone; log the source of each RPC and the others that were not used.

    What an interrupted run left of images that it wrote in place is finished first, but for a dry run. A filter stays
    silent (not ``always``) unless there was a choice between several RPCs.
    """
    if not context.dry_run:
        for notice in finish_interrupted({os.path.dirname(path) or "." for path in paths if os.path.exists(path)}):
            context.log(notice)
    images = []
    for path in paths:
        image, found = open_image_and_source(path)
        if found.ignored or (always and len(paths) <= MOST_LINES):
            context.log(f"{image.id}: {found.summary}")
        if doubt := pixel_doubt(image):
            context.log(f"warning: {image.id}: {doubt}")
        images.append(image)
    require_ids(paths, [image.id for image in images])
    return images


def require_ids(paths: Sequence[str], ids: Sequence[str]) -> None:
    """Raise `InputError` where two images have the same id."""
    named: dict[str, str] = {}
    for path, image_id in zip(paths, ids, strict=True):
        if image_id in named:
            raise InputError(f"{named[image_id]} and {path} have the same id {image_id!r}: rename one")
        named[image_id] = path


def is_on_image(image: Image, xy: np.ndarray) -> np.ndarray:
    """Tell of image points ``(n, 2)`` whether they lie on the image's pixels, or where its RPC is meant for."""
    first_sample, last_sample, first_line, last_line = image.domain_px
    low, high = np.array([first_sample, first_line]) - 0.5, np.array([last_sample, last_line]) + 0.5
    return np.asarray(((xy >= low) & (xy <= high)).all(axis=1))

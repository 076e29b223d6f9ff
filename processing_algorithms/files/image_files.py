"""Images opened for an algorithm, with a word on where each RPC came from."""

from collections.abc import Callable, Sequence

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.exposures import join_exposures
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.io.rasters.images import image_id, open_image_and_source, pixel_doubt, resampling_doubt
from ..interface.declare import Context


@thresholds
class IMAGE_LOG:
    """Which images are listed in the log."""

    images: int = threshold(20, "images", "of a larger block only images with several RPCs are told")


def open_images(paths: Sequence[str], log: Callable[[str], None], always: bool = True) -> list[Image]:
    """Open images or RPC files alone; log the source of each RPC and the others that were not used.

    A filter stays silent (not ``always``) unless there was a choice between several RPCs.
    """
    require_ids(paths, [image_id(path) for path in paths])
    images = []
    for path in paths:
        image, found = open_image_and_source(path)
        if found.ignored or (always and len(paths) <= IMAGE_LOG.images):
            log(f"{image.id}: {found.summary}")
        images.append(image)
    return join_exposures(images)


def open_input_images(paths: Sequence[str], context: Context, always: bool = True) -> list[Image]:
    """Open the images of an algorithm as `open_images` does, and warn of RPCs that may not be those of the pixels."""
    images = open_images(paths, context.log, always)
    for image in images:
        if doubt := pixel_doubt(image):
            context.log(f"warning: {image.id}: {doubt}")
        if ignored := resampling_doubt(image):
            context.log(f"warning: {image.id}: {ignored}")
    return images


def require_ids(paths: Sequence[str], ids: Sequence[str]) -> None:
    """Raise `InputError` where two images have the same id."""
    named: dict[str, str] = {}
    for path, name in zip(paths, ids, strict=True):
        if name in named:
            raise InputError(f"{named[name]} and {path} have the same id {name!r}: rename one")
        named[name] = path


def is_on_image(image: Image, xy: np.ndarray) -> np.ndarray:
    """Tell of image points ``(n, 2)`` whether they lie on the image's pixels, or where its RPC is meant for."""
    first_sample, last_sample, first_line, last_line = image.domain_px
    low, high = np.array([first_sample, first_line]) - 0.5, np.array([last_sample, last_line]) + 0.5
    return np.asarray(((xy >= low) & (xy <= high)).all(axis=1))

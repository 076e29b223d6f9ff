"""Crops of the region of interest with everything that a multi-view reconstruction wants to know of each view."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.progress import silent
from ..rasters.cropping import CropWindow, open_window, save_image
from ..rasters.orthoimages import OrthoFormat
from ..rpc_files.crop import crop_rpc
from ..rpc_files.write import UNTOLD
from .project import BlockProject, find_window

_FORMAT, _KERNEL = OrthoFormat("gtiff", "deflate"), "cubic"


class CropView(NamedTuple):
    """A crop of an image.

    image : the image; file : name of the crop; rpc : its camera; size : its samples and lines
    window : what it shows of the image: first sample and line, samples, lines
    xy : (n, 2) points measured in the crop, from the centre of its first pixel; point : (n,) their rows in the block's
    """

    image: Image
    file: str
    rpc: RPC
    size: tuple[int, int]
    window: tuple[int, int, int, int]
    xy: np.ndarray
    point: np.ndarray


def write_views(project: BlockProject, folder: Path) -> Iterator[CropView]:
    """Write the crop of each image that shows the region, resampled by the project's factor; yield what is known."""
    rows = {name: row for row, name in enumerate(project.points.ids.tolist())}
    for image in project.images:
        bounds = find_window(image, project.area, project.surface)
        if min(bounds[2:]) < 1:
            continue
        if image.raster is None:
            raise InputError(f"{image.id}: has no pixels: adjust the images, not RPC files")
        size = max(1, round(project.factor * bounds[2])), max(1, round(project.factor * bounds[3]))
        window = CropWindow(bounds, size)
        rpc, file = crop_rpc(image.rpc, window.place, size), f"{image.id}.tif"
        pixels = open_window(image.path, window, _KERNEL)
        save_image(pixels, str(folder / file), rpc, _FORMAT, 0, UNTOLD, silent)
        own = project.measured.select(project.measured.image_ids == image.id)
        own = own.select(np.array([name in rows for name in own.ids.tolist()], dtype=bool))
        xy = window.place.from_scene(own.xy)
        shown = ((xy >= -0.5) & (xy <= np.array(size) - 0.5)).all(axis=1)
        point = np.array([rows[name] for name in own.ids[shown].tolist()], dtype=np.int64)
        yield CropView(image, file, rpc, size, bounds, xy[shown], point)


def split_views(names: list[str], every: int) -> tuple[list[str], list[str]]:
    """Return the views to learn from, and those held out: one of ``every``, from the middle of each run on."""
    held = names[every // 2 :: every] if len(names) > every // 2 else names[-1:]
    return [name for name in names if name not in held], held

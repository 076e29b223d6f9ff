"""Crops of the region of interest with the data that a multi-view reconstruction needs of each view."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.progress import silent
from ...foundation.thresholds import GRIDS
from ..rasters.cropping import CropWindow, open_window, save_image
from ..rasters.orthoimages import OrthoFormat
from ..rpc_files.crop import crop_rpc
from ..rpc_files.write import NO_LINEAGE
from .project import PROJECTS, BlockProject, find_window, sample_area

_FORMAT, _KERNEL = OrthoFormat("gtiff", "deflate"), "cubic"


class CropView(NamedTuple):
    """A crop of an image.

    image : the image; rpc : camera of the crop; window : its place in the image, and its samples and lines
    xy : (n, 2) points measured in the crop, from the centre of its first pixel; point : (n,) their rows in the block
    """

    image: Image
    rpc: RPC
    window: CropWindow
    xy: np.ndarray
    point: np.ndarray


def find_views(project: BlockProject) -> list[CropView]:
    """Return the crops of the images that show the region, resampled by the project's factor."""
    rows = {name: row for row, name in enumerate(project.points.ids.tolist())}
    views = []
    for image in project.images:
        bounds = find_window(image, project.area, project.surface)
        if min(bounds[2:]) < 1:
            continue
        if image.raster is None:
            raise InputError(f"{image.id}: has no pixels: adjust the images, not RPC files")
        window = CropWindow(
            bounds, (max(1, round(project.factor * bounds[2])), max(1, round(project.factor * bounds[3])))
        )
        image_points = project.measured.select(project.measured.image_ids == image.id)
        image_points = image_points.select(np.array([name in rows for name in image_points.ids.tolist()], dtype=bool))
        xy = window.place.from_scene(image_points.xy)
        is_inside = ((xy >= -0.5) & (xy <= np.array(window.size) - 0.5)).all(axis=1)
        point = np.array([rows[name] for name in image_points.ids[is_inside].tolist()], dtype=np.int64)
        views.append(CropView(image, crop_rpc(image.rpc, window.place, window.size), window, xy[is_inside], point))
    return views


def sample_volume(project: BlockProject) -> np.ndarray:
    """Return ground points ``(n, 3)`` over the region, in layers from below the lowest to above the highest terrain."""
    ground = sample_area(project.area.bounds, project.surface, GRIDS.fine)
    low, high = np.nanmin(ground[..., 2]), np.nanmax(ground[..., 2])
    heights = np.linspace(low - PROJECTS.height_margin_m, high + PROJECTS.height_margin_m, GRIDS.coarse)
    return np.concatenate(
        [np.column_stack([ground[..., :2].reshape(-1, 2), np.full(ground[..., 0].size, height)]) for height in heights]
    )


def write_crop(view: CropView, path: str) -> None:
    """Write the pixels of a view with its RPC as GeoTIFF."""
    pixels = open_window(view.image.path, view.window, _KERNEL)
    save_image(pixels, path, view.rpc, form=_FORMAT, threads=0, lineage=NO_LINEAGE, progress=silent)


def split_views(names: list[str], step: int) -> tuple[list[str], list[str]]:
    """Return the training views and the held-out views: one of ``step``, beginning in the middle of the first run."""
    held_out = names[step // 2 :: step] if len(names) > step // 2 else names[-1:]
    return [name for name in names if name not in held_out], held_out

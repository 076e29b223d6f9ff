"""Rendered images of a flat, textured scene with RPCs: every true correspondence is known."""

from pathlib import Path

import cv2
import numpy as np
import simulated_blocks as blocks

from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.block.points import ImagePoints
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.simulated_files import write_image

HALF = 350.0
BIAS_PX = ((0.0, 0.0), (4.0, -3.0), (-6.0, 2.0))  # of the RPCs of the triplet


def ortho_texture(size: int = 1400, seed: int = 4) -> np.ndarray:
    """Fractal noise, 1 m a pixel, centred on the block."""
    rng = np.random.default_rng(seed)
    sheet = sum(
        2.0 ** (0.7 * octave)
        * cv2.resize(rng.normal(size=(size >> octave, size >> octave)), (size, size), interpolation=cv2.INTER_CUBIC)
        for octave in range(1, 6)
    )
    return (600 + 120 * cv2.GaussianBlur(sheet, (0, 0), 1.0)).astype(np.float32)


def rendered(view: int, texture: np.ndarray, bias_px=(0.0, 0.0), half: float = HALF) -> Image:
    """Return an image of flat ground with its RPC off by ``bias_px``."""
    rpc = blocks.oblique_rpc(*blocks.VIEWS[view], half_px=half, heading=0.1 * view)
    size = int(2 * half) + 1
    xy = np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1).reshape(-1, 2).astype(float)
    ground, _ = rpc.localize(xy, blocks.HEIGHT)
    metres = ground_difference_m(ground, np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (len(ground), 1)))
    centre = (texture.shape[0] - 1) / 2.0
    column = (metres[:, 0] + centre).astype(np.float32).reshape(size, size)
    row = (centre - metres[:, 1]).astype(np.float32).reshape(size, size)
    grey = cv2.remap(texture, column, row, cv2.INTER_CUBIC)
    grey += np.random.default_rng(view).normal(0, 3, grey.shape)
    return Image(f"view{view}", rpc.shift(*bias_px), (size, size), raster=ArrayRaster(grey.astype(np.uint16)))


def triplet(texture: np.ndarray | None = None, half: float = HALF) -> list[Image]:
    """Return three views whose RPCs are off by `BIAS_PX`."""
    texture = ortho_texture(int(4 * half)) if texture is None else texture
    return [rendered(view, texture, bias, half) for view, bias in enumerate(BIAS_PX)]


def written(images: list[Image], folder: Path) -> list[Image]:
    """Write images as GeoTIFFs with their RPCs; return them opened from there."""
    folder.mkdir(parents=True, exist_ok=True)
    for image in images:
        write_image(str(folder / f"{image.id}.tif"), [image.raster], image.rpc)
    return [open_image(str(folder / f"{image.id}.tif")) for image in images]


def ground_spread_m(images: list[Image], points: ImagePoints) -> tuple[np.ndarray, np.ndarray]:
    """Return how far each measurement leads from the mean of its track on the flat ground, (n, 2) m, and the views."""
    _, track = np.unique(points.ids, return_inverse=True)
    views = np.bincount(track)
    metres = np.empty((len(points), 2))
    for index, image in enumerate(images):
        rows = np.flatnonzero(points.image_ids == image.id)
        ground, _ = image.rpc.localize(points.xy[rows] + BIAS_PX[index], blocks.HEIGHT)
        centre = np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (len(ground), 1))
        metres[rows] = ground_difference_m(ground, centre)[:, :2]
    mean = np.column_stack([np.bincount(track, column) / views for column in metres.T])
    return metres - mean[track], views[track]

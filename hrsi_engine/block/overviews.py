"""Images at reduced resolution: means of square blocks of pixels, in memory."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from ..foundation.thresholds import MEMORY
from .block import Image, Raster


@runtime_checkable
class PyramidRaster(Raster, Protocol):
    """A raster of a file with efficient access to reduced resolutions and a mark of the file's content."""

    def content_mark(self) -> str:
        """Return a text that changes when the content of the file or of its sidecar files changes."""

    def read_means(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the complete image as means of ``step`` x ``step`` pixels, and the mask of valid ones."""


def read_overview_pixels(image: Image, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the complete image as means of ``step`` x ``step`` pixels, and the mask of those that are all valid."""
    raster, size = image.pixels, image.known_size
    if isinstance(raster, PyramidRaster):
        return raster.read_means(step)
    parts, lines = [], step * max(MEMORY.part_px // step, 1)
    for line in range(0, step * (size[1] // step), lines):
        strip = raster.read(0, line, size[0], min(lines, size[1] - line))
        parts.append(average_blocks(*strip, step))
    grey, valid = (np.concatenate(part) for part in zip(*parts, strict=True))
    return grey, valid


def average_blocks(grey: np.ndarray, valid: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of blocks of ``step`` x ``step`` pixels and whether all pixels of each block are valid."""
    lines, samples = grey.shape[0] // step, grey.shape[1] // step
    inner = np.s_[: lines * step, : samples * step]
    shape = (lines, step, samples, step)
    mean = np.where(valid[inner], grey[inner], 0).astype(np.float32).reshape(shape).mean(axis=(1, 3))
    is_complete = valid[inner].reshape(shape).all(axis=(1, 3))
    return np.where(is_complete, mean, np.float32(0.0)), is_complete

"""Images on disk: opened with their RPC; windows of pixels are read by several threads and processes."""

from __future__ import annotations

import atexit
import os
import re
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from osgeo import gdal

from ...block.block import Image
from ...block.placement import PlacementDoubt, judge_size
from ...foundation.errors import InputError
from ...foundation.options import InMemory
from ...foundation.thresholds import MEMORY
from ..opening.datasets import virtual_status
from ..opening.files import open_raster, read_pixels
from ..opening.item_images import item_of
from ..rpc_files.fields import FoundRpc
from ..rpc_files.find import read_rpc_file, rpc_of_dataset
from ..rpc_files.placement import describe_map_evidence, find_placement_doubt
from ..safety.content_marks import content_mark

RPC_SUFFIX = "_rpc"  # ending of the names of RPC files


_open_datasets = threading.local()


class RasterioLike(Protocol):
    """Attribute of a rasterio dataset that is used."""

    name: str


class XarrayLike(Protocol):
    """Attribute of an xarray object that is used."""

    encoding: dict[Any, Any]


#: Types that identify the file of an image.
ImageSource = str | os.PathLike[str] | RasterioLike | XarrayLike


class ImageInMemory(InMemory):
    """An image that is open already; its text is its path, or its id if it is made of arrays."""

    __slots__ = ("image",)
    image: Image

    def __new__(cls, image: Image) -> ImageInMemory:
        """Create the image with its name."""
        instance = super().__new__(cls, image.path or image.id)
        instance.image = image
        return instance


def image_id(path: str) -> str:
    """Return an image's id: that of its STAC item, else the file's stem, of an RPC file without a trailing ``_RPC``."""
    if isinstance(path, ImageInMemory):
        return path.image.id
    if (item := item_of(path)) is not None:
        return item.id
    name = re.sub(rf"(?<=.){RPC_SUFFIX}(?=\.(txt|xml)$)", "", os.path.basename(path), flags=re.IGNORECASE)
    return os.path.splitext(name)[0]


def open_image(source: ImageSource) -> Image:
    """Open an image with its RPC, or an RPC file alone (then without pixels).

    Parameters
    ----------
    source : path, rasterio dataset, or xarray object
        Anything that GDAL opens and that has an RPC, or an RPC file; or an object of such a file: an open rasterio
        dataset, a DataArray or Dataset of xarray or rioxarray. Its file is opened, complete and as saved: changes in
        memory and selections are ignored.

    Returns
    -------
    Image
        With its camera, its size and access to its pixels.

    Raises
    ------
    InputError
        The file is missing, is neither an image nor an RPC file, or has no RPC; or ``source`` has no file.
    """
    return open_image_and_source(path_of(source))[0]


def path_of(source: ImageSource) -> str:
    """Return the path of the file of a path, a rasterio dataset or an xarray object.

    xarray has the path in ``encoding["source"]``, rasterio in ``name``. Raises `InputError` for an object without a
    file, for example a computed array.
    """
    if isinstance(source, (str, os.PathLike)):
        return os.fspath(source)
    encoding = getattr(source, "encoding", None)
    path = encoding.get("source") if isinstance(encoding, Mapping) else getattr(source, "name", None)
    if not isinstance(path, str) or not path:
        raise InputError(f"an image given as {type(source).__name__} has no file: save it and give its path")
    return path


def path_elsewhere(path: str) -> str:
    """Return a path that is valid in a process with another working directory; URLs and subdatasets are unchanged."""
    if os.path.exists(path):
        return os.path.abspath(path)
    layer = re.match(r"(/vsi(?:zip|tar|gzip|7z|rar)/)(.+)", path)  # GDAL's prefix of archives, and the archive
    if layer is None or layer[2].startswith("/"):
        return path
    return f"{layer[1]}{path_elsewhere(layer[2]) if layer[2].startswith('vsi') else os.path.abspath(layer[2])}"


def open_image_and_source(path: str) -> tuple[Image, FoundRpc]:
    """Open an image as `open_image`; return also its RPC with the source, for the log."""
    if isinstance(path, ImageInMemory):
        return path.image, FoundRpc(path.image.rpc, "in memory", size=path.image.size)
    path = os.fspath(path)
    raster, found, item = None, read_rpc_file(path), item_of(path)
    if found is None:
        raster = GdalRaster(path)
        found = raster.found = rpc_of_dataset(path, raster.dataset)
    image = Image(
        image_id(path),
        found.rpc,
        found.size if raster is None else raster.size,
        path=path,
        raster=raster,
        tile=found.tile,
        stated_height_m=found.height_m,
        sensor=found.sensor or ("" if item is None else item.platform),
    )
    return image, found


def placement_doubt(image: Image) -> PlacementDoubt | None:
    """Return why an image's RPC may not be that of its pixels; None if there is no sign of that."""
    raster = image.raster
    if not isinstance(raster, GdalRaster) or raster.found is None:
        return None if image.path or image.size is None else judge_size(image.rpc, image.size)
    return find_placement_doubt(raster.path, raster.dataset, replace(raster.found, rpc=image.rpc))


def map_evidence(image: Image) -> str:
    """Return how closely the map coordinates of an image agree with its RPC, if not to the pixel; else ""."""
    raster = image.raster
    if not isinstance(raster, GdalRaster) or raster.found is None:
        return ""
    return describe_map_evidence(raster.path, raster.dataset, replace(raster.found, rpc=image.rpc))


def file_stamp(path: str) -> tuple[int, ...]:
    """Return size and modification time of an open file, which change with its content; zeros if unknown.

    Valid within one process; for the intermediate results of later runs there is `content_marks.content_mark`.
    """
    if path.startswith("/vsi"):
        status = virtual_status(path)
        return (0, 0) if status is None else (int(status.size), int(status.mtime))
    try:
        status = os.stat(path)
    except OSError:  # a subdataset or connection string
        return (0, 0)
    return status.st_size, status.st_mtime_ns, status.st_ino


@atexit.register
def close_images() -> None:
    """Close the images that the calling thread has open; reading opens them again.

    Call it at the end of a computation: files are locked (Windows) while they are open, and datasets must not outlive
    GDAL. Other threads close their images when they end.
    """
    _open_datasets.__dict__.clear()


class GdalRaster:
    """Pixels of the first band of an image. Several threads can read at the same time: each has its own GDAL handle.

    It can be sent to another process (pickled), which opens the file itself, by its absolute path, since the working
    directory may differ.

    Of several bands the first one is read: it is the panchromatic or a visible band in all known products, and a mean
    of bands would mix bands with small shifts between each other.
    """

    def __init__(self, path: str, band: int = 1) -> None:
        self.path, self._band = str(path), band
        self.stamp = file_stamp(path)
        self.found: FoundRpc | None = None  #: the RPC with which the image was opened
        self.size: tuple[int, int] = (self.dataset.RasterXSize, self.dataset.RasterYSize)
        if not 1 <= band <= self.dataset.RasterCount:
            raise InputError(f"{path}: has {self.dataset.RasterCount} bands, band {band} is wanted: name another image")

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "path": path_elsewhere(self.path)}

    @property
    def dataset(self) -> gdal.Dataset:
        """The GDAL dataset of the calling thread."""
        datasets: OrderedDict[tuple[str, tuple[int, ...]], gdal.Dataset]
        datasets = _open_datasets.__dict__.setdefault("by_path", OrderedDict())  # the oldest are closed
        dataset = datasets.pop((self.path, self.stamp), None) or open_raster(self.path)
        datasets[self.path, self.stamp] = dataset
        while len(datasets) > MEMORY.images:
            datasets.popitem(last=False)
        return dataset

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the grey values ``(lines, samples)`` of a window, and the mask of its valid pixels (bool).

        The window may extend beyond the image: there the mask is False and the grey value 0. Also invalid are nodata,
        pixels that a mask or alpha band excludes, and values that are not finite. Raises `InputError` if the pixels
        cannot be read.
        """
        first_sample, first_line = max(sample, 0), max(line, 0)
        width = min(sample + samples, self.size[0]) - first_sample
        height = min(line + lines, self.size[1]) - first_line
        if width <= 0 or height <= 0:
            return np.zeros((lines, samples), dtype=np.float32), np.zeros((lines, samples), dtype=bool)
        masked = self.dataset.GetRasterBand(self._band).GetMaskFlags() != gdal.GMF_ALL_VALID
        window = first_sample, first_line, width, height
        (grey,), mask = read_pixels(self.path, self.dataset, [self._band], window, masked)
        valid = np.ones(grey.shape, dtype=bool) if mask is None else mask != 0
        if np.issubdtype(grey.dtype, np.inexact):
            valid &= np.isfinite(grey)
        if (width, height) == (samples, lines):
            return grey, valid
        down, right = first_line - line, first_sample - sample
        place = np.s_[down : down + height, right : right + width]
        complete, mask = np.zeros((lines, samples), dtype=grey.dtype), np.zeros((lines, samples), dtype=bool)
        complete[place], mask[place] = grey, valid
        return complete, mask

    def content_mark(self) -> str:
        """Return the fingerprint of the file and its side files: `content_marks.content_mark`."""
        return content_mark(self.path)

    def read_means(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the complete image as means of ``step`` x ``step`` pixels, float32 and mask, ``(lines, samples)``.

        GDAL uses the overviews of the image if it has them. Otherwise all pixels are read by strips, and GDAL's cache
        is emptied after each: memory does not exceed a strip. A mean is valid if all its pixels are.
        """
        samples, lines = self.size[0] // step, self.size[1] // step
        grey, valid = np.empty((lines, samples), dtype=np.float32), np.empty((lines, samples), dtype=bool)
        strip = max(1, MEMORY.values // (samples * step * step))
        dataset = self.dataset
        masked = dataset.GetRasterBand(self._band).GetMaskFlags() != gdal.GMF_ALL_VALID
        means = {"buf_type": gdal.GDT_Float32, "resample_alg": gdal.GRIORA_Average}
        for first in range(0, lines, strip):
            count = min(strip, lines - first)
            window = 0, first * step, samples * step, count * step
            (part,), mask = read_pixels(
                self.path, dataset, [self._band], window, masked, buf_xsize=samples, buf_ysize=count, **means
            )
            dataset.FlushCache()
            is_valid = np.isfinite(part) if mask is None else np.isfinite(part) & (mask >= 254.5)
            grey[first : first + count] = np.where(is_valid, part, np.float32(0.0))
            valid[first : first + count] = is_valid
        return grey, valid

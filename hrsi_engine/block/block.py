"""The block: images with their cameras, points on the ground, and their measurements in the images.

All data are columns of NumPy arrays; text ids are resolved to integer indices once, in `assembly.assemble`.
`GroundPoints` and `ImagePoints` come from files and matchers; a `Block` is what is adjusted.

Images at reduced resolution: means of square blocks of pixels, in memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np

from ..camera.rpc import RPC
from ..camera.rpc_stack import RPCStack
from ..foundation.errors import InputError, list_ids
from ..foundation.thresholds import MEMORY
from ..ground.operation_uses import OperationUse
from .columns import find_unique_ids
from .points import GroundPoints, ImagePoints, Measurements, Role, stack_ground_points


class Raster(Protocol):
    """Access to the pixels of an image; implemented by the readers of `hrsi_engine.io`."""

    @property
    def size(self) -> tuple[int, int]:
        """Number of samples and lines."""

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the grey values ``(lines, samples)`` of a window and its mask of valid pixels (bool).

        Parameters
        ----------
        sample, line : int
            First pixel of the window.
        samples, lines : int
            Size of the window.

        Returns
        -------
        tuple of (lines, samples) ndarray
            Grey values; and True for valid ones.
        """


class ArrayRaster:
    """Pixels in memory: ``grey (lines, samples)``, and the mask ``valid``, by default all True."""

    def __init__(self, grey: np.ndarray, valid: np.ndarray | None = None) -> None:
        self.grey = grey
        self.valid = np.ones(grey.shape, dtype=bool) if valid is None else valid
        self.size: tuple[int, int] = (grey.shape[1], grey.shape[0])

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a window within the image and its mask of valid pixels."""
        window = np.s_[line : line + lines, sample : sample + samples]
        return self.grey[window], self.valid[window]


@dataclass(frozen=True)
class Tile:
    """Position of an image in its scene, as a tile or a band; all images of a scene are one exposure with one camera.

    An image point ``xy`` is ``first + pixel * xy`` in the scene; RPC corrections are in pixels of the scene.

    scene : name of the scene: that of the file with its RPC, or of its panchromatic image
    first : sample and line in the scene of the centre of the image's first pixel
    size : samples and lines of the scene, None if unknown
    pixel : size of the image's pixels in pixels of the scene: 4 for most multispectral bands
    """

    scene: str
    first: tuple[float, float]
    size: tuple[int, int] | None = None
    pixel: float = 1.0


@dataclass(frozen=True, eq=False)
class Image:
    """One image: its id, its camera and, if known, its size and pixels.

    Parameters
    ----------
    id : str
        Its name in the block, in files and messages.
    rpc : RPC
        Its camera.
    size : tuple of int, optional
        Samples and lines.
    path : str
        Path of the file; empty for an image from arrays.
    raster : Raster, optional
        Its pixels.
    tile : Tile, optional
        Position in its scene, if it is a tile or a band of one.
    stated_height_m : float, optional
        Ellipsoidal height of the scene's centre, if the product states it.
    sensor : str
        Name of the satellite in the metadata; empty if they do not contain it.
    """

    id: str
    rpc: RPC
    size: tuple[int, int] | None = None
    path: str = ""
    raster: Raster | None = None
    tile: Tile | None = None
    stated_height_m: float | None = None
    sensor: str = ""

    def __repr__(self) -> str:
        size = f"{self.size[0]} x {self.size[1]} px" if self.size else "size not known"
        return f"<Image {self.id}: {size}{'' if self.raster is not None else ', no pixels'}, {self.rpc!r}>"

    @property
    def middle_height_m(self) -> float:
        """Ellipsoidal height of the ground without a DEM: as stated by the product, else the RPC's HEIGHT_OFF."""
        return self.rpc.height_off if self.stated_height_m is None else self.stated_height_m

    @property
    def known_size(self) -> tuple[int, int]:
        """`size` for uses that require it; raises `InputError` if it is unknown."""
        if self.size is None:
            raise InputError(f"{self.id}: the size of the image is not known: name the image itself, not its RPC file")
        return self.size

    @property
    def pixels(self) -> Raster:
        """`raster` for uses that require it; raises `InputError` for an image without pixels."""
        if self.raster is None:
            raise InputError(f"{self.id} has no pixels: name the image itself, not its RPC file")
        return self.raster

    @property
    def has_file(self) -> bool:
        """Whether the pixels are in a file: not for an RPC without image, and not for an image from arrays."""
        return self.raster is not None and bool(self.path)

    @property
    def domain_px(self) -> tuple[float, float, float, float]:
        """Image area: first and last sample, first and last line (pixel centres).

        From the image size; without it from OFF and SCALE, which for crops can be those of the full scene.
        """
        if self.size is not None:
            return 0.0, self.size[0] - 1.0, 0.0, self.size[1] - 1.0
        rpc = self.rpc
        return (
            rpc.samp_off - rpc.samp_scale,
            rpc.samp_off + rpc.samp_scale,
            rpc.line_off - rpc.line_scale,
            rpc.line_off + rpc.line_scale,
        )

    @property
    def centre_px(self) -> np.ndarray:
        """Centre of the image area, ``(2,)`` sample and line."""
        first_sample, last_sample, first_line, last_line = self.domain_px
        return np.array([(first_sample + last_sample) / 2.0, (first_line + last_line) / 2.0])

    @property
    def half_size_px(self) -> np.ndarray:
        """Half the extent of the image area, ``(2,)`` in pixels."""
        first_sample, last_sample, first_line, last_line = self.domain_px
        return np.array([(last_sample - first_sample) / 2.0, (last_line - first_line) / 2.0])

    @property
    def camera_centre_px(self) -> np.ndarray:
        """Centre of the scene in the image's pixels, ``(2,)``: origin of RPC corrections; differs for tiles only."""
        if self.tile is None or self.tile.size is None:
            return self.centre_px
        return ((np.array(self.tile.size) - 1.0) / 2.0 - np.array(self.tile.first)) / self.tile.pixel

    @property
    def camera_half_size_px(self) -> np.ndarray:
        """Half the extent of the scene, ``(2,)``; it differs from that of the image for tiles only."""
        if self.tile is None or self.tile.size is None:
            return self.half_size_px
        return (np.array(self.tile.size) - 1.0) / 2.0 / self.tile.pixel

    @property
    def camera_pixel(self) -> float:
        """Size of the image's pixels in pixels of its scene, the unit of RPC corrections."""
        return 1.0 if self.tile is None else self.tile.pixel

    def grid_px(self, samples: int, lines: int, margin: float = 0.0) -> np.ndarray:
        """Return a regular grid over the image area.

        Parameters
        ----------
        samples, lines : int
            Number of points along each axis.
        margin : float
            Extension of the grid beyond the image as a share of the image; negative for a smaller grid.

        Returns
        -------
        (samples * lines, 2) ndarray
            Sample, line in pixels.
        """
        reach = (1.0 + margin) * self.half_size_px
        axes = [c + r * np.linspace(-1, 1, n) for c, r, n in zip(self.centre_px, reach, (samples, lines), strict=True)]
        return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)

    def outline_px(self, per_side: int = 5) -> np.ndarray:
        """Return points around the image area (outer pixel edges), clockwise.

        Parameters
        ----------
        per_side : int
            Number of points on each side.

        Returns
        -------
        (4 * per_side, 2) ndarray
            Sample, line in pixels.
        """
        first_sample, last_sample, first_line, last_line = self.domain_px
        s0, s1, l0, l1 = first_sample - 0.5, last_sample + 0.5, first_line - 0.5, last_line + 0.5
        t = np.arange(per_side) / per_side
        sample = np.concatenate([s0 + (s1 - s0) * t, np.full(per_side, s1), s1 - (s1 - s0) * t, np.full(per_side, s0)])
        line = np.concatenate([np.full(per_side, l0), l0 + (l1 - l0) * t, np.full(per_side, l1), l1 - (l1 - l0) * t])
        return np.column_stack([sample, line])


@dataclass(frozen=True, eq=False)
class Block:
    """Images, ground points and measurements with consistent indices; every sigma is set.

    Parameters
    ----------
    images : tuple of Image
        The images.
    points : GroundPoints
        The ground points.
    measurements : Measurements
        Image points, with indices of images and points.
    warnings : tuple of str
        Corrections of the inputs.
    unmeasured : GroundPoints
        Known points that are not measured in any image, with their roles.
    operations : tuple of OperationUse
        Operations that converted the DEM and other sources, except the points, to WGS84.
    """

    images: tuple[Image, ...]
    points: GroundPoints
    measurements: Measurements
    warnings: tuple[str, ...] = field(default=())
    unmeasured: GroundPoints = field(default_factory=lambda: GroundPoints([], np.empty((0, 3))))
    operations: tuple[OperationUse, ...] = ()

    def __repr__(self) -> str:
        return f"<Block: {len(self.images)} images, {len(self.points)} points, {len(self.measurements)} measurements>"

    @property
    def all_operations(self) -> tuple[OperationUse, ...]:
        """Operations that converted the points and all other sources to WGS84."""
        return self.points.operations + self.operations

    @property
    def known(self) -> np.ndarray:
        """Mask of the points with a surveyed ground position: GCPs and check points."""
        return (self.points.role == Role.GCP) | (self.points.role == Role.CHECK)

    @property
    def exposure_of_image(self) -> np.ndarray:
        """Index of each image's exposure, ``(images,)``, equal for the tiles and bands of one exposure."""
        return number_exposures(self.images)

    def rays_per_point(self) -> np.ndarray:
        """Return the number of different exposures in which each point is measured.

        Tiles and bands of one exposure observe a point on the same ray, and do not determine its position together.

        Returns
        -------
        (m,) ndarray
            Numbers of exposures; equal to the numbers of images if each image is an exposure of its own.
        """
        point, image = self.measurements.point, self.measurements.image  # sorted by point, then by image
        exposure = self.exposure_of_image
        if exposure.max(initial=-1) + 1 < len(exposure):
            point, image = np.unique(np.column_stack([point, exposure[image]]), axis=0).T
        another = np.ones(len(point), dtype=bool)
        another[1:] = (point[1:] != point[:-1]) | (image[1:] != image[:-1])
        return np.bincount(point[another], minlength=len(self.points))

    def with_ties(self, ties: ImagePoints) -> Block:
        """Return the block with further tie points appended.

        Parameters
        ----------
        ties : ImagePoints
            Measurements in images of the block, with sigmas; none of their points may be in the block already.

        Returns
        -------
        Block
            The block with the new points and measurements.
        """
        ids, point = find_unique_ids(ties.ids)
        image = find_image_indices(ties, self.images).astype(self.measurements.image.dtype)
        order = np.lexsort((image, point))
        added = GroundPoints(ids, np.full((len(ids), 3), np.nan), Role.TIE)
        columns = {
            "point": (len(self.points) + point).astype(self.measurements.point.dtype),
            "image": image,
            "xy": ties.xy,
            "sigma_px": ties.sigma_px,
            "kind": ties.kind,
            "quality": ties.quality,
        }
        rows = {name: np.concatenate([getattr(self.measurements, name), new[order]]) for name, new in columns.items()}
        return replace(self, points=stack_ground_points([self.points, added]), measurements=Measurements(**rows))

    def with_measurements(self, keep: np.ndarray) -> Block:
        """Return the block with only the selected measurements; all points are kept.

        Parameters
        ----------
        keep : (n,) ndarray
            True for measurements to keep.

        Returns
        -------
        Block
            The smaller block.
        """
        return replace(self, measurements=self.measurements.select(keep))

    def with_cameras(self, cameras: Sequence[RPC]) -> Block:
        """Return the block with the images' cameras replaced.

        Parameters
        ----------
        cameras : sequence of RPC
            One RPC for each image, in the order of the images.

        Returns
        -------
        Block
            The same points and measurements.
        """
        images = tuple(replace(image, rpc=rpc) for image, rpc in zip(self.images, cameras, strict=True))
        return replace(self, images=images)


def find_image_indices(rows: ImagePoints, images: Sequence[Image]) -> np.ndarray:
    """Return the image index of each row; raise `InputError` for image ids that are not in the block."""
    measured, inverse = find_unique_ids(rows.image_ids)
    position = {image.id: index for index, image in enumerate(images)}
    unknown = [name for name in measured if str(name) not in position]
    if unknown:
        source = f" of {rows.source}" if rows.source else ""
        raise InputError(
            f"image {list_ids(map(repr, map(str, unknown)))} in the image points{source} is not in the block "
            "(images: "
            f"{list_ids(position)}): name the image file too, correct the 'image' field, or write FILE|image=ID"
        )
    return np.array([position[str(name)] for name in measured], dtype=np.int64)[inverse]


def number_exposures(images: Sequence[Image]) -> np.ndarray:
    """Return the index of each image's exposure, counted from 0, ``(images,)``."""
    number: dict[str | int, int] = {}
    result = [
        number.setdefault(index if image.tile is None else image.tile.scene, len(number))
        for index, image in enumerate(images)
    ]
    return np.array(result, dtype=np.int64)


def group_tiles(images: Sequence[Image], single_tiles: Sequence[Sequence[str]] = ()) -> list[list[str]]:
    """Return the ids of tiles or bands of each scene that has several, without the ids in ``single_tiles``."""
    names = {name for group in single_tiles for name in group}
    scenes: dict[str, list[str]] = {}
    for image in images:
        if image.tile is not None and image.id not in names:
            scenes.setdefault(image.tile.scene, []).append(image.id)
    return [tiles for tiles in scenes.values() if len(tiles) > 1]


def stack_rpcs(images: Sequence[Image]) -> RPCStack:
    """Return the RPCs of images as a stack, in the order of the images."""
    return RPCStack([image.rpc for image in images])


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
    lines = step * max(MEMORY.part_px // step, 1)
    parts = [
        average_blocks(*raster.read(0, line, size[0], min(lines, size[1] - line)), step)
        for line in range(0, step * (size[1] // step), lines)
    ]
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

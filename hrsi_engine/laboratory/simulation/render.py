"""Pixels of a simulated image or orthophoto, for any window, without the rest of it.

Every pixel is the blurred grey value of the ground where its true ray first meets the terrain. Rays are exact at the
nodes of a grid over the image and bilinear between them (closer in lines where the attitude jitters quickly:
the error is below 1e-3 px for any of the sensors); the intersection with the terrain and the grey
value are computed for every pixel. The noise of each tile has its own seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ...block.block import Block
from ...foundation.pixel_filters import blur
from .landscape import SPECTRAL_BANDS
from .lighting import LitPainter, light_walls
from .pushbroom import PushbroomCamera
from .scene import Scene, select_objects
from .seasons import make_season_texture
from .sensors import LARGEST_DN, Radiometry
from .surface import RayPaths, compute_ray_paths, meet_surface
from .synthesis import BlockSimulation
from .tiles import TILES, TilePainter, compute_tile_shape, cut_window
from .world import constant, constants


@constants
class RENDERING:
    """Grid of exact rays, and blur of orthophotos."""

    node_samples: int = constant(32, "px", "spacing of exact rays along a line")
    node_lines: int = constant(16, "px", "largest spacing of exact rays across lines")
    jitter_px: float = constant(
        5e-4, "px", "largest error of jitter by linear interpolation between exact rays", "bound of interpolation"
    )
    ortho_blur_px: float = constant(0.5, "px", "standard deviation of the blur of an orthophoto")


@dataclass(frozen=True, eq=False)
class ImageRenderer:
    """Renders windows of one band of one image; thread-safe. Make one with `make_renderer`.

    Parameters
    ----------
    scene : Scene
        What is seen.
    camera : PushbroomCamera
        By whom.
    radiometry : Radiometry
        How grey values become digital numbers.
    painter : TilePainter
        Paints the ground of a tile.
    stream : int
        Number of the image and band, for its noise.
    """

    scene: Scene
    camera: PushbroomCamera
    radiometry: Radiometry
    painter: TilePainter
    stream: int

    @property
    def size(self) -> tuple[int, int]:
        """Number of samples and lines."""
        return self.camera.size

    def window(self, sample: int, line: int, samples: int, lines: int) -> np.ndarray:
        """Return a window's digital numbers.

        Parameters
        ----------
        sample, line : int
            The window's first pixel.
        samples, lines : int
            Its size.

        Returns
        -------
        (lines, samples) ndarray
            Type uint16.

        Raises
        ------
        ValueError
            The window is not inside the image.
        """
        return cut_window(self._remembered_tile, self.size, sample, line, samples, lines)

    @cached_property
    def _remembered_tile(self) -> Callable[[int, int], np.ndarray]:
        """`tile`, remembering the last ones for windows that overlap; 8 MB."""
        return lru_cache(maxsize=64)(self.tile)

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """As `Raster.read`: every pixel is valid."""
        return self.window(sample, line, samples, lines), np.ones((lines, samples), dtype=bool)

    def tile(self, row: int, column: int) -> np.ndarray:
        """Return one tile's digital numbers, uint16.

        Parameters
        ----------
        row, column : int
            The tile.

        Returns
        -------
        (lines, samples) ndarray
            Type uint16.
        """
        radiometry = self.radiometry
        grey = np.float32(radiometry.gain) * self.noise_free_tile(row, column) + np.float32(radiometry.offset)
        rng = np.random.default_rng([self.scene.spec.seed, 50, self.stream, row, column])
        noise = rng.standard_normal(grey.shape, dtype=np.float32)
        variance = np.float32(radiometry.noise_dn**2) + np.float32(radiometry.shot_dn) * np.maximum(grey, 0.0)
        return _quantise(grey + noise * np.sqrt(variance))

    def noise_free_tile(self, row: int, column: int) -> np.ndarray:
        """Return one tile's blurred grey values, float32, before gain and noise.

        Parameters
        ----------
        row, column : int
            The tile.

        Returns
        -------
        (lines, samples) ndarray
            Type float32.
        """
        paths = self.tile_paths(row, column)
        height = meet_surface(paths, self.scene.terrain)
        east, north = paths.position_at(height)
        lean = np.stack(paths.position_at(height + 1.0)) - (east, north)
        grey = self.painter.grey(row, column, east, north, lean)
        if self.scene.has_walls:
            grey *= blur(light_walls(self.scene.terrain, east, north), self.radiometry.psf_px)
        return grey

    def tile_paths(self, row: int, column: int) -> RayPaths:
        """Return the rays of a tile's pixels, from the exact ones at the nodes around it.

        Parameters
        ----------
        row, column : int
            The tile.

        Returns
        -------
        RayPaths
            Where they go through the terrain's heights.
        """
        lines, samples = compute_tile_shape(self.size, row, column)
        across, down = samples // RENDERING.node_samples + 2, lines // self._node_lines + 2
        sample = column * TILES.tile_px + RENDERING.node_samples * np.arange(across)
        line = row * TILES.tile_px + self._node_lines * np.arange(down)
        nodes = np.stack(np.meshgrid(sample, line), axis=-1).reshape(-1, 2)
        exact = compute_ray_paths(self.camera, self.scene.terrain, nodes.astype(np.float64))
        grid = exact.coefficients.reshape(3, 2, down, across)
        by_line = _compute_linear_weights(lines, self._node_lines, down)
        by_sample = _compute_linear_weights(samples, RENDERING.node_samples, across)
        return exact._replace(coefficients=by_line @ grid @ by_sample.T)

    @cached_property
    def _node_lines(self) -> int:
        """Lines from one row of exact rays to the next."""
        # Between nodes at a distance h a chord deviates by h² / 8 times the second derivative at most
        curvature_px = max(self.camera.error.vibration.curvature_rad / self.camera.pixel_rad, 1e-12)
        return int(np.clip(np.sqrt(8.0 * RENDERING.jitter_px / curvature_px), 1, RENDERING.node_lines))


def make_renderer(simulated: BlockSimulation, image_id: str, band: str = "pan") -> ImageRenderer:
    """Return the renderer of one band of an image.

    A multispectral pixel covers `Sensor.ms_ratio` squared panchromatic ones; both images have the same upper left outer
    corner.

    Parameters
    ----------
    simulated : BlockSimulation
        The block.
    image_id : str
        The image.
    band : str
        ``pan`` or one of the multispectral bands, which have larger pixels.

    Returns
    -------
    ImageRenderer
        The renderer.

    Raises
    ------
    InputError
        The image is not known.
    ValueError
        The band is not known.
    """
    index, band_index = simulated.index(image_id), SPECTRAL_BANDS.index(band)
    view, camera, scene = simulated.views[index], simulated.truth.cameras[index], simulated.scene
    if band_index:
        camera = camera.coarsen(view.sensor.ms_ratio)
    blur_m = view.radiometry.psf_px * float(np.sqrt(np.prod(camera.gsd_m())))
    gsd_m = min(camera.gsd_m())
    if view.acquisition is None:
        texture = scene.texture.blur(blur_m, band_index, view.date, scene.spec.change)
        centres = camera.ground_to_image(scene.object_ground())
        painter = TilePainter.from_objects(camera.size, texture, scene.objects, centres, gsd_m, blur_m)
    else:
        objects, height_m = select_objects(scene, view.acquisition)
        position = objects.position_m
        centres = camera.ground_to_image(scene.chart.to_ground(position, scene.terrain.height(*position.T)))
        texture = make_season_texture(scene.texture, view.acquisition, scene.spec.lat_deg, blur_m, band_index)
        plain = TilePainter.from_objects(camera.size, texture, objects, centres, gsd_m, blur_m)
        painter = LitPainter.from_painter(plain, scene.terrain, view.acquisition, height_m, gsd_m)
    return ImageRenderer(scene, camera, view.radiometry, painter, len(SPECTRAL_BANDS) * index + band_index)


def make_multispectral_renderers(simulated: BlockSimulation, image_id: str) -> tuple[ImageRenderer, ...]:
    """Return the renderers of blue, green, red and near infrared, which share what does not depend on the band.

    Parameters
    ----------
    simulated : BlockSimulation
        The block.
    image_id : str
        The image.

    Returns
    -------
    tuple of ImageRenderer
        In this order.

    Raises
    ------
    InputError
        The image is not known.
    """
    first = make_renderer(simulated, image_id, SPECTRAL_BANDS[1])
    return tuple(
        replace(
            first,
            painter=replace(first.painter, texture=replace(first.painter.texture, band=band)),
            stream=first.stream + band - 1,
        )
        for band in range(1, len(SPECTRAL_BANDS))
    )


def render_window(
    simulated: BlockSimulation, image_id: str, sample: int, line: int, samples: int, lines: int, band: str = "pan"
) -> np.ndarray:
    """Return a window of a simulated image. For many windows keep a `make_renderer`.

    Parameters
    ----------
    simulated : BlockSimulation
        The block.
    image_id : str
        The image.
    sample, line : int
        The window's first pixel.
    samples, lines : int
        Its size.
    band : str
        The band.

    Returns
    -------
    (lines, samples) ndarray
        Type uint16.
    """
    return make_renderer(simulated, image_id, band).window(sample, line, samples, lines)


def add_pixels(simulated: BlockSimulation) -> Block:
    """Return the simulated block whose images render their pixels when they are read.

    Parameters
    ----------
    simulated : BlockSimulation
        The block.

    Returns
    -------
    Block
        The same block; its images have a raster.
    """
    images = tuple(replace(image, raster=make_renderer(simulated, image.id)) for image in simulated.block.images)
    return replace(simulated.block, images=images)


@dataclass(frozen=True, eq=False)
class OrthoRenderer:
    """The ground seen straight from above, free of noise; pixels are regular in longitude and latitude."""

    scene: Scene
    painter: TilePainter
    west_m: float
    north_m: float
    gsd_m: float

    @property
    def size(self) -> tuple[int, int]:
        """Number of samples and lines."""
        return self.painter.size

    @property
    def geotransform(self) -> tuple[float, float, float, float, float, float]:
        """GDAL geotransform in degrees."""
        return self.scene.chart.geotransform(self.west_m, self.north_m, self.gsd_m)

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a window and its mask of valid pixels, all of them: `block.Raster`'s contract."""
        pixels = cut_window(self._tile, self.size, sample, line, samples, lines)
        return pixels, np.ones((lines, samples), dtype=bool)

    def _tile(self, row: int, column: int) -> np.ndarray:
        """Return one tile's digital numbers, uint16, without noise."""
        lines, samples = compute_tile_shape(self.size, row, column)
        east = self.west_m + self.gsd_m * (column * TILES.tile_px + np.arange(samples))
        north = self.north_m - self.gsd_m * (row * TILES.tile_px + np.arange(lines))
        ground = self.ground_of(*np.meshgrid(east, north))
        return _quantise(self.painter.grey(row, column, *ground))

    def ground_of(self, east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the chart positions that pixels at stated ones show: the same.

        Parameters
        ----------
        east, north : ndarray
            Chart metres, as the orthophoto states them.

        Returns
        -------
        tuple of ndarray
            East and north.
        """
        return east, north


def make_orthophoto(scene: Scene, gsd_m: float, half_extent_m: float | None = None, band: str = "pan") -> OrthoRenderer:
    """Return the orthophoto of a square around the scene's centre.

    Parameters
    ----------
    scene : Scene
        What is seen.
    gsd_m : float
        Side of a pixel.
    half_extent_m : float, optional
        Half the square's side; by default the scene's.
    band : str
        The band.

    Returns
    -------
    OrthoRenderer
        It renders windows.
    """
    half = int((half_extent_m or scene.half_extent_m) / gsd_m)
    corner = -half * gsd_m, half * gsd_m
    size = 2 * half + 1, 2 * half + 1
    centres = (scene.objects.position_m - corner) * [1.0, -1.0] / gsd_m
    texture = scene.texture.blur(RENDERING.ortho_blur_px * gsd_m, SPECTRAL_BANDS.index(band))
    painter = TilePainter.from_objects(size, texture, scene.objects, centres, gsd_m, RENDERING.ortho_blur_px * gsd_m)
    return OrthoRenderer(scene, painter, *corner, gsd_m)


def _quantise(grey: np.ndarray) -> np.ndarray:
    """Return grey values as digital numbers of 11 bits."""
    return np.clip(np.rint(grey), 0, LARGEST_DN).astype(np.uint16)


@lru_cache(maxsize=32)
def _compute_linear_weights(count: int, spacing: int, nodes: int) -> np.ndarray:
    """Return ``(count, nodes)``: weights that interpolate linearly between nodes ``spacing`` pixels apart."""
    position = np.arange(count) / spacing
    return np.clip(1.0 - np.abs(position[:, None] - np.arange(nodes)), 0.0, 1.0)

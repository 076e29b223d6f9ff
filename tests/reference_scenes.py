"""Simulated images with the orthophoto of the same ground, for tests that match one with the other."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from hrsi.hrsi_engine.block.block import ArrayRaster, Image, Raster
from hrsi.hrsi_engine.block.orthoimage import Orthoimage
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.laboratory.simulation.terrain import TerrainSurface
from hrsi.hrsi_engine.surface.grid_surface import GridSurface


def place_on_degrees(raster: Raster, geotransform: tuple[float, ...]) -> Orthoimage:
    """Return an orthoimage whose rows and columns follow parallels and meridians, with GDAL's geotransform."""
    west, lon_step, _, north, _, lat_step = geotransform
    step, corner = np.array([lon_step, lat_step]), np.array([west, north])
    return Orthoimage(
        raster, lambda lonlat: (lonlat - corner) / step - 0.5, lambda pixels: (pixels + 0.5) * step + corner
    )


@dataclass(frozen=True, eq=False)
class Scene:
    """Images with pixels, the true orthophoto, the true terrain, and the truth."""

    simulated: lab.BlockSimulation
    images: tuple[Image, ...]
    reference: Orthoimage
    terrain: GridSurface

    def true_error_px(self, number: int, ground: np.ndarray, xy: np.ndarray) -> np.ndarray:
        """Return measured - true image points of an image for ground points; ``(n, 2)``."""
        return xy - self.simulated.truth.cameras[number].ground_to_image(ground)


def surface_of(terrain: TerrainSurface) -> GridSurface:
    """Return a simulated terrain as a height surface."""
    west, lon_step, _, north, _, lat_step = terrain.geotransform
    return GridSurface.from_array(
        terrain.posts, (west + lon_step / 2.0, north + lat_step / 2.0), (lon_step, lat_step)
    )  # fmt: skip


def make(
    seed: int = 1, size: int = 500, images: int = 1, ratio: float = 1.0, band: str = "pan", relief_m: float = 100.0,
    error: lab.OrientationError | None = None, points: lab.PointCounts | None = None, noise_px: float = 0.3,
) -> Scene:  # fmt: skip
    """Return a scene of oblique Pleiades images; ``ratio`` is the reference's pixel size in those of the images.

    ``error`` is the vendor's orientation error of every image, by default drawn from the sensor's accuracy.
    """
    sensor = lab.SENSORS["pleiades"]
    oblique = lab.make_along_track_views(sensor, max(images, 2), (size, size))[:images]
    views = [replace(view, vendor_error=error) if error else view for view in oblique]
    spec, counts = lab.SceneSpec(seed=seed, relief_m=relief_m), points or lab.PointCounts(0, 4, 10)
    simulated = lab.simulate_block(spec, views, counts, lab.Noise(image_px=noise_px))
    block = lab.add_pixels(simulated)
    pixels = tuple(
        replace(image, raster=ArrayRaster(image.raster.window(0, 0, *image.size)))  # type: ignore[union-attr, misc]
        for image in block.images
    )
    photo = lab.make_orthophoto(simulated.scene, ratio * sensor.gsd_m, band=band)
    reference = place_on_degrees(ArrayRaster(photo.read(0, 0, *photo.size)[0]), photo.geotransform)
    return Scene(simulated, pixels, reference, surface_of(simulated.scene.terrain))


def another_season(grey: np.ndarray, seed: int = 1) -> np.ndarray:
    """Return an image of which contrast changes and reverses from place to place, with new fields and noise."""
    rng = np.random.default_rng(seed)
    lines, samples = grey.shape

    def smooth(cell: int, low: float, high: float) -> np.ndarray:
        field = rng.uniform(low, high, (lines // cell + 2, samples // cell + 2)).astype(np.float32)
        return cv2.resize(field, (samples, lines), interpolation=cv2.INTER_CUBIC)

    pixels = grey.astype(np.float32)
    mean, sign = cv2.GaussianBlur(pixels, (0, 0), 40), smooth(150, -1.0, 1.0)
    new = mean + (pixels - mean) * np.sign(sign) * np.maximum(np.abs(sign), 0.3) + 300.0 * smooth(60, 0.0, 1.0)
    new += rng.normal(0.0, 15.0, new.shape)
    for _ in range(lines * samples // 60_000):  # a tenth is another field
        x, y = rng.integers(0, samples - 80), rng.integers(0, lines - 80)
        new[y : y + 80, x : x + 80] = 1500.0 + rng.normal(0.0, 20.0, (80, 80))
    return np.clip(new, 0, 2047).astype(np.uint16)

"""A small oblique image with an RPC that GDAL reads, and DEMs below it."""

from pathlib import Path

import numpy as np
import pyproj
from gdal_files import write_raster
from osgeo import gdal

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files import write_geotiff_copy
from hrsi.tests.simulated_blocks import LAT, LON, oblique_rpc

SIZE = (520, 500)
CELL_DEG = 1e-4  # about 8 m


def utm_wkt() -> str:
    return str(pyproj.CRS.from_epsg(32755).to_wkt())


def texture(rows: int, columns: int, seed: int = 3) -> np.ndarray:
    """Return a random texture without details that pixels cannot show, 0 to 1."""
    rng = np.random.default_rng(seed)
    across, down = np.meshgrid(np.fft.fftfreq(columns), np.fft.fftfreq(rows))
    frequency = np.hypot(across, down)
    spectrum = np.fft.fft2(rng.normal(size=(rows, columns))) * np.exp(-0.5 * (frequency / 0.12) ** 2)
    grey = np.real(np.fft.ifft2(spectrum / np.maximum(frequency, 0.01)))
    return (grey - grey.min()) / np.ptp(grey)


def camera(tilt_east: float = 0.35) -> RPC:
    return oblique_rpc(tilt_east, 0.1, half_px=250.0, heading=0.3)


def rpc_image(path: Path, rpc: RPC | None = None, bands: int = 1, gdal_type: int = gdal.GDT_UInt16) -> Image:
    """Write an image of random texture with an RPC and open it."""
    plain = path.with_name(f"plain_{path.name}")
    dataset = gdal.GetDriverByName("GTiff").Create(str(plain), *SIZE, bands, gdal_type)
    for band in range(1, bands + 1):
        grey = texture(SIZE[1], SIZE[0], seed=band)
        dataset.GetRasterBand(band).WriteArray(10.0 + 200.0 * grey if gdal_type == gdal.GDT_Byte else 500 + 2000 * grey)
        dataset.GetRasterBand(band).SetDescription(f"band {band}")
    del dataset
    write_geotiff_copy(str(plain), str(path), rpc or camera())
    plain.unlink()
    return open_image(str(path))


def hills(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    x, y = (lon - LON) * 81_600.0, (lat - LAT) * 111_100.0
    return 230.0 + 40.0 * np.sin(x / 180.0) * np.cos(y / 150.0) + 0.02 * x


def write_dem(path: Path, cell_deg: float = CELL_DEG, roughness: float = 0.0, lower: float = 0.0) -> str:
    """Write hills, with houses of a height in metres where the DEM is to be rough, lowered by a number of metres."""
    half = 0.009
    count = int(2 * half / cell_deg)
    west, north = LON - half, LAT + half
    lon, lat = np.meshgrid(west + cell_deg * (np.arange(count) + 0.5), north - cell_deg * (np.arange(count) + 0.5))
    heights = hills(lon, lat) - lower
    rows, columns = np.indices(heights.shape)
    heights[((rows % 40) < 15) & ((columns % 50) < 20)] += roughness
    return write_raster(path, heights, (west, cell_deg, 0.0, north, 0.0, -cell_deg), "EPSG:4326")

"""Files of a simulated block: images streamed by blocks, terrain and points.

This module is independent of how pixels are made: an image is anything whose windows can be read (`block.Raster`).
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from osgeo import gdal, osr

from ..block.block import Block, GroundPoints, ImagePoints, Raster, Role
from ..block.laser import LaserPoints
from ..camera.rpc import RPC
from ..foundation.errors import OutputError
from ..foundation.progress import Progress, advance, silent
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import WGS84_3D
from ..io.opening.datasets import Messages, gdal_messages
from ..io.point_files.csv_text import write_csv, write_measurements
from ..io.rasters.dems import ELLIPSOIDAL_HEIGHTS, VERTICAL_DATUM
from ..io.rpc_files.fields import gdal_metadata
from ..io.rpc_files.placement import Geotransform
from ..io.safety.replacing import replacing


@thresholds
class IMAGE_FILES:
    """Tiles of the files of simulated images."""

    tile_px: int = threshold(256, "px", "side of a tile of the file")
    window_samples: int = threshold(1024, "px", "samples that one thread renders together")


PixelStrip = tuple[int, int, Future[tuple[np.ndarray, np.ndarray]]]  # band, first sample, pixels and their mask


def write_image(
    path: str,
    bands: Sequence[Raster],
    rpc: RPC | None = None,
    geotransform: Geotransform | None = None,
    threads: int = 1,
    progress: Progress = silent,
) -> None:
    """Write an image as a tiled 16 bit GeoTIFF with its RPC or geotransform, a row of tiles at a time.

    ``bands`` have the same size. Memory is a few rows of tiles, whatever the size of the image.
    Raises `OutputError` where the file cannot be written, `Cancelled` where ``progress`` asks to stop.
    """
    samples, lines = bands[0].size
    with replacing(path) as temporary:
        with gdal_messages() as messages:
            dataset = _create_file(path, temporary, (samples, lines, len(bands)), gdal.GDT_UInt16, messages)
            if rpc is not None:
                dataset.SetMetadata(gdal_metadata(rpc), "RPC")
            if geotransform is not None:
                _georeference_file(dataset, geotransform)
            for line, parts in _iterate_tile_rows(bands, threads):
                advance(progress, line / lines, f"rendering {os.path.basename(path)}")
                for band, sample, pixels in parts:
                    dataset.GetRasterBand(band + 1).WriteArray(pixels.result()[0], sample, line)
                dataset.FlushCache()  # GDAL would keep up to a twentieth of the machine's memory
                _require_quiet(path, messages)
            del dataset
        _require_quiet(path, messages)
    advance(progress, 1.0, f"wrote {os.path.basename(path)}")


def _create_file(
    path: str, temporary: str, shape: tuple[int, int, int], data_type: int, messages: Messages
) -> gdal.Dataset:
    """Return a new tiled GeoTIFF of samples, lines and bands; raises `OutputError` if it cannot be created."""
    samples, lines, bands = shape
    options = [
        "TILED=YES",
        f"BLOCKXSIZE={IMAGE_FILES.tile_px}",
        f"BLOCKYSIZE={IMAGE_FILES.tile_px}",
        "BIGTIFF=IF_SAFER",
        "INTERLEAVE=BAND",
    ]
    dataset = gdal.GetDriverByName("GTiff").Create(temporary, samples, lines, bands, data_type, options)
    if dataset is None:
        raise OutputError(f"{path}: cannot be created ({messages.reason})")
    return dataset


def _require_quiet(path: str, messages: Messages) -> None:
    if messages:
        raise OutputError(f"{path}: cannot be written ({messages[-1]}): check free space and permissions")


def _georeference_file(dataset: gdal.Dataset, geotransform: Geotransform) -> None:
    """Place a dataset in geographic WGS84 with ellipsoidal heights."""
    reference = osr.SpatialReference()
    reference.ImportFromEPSG(WGS84_3D)
    dataset.SetSpatialRef(reference)
    dataset.SetGeoTransform(geotransform)


def _iterate_tile_rows(bands: Sequence[Raster], threads: int) -> Iterator[tuple[int, list[PixelStrip]]]:
    """Yield the first line and the parts of each row of tiles, while the next row is in work.

    A consumer that stops early cancels what has not begun.
    """
    samples, lines = bands[0].size
    with ThreadPoolExecutor(max(threads, 1)) as pool:
        waiting: deque[tuple[int, list[PixelStrip]]] = deque()
        try:
            for line in range(0, lines, IMAGE_FILES.tile_px):
                height = min(IMAGE_FILES.tile_px, lines - line)
                windows = [
                    (sample, line, min(IMAGE_FILES.window_samples, samples - sample), height)
                    for sample in range(0, samples, IMAGE_FILES.window_samples)
                ]
                jobs = [
                    (band, window[0], pool.submit(raster.read, *window))
                    for band, raster in enumerate(bands)
                    for window in windows
                ]
                waiting.append((line, jobs))
                if len(waiting) > 1:
                    yield waiting.popleft()
            yield from waiting
        finally:
            pool.shutdown(cancel_futures=True)


def write_dem(path: str, heights: np.ndarray, geotransform: Geotransform) -> None:
    """Write ellipsoidal heights ``(rows, columns)`` as a float32 GeoTIFF in EPSG:4979, row 0 in the north."""
    rows, columns = heights.shape
    with replacing(path) as temporary:
        with gdal_messages() as messages:
            dataset = _create_file(path, temporary, (columns, rows, 1), gdal.GDT_Float32, messages)
            _georeference_file(dataset, geotransform)
            dataset.SetMetadata({VERTICAL_DATUM: ELLIPSOIDAL_HEIGHTS, "AREA_OR_POINT": "Point"})
            band = dataset.GetRasterBand(1)
            band.SetUnitType("m")
            band.SetDescription("ellipsoidal height")
            band.WriteArray(np.asarray(heights, dtype=np.float32))
            del band, dataset
        _require_quiet(path, messages)


def write_ground_points(path: str, points: GroundPoints) -> None:
    """Write the known points of a block as CSV: id, role, lon, lat, height, sigma_xy, sigma_h."""
    is_surveyed = points.role != Role.TIE
    names, roles = points.ids[is_surveyed].tolist(), [Role(role).label for role in points.role[is_surveyed]]
    numbers = np.column_stack([points.ground, points.sigma_m])[is_surveyed].tolist()
    rows = [[name, role, *values] for name, role, values in zip(names, roles, numbers, strict=True)]
    write_csv(path, ["id", "role", "lon", "lat", "height", "sigma_xy", "sigma_h"], rows)


def write_laser_points(path: str, points: LaserPoints) -> None:
    """Write laser points as CSV, in the names of SlideRule: h_mean, h_sigma, rms_misfit …; and their track."""
    columns = {
        "id": points.ids,
        "lon": points.ground[:, 0].round(9),
        "lat": points.ground[:, 1].round(9),
        "h_mean": points.ground[:, 2].round(4),
        "h_sigma": points.sigma_m.round(4),
        "rms_misfit": points.misfit_m.round(4),
        "n_fit_photons": points.photons,
        "dh_fit_dx": points.slope.round(5),
        "track": points.track,
    }
    write_csv(path, list(columns), zip(*(column.tolist() for column in columns.values()), strict=True))


def write_image_points(path: str, block: Block) -> None:
    """Write the measurements of a block as CSV: id, image, sample, line, sigma, kind, quality."""
    measured = block.measurements
    image_ids = np.array([image.id for image in block.images])[measured.image]
    write_measurements(
        path,
        ImagePoints(
            block.points.ids[measured.point], image_ids, measured.xy, measured.sigma_px, measured.kind, measured.quality
        ),
    )

"""RPCs and small images that the tests of the RPC files share; nothing here comes from a real scene."""

import os
from pathlib import Path

import numpy as np
from osgeo import gdal

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io import rpc_files
from hrsi.hrsi_engine.io.rpc_files.fields import gdal_metadata
from hrsi.hrsi_engine.io.safety.transactions import Transaction


def sample_rpc(seed: int = 0, err_bias: float | None = None) -> RPC:
    """Return a camera near a plain map (sample along longitude, line against latitude) with small cubic terms."""
    rng = np.random.default_rng(seed)
    sample, line = 1e-4 * rng.standard_normal((2, 20))
    sample[1] += 1.0
    line[2] -= 1.0
    sample[3] += 0.03
    denominators = 1e-5 * rng.standard_normal((2, 20))
    denominators[:, 0] = 1.0
    offs = rng.uniform(0.0, 0.1, 5)
    return RPC(
        line_off=150.0 + offs[0], samp_off=200.0 + offs[1], lat_off=45.0 + offs[2], long_off=7.0 + offs[3],
        height_off=300.0 + offs[4], line_scale=150.0, samp_scale=200.0, lat_scale=0.001, long_scale=0.0014,
        height_scale=250.0, line_num=line, line_den=denominators[0], samp_num=sample, samp_den=denominators[1],
        err_bias=err_bias, err_rand=None if err_bias is None else err_bias / 10.0,
    )  # fmt: skip


def write_image(
    path: Path,
    rpc: RPC | None,
    options: tuple[str, ...] = (),
    driver: str = "GTiff",
    metadata: dict[str, str] | None = None,
    geotransform: tuple[float, ...] | None = None,
    size: tuple[int, int] = (400, 300),
) -> np.ndarray:
    """Write a small 16-bit image with GDAL; return its pixels."""
    rng = np.random.default_rng(7)
    pixels = (rng.integers(0, 60, size[::-1]) + 5 * np.arange(size[0])).astype(np.uint16)
    memory = gdal.GetDriverByName("MEM").Create("", *size, 1, gdal.GDT_UInt16)
    memory.GetRasterBand(1).WriteArray(pixels)
    if metadata:
        memory.SetMetadata(metadata)
    if geotransform:
        memory.SetGeoTransform(geotransform)
    if rpc is not None:
        memory.SetMetadata(gdal_metadata(rpc), "RPC")
    gdal.GetDriverByName(driver).CreateCopy(str(path), memory, options=list(options))
    return pixels


def ground_grid(rpc: RPC, steps: int = 5) -> np.ndarray:
    """Return ground points over the whole domain of an RPC, ``(steps ** 3, 3)``."""
    axis = np.linspace(-1.0, 1.0, steps)
    lon, lat, height = np.meshgrid(axis, axis, axis)
    unit = np.column_stack([lon.ravel(), lat.ravel(), height.ravel()])
    return unit * [rpc.long_scale, rpc.lat_scale, rpc.height_scale] + [rpc.long_off, rpc.lat_off, rpc.height_off]


def write_in_place(path: str, rpc: RPC) -> tuple[str, ...]:
    """Replace the RPC of one file as `write-rpc` does; return the notices."""
    with Transaction(os.path.dirname(os.path.abspath(path))) as changes:
        notices = rpc_files.prepare_in_place(path, rpc, changes)
        changes.commit()
    rpc_files.require_in_place(path, rpc)
    return notices


def restore(path: str) -> tuple[str, ...]:
    """Restore the RPC of one file; return the notices. Raises `InputError` if it keeps no original."""
    with Transaction(os.path.dirname(os.path.abspath(path))) as changes:
        notices = rpc_files.prepare_restoring(path, changes)
        changes.commit()
    if not notices:
        raise InputError(f"{path}: {rpc_files.KEEPS_NONE}")
    return notices

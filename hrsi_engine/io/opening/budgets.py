"""What reading a file may cost, and which of its numbers can be: the one place where readers' limits stand.

A damaged file claims what it likes: a million pixels a side, an id of a megabyte, a DEM of 1e30 m. Readers ask here
before they make room for it or work with it, and refuse in one line what no file of its kind holds. The limits leave
room for what is large and real: seven million measurements, databases of gigabytes, images of 40 000 x 40 000 px,
mosaics of DEMs of a continent.

Bytes and text have limits of their kind of file; what a compressed format unfolds to is compared with the bytes that
are there. Databases get a time that grows with their size (`database_seconds`), servers one in which they must have
sent something (`datasets.HTTP_PATIENCE`).
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable

import numpy as np
from osgeo import gdal

from ...foundation.errors import InputError
from .virtual_files import virtual_status

MIB = 2**20
#: Bytes of files that are read as a whole, by what they hold.
MOST_BYTES = {
    "RPC": 32 * MIB,  # the largest vendor XML known (with ephemeris and attitude lists) has about 2 MB
    "points": 256 * MIB,  # text of which every line becomes objects: some millions of points
    "matches": 2048 * MIB,  # binary records
    "report": 128 * MIB,  # of ten thousand images and points: some 20 MB
    "items": 256 * MIB,  # a STAC item with its RPC has some 10 kB: as many images as a block can have
    "names": 32 * MIB,  # a list of images
    "journal": 256 * MIB,  # of what somebody measured by hand, point by point
    "result": 2048 * MIB,  # of one finished part of a search
}
MOST_LASER_POINTS = 50_000_000  # values of an array: a granule of GEDI has some 2e5 shots with 101 heights each
LONGEST_LINE = 4 * MIB  # characters of a line of text
LONGEST_TEXT = 4096  # characters of an id or an image's name: paths and signed addresses fit
PLAIN_TEXT = 64  # characters that names may have in any number
WIDE_TEXT_BYTES = 512 * MIB  # of a column of longer ones: NumPy gives every row the width of the longest
LARGEST_UNFOLDED = 2048 * MIB  # of a spreadsheet's parts

MOST_SIDE_PX, MOST_PIXELS = 4_000_000, 4 * 10**11  # a mosaic of the world at 60 m; a scene has some 1e10
PIXELS_PER_BYTE, EMPTY_PIXELS = 10_000, 2 * 10**8  # no compression but emptiness comes to more; small files may
LARGEST_BLOCK_BYTES = 1024 * MIB  # pixels that a format can give only together

LOWEST_M, HIGHEST_M = -12_000.0, 9_000.0  # of the ground: the deepest trench, the highest mountain, and a datum's error
NO_DATA_M = -9999.0  # what files mean by "no height" that do not declare it; no ground that images show is so deep
#: Of an RPC: what its offsets and scales can be; longitudes count to 360 or around the date line.
RPC_RANGES = {
    "line_off": (-1e8, 1e8), "samp_off": (-1e8, 1e8), "lat_off": (-90.0, 90.0), "long_off": (-540.0, 540.0),
    "height_off": (-1e5, 1e5), "line_scale": (-1e8, 1e8), "samp_scale": (-1e8, 1e8), "lat_scale": (-180.0, 180.0),
    "long_scale": (-360.0, 360.0), "height_scale": (-1e5, 1e5),
}  # fmt: skip
LEAST_SCALES = {
    "line_scale": 1e-3, "samp_scale": 1e-3, "lat_scale": 1e-9, "long_scale": 1e-9, "height_scale": 1e-3,
}  # fmt: skip
MOST_DENOMINATOR = 1e3  # times the constant term, which is 1 in the files of all vendors: beyond, it would pass zero
MOST_COEFFICIENT = 1e9  # crops with a scene's scales have some 1e3
MOST_SAMPLES_PX = 1e8  # sample or line of a point
CELL_M = (1e-3, 1e6)  # sides of a DEM's or orthoimage's cells


def require_size(path: str, kind: str) -> None:
    """Raise `InputError` for a file that is too large to be what it is read as, one of `MOST_BYTES`."""
    size, most = file_bytes(path), MOST_BYTES[kind]
    if size is not None and size > most:
        raise InputError(f"{path}: has {size / MIB:.0f} MiB, more than a file of {kind} can have ({most // MIB}): "
                         "name another file")  # fmt: skip


def file_bytes(path: str) -> int | None:
    """Return a file's size, None where it has none (a database's address, a folder)."""
    if path.startswith("/vsi"):
        status = virtual_status(path)
        return None if status is None or status.IsDirectory() else int(status.size)
    return os.path.getsize(path) if os.path.isfile(path) else None


def require_texts(source: str, field: str, rows: int, longest: int) -> None:
    """Raise `InputError` for a column of texts that no column of names is like.

    Parameters
    ----------
    source, field : where the column stands
    rows : their number
    longest : characters of the longest text
    """
    if longest > LONGEST_TEXT or (longest > PLAIN_TEXT and rows * longest * 4 > WIDE_TEXT_BYTES):
        raise InputError(
            f"{source}: field {field!r} holds a text of {longest} characters ({rows} rows): no name is that long; "
            "correct it, or get the file again"
        )


def require_unfolded(path: str) -> None:
    """Raise `InputError` for a spreadsheet (a zip archive) whose parts are larger than any table's."""
    if not path.startswith("/vsi") and zipfile.is_zipfile(path):
        try:
            with zipfile.ZipFile(path) as archive:
                size = sum(part.file_size for part in archive.infolist())
        except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError) as error:
            raise InputError(f"{path}: is a damaged archive ({error}): get it again") from None
        if size > LARGEST_UNFOLDED:
            raise InputError(f"{path}: unfolds to {size // MIB} MiB, no table does: get it again, or save it as CSV")


def database_seconds(size: int) -> float:
    """Return the processor time in which a database of a size in bytes can be looked through: 10 MB a second."""
    return 5.0 + size / 1e7


def require_raster(path: str, dataset: gdal.Dataset) -> None:
    """Raise `InputError` for a raster larger than any, or one whose pixels cannot be read piece by piece.

    A raster of the disk that claims many more pixels than its bytes (and those of the files it is made of) can hold is
    empty or damaged: whoever goes through its pixels would wait for nothing.
    """
    columns, rows = dataset.RasterXSize, dataset.RasterYSize
    claim = f"{path}: claims {columns} x {rows} pixels"
    if max(columns, rows) > MOST_SIDE_PX or columns * rows > MOST_PIXELS:
        raise InputError(f"{claim}, more than any image or DEM has: get the file again, or cut out what is needed")
    if columns * rows > EMPTY_PIXELS:
        sizes = [file_bytes(file) for file in dataset.GetFileList() or [path]]
        held = sum(size for size in sizes if size is not None)
        if None not in sizes and columns * rows > PIXELS_PER_BYTE * held:
            raise InputError(
                f"{claim} in {held} bytes: nearly all of it is empty, or the file is damaged: get it again, or cut out "
                "what is needed"
            )
    band = dataset.GetRasterBand(1)
    if band is not None:
        width, height = band.GetBlockSize()
        size = min(width, columns) * min(height, rows) * max(1, gdal.GetDataTypeSize(band.DataType) // 8)
        if size > LARGEST_BLOCK_BYTES:
            raise InputError(
                f"{path}: its pixels come in blocks of {width} x {height}, {size // MIB} MiB each: write it in tiles "
                "(gdal_translate -co TILED=YES)"
            )


def require_heights(heights_m: np.ndarray, where: Callable[[int], str]) -> None:
    """Raise `InputError` for heights ``(n,)`` that no ground on Earth has; NaN passes.

    ``where`` names the place of an index: file and cell, or file and row.
    """
    wrong = (heights_m < LOWEST_M) | (heights_m > HIGHEST_M) | (heights_m == NO_DATA_M)
    if wrong.any():
        index = int(np.flatnonzero(wrong)[0])
        share = f"{wrong.sum()} of {len(heights_m)}"
        raise InputError(
            f"{where(index)}: the height {heights_m[index]:g} m is on no ground of the Earth (so are {share} there): "
            "declare the value that means no data, correct units or values, or get the file again"
        )

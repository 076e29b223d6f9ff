"""Limits of readers, all in one place: how much of a file is read, and which of its numbers are possible.

A damaged file can claim anything: a million pixels a side, an id of a megabyte, a DEM of 1e30 m. Readers check the
limits before they allocate memory or use a number, and refuse with one line what no file of its kind contains. The
limits admit large real data: seven million measurements, databases of gigabytes, images of 40 000 x 40 000 px,
mosaics of DEMs of a continent.

Bytes and text have limits for each kind of file; the uncompressed size of a compressed format is compared with its
bytes on disk. The time for databases grows with their size (`database_seconds`), and servers must have sent data
within a time limit (`datasets.HTTP_PATIENCE`).
"""

import os
import re
import tarfile
import zipfile
import zlib
from collections.abc import Callable

import numpy as np
from osgeo import gdal

from ...block.imaging_geometry import GEOMETRY
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from .datasets import require_plain, virtual_status

MIB = 2**20
ROLE_OF_TIES = re.compile(rb"""[,;\t]["']?(?:tie|held[-_]out)["']?[,;\t\r\n]""", re.IGNORECASE)  #: in a line


@thresholds
class FILE_BUDGETS:
    """Largest sizes that readers accept: bytes by the kind of file, values of an array, characters of a text."""

    description_bytes: int = threshold(
        32 * MIB,
        "byte",
        "largest RPC file, list of images, and directory of an archive",
        "the largest vendor XML known has about 2 MB; a file in an archive takes 1 kB of memory",
    )
    text_bytes: int = threshold(
        256 * MIB,
        "byte",
        "largest text of points, journal, report and file of STAC items",
        "some millions of points; ten thousand images with 10 kB each",
    )
    gcp_rows: int = threshold(
        600_000,
        "rows",
        "most rows of a text file of GCPs, without tie points",
        "surveys have hundreds, matches with a reference about 1e5; image points and tie points may have more",
    )
    binary_bytes: int = threshold(
        2048 * MIB,
        "byte",
        "largest file of matches or results, sum of a spreadsheet's parts, and column of texts",
        "NumPy gives every row of a column the width of the longest text",
    )
    line_characters: int = threshold(4 * MIB, "characters", "longest line of a text file")
    text_characters: int = threshold(4096, "characters", "longest id or image name", "paths and signed addresses fit")
    delivery_files: int = threshold(
        200_000, "files", "most files of a folder or archive that is looked through", "all of an archive of orders"
    )
    delivery_in_vain: int = threshold(
        5_000,
        "files",
        "most files of a folder or archive that are opened although they are no images with RPCs",
        "each takes 1 ms; the limit grows with the images found, which may have masks and browse images",
    )
    archive_images: int = threshold(
        20_000, "files", "most files of an archive that may be images", "each takes GDAL 0.1 ms to find and 1 to open"
    )
    delivery_depth: int = threshold(32, "folders", "deepest level of folders in a delivery")
    array_values: float = threshold(1e8, "values", "most numbers of an array of matches or laser heights in HDF5")
    point_bytes: int = threshold(
        128, "byte", "longest geometry of a point in a database", "a point with the longest header of a GeoPackage"
    )
    tiff_tags: int = threshold(4096, "tags", "most tags of the first directory of a TIFF", "it has a few dozen")
    packed_factor: int = threshold(
        100, "", "largest ratio of unpacked and packed size of an archive of images", "imagery: 2, text: 20"
    )


#: Most bytes of files that are read as a whole, by their content.
MOST_BYTES = {
    "RPC": FILE_BUDGETS.description_bytes,
    "points": FILE_BUDGETS.text_bytes,
    "matches": FILE_BUDGETS.binary_bytes,
    "report": FILE_BUDGETS.text_bytes,
    "items": FILE_BUDGETS.text_bytes,
    "names": FILE_BUDGETS.description_bytes,
    "journal": FILE_BUDGETS.text_bytes,
    "result": FILE_BUDGETS.binary_bytes,
}


@thresholds
class RASTER_BUDGETS:
    """Largest sizes of rasters, possible sizes of their cells, and a height that means nodata."""

    pixels: int = threshold(4 * 10**11, "px", "most pixels of a raster", "the world at 60 m; a scene has about 1e10")
    pixels_per_byte: int = threshold(
        10_000, "px/byte", "largest number of pixels per byte of the file", "only empty rasters are compressed more"
    )
    empty_pixels: int = threshold(2 * 10**8, "px", "size above which pixels per byte are tested")
    block_bytes: int = threshold(
        1024 * MIB, "byte", "largest block of pixels that is read, and files that are hashed, as a whole"
    )
    cell_m: tuple[float, float] = threshold((1e-3, 1e6), "m", "smallest and largest cell of DEMs and orthoimages")
    no_data_m: float = threshold(
        -9999.0, "m", "height that means nodata in files that do not declare it", "images show no ground as deep"
    )


@thresholds
class RPC_BUDGETS:
    """Ranges of the offsets, scales and coefficients of an RPC; others are refused."""

    image_px: float = threshold(1e8, "px", "largest image offset or scale, and sample or line of a point")
    longitude_deg: float = threshold(
        540.0, "deg", "largest offset and scale of longitudes", "0 to 360, or across the date line"
    )
    height_m: float = threshold(1e5, "m", "largest height offset and scale")
    least_scale: float = threshold(1e-5, "", "smallest scale, in degrees, metres or pixels", "a metre in degrees")
    denominator: float = threshold(
        1e3,
        "",
        "largest coefficient of a denominator relative to its constant term",
        "the constant term is 1 in the files of all vendors; with larger coefficients the denominator becomes zero",
    )
    coefficient: float = threshold(1e9, "", "largest coefficient in size", "about 1e3 in crops with a scene's scales")


#: For each number of an RPC: largest magnitude of an offset, or smallest and largest value of a scale.
RPC_RANGES = {
    "line_off": (0.0, RPC_BUDGETS.image_px),
    "samp_off": (0.0, RPC_BUDGETS.image_px),
    "lat_off": (0.0, 90.0),
    "long_off": (0.0, RPC_BUDGETS.longitude_deg),
    "height_off": (0.0, RPC_BUDGETS.height_m),
    "line_scale": (RPC_BUDGETS.least_scale, RPC_BUDGETS.image_px),
    "samp_scale": (RPC_BUDGETS.least_scale, RPC_BUDGETS.image_px),
    "lat_scale": (RPC_BUDGETS.least_scale, 90.0),
    "long_scale": (RPC_BUDGETS.least_scale, RPC_BUDGETS.longitude_deg),
    "height_scale": (RPC_BUDGETS.least_scale, RPC_BUDGETS.height_m),
}


def require_gcp_rows(path: str) -> None:
    """Raise `InputError` for a text file with more GCPs than any block has; databases and archives are skipped.

    Rows with the role ``tie`` or ``held-out`` cost what an image point costs, and are not counted.
    """
    if path.startswith("/vsi") or not path.lower().endswith((".csv", ".tsv", ".txt", ".tab")):
        return

    def add_up(count: Callable[[bytes], int]) -> int:
        with open(path, "rb") as file:  # whole lines: no role is cut in two
            return sum(count(block) for block in iter(lambda: file.read(MIB) + file.readline(), b""))

    rows = add_up(lambda block: max(block.count(b"\n"), block.count(b"\r"))) if os.path.isfile(path) else 0
    if rows > FILE_BUDGETS.gcp_rows:
        rows -= add_up(lambda block: len(ROLE_OF_TIES.findall(block)))
    if rows > FILE_BUDGETS.gcp_rows:
        raise InputError(
            f"{path}: has {rows} rows, more than are read as GCPs ({FILE_BUDGETS.gcp_rows}): thin them out, give a "
            "GeoPackage, or, where they are heights only, name them as `laser` or `surface`"
        )


def require_texts(source: str, field: str, rows: int, longest: int) -> None:
    """Raise `InputError` for a column of texts that are too long for names; ``longest`` is in characters."""
    if longest > FILE_BUDGETS.text_characters or rows * longest * 4 > FILE_BUDGETS.binary_bytes:
        raise InputError(
            f"{source}: field {field!r} contains a text of {longest} characters ({rows} rows): names are shorter; "
            "correct it, or obtain the file again"
        )


def require_small_archive(path: str) -> None:
    """Raise `InputError` for a spreadsheet (a zip archive) whose uncompressed size exceeds that of any table."""
    require_plain(path)
    if not path.startswith("/vsi") and zipfile.is_zipfile(path):
        size = sum(size for _name, size in list_archive(path))
        if size > FILE_BUDGETS.binary_bytes:
            raise InputError(f"{path}: unfolds to {size // MIB} MiB, no table does: obtain it again, or save it as CSV")


def list_archive(path: str) -> list[tuple[str, int]]:
    """Return names and sizes of the members of a zip or tar archive on disk; unlike GDAL's list, interruptible.

    Raises `InputError` if it is damaged, has more members than any delivery, or takes too long to decompress.
    """
    try:
        if zipfile.is_zipfile(path):
            # A directory with too many entries is refused before it is read
            with open(path, "rb") as file:
                file.seek(-min(os.path.getsize(path), 2**16 + 100), os.SEEK_END)
                tail = file.read()
            end, wide = tail.rfind(b"PK\5\6"), tail.rfind(b"PK\6\6")
            size = int.from_bytes(tail[end + 12 : end + 16], "little")
            if size == 2**32 - 1 and wide >= 0:
                size = int.from_bytes(tail[wide + 40 : wide + 48], "little")
            if size > FILE_BUDGETS.description_bytes:
                raise InputError(f"{path}: has a directory of {size // MIB} MiB: unpack it, and name the images")
            with zipfile.ZipFile(path) as archive:
                return [(part.filename, part.file_size) for part in archive.infolist()]
        members: list[tuple[str, int]] = []
        with tarfile.open(path) as tar:
            for member in tar:
                members.append((member.name, member.size))
                tar.members.clear()  # type: ignore[attr-defined]  # TarFile keeps all of them
                unfolded = member.offset_data + member.size
                if len(members) > FILE_BUDGETS.delivery_files:
                    raise InputError(f"{path}: contains more than {FILE_BUDGETS.delivery_files} files: name its images")
                if unfolded > FILE_BUDGETS.binary_bytes and unfolded > os.path.getsize(path):  # a compressed one
                    raise InputError(
                        f"{path}: unfolds to more than {unfolded // MIB} MiB: unpack it, and name the folder"
                    )
        return members
    except (
        OSError,
        EOFError,
        ValueError,
        zlib.error,
        zipfile.BadZipFile,
        tarfile.TarError,
        NotImplementedError,
    ) as error:
        cause = (str(error).splitlines() or [type(error).__name__])[0].rstrip(
            ":"
        )  # tarfile adds a line for each method
        raise InputError(f"{path}: is a damaged archive ({cause}): obtain it again") from None


def require_delivery(name: str, count: int, most: int = FILE_BUDGETS.delivery_files, what: str = "files") -> None:
    """Raise `InputError` for a folder or archive that contains more files, or more of ``what``, than any delivery."""
    if count > most:
        raise InputError(
            f"{name}: contains more than {most} {what}: name the images themselves (by a pattern such as FOLDER/*.tif, "
            "or @LIST), or parts of it"
        )


def database_seconds(size: int) -> float:
    """Return the processor time (s) allowed for checking a database: 5 s and 1 s for each 10 MB of ``size`` (bytes)."""
    return 5.0 + size / 1e7


def require_raster(path: str, dataset: gdal.Dataset) -> None:
    """Raise `InputError` for a raster that is too large, or whose pixels cannot be read in small blocks.

    A raster on disk that claims many more pixels than its bytes (and those of the files that it refers to) can contain
    is empty or damaged: processing all its pixels would take long without result.
    """
    columns, rows = dataset.RasterXSize, dataset.RasterYSize
    claim = f"{path}: claims {columns} x {rows} pixels"
    if columns * rows > RASTER_BUDGETS.pixels:
        raise InputError(f"{claim}, more than any image or DEM has: obtain the file again, or cut out what is needed")
    if columns * rows > RASTER_BUDGETS.empty_pixels:
        found = [virtual_status(file) for file in dataset.GetFileList() or [path]]
        are_files = all(status is not None and not status.IsDirectory() for status in found)
        held = sum(int(status.size) for status in found if status is not None)
        if are_files and columns * rows > RASTER_BUDGETS.pixels_per_byte * held:
            raise InputError(
                f"{claim} in {held} bytes: nearly all of it is empty, or the file is damaged: obtain it again, or cut "
                "what is needed"
            )
    band = dataset.GetRasterBand(1)
    if band is not None:
        width, height = band.GetBlockSize()
        size = min(width, columns) * min(height, rows) * max(1, gdal.GetDataTypeSize(band.DataType) // 8)
        if size > RASTER_BUDGETS.block_bytes:
            raise InputError(
                f"{path}: its pixels come in blocks of {width} x {height}, {size // MIB} MiB each: write it in tiles "
                "(gdal_translate -co TILED=YES)"
            )


def require_heights(heights_m: np.ndarray, where: Callable[[int], str]) -> None:
    """Raise `InputError` for heights ``(n,)`` that no ground on Earth has; NaN is accepted.

    ``where`` returns the place of an index: file and cell, or file and row.
    """
    wrong = (heights_m <= RASTER_BUDGETS.no_data_m) | (heights_m > GEOMETRY.highest_height_m)
    if wrong.any():
        index = int(np.flatnonzero(wrong)[0])
        share = f"{wrong.sum()} of {len(heights_m)}"
        raise InputError(
            f"{where(index)}: the height {heights_m[index]:g} m is on no ground of the Earth (so are {share} there): "
            "declare the value that means no data, correct units or values, or obtain the file again"
        )

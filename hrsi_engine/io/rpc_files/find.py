"""Finds the RPC of an image among all sources in it and next to it; GDAL's order decides.

For GeoTIFF, GDAL takes ``.RPB`` before ISD XML, ``_RPC.TXT``, DIMAP XML and ``.rpc``, these before the tag, and that
before its own ``.aux.xml`` (tried with GDAL 3.6; a test compares). For other images the order depends on the driver:
there the RPC that GDAL reports is used if there is one. ``.geom`` and rpcm JSON, which GDAL does not read, come last.
An image therefore has the same RPC here as in GDAL if GDAL finds one, except that a scene's RPC is moved to the crop
and ICHIPB is applied. If the first source is damaged, this is an error; it is never skipped.

`require_same` checks that a file returns what was written.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
from osgeo import gdal

from ...block.block import Tile
from ...camera.rpc import RPC
from ...foundation.errors import InputError, OutputError
from ...foundation.thresholds import EQUALITY
from ..opening.datasets import metadata_of, open_dataset, read_head
from ..opening.files import open_raster, parse_finite
from ..opening.item_images import item_of
from . import crop, fields, text_formats, tiff_tag, xml_formats
from .content import siblings
from .fields import FoundRpc, RpcReader
from .placement import difference_px, find_placement_doubt, place_by_other_rpc, place_in_scene, same_numbers

#: Formats of files with an RPC and no pixels, in the order of their precedence next to an image.
RPC_READERS: dict[str, RpcReader] = {
    "rpb": text_formats.RPB,
    "isd": xml_formats.ISD,
    "rpc-txt": text_formats.RPC_TXT,
    "dimap": xml_formats.DIMAP,
    "kompsat": text_formats.KOMPSAT,
    "geom": text_formats.GEOM,
    "rpcm-json": text_formats.RPCM_JSON,
    "orthority": text_formats.ORTHORITY,
    "alos": text_formats.ALOS,
}
#: Metadata of images made here, with data from the vendor's side files of the original.
SENSOR_ITEM, HEIGHT_ITEM = "HRSI_SENSOR", "HRSI_GROUND_HEIGHT_M"


#: Name of a source in the log, and a function that reads its RPC: it is called only for the source that is used.
Source = tuple[str, Callable[[], FoundRpc]]


def read_rpc(path: str) -> FoundRpc:
    """Return the RPC of an image, or of an RPC file alone, and its source.

    Parameters
    ----------
    path : str
        An image, or an RPC file alone.

    Returns
    -------
    FoundRpc
        The RPC and its source.

    Raises
    ------
    InputError
        The file is missing, is neither an image nor an RPC file, has no RPC, or the source with precedence is damaged.
    """
    path = os.fspath(path)
    rpc_source = read_rpc_file(path)
    return rpc_source if rpc_source is not None else rpc_of_dataset(path, open_raster(path))


def read_rpc_file(path: str) -> FoundRpc | None:
    """Return the RPC of a file without pixels; None for anything else. Raises `InputError` as `read_rpc` does."""
    reader = rpc_reader_of(path)
    if reader is None:
        return None
    reading = reader.read(path)
    return replace(reading, source=f"{reader.title} {os.path.basename(path)}", size=reading.stated_size)


def rpc_reader_of(path: str) -> RpcReader | None:
    """Return the reader of an RPC file without pixels; None for any other file.

    Raises `InputError` if there is no such file.
    """
    if os.path.isdir(path):
        return None
    if not path.startswith("/vsi") and not os.path.exists(path):
        if ":" in path and open_dataset(path)[0] is not None:
            return None  # a GDAL subdataset or connection string
        raise InputError(f"{path}: no such file: check the path")
    reader, head = _reader_by_head(path)
    if reader is not None and reader.is_product(head) and (dataset := open_dataset(path)[0]) and dataset.RasterCount:
        return None  # the image itself: GDAL composes it from the files of the product
    return reader


def _reader_by_head(path: str) -> tuple[RpcReader | None, bytes]:
    """Return the reader of a file's format, None if it is unknown, and the first bytes of the file."""
    head, name = read_head(path), os.path.basename(path).lower()
    return next((reader for reader in RPC_READERS.values() if reader.recognises(name, head)), None), head


def product_reader_of(path: str) -> RpcReader | None:
    """Return the reader of a file that describes a whole product; None for any other file."""
    reader, head = _reader_by_head(path)
    return reader if reader is not None and reader.is_product(head) else None


def rpc_of_dataset(path: str, dataset: gdal.Dataset) -> FoundRpc:
    """Return the RPC of an image that is already open; raise `InputError` if it has none."""
    sources = _rank_sources(path, dataset)
    if not sources:
        raise InputError(
            f"{path}: has no RPC: copy its _RPC.TXT, .RPB, XML or .geom file into the same folder, with the same name, "
            "if the image was not cut or resampled; otherwise make it again from the original with 'crop'"
        )
    rpc_source = _compare_sources(path, dataset, [read for _, read in sources])
    ignored = tuple(title + _describe_difference(rpc_source.rpc, read) for title, read in sources[1:])
    metadata, by_gdal = metadata_of(dataset), metadata_of(dataset, "RPC")
    if by_gdal and not item_of(path):
        # GDAL 3.6 subtracts FIRST_COL of Pleiades Neo, which later versions and other programs do not
        difference = _describe_difference(rpc_source.rpc, lambda: FoundRpc(fields.rpc_from_entries(path, by_gdal), ""))
        ignored += (f"what GDAL {gdal.__version__} reads{difference}",) if difference else ()
    elif not by_gdal and any(side_files(path).values()):
        rpc_source = replace(rpc_source, source=f"{rpc_source.source}, which GDAL does not read next to this image")
    sensor = (
        rpc_source.sensor or metadata_of(dataset, "IMAGERY").get("SATELLITEID", "") or metadata.get(SENSOR_ITEM, "")
    )
    height_m = parse_finite(metadata.get(HEIGHT_ITEM)) if rpc_source.height_m is None else rpc_source.height_m
    size = (dataset.RasterXSize, dataset.RasterYSize)
    return replace(rpc_source, ignored=ignored, size=size, sensor=sensor, height_m=height_m)


def _compare_sources(path: str, dataset: gdal.Dataset, readers: Sequence[Callable[[], FoundRpc]]) -> FoundRpc:
    """Return the RPC of the first source, moved to where the image was cut if another source shows that."""
    first_source, size = readers[0](), (dataset.RasterXSize, dataset.RasterYSize)
    if len(readers) < 2 or first_source.is_placed or not find_placement_doubt(path, dataset, first_source):
        return first_source
    for read in readers[1:]:
        with suppress(InputError):
            second_source = read()
            place = place_by_other_rpc(first_source.rpc, second_source.rpc)
            if place is not None and place.moves and not find_placement_doubt(path, dataset, second_source):
                return replace(_move_to(first_source, place, size), doubt=None)
    return first_source


def _describe_difference(rpc: RPC, read_other: Callable[[], FoundRpc]) -> str:
    """Return the difference of another source as text, `` (500 px off)``; empty for the same RPC."""
    try:
        off_px = difference_px(rpc, read_other().rpc)
    except InputError:
        return " (damaged)"
    if off_px < EQUALITY.file_px:
        return ""
    return f" ({off_px:.3g} px off)" if np.isfinite(off_px) else " (another RPC)"


def read_rpc_or_none(path: str) -> FoundRpc | None:
    """Return the RPC as `read_rpc` does; None for an image without an RPC."""
    rpc_source = read_rpc_file(path)
    if rpc_source is not None:
        return rpc_source
    dataset = open_raster(path)
    return rpc_of_dataset(path, dataset) if _rank_sources(path, dataset) else None


def rpc_in_folder(folder: str, image_path: str) -> str:
    """Return the RPC file in a folder that has the name of an image; raise `InputError` if there is none."""
    files_by_reader = side_files(os.path.join(folder, os.path.basename(image_path)))
    rpc_files = [file for files in files_by_reader.values() for file in files]
    if not rpc_files:
        stem = os.path.splitext(os.path.basename(image_path))[0]
        raise InputError(f"{folder}: contains no RPC file for {stem} ({stem}_RPC.TXT, {stem}.RPB …): check the folder")
    return rpc_files[0]


def rpc_for_image(rpc_path: str, image_path: str) -> FoundRpc:
    """Return the RPC of any file for another image; the RPC of a scene is moved to the crop that the image is."""
    reader = rpc_reader_of(rpc_path)
    if reader is None:
        return read_rpc(rpc_path)
    title = f"{reader.title} {os.path.basename(rpc_path)}"
    if read_rpc_file(image_path) is not None:
        return replace(reader.read(rpc_path), source=title)
    return _read_beside(reader, rpc_path, title, image_path, open_raster(image_path))


def side_files(path: str) -> dict[str, list[str]]:
    """Return the RPC files next to an image that have its name, by format in the order of `RPC_READERS`."""
    files = siblings(path)
    stem = os.path.splitext(os.path.basename(path))[0].lower()
    files_by_reader: dict[str, list[str]] = {key: [] for key in RPC_READERS}
    for key, reader in RPC_READERS.items():
        for name in reader.beside(stem):
            file = files.get(name, path)
            is_there = file != path and (path.startswith("/vsi") or os.path.isfile(file))
            if is_there and reader.recognises(name, read_head(file)):
                files_by_reader[key].append(file)
    return files_by_reader


def _rank_sources(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return all sources of an image's RPC by precedence: that of its STAC item first, if it has one."""
    leading: list[Source] = []
    item = item_of(path)
    if item is not None and item.rpc_fields:
        title, item_text = f"rpc: fields of the STAC item {item.id}", f"{item.source}, item {item.id!r}"
        leading = [
            (title, lambda: FoundRpc(fields.rpc_from_json(item_text, item.rpc_fields, fields.STAC_NAMES), title))
        ]
    elif item is not None:
        readers = ((_reader_by_head(file)[0], file) for file in item.rpc_files)
        sources = (_side_source(reader, file, path, dataset) for reader, file in readers if reader is not None)
        leading = [*islice(sources, 1)]
    is_tiff = dataset.GetDriver().ShortName == "GTiff"
    ranked = _rank_of_tiff(path, dataset) if is_tiff else _rank_as_gdal(path, dataset)
    return [*leading, *(source for source in ranked if source[0] not in dict(leading))]


def _rank_of_tiff(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return the sources in a GeoTIFF and next to it, by precedence."""
    earlier: list[Source] = []
    later: list[Source] = []
    for key, files in side_files(path).items():
        ranked = earlier if key in ("rpb", "isd", "rpc-txt", "dimap", "kompsat") else later  # … before the tag inside
        ranked += [_side_source(RPC_READERS[key], file, path, dataset) for file in files]
    inside = _sources_inside(path, dataset)
    if earlier:  # what GDAL reports is then that of the first side file
        inside = [source for source in inside if not source[0].startswith("GTiff ")]
    return [*earlier, *inside, *later]


def _rank_as_gdal(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return the sources of an image that is no GeoTIFF: first the one with the numbers that GDAL reports.

    A product file that GDAL opens as an image is its own and only source.
    """
    product, _head = _reader_by_head(path) if os.path.isfile(path) or path.startswith("/vsi") else (None, b"")
    if product is not None:
        return [_side_source(product, path, path, dataset)]
    files = [(RPC_READERS[key], file) for key, files_of_reader in side_files(path).items() for file in files_of_reader]
    sources = [_side_source(reader, file, path, dataset) for reader, file in files]
    metadata = metadata_of(dataset, "RPC")
    if not metadata:
        return sources
    for place, (reader, file) in enumerate(files):
        with suppress(InputError):
            ours, theirs = (
                fields.numbers_of(reader.read(file).rpc),
                fields.numbers_of(fields.rpc_from_entries(file, metadata)),
            )
            if np.allclose(ours[2:], theirs[2:], rtol=1e-13, atol=0.0):  # GDAL may have rounded to 15 digits
                return [sources.pop(place), *sources]
    return [*_sources_inside(path, dataset), *sources]


def _side_source(reader: RpcReader, file: str, path: str, dataset: gdal.Dataset) -> Source:
    title = f"{reader.title} {os.path.basename(file)}"
    return title, partial(_read_beside, reader, file, title, path, dataset)


def _read_beside(reader: RpcReader, file: str, title: str, path: str, dataset: gdal.Dataset) -> FoundRpc:
    """Return the RPC of a side file, moved from the scene to the crop or tile that the image shows."""
    reading = reader.read(file) if reader.read_beside is None else reader.read_beside(path, file)
    size = (dataset.RasterXSize, dataset.RasterYSize)
    try:
        rpc_source = _move(replace(reading, source=title), dataset, inside=False)
        origin = None if rpc_source.is_placed or rpc_source.doubt else reader.tile_origin(path, file)
        if origin is None or reading.stated_size == size:
            return rpc_source
        rpc_source = replace(
            rpc_source, tile=Tile(os.path.abspath(file), origin, reading.stated_size), stated_size=None, is_placed=True
        )
        return _move_to(rpc_source, crop.CropPlace(np.eye(2), np.array(origin)), size) if any(origin) else rpc_source
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _move(rpc_source: FoundRpc, dataset: gdal.Dataset, inside: bool) -> FoundRpc:
    """Return an RPC moved to the place in its scene that an image's geotransform gives, or with the doubt about it."""
    place, doubt = place_in_scene(dataset, rpc_source.rpc, rpc_source.stated_size, inside)
    if place is None:
        return replace(rpc_source, doubt=doubt)
    return _move_to(rpc_source, place, (dataset.RasterXSize, dataset.RasterYSize))


def _move_to(rpc_source: FoundRpc, place: crop.CropPlace, size: tuple[int, int]) -> FoundRpc:
    source = f"{rpc_source.source}, moved to the crop {place}"
    rpc = crop.crop_rpc(rpc_source.rpc, place, size)
    return replace(rpc_source, rpc=rpc, source=source, stated_size=None, is_placed=True)


def _sources_inside(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return the RPC in the image itself (tag, NITF, VRT …) and that of its ``.aux.xml``."""
    name = os.path.basename(path)
    inside_sources: list[Source] = []
    directory = tiff_tag.read_directory(path)
    if directory is not None and directory.entry(tiff_tag.TAG_RPC) is not None:
        title = f"GeoTIFF tag of {name}"
        inside_sources.append((title, partial(_read_tag, path, title, dataset)))
    auxiliary = f"{path}.aux.xml"
    if os.path.isfile(auxiliary) and (stored := xml_formats.read_domain(auxiliary, "RPC")):
        title = f"PAM {os.path.basename(auxiliary)}"
        inside_sources.append((title, partial(_read_metadata, auxiliary, stored, title, {}, dataset)))
    if not inside_sources and (metadata := metadata_of(dataset, "RPC")):
        driver = dataset.GetDriver().ShortName
        title, tags = f"{driver} {name}", metadata_of(dataset) if driver == "NITF" else {}
        extensions = metadata_of(dataset, "TRE") if driver == "NITF" else {}
        for tre in extensions.keys() & {"RPC00A", "RPC00B"}:
            # Raise `InputError` for a field that is not completely a number: GDAL reads its beginning, of 43,5 43.
            # Fields of RPC00A and RPC00B (STDI-0002, appendix E): success, errors, offsets and scales, 4 x 20
            # coefficients
            end = 0
            for number, width in enumerate((1, 7, 7, 6, 5, 8, 9, 5, 6, 5, 8, 9, 5, *(12,) * 80)):
                field, end = extensions[tre][end : end + width], end + width
                unknown_error = number in (1, 2) and not field.strip()
                if parse_finite(field) is None and not unknown_error:
                    raise InputError(
                        f"{path}: field {number + 1} of its {tre} is {field!r}, no number: obtain the file again"
                    )
        inside_sources.append((title, partial(_read_metadata, path, metadata, title, tags, dataset)))
    return inside_sources


def _read_tag(path: str, title: str, dataset: gdal.Dataset) -> FoundRpc:
    rpc = tiff_tag.read(path)
    if rpc is None:
        raise InputError(f"{path}: its RPC tag was there a moment ago: do not change the file meanwhile")
    return _move(FoundRpc(rpc, title), dataset, inside=True)


def _read_metadata(
    path: str, metadata: Mapping[str, str], title: str, tags: Mapping[str, str], dataset: gdal.Dataset
) -> FoundRpc:
    """Return the RPC of GDAL's metadata domain, changed for a chip by ICHIPB in the ``tags`` of a NITF file."""
    rpc, note = crop.apply_ichipb(path, fields.rpc_from_entries(path, metadata), tags)
    return _move(FoundRpc(rpc, f"{title}, {note}" if note else title, is_placed=bool(note)), dataset, inside=True)


# ---- comparison ----------------------------------------------------------------------------------------------------


def require_same(path: str, rpc_expected: RPC, rpc_found: RPC) -> None:
    """Raise `OutputError` with the first field whose doubles differ."""
    if same_numbers(rpc_expected, rpc_found):
        return
    for field in (*fields.SCALARS, *fields.POLYNOMIALS):
        if not np.array_equal(getattr(rpc_expected, field), getattr(rpc_found, field)):
            raise OutputError(f"{path}: {field} did not read back as it was written: the disk or GDAL is at fault")


def read_back_px(path: str, rpc: RPC) -> float:
    """Return the difference (px) of the RPC that GDAL (for RPC files HRSI) reads from a written file from ``rpc``.

    GDAL rounds the doubles of a GeoTIFF tag to 15 digits. Raises `OutputError` if GDAL finds no RPC, or one with a
    larger difference (`EQUALITY.written_px`): then another file takes precedence.
    """
    rpc_source = read_rpc_file(path)
    if rpc_source is not None:
        return difference_px(rpc, rpc_source.rpc)
    dataset = open_raster(path)
    metadata = metadata_of(dataset, "RPC")
    if not metadata:
        raise OutputError(f"{path}: GDAL finds no RPC in it: check the version of GDAL")
    difference = difference_px(rpc, fields.rpc_from_entries(path, metadata), (dataset.RasterXSize, dataset.RasterYSize))
    if not difference <= EQUALITY.written_px:
        raise OutputError(
            f"{path}: GDAL gives another RPC, {difference:.3g} px away: remove older RPC files in its folder"
        )
    return difference

"""Which RPC is an image's: every source beside it and inside it, in GDAL's order, the first one wins.

For GeoTIFF, GDAL takes ``.RPB`` before ISD XML, ``_RPC.TXT``, DIMAP XML and ``.rpc``, these before the tag, and that
before its own ``.aux.xml`` (tried with GDAL 3.6; a test compares). For other images the order depends on the driver:
there GDAL's word counts where it has one. ``.geom`` and rpcm JSON, which GDAL does not read, come last. So an image has
the same RPC here as in GDAL wherever GDAL finds one, except that a scene's RPC is moved to the crop and ICHIPB is
applied. A source that would win but is damaged is an error, never skipped silently.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from osgeo import gdal

from ...block.block import Tile
from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import metadata_of, open_dataset
from ..opening.item_images import StacItem, item_of
from ..opening.raster_datasets import open_raster
from . import crop, dimap, enmap, geom, isd, nitf, pam, rpb, rpc_txt, rpcm_json, tiff_tag
from .content import finite_number, read_head, siblings
from .fields import STAC_NAMES, numbers_of, rpc_from_gdal, rpc_from_json
from .reading import FoundRpc, RpcReader, RpcReading

#: Formats of files that hold an RPC and no pixels, in the order in which they win beside an image.
RPC_READERS: dict[str, RpcReader] = {
    "rpb": rpb.READER,
    "isd": isd.READER,
    "rpc-txt": rpc_txt.READER,
    "dimap": dimap.READER,
    "kompsat": rpc_txt.KOMPSAT,
    "enmap": enmap.READER,
    "geom": geom.READER,
    "rpcm-json": rpcm_json.READER,
}
#: Metadata of images made here, for what the vendor's files beside the original told.
SENSOR_ITEM, HEIGHT_ITEM = "HRSI_SENSOR", "HRSI_GROUND_HEIGHT_M"
#: Formats that win over the tag inside a GeoTIFF.
BEFORE_THE_TAG = frozenset({"rpb", "isd", "rpc-txt", "dimap", "kompsat"})


@thresholds
class RPC_SOURCES:
    """When two sources of an image's RPC say the same."""

    same_px: float = threshold(0.01, "px", "largest difference of two writings of one RPC", "the digits of the formats")


#: What a log calls a source, and how its RPC is read: only the one that wins is.
Source = tuple[str, Callable[[], FoundRpc]]


def read_rpc(path: str) -> FoundRpc:
    """Return the RPC of an image, or of an RPC file alone, and where it came from.

    Parameters
    ----------
    path : str
        An image, or an RPC file alone.

    Returns
    -------
    FoundRpc
        The RPC, and where it came from.

    Raises
    ------
    InputError
        The file is missing, is neither an image nor an RPC file, has no RPC, or the source that wins is damaged.
    """
    path = os.fspath(path)
    found = read_rpc_file(path)
    return found if found is not None else rpc_of_dataset(path, open_raster(path))


def read_rpc_file(path: str) -> FoundRpc | None:
    """Return the RPC of a file without pixels; None for anything else. Raises `InputError` as `read_rpc` does."""
    reader = rpc_reader_of(path)
    if reader is None:
        return None
    reading = reader.read(path)
    title = f"{reader.title} {os.path.basename(path)}"
    return FoundRpc(reading.rpc, title, size=reading.size, height_m=reading.height_m, sensor=reading.sensor)


def rpc_reader_of(path: str) -> RpcReader | None:
    """Return the reader of a file that is an RPC without pixels; None for anything else.

    Raises `InputError` where there is no such file.
    """
    if os.path.isdir(path):
        return None
    if not path.startswith("/vsi") and not os.path.exists(path):
        if ":" in path and open_dataset(path)[0] is not None:
            return None  # a GDAL subdataset or connection string
        raise InputError(f"{path}: no such file: check the path")
    reader, head = _reader_by_head(path)
    if reader is not None and reader.is_product(head) and (dataset := open_dataset(path)[0]) and dataset.RasterCount:
        return None  # the image itself: GDAL puts it together from the product's files
    return reader


def _reader_by_head(path: str) -> tuple[RpcReader | None, bytes]:
    """Return the reader of a file's format, None where no reader knows it, and the file's first bytes."""
    head, name = read_head(path), os.path.basename(path).lower()
    return next((reader for reader in RPC_READERS.values() if reader.recognises(name, head)), None), head


def product_reader_of(path: str) -> RpcReader | None:
    """Return the reader of a file that describes a whole product; None for anything else."""
    reader, head = _reader_by_head(path)
    return reader if reader is not None and reader.is_product(head) else None


def rpc_of_dataset(path: str, dataset: gdal.Dataset) -> FoundRpc:
    """Return the RPC of an image that is already open; raise `InputError` where it has none."""
    sources = _rank_sources(path, dataset)
    if not sources:
        raise InputError(
            f"{path}: has no RPC, inside or beside it: "
            "put its _RPC.TXT, .RPB, XML or .geom file beside it under the same name"
        )
    found = sources[0][1]()
    ignored = tuple(title + _describe_difference(found.rpc, read) for title, read in sources[1:])
    told = metadata_of(dataset)
    sensor = found.sensor or metadata_of(dataset, "IMAGERY").get("SATELLITEID", "") or told.get(SENSOR_ITEM, "")
    height_m = finite_number(told.get(HEIGHT_ITEM)) if found.height_m is None else found.height_m
    size = (dataset.RasterXSize, dataset.RasterYSize)
    return replace(found, ignored=ignored, size=size, sensor=sensor, height_m=height_m)


def _describe_difference(rpc: RPC, read_other: Callable[[], FoundRpc]) -> str:
    """Return in words how far off another source is: `` (500 px off)``; nothing for the same RPC."""
    try:
        other = read_other().rpc
    except InputError:
        return " (damaged)"
    if other == rpc:
        return ""
    steps = np.array([[0.0, 0.0, 0.0], *([x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5))])
    ground = np.array([rpc.long_off, rpc.lat_off, rpc.height_off]) + steps * [
        rpc.long_scale,
        rpc.lat_scale,
        rpc.height_scale,
    ]
    off_px = float(np.max(np.hypot(*(rpc.project(ground) - other.project(ground)).T)))
    if off_px < RPC_SOURCES.same_px:
        return ""
    return f" ({off_px:.3g} px off)" if np.isfinite(off_px) else " (another RPC)"


def read_rpc_or_none(path: str) -> FoundRpc | None:
    """Return the RPC as `read_rpc` does; None for an image that has none."""
    found = read_rpc_file(path)
    if found is not None:
        return found
    dataset = open_raster(path)
    return rpc_of_dataset(path, dataset) if _rank_sources(path, dataset) else None


def rpc_in_folder(folder: str, image_path: str) -> str:
    """Return the RPC file in a folder that is named like an image; raise `InputError` where there is none."""
    beside = side_files(os.path.join(folder, os.path.basename(image_path)))
    found = [file for files in beside.values() for file in files]
    if not found:
        stem = os.path.splitext(os.path.basename(image_path))[0]
        raise InputError(f"{folder}: holds no RPC file for {stem} ({stem}_RPC.TXT, {stem}.RPB …): check the folder")
    return found[0]


def rpc_for_image(rpc_path: str, image_path: str) -> FoundRpc:
    """Return the RPC of any file for another image; the RPC of a scene is moved to the image's crop."""
    reader = rpc_reader_of(rpc_path)
    if reader is None:
        return read_rpc(rpc_path)
    title = f"{reader.title} {os.path.basename(rpc_path)}"
    if read_rpc_file(image_path) is not None:
        return FoundRpc(reader.read(rpc_path).rpc, title)
    return _read_beside(reader, rpc_path, title, image_path, open_raster(image_path))


def side_files(path: str) -> dict[str, list[str]]:
    """Return the RPC files that stand beside an image under its name, by format in the order of `RPC_READERS`."""
    files = siblings(path)
    stem = os.path.splitext(os.path.basename(path))[0].lower()
    return {key: [file for name in reader.beside(stem) if (file := _find_side_file(files, name, path, reader))]
            for key, reader in RPC_READERS.items()}  # fmt: skip


def _find_side_file(files: dict[str, str], name: str, path: str, reader: RpcReader) -> str | None:
    """Return the side file of a name where it is there and of the reader's format."""
    file = files.get(name)
    if file is None or file == path or not (path.startswith("/vsi") or os.path.isfile(file)):
        return None
    return file if reader.recognises(name, read_head(file)) else None


def _rank_sources(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return every source of an image's RPC, the one that wins first: what its STAC item says, if it is of one."""
    named = _of_item(path, dataset)
    return [*named, *(source for source in _with_the_image(path, dataset) if source[0] not in dict(named))]


def _of_item(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return the source that the STAC item of an image names, if any."""
    item = item_of(path)
    if item is None:
        return []
    if item.rpc_fields:
        title = f"rpc: fields of the STAC item {item.id}"
        return [(title, partial(_read_item_fields, item, title))]
    for file in item.rpc_files:
        reader, _head = _reader_by_head(file)
        if reader is not None:
            return [_side_source(reader, file, path, dataset)]
    return []


def _read_item_fields(item: StacItem, title: str) -> FoundRpc:
    return FoundRpc(rpc_from_json(f"{item.source}, item {item.id!r}", item.rpc_fields, STAC_NAMES), title)


def _with_the_image(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return the sources in and beside an image, the one that wins first."""
    if dataset.GetDriver().ShortName != "GTiff":
        return _as_gdal_ranks(path, dataset)
    before: list[Source] = []
    after: list[Source] = []
    for key, files in side_files(path).items():
        ranked = before if key in BEFORE_THE_TAG else after
        ranked += [_side_source(RPC_READERS[key], file, path, dataset) for file in files]
    return [*before, *_sources_inside(path, dataset), *after]


def _as_gdal_ranks(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return the sources of an image that is no GeoTIFF: first the one with the numbers that GDAL reports.

    A product file that GDAL opens as an image is the first source of its own.
    """
    product, _head = _reader_by_head(path) if os.path.isfile(path) or path.startswith("/vsi") else (None, b"")
    if product is not None:
        return [_side_source(product, path, path, dataset)]
    files = [(RPC_READERS[key], file) for key, listed in side_files(path).items() for file in listed]
    sources = [_side_source(reader, file, path, dataset) for reader, file in files]
    metadata = metadata_of(dataset, "RPC")
    if not metadata:
        return sources
    for place, (reader, file) in enumerate(files):
        if _reads_as(reader, file, metadata):
            return [sources.pop(place), *sources]
    return [*_sources_inside(path, dataset), *sources]


def _reads_as(reader: RpcReader, file: str, metadata: dict[str, str]) -> bool:
    """Return whether a side file is where GDAL's metadata come from; GDAL may have rounded them to 15 digits."""
    try:
        ours, theirs = numbers_of(reader.read(file).rpc), numbers_of(rpc_from_gdal(file, metadata))
    except InputError:
        return False
    return np.allclose(ours[2:], theirs[2:], rtol=1e-13, atol=0.0)


def _side_source(reader: RpcReader, file: str, path: str, dataset: gdal.Dataset) -> Source:
    title = f"{reader.title} {os.path.basename(file)}"
    return title, partial(_read_beside, reader, file, title, path, dataset)


def _read_beside(reader: RpcReader, file: str, title: str, path: str, dataset: gdal.Dataset) -> FoundRpc:
    """Return a side file's RPC, moved from the scene to the crop or tile that the image is."""
    reading: RpcReading = reader.read_for(path, file)
    size = (dataset.RasterXSize, dataset.RasterYSize)
    geotransform, has_crs = dataset.GetGeoTransform(can_return_null=True), bool(dataset.GetProjection())
    try:
        place = crop.crop_place(geotransform, has_crs)
        if place is None:
            crop.require_place_in_scene(reading.rpc, geotransform, has_crs, size)
        origin = None if place is not None and place.moves else reader.tile_origin(path, file)
        place = crop.CropPlace.from_first_pixel(*(origin or (0.0, 0.0))) if place is None or not place.moves else place
        tile = None if origin is None or reading.size == size else Tile(os.path.abspath(file), origin, reading.size)
        whole = not place.moves or (reading.size == size and not place.mirrored)
        if whole or not crop.is_of_full_scene(reading.rpc, place, size):
            stated = None if place.moves else reading.size
            found = FoundRpc(reading.rpc, title, tile=tile, height_m=reading.height_m, sensor=reading.sensor)
            return replace(found, stated_size=stated)
        moved, told = crop.crop_rpc(reading.rpc, place, size), f"{title}, moved to the crop {place}"
        return FoundRpc(moved, told, tile=tile, height_m=reading.height_m, sensor=reading.sensor)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _sources_inside(path: str, dataset: gdal.Dataset) -> list[Source]:
    """Return the RPC in the image itself (tag, NITF, VRT …) and that of its ``.aux.xml``."""
    name = os.path.basename(path)
    found: list[Source] = []
    if tiff_tag.has_tag(path):
        title = f"GeoTIFF tag of {name}"
        found.append((title, partial(_read_tag, path, title)))
    auxiliary = f"{path}.aux.xml"
    if os.path.isfile(auxiliary) and (kept := pam.read_domain(auxiliary, "RPC")):
        title = f"PAM {os.path.basename(auxiliary)}"
        found.append((title, partial(_read_domain, auxiliary, kept, title)))
    if not found and (metadata := metadata_of(dataset, "RPC")):
        driver = dataset.GetDriver().ShortName
        title = f"{driver} {name}"
        if driver == "NITF":
            found.append((title, partial(_read_nitf, path, metadata, title, metadata_of(dataset))))
        else:
            found.append((title, partial(_read_domain, path, metadata, title)))
    return found


def _read_tag(path: str, title: str) -> FoundRpc:
    reading = tiff_tag.read(path)
    if reading is None:
        raise InputError(f"{path}: its RPC tag was there a moment ago: do not change the file meanwhile")
    return FoundRpc(reading.rpc, title)


def _read_domain(path: str, metadata: Mapping[str, str], title: str) -> FoundRpc:
    """Return the RPC that GDAL says in the metadata domain of that name."""
    return FoundRpc(rpc_from_gdal(path, metadata), title)


def _read_nitf(path: str, metadata: Mapping[str, str], title: str, tags: Mapping[str, str]) -> FoundRpc:
    """Return the RPC of a NITF file, with ICHIPB of its ``tags`` applied to a chip."""
    rpc, note = nitf.apply_ichipb(path, rpc_from_gdal(path, metadata), tags)
    return FoundRpc(rpc, f"{title}, {note}" if note else title)

"""Writing RPCs: each file is made under a temporary name, read again, compared, and renamed in one step."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from osgeo import gdal

from ...camera.rpc import RPC
from ...foundation.errors import Cancelled, InputError, OutputError
from ...foundation.progress import Progress, silent
from ..opening.datasets import gdal_messages, metadata_of, open_dataset
from ..opening.files import open_raster
from ..safety.replacing import copy_bytes, replacing
from ..safety.transactions import Transaction
from . import tiff_tag
from .fields import gdal_metadata, numbers_of, rpc_from_entries
from .find import RPC_READERS, read_rpc, require_same
from .sidecars import set_aside_conflicting_rpcs
from .text_formats import geom_text, rpb_text, rpc_txt_text, rpcm_json_text
from .tiff_tag import read_directory
from .xml_formats import isd_text, without_domain


@dataclass(frozen=True)
class Lineage:
    """Provenance stored in a file with a refined RPC.

    items : metadata by name, ``HRSI_VERSION``
    original : the RPC before the refinement; a GeoTIFF keeps it for `restore`
    """

    items: Mapping[str, str] = field(default_factory=dict)
    original: RPC | None = None


NO_LINEAGE = Lineage()
#: Gives a temporary name to write to: `replacing`, or that of a transaction, which renames several files together.
Replace = Callable[[str], AbstractContextManager[str]]
#: By format of an RPC file that is written: suffix after the image's stem, and a function that returns its content.
SIDECARS: dict[str, tuple[str, Callable[[RPC], str]]] = {
    "rpc-txt": ("_RPC.TXT", rpc_txt_text), "rpb": (".RPB", rpb_text), "isd": (".xml", isd_text),
    "geom": (".geom", geom_text), "rpcm-json": (".json", rpcm_json_text),
}  # fmt: skip


def write_rpc_text(path: str, rpc: RPC, lineage: Lineage = NO_LINEAGE, replace: Replace = replacing) -> None:
    """Write a ``_RPC.TXT`` file with all digits, read it again and compare."""
    write_rpc_file(path, rpc, "rpc-txt", replace, lineage)


def write_rpb(path: str, rpc: RPC, replace: Replace = replacing) -> None:
    """Write an ``.RPB`` file with all digits, read it again and compare."""
    write_rpc_file(path, rpc, "rpb", replace)


def write_rpc_file(path: str, rpc: RPC, kind: str, replace: Replace = replacing, lineage: Lineage = NO_LINEAGE) -> None:
    """Write a file of a ``kind`` of `SIDECARS` with all digits, read it again and compare."""
    text = rpc_txt_text(rpc, lineage.items) if kind == "rpc-txt" else SIDECARS[kind][1](rpc)
    with replace(path) as temporary:
        with open(temporary, "w", encoding="ascii", errors="backslashreplace", newline="\n") as file:
            file.write(text)
        require_same(path, rpc, RPC_READERS[kind].read(temporary).rpc)


def write_geotiff_copy(
    source_path: str, target_path: str, rpc: RPC, progress: Progress = silent, lineage: Lineage = NO_LINEAGE
) -> tuple[str, ...]:
    """Copy an image to a GeoTIFF with another RPC; the source is only read.

    A TIFF is copied byte for byte and only its RPC tag changes, so that pixels, compression, overviews, metadata and
    the layout of a Cloud Optimized GeoTIFF remain; GDAL's side files (``.aux.xml``, ``.msk``, ``.ovr``) are copied
    too. Any other image is written by GDAL as a tiled, losslessly compressed GeoTIFF.

    progress : callback; False cancels; lineage : metadata items of the copy, and its RPC before the refinement
    Result: notices for the log.
    Raises `InputError`: the source cannot be read or is the target; `OutputError`: the target cannot be written;
    `Cancelled`: ``progress`` returned False.
    """
    with Transaction(os.path.dirname(os.path.abspath(target_path))) as changes:
        notices = prepare_geotiff_copy(source_path, target_path, rpc, changes, progress, lineage)
        changes.commit()
    require_same(target_path, rpc, read_rpc(target_path).rpc)
    return notices


def prepare_geotiff_copy(
    source_path: str, target_path: str, rpc: RPC, changes: Transaction, progress: Progress = silent,
    lineage: Lineage = NO_LINEAGE,
) -> tuple[str, ...]:  # fmt: skip
    """Prepare a copy as `write_geotiff_copy` writes it; it is renamed when the changes are committed."""
    _require_other_file(source_path, target_path)
    source = open_raster(source_path)
    is_tiff = source.GetDriver().ShortName == "GTiff" and read_directory(source_path) is not None
    notices = set_aside_conflicting_rpcs(target_path, source_path, rpc, changes)
    if not is_tiff:
        # Lossless options that every GDAL reads
        band = source.GetRasterBand(1)
        kind, bits = gdal.GetDataTypeName(band.DataType), band.GetMetadataItem("NBITS", "IMAGE_STRUCTURE")
        integer_types = ("Byte", "UInt16", "Int16", "UInt32", "Int32")
        predictor = "3" if kind in ("Float32", "Float64") else "2" if kind in integer_types else "1"
        packing = f"NBITS={bits}" if bits else f"PREDICTOR={predictor}"  # predictors need whole bytes
        options = ["BIGTIFF=IF_SAFER", "TILED=YES", "COMPRESS=DEFLATE", packing]
        return notices + save_geotiff(
            source,
            target_path,
            rpc,
            driver="GTiff",
            options=options,
            progress=progress,
            lineage=lineage,
            replace=changes.replacing,
        )
    # GDAL's side files of a TIFF: mask, overviews, and the auxiliary metadata without an old RPC
    for suffix in (".msk", ".ovr"):
        if os.path.isfile(source_path + suffix):
            with changes.replacing(target_path + suffix) as temporary:
                copy_bytes(source_path + suffix, temporary)
    if os.path.isfile(f"{source_path}.aux.xml"):
        with changes.replacing(f"{target_path}.aux.xml") as temporary, open(temporary, "wb") as file:
            file.write(without_domain(f"{source_path}.aux.xml", "RPC"))
    with changes.replacing(target_path) as temporary:
        copy_bytes(source_path, temporary, progress, f"writing {os.path.basename(target_path)}")
        notices += _set_tag(temporary, target_path, rpc, source, lineage)
        require_tag(temporary, target_path, rpc)
    return notices


def save_geotiff(
    source: gdal.Dataset, target_path: str, rpc: RPC, driver: str, options: Sequence[str],
    progress: Progress = silent, lineage: Lineage = NO_LINEAGE, replace: Replace = replacing,
) -> tuple[str, ...]:  # fmt: skip
    """Write a dataset, which may be virtual, with GDAL's ``driver`` GTiff or COG; otherwise as `write_geotiff_copy`."""
    notices: tuple[str, ...] = ()
    # A virtual dataset has the new RPC and metadata, so that the tags are written once
    virtual = gdal.GetDriverByName("VRT").CreateCopy("", source)
    virtual.SetMetadata(gdal_metadata(rpc), "RPC")
    for name, value in lineage.items.items():
        virtual.SetMetadataItem(name, value)
    with replace(target_path) as temporary:
        create_copy(virtual, temporary, target_path, driver, options, progress)
        if lineage.original is not None:
            notices = _set_tag(temporary, target_path, rpc, gdal.Open(temporary), lineage)
        require_tag(temporary, target_path, rpc)
    return notices


def require_tag(temporary: str, target_path: str, rpc: RPC) -> None:
    """Raise `OutputError` if a file does not have the RPC tag that was to be written."""
    written = tiff_tag.read(temporary)
    if written is None:
        raise OutputError(f"{target_path}: GDAL wrote no RPC tag: check the version of GDAL")
    require_same(target_path, rpc, written)


def _require_other_file(source_path: str, target_path: str) -> None:
    if os.path.exists(target_path) and os.path.exists(source_path) and os.path.samefile(source_path, target_path):
        raise InputError(f"{target_path}: is the input itself: choose another output directory, or write in place")


def _set_tag(temporary: str, target_path: str, rpc: RPC, source: gdal.Dataset, lineage: Lineage) -> tuple[str, ...]:
    original = None if lineage.original is None else numbers_of(lineage.original)
    stayed = tiff_tag.set_numbers(temporary, numbers_of(rpc), original is not None, lineage.items, original)
    if stayed or source.GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE") != "COG":
        return ()
    return (f"{target_path}: there was no room for the RPC tag in the header: no longer a Cloud Optimized GeoTIFF",)


def create_copy(
    source: gdal.Dataset, temporary: str, target_path: str, driver: str, options: Sequence[str], progress: Progress
) -> None:
    """Let GDAL copy pixels and metadata to a new file; messages name ``target_path``."""
    is_complete = cancelled = False

    def report(fraction: float, _message: str, _data: Any) -> int:
        nonlocal cancelled
        cancelled = cancelled or progress(fraction, f"writing {os.path.basename(target_path)}") is False
        return 0 if cancelled else 1

    with gdal_messages() as messages:
        copy = gdal.GetDriverByName(driver).CreateCopy(temporary, source, 0, list(options), callback=report)
        is_complete = copy is not None
        del copy  # closed here, so that failures of the last writing are noticed
    if cancelled:
        raise Cancelled(f"cancelled; {target_path} was not written")
    if not is_complete or messages:
        raise OutputError(f"{target_path}: cannot be written ({messages.reason})")


def write_vrt(
    source_path: str, target_path: str, rpc: RPC, lineage: Lineage = NO_LINEAGE, replace: Replace = replacing
) -> tuple[str, ...]:
    """Write a virtual image: the source's pixels with another RPC; the source is only read.

    The path of the source is relative if it is in the folder of the VRT or below. Arguments, result and errors as in
    `write_geotiff_copy`.
    """
    _require_other_file(source_path, target_path)
    local = os.path.exists(source_path)
    source = open_raster(os.path.abspath(source_path) if local else source_path)
    save_vrt(source, target_path, rpc, lineage, replace)
    return ()


def save_vrt(
    source: gdal.Dataset, target_path: str, rpc: RPC, lineage: Lineage = NO_LINEAGE, replace: Replace = replacing
) -> None:
    """Write a dataset that was opened by its absolute path, or a virtual one of it; otherwise as `write_vrt`."""
    with replace(os.path.abspath(target_path)) as temporary:
        virtual = None
        with gdal_messages() as messages:
            virtual = gdal.GetDriverByName("VRT").CreateCopy(temporary, source)
            virtual.SetMetadata(gdal_metadata(rpc), "RPC")
            if lineage.original is not None:
                virtual.SetMetadata(gdal_metadata(lineage.original), tiff_tag.ORIGINAL_DOMAIN)
            for name, value in lineage.items.items():
                virtual.SetMetadataItem(name, value)
            virtual.FlushCache()
            del virtual
        if messages or not os.path.exists(temporary):
            raise OutputError(f"{target_path}: cannot be written ({messages.reason})")
        reopened, message = open_dataset(temporary)
        if reopened is None:
            raise OutputError(f"{target_path}: cannot be opened again ({message})")
        require_same(target_path, rpc, rpc_from_entries(target_path, metadata_of(reopened, "RPC")))
        del reopened

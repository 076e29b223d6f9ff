"""Writing RPCs: each file is made under a temporary name, read again, compared, and renamed in one step.

Writes an RPC into an image itself or next to it, and restores the original.

The image is copied in its folder, and the copy is changed; files to be renamed or removed are collected in a
`Transaction`, so that a complete block is written or nothing. The RPC before the first writing is kept in the image's
metadata (see `tiff_tag`); files next to it that would take precedence are set aside (see `sidecars`). The order of
steps ensures that a reader finds a complete RPC, old or new, at any time.
"""

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
from .content import siblings
from .fields import gdal_metadata, numbers_of, rpc_from_entries
from .find import RPC_READERS, read_rpc, require_same, rpc_reader_of, side_files
from .sidecars import (
    PLAIN,
    keep_original,
    restore_originals,
    set_aside,
    set_aside_conflicting_rpcs,
    stale_files,
    vendor_xml,
)
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
    "rpc-txt": ("_RPC.TXT", rpc_txt_text),
    "rpb": (".RPB", rpb_text),
    "isd": (".xml", isd_text),
    "geom": (".geom", geom_text),
    "rpcm-json": (".json", rpcm_json_text),
}


def write_rpc_text(
    path: str, rpc: RPC, lineage: Lineage = NO_LINEAGE, kind: str = "rpc-txt", replace: Replace = replacing
) -> None:
    """Write an RPC as a text file with all digits, read it again and compare.

    kind : format, a key of `SIDECARS`; only a ``_RPC.TXT`` file contains the items of the ``lineage``
    replace : gives the temporary name
    Raises `OutputError` if the file cannot be written, or another RPC is read from it.
    """
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
    source_path: str,
    target_path: str,
    rpc: RPC,
    changes: Transaction,
    progress: Progress = silent,
    lineage: Lineage = NO_LINEAGE,
) -> tuple[str, ...]:
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
    source: gdal.Dataset,
    target_path: str,
    rpc: RPC,
    driver: str,
    options: Sequence[str],
    progress: Progress = silent,
    lineage: Lineage = NO_LINEAGE,
    replace: Replace = replacing,
) -> tuple[str, ...]:
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
    save_vrt(open_raster(os.path.abspath(source_path) if local else source_path), target_path, rpc, lineage, replace)
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


KEEPS_NONE = "keeps no original RPC: it was not written in place by this program, or is restored already"


def prepare_in_place(
    path: str, rpc: RPC, changes: Transaction, progress: Progress = silent, lineage: Lineage = NO_LINEAGE
) -> tuple[str, ...]:
    """Prepare the replacement of an image's RPC, which the commit of ``changes`` makes; return notices for the log.

    Pixels, overviews and the layout of a Cloud Optimized GeoTIFF are unchanged. Files that must exist next to the
    image, or must be set aside so that the new RPC takes precedence, are part of the changes.

    path : a GeoTIFF, or a ``_RPC.TXT`` or ``.RPB`` file alone (its original is kept as ``<name>.original``)
    changes : collects the changes of this file, and of others that are made together with them
    progress : callback; False cancels; lineage : metadata items of the file

    Raises `InputError` for a file of another kind, `OutputError` without space or permission, and `Cancelled`.
    """
    reader = rpc_reader_of(path)
    if reader is not None:
        key = next(key for key, other_reader in RPC_READERS.items() if other_reader is reader)
        if key not in ("rpc-txt", "rpb"):  # other formats contain more than the RPC
            raise InputError(f"{path}: {RPC_READERS[key].title} is read only: write a sidecar (_RPC.TXT) instead")
        keep_original(path, changes, is_alone=True)
        write_rpc_text(path, rpc, kind=key, replace=changes.replacing)
        return ()
    if not os.path.isfile(path) or read_directory(path) is None:
        raise InputError(f"{path}: only a GeoTIFF can be written in place: write a copy, a VRT or a sidecar")
    was_cog = open_raster(path).GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE") == "COG"
    with changes.replacing(path) as temporary:  # a copy with the new tag; it keeps the original
        copy_bytes(path, temporary, progress, f"writing {os.path.basename(path)}")
        stayed = tiff_tag.set_numbers(temporary, numbers_of(rpc), keep_original=True, lineage=lineage.items)
        open_raster(temporary)
        require_tag(temporary, path, rpc)
    notices: tuple[str, ...] = ()
    if was_cog and not stayed:
        notices = (f"{path}: there was no room in its header: no longer a Cloud Optimized GeoTIFF",)
    if vendor_xml(path):
        return notices + prepare_sidecar(os.path.splitext(path)[0] + SIDECARS["rpb"][0], rpc, changes, "rpb")
    return notices + tuple(set_aside(file, changes) for file in stale_files(path, rpc))


def require_in_place(path: str, rpc: RPC) -> None:
    """Raise `OutputError` if a reader does not find the RPC that was written."""
    require_same(path, rpc, read_rpc(str(path)).rpc)  # from the file, not from a STAC item


def prepare_sidecar(path: str, rpc: RPC, changes: Transaction, kind: str = "rpc-txt") -> tuple[str, ...]:
    """Prepare an RPC file of a ``kind`` of `SIDECARS`; it is written when the changes are committed.

    A vendor's file of that name, in upper or lower case, is kept as ``<name>.original``. An ``.RPB`` of the same image
    with another RPC, which would take precedence over a new ``_RPC.TXT`` or ISD XML, is set aside. Returns notices.
    """
    path = siblings(path).get(os.path.basename(path).lower(), path)
    keep_original(path, changes)
    write_rpc_text(path, rpc, kind=kind, replace=changes.replacing)
    if kind not in ("rpc-txt", "isd"):  # GDAL reads these, but an .RPB first; it does not read the others
        return ()
    image = f"{path[: -len(SIDECARS[kind][0])]}.tif"
    stale = [set_aside(file, changes) for file in stale_files(image, rpc) if file.lower().endswith(".rpb")]
    if kind == "isd":
        return tuple(stale)
    winning = [
        f"{file}: GDAL prefers it to a _RPC.TXT, and would prefer an .RPB to it" for file in side_files(image)["isd"]
    ]
    return (*stale, *winning)


def prepare_restoring(path: str, changes: Transaction, progress: Progress = silent) -> tuple[str, ...]:
    """Prepare in ``changes`` that an image or RPC file has the RPC again that it had before the first writing in place.

    Result: notices for the log, none if no original is kept.
    """
    stem = os.path.splitext(os.path.basename(path))[0].lower()
    is_rpc_file = rpc_reader_of(path) is not None
    names = {os.path.basename(path).lower()} if is_rpc_file else {n for k in PLAIN for n in RPC_READERS[k].beside(stem)}
    notices = restore_originals(path, names, changes)
    if not is_rpc_file and os.path.isfile(path) and tiff_tag.keeps_original(path):
        notices += (f"{path}: the original RPC is back",)
        with changes.replacing(path) as temporary:
            copy_bytes(path, temporary, progress, f"restoring {os.path.basename(path)}")
            tiff_tag.restore_numbers(temporary)
            open_raster(temporary)
    return notices

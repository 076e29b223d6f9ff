"""Writes an RPC into an image itself or next to it, and restores the original.

The image is copied in its folder, and the copy is changed; files to be renamed or removed are collected in a
`Transaction`, so that a complete block is written or nothing. The RPC before the first writing is kept in the image's
metadata (see `tiff_tag`); files next to it that would take precedence are set aside (see `sidecars`). The order of
steps ensures that a reader finds a complete RPC, old or new, at any time.
"""

import os

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.progress import Progress, silent
from ..opening.files import open_raster
from ..safety.replacing import copy_bytes
from ..safety.transactions import Transaction
from . import tiff_tag
from .content import siblings
from .fields import numbers_of
from .find import RPC_READERS, read_rpc, require_same, rpc_reader_of, side_files
from .sidecars import PLAIN, keep_original, restore_originals, set_aside, stale_files, vendor_xml
from .tiff_tag import read_directory
from .write import NO_LINEAGE, SIDECARS, Lineage, require_tag, write_rpc_file

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
        write_rpc_file(path, rpc, key, changes.replacing)
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
    write_rpc_file(path, rpc, kind, changes.replacing)
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

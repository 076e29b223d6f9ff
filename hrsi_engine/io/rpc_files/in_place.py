"""Writing an RPC into an image itself or beside it, and bringing the original back.

The image is copied beside itself and changed there; what is to be renamed or removed is collected in a `Transaction`,
so that a whole block is written or none of it. The RPC that an image had before the first writing is kept in its
metadata (see `tiff_tag`); files beside it that would win are set aside (see `sidecars`). The order of the steps is such
that at any moment some complete RPC, old or new, is what a reader finds.
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
from .sidecars import PLAIN, keep_original, put_back, set_aside, stale_files, vendor_xml
from .tiff_tag import read_directory
from .write import SIDECARS, UNTOLD, Lineage, write_rpc_file

KEEPS_NONE = "keeps no original RPC: it was not written in place by this program, or is restored already"


def write_in_place(path: str, rpc: RPC, progress: Progress = silent) -> tuple[str, ...]:
    """Replace the RPC of one image and keep the original inside the file; see `prepare_in_place`.

    path : A GeoTIFF, or a ``_RPC.TXT`` or ``.RPB`` file alone (its original is kept as ``<name>.original``)
    rpc : the new camera; progress : callback; False cancels
    Result: notices for the log.
    Raises `InputError`: the file is of another kind; `OutputError`: there is no room, or no permission; `Cancelled`:
    when ``progress`` asks to stop.
    """
    with Transaction(os.path.dirname(os.path.abspath(path))) as changes:
        notices = prepare_in_place(path, rpc, changes, progress)
        changes.commit()
    require_in_place(path, rpc)
    return notices


def prepare_in_place(
    path: str, rpc: RPC, changes: Transaction, progress: Progress = silent, lineage: Lineage = UNTOLD
) -> tuple[str, ...]:
    """Prepare the replacement of an image's RPC, committed with the changes; return notices for the log.

    Pixels, overviews and the layout of a Cloud Optimized GeoTIFF stay as they are. What has to lie beside the image, or
    must be out of the way so that the new RPC wins, is part of the changes.

    path : a GeoTIFF, or a ``_RPC.TXT`` or ``.RPB`` file alone (its original is kept as ``<name>.original``)
    changes : collects the changes of this file, and of others that are to happen together with them
    progress : callback; False cancels; lineage : what the file tells of itself

    Raises `InputError` for a file of another kind, `OutputError` without room or permission, and `Cancelled`.
    """
    reader = rpc_reader_of(path)
    if reader is not None:
        key = next(key for key, other in RPC_READERS.items() if other is reader)
        if key not in ("rpc-txt", "rpb"):  # the others hold more than the RPC
            raise InputError(f"{path}: {RPC_READERS[key].title} is read only: write a sidecar (_RPC.TXT) instead")
        keep_original(path, changes, is_alone=True)
        write_rpc_file(path, rpc, key, changes.replacing)
        return ()
    if not os.path.isfile(path) or read_directory(path) is None:
        raise InputError(f"{path}: only a GeoTIFF can be written in place: write a copy, a VRT or a sidecar")
    was_cog = open_raster(path).GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE") == "COG"
    with changes.replacing(path) as temporary:  # a copy with the new tag, which keeps the original
        copy_bytes(path, temporary, progress, f"writing {os.path.basename(path)}")
        stayed = tiff_tag.set_numbers(temporary, numbers_of(rpc), keep_original=True, lineage=lineage.items)
        written = tiff_tag.read(temporary)
        open_raster(temporary)
        require_same(path, rpc, written.rpc if written else rpc.shift(float("nan"), 0.0))
    notices: tuple[str, ...] = ()
    if was_cog and not stayed:
        notices = (f"{path}: there was no room in its header: no longer a Cloud Optimized GeoTIFF",)
    if vendor_xml(path):
        return notices + prepare_sidecar(os.path.splitext(path)[0] + SIDECARS["rpb"][0], rpc, changes, "rpb")
    return notices + tuple(set_aside(file, changes) for file in stale_files(path, rpc))


def require_in_place(path: str, rpc: RPC) -> None:
    """Raise `OutputError` where a reader does not find the RPC that was written."""
    require_same(path, rpc, read_rpc(str(path)).rpc)  # what the file says, whatever a STAC item says of it


def prepare_sidecar(path: str, rpc: RPC, changes: Transaction, kind: str = "rpc-txt") -> tuple[str, ...]:
    """Prepare an RPC file of a ``kind`` of `SIDECARS`; it appears when the changes are committed.

    A vendor's file of that name, in whatever case, is kept as ``<name>.original``. An ``.RPB`` of the same image, which
    would win over a new ``_RPC.TXT`` or ISD XML with another RPC, is set aside. Returns notices for the log.
    """
    path = siblings(path).get(os.path.basename(path).lower(), path)
    keep_original(path, changes)
    write_rpc_file(path, rpc, kind, changes.replacing)
    if kind not in ("rpc-txt", "isd"):  # which GDAL reads, but after an .RPB; it does not read the rest
        return ()
    image = f"{path[: -len(SIDECARS[kind][0])]}.tif"
    stale = [set_aside(file, changes) for file in stale_files(image, rpc) if file.lower().endswith(".rpb")]
    if kind == "isd":
        return tuple(stale)
    winning = [
        f"{file}: GDAL prefers it to a _RPC.TXT, and would prefer an .RPB to it" for file in side_files(image)["isd"]
    ]
    return (*stale, *winning)


def restore(path: str, progress: Progress = silent) -> tuple[str, ...]:
    """Bring back the RPC that an image or RPC file had before the first writing in place.

    Parameters
    ----------
    path : str
        The file.
    progress : Progress
        Callback; False cancels.

    Returns
    -------
    tuple of str
        Notices for the log.

    Raises
    ------
    InputError
        Nothing is kept that could be brought back.
    """
    with Transaction(os.path.dirname(os.path.abspath(path))) as changes:
        notices = prepare_restoring(path, changes, progress)
        changes.commit()
    if not notices:
        raise InputError(f"{path}: {KEEPS_NONE}")
    return notices


def prepare_restoring(path: str, changes: Transaction, progress: Progress = silent) -> tuple[str, ...]:
    """Prepare what `restore` does, committed with the changes; return notices, none where no original is kept."""
    stem = os.path.splitext(os.path.basename(path))[0].lower()
    is_rpc_file = rpc_reader_of(path) is not None
    names = {os.path.basename(path).lower()} if is_rpc_file else {n for k in PLAIN for n in RPC_READERS[k].beside(stem)}
    notices = put_back(path, names, changes)
    if not is_rpc_file and os.path.isfile(path) and tiff_tag.keeps_original(path):
        notices += (f"{path}: the original RPC is back",)
        with changes.replacing(path) as temporary:
            copy_bytes(path, temporary, progress, f"restoring {os.path.basename(path)}")
            tiff_tag.restore_numbers(temporary)
            open_raster(temporary)
    return notices

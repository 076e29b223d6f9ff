"""RPC files next to an image that take precedence over the RPC inside it: setting aside and restoring them.

A vendor's file is never deleted: it is renamed to ``<name>.original``, and `restore_originals` renames it again. Files
that HRSI wrote contain a mark and are replaced or removed.
"""

import contextlib
import os

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ..opening.datasets import read_head
from ..safety.replacing import copy_bytes, take_permissions
from ..safety.transactions import Transaction
from .content import siblings
from .find import read_rpc, rpc_reader_of, side_files
from .placement import same_numbers
from .text_formats import MARKS

ORIGINAL = ".original"
#: Formats that can be set aside; the vendor's XML is not changed, because it contains more than the RPC.
PLAIN = ("rpb", "rpc-txt", "kompsat")


def is_written_by_hrsi(path: str) -> bool:
    """Return whether an RPC file was written by HRSI."""
    head = read_head(path)
    return any(mark.encode() in head for mark in MARKS.values())


def vendor_xml(image_path: str) -> list[str]:
    """Return the vendor's XML files of an image, which also take precedence over an RPC inside it."""
    files_by_reader = side_files(image_path)
    return [file for key in ("isd", "dimap") for file in files_by_reader[key]]


def is_rpc_file(path: str) -> bool:
    """Return whether a file contains an RPC and no pixels."""
    try:
        return os.path.isfile(path) and rpc_reader_of(path) is not None
    except InputError:
        return False


def is_only_rpc(path: str) -> bool:
    """Return whether an RPC file is the only RPC of its image; then it is kept even if HRSI wrote it."""
    name, files = os.path.basename(path).lower(), siblings(path)
    if name + ORIGINAL in files:
        return False
    for entry, image in files.items():
        if entry != name and name.startswith(os.path.splitext(entry)[0]) and not is_rpc_file(image):
            with contextlib.suppress(InputError):  # no image, or the image of another RPC file
                if any(path in side_list for side_list in side_files(image).values()):
                    return not read_rpc(image).ignored
    return False


def set_aside(path: str, changes: Transaction) -> str:
    """Schedule the removal of HRSI's own RPC file, or the renaming of a vendor's; return a notice for the log."""
    if is_written_by_hrsi(path) and not is_only_rpc(path):
        changes.remove(path)
        return f"{path}: GDAL would read this RPC file of an earlier run instead of the new RPC; it was removed"
    new_name = _free_name(path)
    changes.rename(path, new_name)
    return f"{path}: GDAL would read it instead of the new RPC; it was renamed to {os.path.basename(new_name)}"


def keep_original(path: str, changes: Transaction, is_alone: bool = False) -> None:
    """Schedule a copy ``<name>.original`` of an RPC file that will be overwritten.

    HRSI's own file is copied only if it is the only RPC of an image, or was given alone and has no copy yet.
    """
    first = is_alone and not os.path.exists(path + ORIGINAL)
    if is_rpc_file(path) and (not is_written_by_hrsi(path) or first or is_only_rpc(path)):
        with changes.replacing(_free_name(path)) as copy:
            copy_bytes(path, copy)
            take_permissions(path, copy)


def _free_name(path: str) -> str:
    free_name, number = path + ORIGINAL, 1
    while os.path.exists(free_name):
        number += 1
        free_name = f"{path}{ORIGINAL}-{number}"
    return free_name


def restore_originals(image_path: str, names: set[str], changes: Transaction) -> tuple[str, ...]:
    """Schedule the renaming of the originals among an image's RPC files, and the removal of HRSI's; return notices.

    ``names`` are the names, in lower case, of RPC files that belong to the image.
    """
    notices = []
    files = siblings(image_path)
    for name in sorted(names):
        original, current = files.get(name + ORIGINAL), files.get(name)
        if original is not None:
            changes.rename(original, original.removesuffix(ORIGINAL))
            notices.append(f"{original.removesuffix(ORIGINAL)}: the original is back")
        elif current not in (None, image_path) and is_written_by_hrsi(current) and not is_only_rpc(current):
            changes.remove(current)
            notices.append(f"{current}: written by an earlier run, removed")
    return tuple(notices)


def stale_files(image_path: str, rpc: RPC) -> list[str]:
    """Return the ``.RPB`` and ``_RPC.TXT`` files of an image with an RPC that differs from ``rpc``."""
    files_by_reader, stale = side_files(image_path), []
    for file in (file for key in PLAIN for file in files_by_reader[key]):
        try:
            is_same = same_numbers(rpc, read_rpc(file).rpc)
        except InputError:
            is_same = False
        if not is_same:
            stale.append(file)
    return stale


def set_aside_conflicting_rpcs(target_path: str, source_path: str, rpc: RPC, changes: Transaction) -> tuple[str, ...]:
    """Set files aside that are next to a copy and whose RPC would take precedence over its tag; return notices.

    Raises `InputError` if they may belong to the source (the same folder) or are the vendor's XML.
    """
    same_folder = os.path.dirname(os.path.abspath(target_path)) == os.path.dirname(os.path.abspath(source_path))
    stale = stale_files(target_path, rpc)
    foreign = vendor_xml(target_path) + (stale if same_folder else [])
    if foreign:
        raise InputError(
            f"{foreign[0]}: would be read instead of the RPC of {os.path.basename(target_path)}: choose another output "
            "directory"
        )
    return tuple(set_aside(file, changes) for file in stale)

"""RPC files beside an image that win over the RPC inside it: set aside, taken back, told apart from our own.

A vendor's file is never deleted: it is renamed to ``<name>.original`` and `put_back` renames it again. Files written
here carry a mark and are simply replaced or removed.
"""

import os

from ...camera.rpc import RPC
from ...foundation.errors import InputError, OutputError
from ..safety.replacing import copy_bytes
from ..safety.transactions import Transaction
from . import geom, isd, rpb, rpc_txt, rpcm_json
from .compare import same_numbers
from .content import read_head, siblings
from .find import read_rpc, rpc_reader_of, side_files

ORIGINAL = ".original"
#: Formats that can be set aside; the vendor's XML is left alone, because it holds more than the RPC.
PLAIN = ("rpb", "rpc-txt", "kompsat")
VENDOR_XML = ("isd", "dimap")
_FORMATS = (rpb, rpc_txt, isd, geom, rpcm_json)
_MARKS = tuple(module.WRITTEN_BY.encode() for module in _FORMATS)


def is_ours(path: str) -> bool:
    """Return whether an RPC file was written by this program."""
    head = read_head(path)
    return any(mark in head for mark in _MARKS)


def plain_files(image_path: str) -> list[str]:
    """Return the ``.RPB`` and ``_RPC.TXT`` files of an image, the one that wins first."""
    beside = side_files(image_path)
    return [file for key in PLAIN for file in beside[key]]


def vendor_xml(image_path: str) -> list[str]:
    """Return the vendor's XML files of an image, which also win over an RPC inside it."""
    beside = side_files(image_path)
    return [file for key in VENDOR_XML for file in beside[key]]


def is_rpc_file(path: str) -> bool:
    """Return whether a file holds an RPC and no pixels."""
    try:
        return os.path.isfile(path) and rpc_reader_of(path) is not None
    except InputError:
        return False


def set_aside(path: str, changes: Transaction) -> str:
    """Schedule the removal of our own RPC file, or the renaming of a vendor's; return a notice for the log."""
    if is_ours(path):
        changes.remove(path)
        return f"{path}: an RPC file of an earlier run would win over the new RPC and was removed"
    kept = _free_name(path)
    changes.rename(path, kept)
    return f"{path}: would win over the new RPC and was set aside as {os.path.basename(kept)}"


def keep_original(path: str, changes: Transaction) -> None:
    """Schedule a copy ``<name>.original`` of a vendor's RPC file that will be overwritten; not for our own."""
    if is_rpc_file(path) and not is_ours(path):
        copy_bytes(path, changes.new_file(_free_name(path)))


def _free_name(path: str) -> str:
    kept, number = path + ORIGINAL, 1
    while os.path.exists(kept):
        number += 1
        kept = f"{path}{ORIGINAL}-{number}"
    return kept


def put_back(image_path: str, names: set[str]) -> tuple[str, ...]:
    """Bring back the originals among an image's RPC files and remove our own; return notices for the log.

    ``names`` are the file names, in lower case, that count as the image's.
    """
    notices = []
    files = siblings(image_path)
    for name in sorted(names):
        original, current = files.get(name + ORIGINAL), files.get(name)
        try:
            if original is not None:
                os.replace(original, original.removesuffix(ORIGINAL))
                notices.append(f"{original.removesuffix(ORIGINAL)}: the original is back")
            elif current is not None and is_ours(current):
                os.remove(current)
                notices.append(f"{current}: written by an earlier run, removed")
        except OSError as error:
            raise OutputError(f"{original or current}: cannot be renamed ({error.strerror})") from None
    return tuple(notices)


def stale_files(image_path: str, rpc: RPC) -> list[str]:
    """Return the ``.RPB`` and ``_RPC.TXT`` files of an image that hold another RPC than ``rpc``."""
    return [file for file in plain_files(image_path) if not _holds_rpc(file, rpc)]


def _holds_rpc(path: str, rpc: RPC) -> bool:
    try:
        return same_numbers(rpc, read_rpc(path).rpc)
    except InputError:
        return False


def free_the_way(target_path: str, source_path: str, rpc: RPC, changes: Transaction) -> tuple[str, ...]:
    """Have files set aside that lie beside a copy's name and would win over its tag with another RPC; return notices.

    Raises `InputError` where they may belong to the source (the same folder) or are the vendor's XML.
    """
    same_folder = os.path.dirname(os.path.abspath(target_path)) == os.path.dirname(os.path.abspath(source_path))
    stale = stale_files(target_path, rpc)
    foreign = vendor_xml(target_path) + (stale if same_folder else [])
    if foreign:
        raise InputError(
            f"{foreign[0]}: would win over the RPC of {os.path.basename(target_path)}: choose another output directory"
        )
    return tuple(set_aside(file, changes) for file in stale)

"""The RPC in a GeoTIFF: tag 50844 (RPCCoefficientTag), 92 doubles, read and overwritten exactly.

GDAL hands the numbers out rounded to 15 digits; here they are the doubles themselves. An RPC that is replaced in
place is kept in the file's GDAL metadata, domain ``HRSI_ORIGINAL_RPC``: readable with
``gdalinfo -mdd HRSI_ORIGINAL_RPC``, and with every double as a hexadecimal float, so that it comes back bit by bit.
"""

import re
import struct
from collections.abc import Iterable, Mapping
from html import escape

from ...foundation.errors import InputError
from .fields import GDAL_NAMES, SCALARS, rpc_from_numbers
from .reading import RpcReading
from .tiff_directory import ASCII, DOUBLE, Directory, Field, edit_directory, read_directory, read_value

TAG_RPC = 50844
TAG_METADATA = 42112  # GDAL_METADATA, XML
COUNT = 92
ORIGINAL_DOMAIN = "HRSI_ORIGINAL_RPC"
_DOUBLES_ITEM = "TAG_50844"
_ABSENT = "absent"
_ORIGINAL_ITEM = re.compile(rf'<Item name="([^"]*)" domain="{ORIGINAL_DOMAIN}"[^>]*>([^<]*)</Item>\r?\n?')
_LINEAGE_ITEM = re.compile(r'<Item name="HRSI_[A-Z0-9_]*">[^<]*</Item>\r?\n?')
_END = "</GDALMetadata>"


def read(path: str) -> RpcReading | None:
    """Return the RPC of a GeoTIFF's tag; None for other files and without the tag.

    Raises `InputError` where the tag is there but damaged.
    """
    numbers = read_numbers(path)
    return None if numbers is None else RpcReading(rpc_from_numbers(f"{path} (tag {TAG_RPC})", numbers))


def has_tag(path: str) -> bool:
    """Return whether a file is a TIFF with an RPC tag, damaged or not."""
    directory = read_directory(path)
    return directory is not None and directory.entry(TAG_RPC) is not None


def read_numbers(path: str) -> list[float] | None:
    """Return the 92 doubles of the tag as they stand in the file; None for other files and without the tag."""
    directory = read_directory(path)
    entry = None if directory is None else directory.entry(TAG_RPC)
    if directory is None or entry is None:
        return None
    if entry.kind != DOUBLE or entry.count != COUNT:
        raise InputError(
            f"{path}: tag {TAG_RPC} has {entry.count} values of type {entry.kind}, {COUNT} doubles are needed: "
            "write the RPC anew"
        )
    content = read_value(path, directory, TAG_RPC)
    return list(struct.unpack(f"{directory.order}{COUNT}d", content or b""))


def set_numbers(
    path: str, numbers: list[float], keep_original: bool, lineage: Mapping[str, str] | None = None,
    original: list[float] | None = None,
) -> bool:  # fmt: skip
    """Write the RPC tag into a TIFF file in place; return False where the directory had to move.

    With ``keep_original`` the old doubles (or those of ``original``, where the RPC came from beside the image) go into
    the metadata domain, unless an older original is there already. ``lineage`` becomes items of the metadata, in place
    of those of an earlier run.
    """
    directory = _require_directory(path)
    changes: dict[int, Field | None] = {TAG_RPC: _doubles_field(directory, numbers)}
    xml = _read_metadata(path, directory)
    told = xml
    if keep_original and not _ORIGINAL_ITEM.search(xml):
        told = _with_original(told, read_numbers(path) if original is None else original)
    if lineage:
        told = _with_items(_LINEAGE_ITEM.sub("", told), [_write_item(name, value) for name, value in lineage.items()])
    if told != xml:
        changes[TAG_METADATA] = _text_field(told)
    return edit_directory(path, changes)


def restore_numbers(path: str) -> bool:
    """Put the original doubles back (or take the tag out where there was none) and forget them.

    Returns False where the file keeps no original. Raises `InputError` where what it keeps is damaged.
    """
    directory = _require_directory(path)
    xml = _read_metadata(path, directory)
    kept = dict(_ORIGINAL_ITEM.findall(xml))
    if _DOUBLES_ITEM not in kept:
        return False
    cleaned = _LINEAGE_ITEM.sub("", _ORIGINAL_ITEM.sub("", xml))
    numbers = parse_original(path, kept)
    edit_directory(
        path,
        {
            TAG_RPC: None if numbers is None else _doubles_field(directory, numbers),
            TAG_METADATA: _text_field(cleaned) if "<Item" in cleaned else None,
        },
    )
    return True


def keeps_original(path: str) -> bool:
    """Return whether a file keeps the RPC that it had before the first writing in place."""
    directory = read_directory(path)
    return directory is not None and bool(_ORIGINAL_ITEM.search(_read_metadata(path, directory)))


def _require_directory(path: str) -> Directory:
    directory = read_directory(path)
    if directory is None:
        raise InputError(f"{path}: is not a TIFF file, so its RPC cannot be written in place: write a copy or a VRT")
    return directory


def _doubles_field(directory: Directory, numbers: list[float]) -> Field:
    return Field(DOUBLE, struct.pack(f"{directory.order}{COUNT}d", *numbers))


def _text_field(xml: str) -> Field:
    return Field(ASCII, xml.encode("utf-8", "surrogateescape") + b"\0")


def _read_metadata(path: str, directory: Directory) -> str:
    content = read_value(path, directory, TAG_METADATA) or b""
    return content.rstrip(b"\0").decode("utf-8", "surrogateescape")


def _with_original(xml: str, numbers: list[float] | None) -> str:
    """Return the GDAL metadata with the original RPC as further items."""
    items = {_DOUBLES_ITEM: _ABSENT if numbers is None else " ".join(number.hex() for number in numbers)}
    if numbers is not None:
        items |= {GDAL_NAMES[name]: repr(value) for name, value in zip(SCALARS, numbers[2:12], strict=True)}
    return _with_items(xml, [_write_item(name, value, ORIGINAL_DOMAIN) for name, value in items.items()])


def _with_items(xml: str, items: Iterable[str]) -> str:
    """Return the GDAL metadata with further items."""
    body = xml[: xml.rindex(_END)] if _END in xml else "<GDALMetadata>\n"
    return f"{body}{''.join(items)}{_END}\n"


def _write_item(name: str, value: str, domain: str = "") -> str:
    where = f' domain="{domain}"' if domain else ""
    return f'<Item name="{name}"{where}>{escape(value)}</Item>\n'


def parse_original(path: str, kept: Mapping[str, str]) -> list[float] | None:
    """Return the doubles of the original RPC from the items of its metadata domain; None where there was none.

    Raises `InputError` where they are damaged.
    """
    text = kept.get(_DOUBLES_ITEM, _ABSENT)
    if text == _ABSENT:
        return None
    try:
        numbers = [float.fromhex(number) for number in text.split()]
    except (ValueError, OverflowError):
        numbers = []
    if len(numbers) != COUNT:
        raise InputError(f"{path}: the original RPC in domain {ORIGINAL_DOMAIN} is damaged: write the RPC anew")
    return numbers

"""The RPC in a GeoTIFF: tag 50844 (RPCCoefficientTag), 92 doubles, read and overwritten exactly.

GDAL returns the numbers rounded to 15 digits; here they are the doubles themselves. An RPC that is replaced in place
is kept in the file's GDAL metadata, domain ``HRSI_ORIGINAL_RPC``: readable with ``gdalinfo -mdd HRSI_ORIGINAL_RPC``,
and with every double as a hexadecimal float, so that it is restored bit by bit.

GDAL changes a tag by writing the first directory of the file (TIFF 6.0 and BigTIFF, either byte order) again at its
end, which ends the layout of a Cloud Optimized GeoTIFF. Here the directory is changed at its place: a value of the same
length is overwritten; a longer one is appended to the file, and only its entry changes; for a new entry, the values
directly after the directory are moved to the end of the file. Nothing else moves, so pixels, overviews and the COG
layout are unchanged.
"""

import os
import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from html import escape
from typing import BinaryIO, NamedTuple

from ...camera.rpc import RPC
from ...foundation.errors import InputError, OutputError
from ..opening.budgets import FILE_BUDGETS
from .fields import GDAL_NAMES, SCALARS, rpc_from_numbers

# ---- the first directory -----------------------------------------------------------------------------------------


#: Bytes of one value, by TIFF field type.
TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
ASCII, DOUBLE = 2, 12


@dataclass(frozen=True)
class TagEntry:
    """One entry: tag, field type, number of values, and the raw value field (the value itself, or its offset)."""

    tag: int
    kind: int
    count: int
    field: bytes

    @property
    def length(self) -> int:
        """Number of bytes of all values."""
        return TYPE_BYTES.get(self.kind, 1) * self.count

    @property
    def is_inline(self) -> bool:
        return self.length <= len(self.field)


class Field(NamedTuple):
    """A value to be written: field type and bytes, in the file's byte order."""

    kind: int
    content: bytes


@dataclass(frozen=True)
class Directory:
    """The first directory: byte order (``<`` or ``>``), BigTIFF or not, place, entries and pointer to the next one."""

    order: str
    big: bool
    offset: int
    entries: tuple[TagEntry, ...]
    following: int

    @property
    def word(self) -> str:
        """Format code of offsets and of the entries' counts."""
        return self.order + ("Q" if self.big else "I")

    def entry(self, tag: int) -> TagEntry | None:
        """Return the entry of a tag, None if there is none."""
        return next((entry for entry in self.entries if entry.tag == tag), None)

    def place(self, entry: TagEntry) -> int:
        """Return the offset of a value that does not fit into its entry."""
        return int(struct.unpack(self.word, entry.field)[0])

    def pack(self) -> bytes:
        """Return the bytes of the directory as in the file."""
        head = struct.pack(self.order + ("Q" if self.big else "H"), len(self.entries))
        code = self.order + "HH" + self.word[1:]
        table = b"".join(struct.pack(code, e.tag, e.kind, e.count) + e.field for e in self.entries)
        return head + table + struct.pack(self.word, self.following)


def read_directory(path: str) -> Directory | None:
    """Return the first directory of a TIFF file; None for other files. Raises `InputError` if it is damaged."""
    if not os.path.isfile(path):
        return None
    try:
        with open(path, "rb") as file:
            head = file.read(16)
            order = {b"II": "<", b"MM": ">"}.get(head[:2])
            if order is None or len(head) < 8:
                return None
            version = struct.unpack(f"{order}H", head[2:4])[0]
            if version not in (42, 43):
                return None
            big = version == 43
            offset = struct.unpack(order + ("Q" if big else "I"), head[8:16] if big else head[4:8])[0]
            count_code, word, word_bytes = order + ("Q" if big else "H"), "Q" if big else "I", 8 if big else 4
            file.seek(offset)
            (count,) = struct.unpack(count_code, file.read(struct.calcsize(count_code)))
            if count > FILE_BUDGETS.tiff_tags:
                raise InputError(
                    f"{path}: the TIFF directory claims {count} entries: the file is damaged, obtain it again"
                )
            code = f"{order}HH{word}{word_bytes}s"
            size = struct.calcsize(code)
            table = file.read(size * count + word_bytes)
            entries = tuple(TagEntry(*struct.unpack_from(code, table, start)) for start in range(0, size * count, size))
            return Directory(order, big, offset, entries, struct.unpack_from(order + word, table, size * count)[0])
    except (struct.error, OSError, OverflowError, ValueError):  # the last: an offset of 2^63 or more
        raise InputError(f"{path}: the TIFF directory is cut short or damaged: obtain the file again") from None


def read_value(path: str, directory: Directory, tag: int) -> bytes | None:
    """Return the bytes of a tag's value; None without the tag. Raises `InputError` if they are outside the file."""
    entry = directory.entry(tag)
    if entry is None:
        return None
    if entry.is_inline:
        return entry.field[: entry.length]
    offset = directory.place(entry)
    if offset + entry.length > os.path.getsize(path):
        raise InputError(f"{path}: tag {tag} points behind the end of the file: it is cut short, obtain it again")
    with open(path, "rb") as file:
        file.seek(offset)
        return file.read(entry.length)


def edit_directory(path: str, directory: Directory, changes: Mapping[int, Field | None]) -> bool:
    """Set tags of the first directory (None removes one); return False if the directory was moved to the end.

    The file itself is changed: give a copy, and rename it afterwards. A moved directory is valid TIFF but ends the
    layout of a Cloud Optimized GeoTIFF. Raises `OutputError` if a classic TIFF would grow beyond 4 GiB.
    """
    with open(path, "r+b") as file:
        entries = {entry.tag: entry for entry in directory.entries}
        for tag, field in changes.items():
            old = entries.pop(tag, None)
            if field is not None:
                entries[tag] = _place_value(file, directory, tag, old, field)
        return _write_table(file, directory, replace(directory, entries=tuple(entries[tag] for tag in sorted(entries))))


def _place_value(file: BinaryIO, directory: Directory, tag: int, old: TagEntry | None, field: Field) -> TagEntry:
    """Write a value over the old one if it fits, otherwise at the end of the file; return its entry."""
    word_bytes, content = struct.calcsize(directory.word), field.content
    if len(content) <= word_bytes:
        place = content.ljust(word_bytes, b"\0")
    elif old is not None and not old.is_inline and len(content) <= old.length:
        file.seek(directory.place(old))
        file.write(content)
        place = old.field
    else:
        place = _append_value(file, directory, content)
    return TagEntry(tag, field.kind, len(content) // TYPE_BYTES[field.kind], place)


def _append_value(file: BinaryIO, directory: Directory, content: bytes) -> bytes:
    """Write ``content`` at the end of the file; return the value field that points to it."""
    end = file.seek(0, os.SEEK_END)
    file.write(b"\0" * (-end % 8))  # aligned
    offset = file.tell()
    if not directory.big and offset + len(content) >= 2**32:
        raise OutputError("a classic TIFF cannot grow beyond 4 GiB: write a VRT or a sidecar instead")
    file.write(content)
    return struct.pack(directory.word, offset)


def _write_table(file: BinaryIO, old: Directory, new: Directory) -> bool:
    """Write the changed directory over the old one if there is room or it can be made, otherwise at the end."""
    first, last = old.offset + len(old.pack()), new.offset + len(new.pack())
    if last > first:
        in_the_way = _values_between(old, new, first, last)
        if in_the_way is None:
            pointer = _append_value(file, new, new.pack())
            file.seek(8 if new.big else 4)
            file.write(pointer)
            return False
        for entry in in_the_way:
            if entry in new.entries:  # a changed one has moved already
                file.seek(new.place(entry))
                appended = replace(entry, field=_append_value(file, new, file.read(entry.length)))
                new = replace(new, entries=tuple(appended if item == entry else item for item in new.entries))
    file.seek(new.offset)
    file.write(new.pack())
    return True


def _values_between(old: Directory, new: Directory, first: int, last: int) -> list[TagEntry] | None:
    """Return the old entries whose values are in a range of the file; None if it may contain anything else."""
    spans = []
    for entry in old.entries:
        start = 0 if entry.is_inline else old.place(entry)
        if not entry.is_inline and start < last and start + entry.length > first:
            spans.append((start, start + entry.length, entry))
    covered = first
    for start, end, _entry in sorted(spans, key=lambda span: span[0]):
        if start > covered + 1:  # one byte may pad a value of odd length
            return None
        covered = max(covered, end)
    return [entry for _start, _end, entry in spans] if covered >= last else None


# ---- the RPC tag ---------------------------------------------------------------------------------------------------

TAG_RPC = 50844
TAG_METADATA = 42112  # GDAL_METADATA, XML
COUNT = 92
ORIGINAL_DOMAIN = "HRSI_ORIGINAL_RPC"
_DOUBLES_ITEM = "TAG_50844"
_ABSENT = "absent"
_ORIGINAL_ITEM = re.compile(rf'<Item name="([^"]*)" domain="{ORIGINAL_DOMAIN}"[^>]*>([^<]*)</Item>\r?\n?')
_LINEAGE_ITEM = re.compile(r'<Item name="HRSI_[A-Z0-9_]*">[^<]*</Item>\r?\n?')
_END = "</GDALMetadata>"


def read(path: str) -> RPC | None:
    """Return the RPC of a GeoTIFF's tag; None for other files and without the tag.

    Raises `InputError` if the tag exists but is damaged.
    """
    numbers = read_numbers(path)
    return None if numbers is None else rpc_from_numbers(f"{path} (tag {TAG_RPC})", numbers)


def read_numbers(path: str) -> list[float] | None:
    """Return the 92 doubles of the tag exactly as in the file; None for other files and without the tag."""
    directory = read_directory(path)
    entry = None if directory is None else directory.entry(TAG_RPC)
    if directory is None or entry is None:
        return None
    if entry.kind != DOUBLE or entry.count != COUNT:
        raise InputError(
            f"{path}: tag {TAG_RPC} has {entry.count} values of type {entry.kind}, {COUNT} doubles are needed: write "
            "the RPC again"
        )
    return list(struct.unpack(f"{directory.order}{COUNT}d", read_value(path, directory, TAG_RPC) or b""))


def set_numbers(
    path: str,
    numbers: list[float],
    keep_original: bool,
    lineage: Mapping[str, str] | None = None,
    original: list[float] | None = None,
) -> bool:
    """Write the RPC tag into a TIFF file in place; return False if the directory was moved to the end.

    With ``keep_original`` the old doubles (or those of ``original``, if the RPC was next to the image) are stored in
    the metadata domain, unless it has an older original already. ``lineage`` becomes items of the metadata, instead of
    those of an earlier run.
    """
    directory = _require_directory(path)
    changes: dict[int, Field | None] = {TAG_RPC: Field(DOUBLE, struct.pack(f"{directory.order}{COUNT}d", *numbers))}
    xml = _read_metadata(path, directory)
    new_xml = xml
    if keep_original and not _ORIGINAL_ITEM.search(xml):
        original_numbers = read_numbers(path) if original is None else original
        items = {
            _DOUBLES_ITEM: _ABSENT
            if original_numbers is None
            else " ".join(number.hex() for number in original_numbers)
        }
        if original_numbers is not None:
            items |= {
                GDAL_NAMES[name]: repr(value) for name, value in zip(SCALARS, original_numbers[2:12], strict=True)
            }
        new_xml = _with_items(new_xml, [_write_item(name, value, ORIGINAL_DOMAIN) for name, value in items.items()])
    if lineage:
        new_xml = _with_items(
            _LINEAGE_ITEM.sub("", new_xml), [_write_item(name, value) for name, value in lineage.items()]
        )
    if new_xml != xml:
        changes[TAG_METADATA] = Field(ASCII, new_xml.encode("utf-8", "surrogateescape") + b"\0")
    return edit_directory(path, directory, changes)


def restore_numbers(path: str) -> bool:
    """Restore the original doubles (or remove the tag if there was none), and remove them from the metadata.

    Returns False if the file has no original. Raises `InputError` if the original is damaged.
    """
    directory = _require_directory(path)
    xml = _read_metadata(path, directory)
    original_items = dict(_ORIGINAL_ITEM.findall(xml))
    if _DOUBLES_ITEM not in original_items:
        return False
    cleaned = _LINEAGE_ITEM.sub("", _ORIGINAL_ITEM.sub("", xml))
    numbers = parse_original(path, original_items)
    changes = {
        TAG_RPC: None if numbers is None else Field(DOUBLE, struct.pack(f"{directory.order}{COUNT}d", *numbers)),
        TAG_METADATA: Field(ASCII, cleaned.encode("utf-8", "surrogateescape") + b"\0") if "<Item" in cleaned else None,
    }
    edit_directory(path, directory, changes)
    return True


def keeps_original(path: str) -> bool:
    """Return whether a file contains the RPC that it had before the first writing in place."""
    directory = read_directory(path)
    return directory is not None and bool(_ORIGINAL_ITEM.search(_read_metadata(path, directory)))


def _require_directory(path: str) -> Directory:
    directory = read_directory(path)
    if directory is None:
        raise InputError(f"{path}: is not a TIFF file, so its RPC cannot be written in place: write a copy or a VRT")
    return directory


def _read_metadata(path: str, directory: Directory) -> str:
    return (read_value(path, directory, TAG_METADATA) or b"").rstrip(b"\0").decode("utf-8", "surrogateescape")


def _with_items(xml: str, items: Iterable[str]) -> str:
    """Return the GDAL metadata with further items."""
    body = xml[: xml.rindex(_END)] if _END in xml else "<GDALMetadata>\n"
    return f"{body}{''.join(items)}{_END}\n"


def _write_item(name: str, value: str, domain: str = "") -> str:
    domain_text = f' domain="{domain}"' if domain else ""
    return f'<Item name="{name}"{domain_text}>{escape(value)}</Item>\n'


def parse_original(path: str, original_items: Mapping[str, str]) -> list[float] | None:
    """Return the doubles of the original RPC from the items of its metadata domain; None if there was no RPC.

    Raises `InputError` if they are damaged.
    """
    text = original_items.get(_DOUBLES_ITEM, _ABSENT)
    if text == _ABSENT:
        return None
    try:
        numbers = [float.fromhex(number) for number in text.split()]
    except (ValueError, OverflowError):
        numbers = []
    if len(numbers) != COUNT:
        raise InputError(f"{path}: the original RPC in domain {ORIGINAL_DOMAIN} is damaged: write the RPC again")
    return numbers

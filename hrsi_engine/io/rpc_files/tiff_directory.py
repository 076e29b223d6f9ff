"""The first directory of a TIFF file (TIFF 6.0 and BigTIFF, either byte order): read, and edited where it stands.

GDAL can change a tag only by writing the directory anew at the end of the file, which ends the layout of a Cloud
Optimized GeoTIFF. Here a value of the same length is overwritten where it stands; a longer one goes to the end of
the file and only its entry changes; a new entry makes room by moving the values that lie right behind the directory
to the end of the file. Nothing else moves, so pixels, overviews and the COG layout stay as they are.
"""

import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import BinaryIO

from ...foundation.errors import InputError, OutputError
from ...foundation.thresholds import threshold, thresholds


@thresholds
class DIRECTORY:
    """Which directories of TIFF files are sound."""

    entries: int = threshold(4096, "tags", "most tags of a first directory", "it has a few dozen")


#: Bytes of one value, by TIFF field type.
TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
ASCII, DOUBLE = 2, 12
ALIGNMENT = 8


@dataclass(frozen=True)
class TagEntry:
    """One entry: tag, field type, number of values, and the raw value field (the value itself, or its offset)."""

    tag: int
    kind: int
    count: int
    field: bytes

    @property
    def length(self) -> int:
        """Bytes of all values."""
        return TYPE_BYTES.get(self.kind, 1) * self.count

    @property
    def is_inline(self) -> bool:
        return self.length <= len(self.field)


@dataclass(frozen=True)
class Field:
    """A value to be written: field type and bytes, in the file's byte order."""

    kind: int
    content: bytes

    @property
    def count(self) -> int:
        return len(self.content) // TYPE_BYTES[self.kind]


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
        """Format of offsets and of the entries' counts."""
        return self.order + ("Q" if self.big else "I")

    def entry(self, tag: int) -> TagEntry | None:
        """Return the entry of a tag, None where there is none."""
        return next((entry for entry in self.entries if entry.tag == tag), None)

    def place(self, entry: TagEntry) -> int:
        """Return the offset of a value that does not fit into its entry."""
        return int(struct.unpack(self.word, entry.field)[0])

    def pack(self) -> bytes:
        """Return the directory as it stands in the file."""
        head = struct.pack(self.order + ("Q" if self.big else "H"), len(self.entries))
        code = self.order + "HH" + self.word[1:]
        table = b"".join(struct.pack(code, e.tag, e.kind, e.count) + e.field for e in self.entries)
        return head + table + struct.pack(self.word, self.following)


def read_directory(path: str) -> Directory | None:
    """Return the first directory of a TIFF file; None for other files. Raises `InputError` where it is damaged."""
    if not os.path.isfile(path):
        return None
    try:
        with open(path, "rb") as file:
            return _read_entries(path, file)
    except (struct.error, OSError, OverflowError, ValueError):  # the last: an offset of 2^63 or more
        raise InputError(f"{path}: the TIFF directory is cut short or damaged: get the file again") from None


def _read_entries(path: str, file: BinaryIO) -> Directory | None:
    head = file.read(16)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 8:
        return None
    version = struct.unpack(f"{order}H", head[2:4])[0]
    if version not in (42, 43):
        return None
    big = version == 43
    offset = struct.unpack(order + ("Q" if big else "I"), head[8:16] if big else head[4:8])[0]
    directory = Directory(order, big, offset, (), 0)
    count_code, word_bytes = directory.order + ("Q" if directory.big else "H"), 8 if directory.big else 4
    file.seek(directory.offset)
    (count,) = struct.unpack(count_code, file.read(struct.calcsize(count_code)))
    if count > DIRECTORY.entries:
        raise InputError(f"{path}: the TIFF directory claims {count} entries: the file is damaged, get it again")
    code = directory.order + "HH" + directory.word[1:]
    size = struct.calcsize(code) + word_bytes
    table = file.read(size * count + word_bytes)
    entries = tuple(
        _make_entry(struct.unpack_from(code, table, start), table[start + size - word_bytes : start + size])
        for start in range(0, size * count, size)
    )
    following = struct.unpack_from(directory.word, table, size * count)[0]
    return replace(directory, entries=entries, following=following)


def _make_entry(numbers: tuple[int, int, int], field: bytes) -> TagEntry:
    tag, kind, count = numbers
    return TagEntry(tag, kind, count, field)


def read_value(path: str, directory: Directory, tag: int) -> bytes | None:
    """Return the bytes of a tag's value; None without the tag. Raises `InputError` where they lie outside the file."""
    entry = directory.entry(tag)
    if entry is None:
        return None
    if entry.is_inline:
        return entry.field[: entry.length]
    offset = directory.place(entry)
    if offset + entry.length > os.path.getsize(path):
        raise InputError(f"{path}: tag {tag} points behind the end of the file: it is cut short, get it again")
    with open(path, "rb") as file:
        file.seek(offset)
        return file.read(entry.length)


def edit_directory(path: str, changes: Mapping[int, Field | None]) -> bool:
    """Set tags of the first directory (None removes one); return False where the directory had to move.

    The file is changed where it stands: give a copy, and rename it afterwards. A moved directory is valid TIFF but
    ends the layout of a Cloud Optimized GeoTIFF. Raises `InputError` where the file is no TIFF or damaged,
    `OutputError` where a classic TIFF would grow beyond 4 GiB.
    """
    directory = read_directory(path)
    if directory is None:
        raise InputError(f"{path}: is not a TIFF file: name a GeoTIFF")
    with open(path, "r+b") as file:
        entries = {entry.tag: entry for entry in directory.entries}
        for tag, field in changes.items():
            old = entries.pop(tag, None)
            if field is not None:
                entries[tag] = _place_value(file, directory, tag, old, field)
        return _write_table(file, directory, replace(directory, entries=tuple(entries[tag] for tag in sorted(entries))))


def _place_value(file: BinaryIO, directory: Directory, tag: int, old: TagEntry | None, field: Field) -> TagEntry:
    """Write a value over the old one where it fits, else at the end of the file; return its entry."""
    word_bytes = struct.calcsize(directory.word)
    if len(field.content) <= word_bytes:
        return TagEntry(tag, field.kind, field.count, field.content.ljust(word_bytes, b"\0"))
    if old is not None and not old.is_inline and len(field.content) <= old.length:
        file.seek(directory.place(old))
        file.write(field.content)
        return TagEntry(tag, field.kind, field.count, old.field)
    return TagEntry(tag, field.kind, field.count, _append_value(file, directory, field.content))


def _append_value(file: BinaryIO, directory: Directory, content: bytes) -> bytes:
    """Write ``content`` at the end of the file; return the value field that points to it."""
    end = file.seek(0, os.SEEK_END)
    file.write(b"\0" * (-end % ALIGNMENT))
    offset = file.tell()
    if not directory.big and offset + len(content) >= 2**32:
        raise OutputError("a classic TIFF cannot grow beyond 4 GiB: write a VRT or a sidecar instead")
    file.write(content)
    return struct.pack(directory.word, offset)


def _write_table(file: BinaryIO, old: Directory, new: Directory) -> bool:
    """Write the changed directory over the old one where there is room or room can be made, else at the end."""
    first, last = old.offset + len(old.pack()), new.offset + len(new.pack())
    if last > first:
        in_the_way = _values_between(old, new, first, last)
        if in_the_way is None:
            pointer = _append_value(file, new, new.pack())
            file.seek(8 if new.big else 4)
            file.write(pointer)
            return False
        for entry in in_the_way:
            new = _relocate_value(file, new, entry)
    file.seek(new.offset)
    file.write(new.pack())
    return True


def _values_between(old: Directory, new: Directory, first: int, last: int) -> list[TagEntry] | None:
    """Return the old entries whose values lie in a range of the file; None where anything else may lie there."""
    spans = []
    for entry in old.entries:
        start = 0 if entry.is_inline else old.place(entry)
        if not entry.is_inline and start < last and start + entry.length > first:
            spans.append((start, start + entry.length, entry))
    covered = first
    for start, end, _make_entry in sorted(spans, key=lambda span: span[0]):
        if start > covered + 1:  # one byte may pad a value of odd length
            return None
        covered = max(covered, end)
    return [entry for _start, _end, entry in spans] if covered >= last else None


def _relocate_value(file: BinaryIO, directory: Directory, entry: TagEntry) -> Directory:
    """Copy one value to the end of the file and point its entry there; entries that changed since are left alone."""
    if entry not in directory.entries:
        return directory
    file.seek(directory.place(entry))
    field = _append_value(file, directory, file.read(entry.length))
    moved = replace(entry, field=field)
    return replace(directory, entries=tuple(moved if item == entry else item for item in directory.entries))

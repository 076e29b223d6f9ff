"""Marks of the content of files, by which a later run recognises that stored results are still valid.

Size and modification time are not sufficient: copies and archives keep the time, and so do tools that restore it. A
file with all its side files up to `CONTENT_SAMPLING.whole_bytes` is hashed completely: every change is detected, and
nothing else. Reading larger files completely would take longer than it saves: only their beginnings and ends (headers,
tags and tile tables) and some blocks in between are hashed. This detects every change that is longer than two distances
of blocks; a smaller one is detected by the times of the last change of content and of the inode, of which no tool can
restore the second.
"""

import hashlib
import os
from collections.abc import Iterable, Iterator
from typing import BinaryIO

from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import open_dataset, read_virtual, virtual_status


@thresholds
class CONTENT_SAMPLING:
    """Parts of a file that are hashed to distinguish its states."""

    whole_bytes: int = threshold(
        64 * 2**20, "byte", "size up to which a file and its side files are hashed completely", "larger: too long"
    )
    edge_bytes: int = threshold(
        2**20, "byte", "length of the beginnings and ends of all files together", "headers and tables of tiles"
    )
    blocks: int = threshold(512, "blocks", "blocks spread over all files together")
    block_bytes: int = threshold(2**14, "byte", "length of a block, and of the beginning of a remote file")


def content_mark(path: str) -> str:
    """Return a text that differs if the content of a dataset differs: its file, side files, sources of a VRT.

    For a virtual path of GDAL into an archive it is that of the archive; for a file in memory or on a server it depends
    on size, time and beginning. 32 hexadecimal digits; all zeros if nothing can be read, as for a connection string.
    """
    if path.startswith("/vsi"):
        # The local file that the path leads into: after /vsizip/ the rest is relative, or begins with /
        start = path.find("/", 1) + 1
        ends = [len(path), *(position for position in range(len(path) - 1, start, -1) if path[position] == "/")]
        archive = next((path[start:end] for end in ends if os.path.isfile(path[start:end])), None)
        if archive is not None:
            return files_mark([archive])
        status = virtual_status(path)
        head = None if status is None else read_virtual(path, CONTENT_SAMPLING.block_bytes)
        if status is None or head is None:
            return "0" * 32
        return hashlib.blake2b(head + f"\0{status.size}\0{status.mtime}".encode(), digest_size=16).hexdigest()
    dataset, _ = open_dataset(path)
    names = [path, f"{path}-wal", *((dataset.GetFileList() or []) if dataset is not None else [])]
    del dataset
    return files_mark(names)


def files_mark(paths: Iterable[str], times: bool = True) -> str:
    """Return the common mark of files, by their contents; see `content_mark`.

    Without ``times`` copies of large files have the same mark, but a change between the hashed blocks is not detected,
    unless the format itself counts changes at its beginning, as SQLite does.
    """
    sizes = {name: os.path.getsize(name) for name in sorted({*map(os.path.abspath, paths)}) if os.path.isfile(name)}
    if not sizes:
        return "0" * 32
    total, state = sum(sizes.values()), hashlib.blake2b(digest_size=16)
    for name, size in sizes.items():
        state.update(f"{os.path.basename(name)}\0{size}\0".encode("utf-8", "surrogateescape"))
        with open(name, "rb", buffering=0) as file:
            is_complete = total <= CONTENT_SAMPLING.whole_bytes
            if times and not is_complete:
                state.update(_change_times(file.fileno()))
            for block in read_places(file, [(0, size)] if is_complete else places_of(size, size / total)):
                state.update(block)
    return state.hexdigest()


def places_of(size: int, share: float = 1.0) -> list[tuple[int, int]]:
    """Return start and length of the blocks of a file that are hashed; ``share`` is its part of all hashed bytes."""
    edge = max(int(CONTENT_SAMPLING.edge_bytes * share), CONTENT_SAMPLING.block_bytes)
    count = max(int(CONTENT_SAMPLING.blocks * share), 1)
    # Not at equal distances, which lines and tiles of an image have too. Odd steps of the golden ratio are as even
    jitter = ((k * 0.6180339887498949) % 1.0 for k in range(count))
    starts = [int((k + additional) / count * size) for k, additional in enumerate(jitter)]
    return [(0, edge), *((start, CONTENT_SAMPLING.block_bytes) for start in starts), (max(size - edge, 0), edge)]


def read_places(file: BinaryIO, places: Iterable[tuple[int, int]]) -> Iterator[bytes]:
    """Yield the bytes of an unbuffered file at these places (start, length), in blocks."""
    for start, length in places:
        file.seek(start)
        while length > 0 and (block := file.read(min(length, 2**20))):
            yield block
            length -= len(block)


def _change_times(descriptor: int) -> bytes:
    status = os.fstat(descriptor)
    return f"{status.st_mtime_ns}\0{status.st_ctime_ns}\0".encode()

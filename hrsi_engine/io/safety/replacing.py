"""Files that are replaced in one step: a killed process leaves the old file or the new one, never a torn one."""

import contextlib
import os
import shutil
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ...foundation.errors import InputError, OutputError
from ...foundation.progress import Progress, advance, silent
from ...foundation.thresholds import threshold, thresholds
from .leftovers import is_unfinished, temporary_name

WRITE_AHEAD_LOG = ("-wal", "-shm")  #: what follows the name of an SQLite file


@thresholds
class REPLACING:
    """How files are copied and brought to the disk."""

    copy_bytes: int = threshold(64 * 2**20, "byte", "length of the parts in which a file is copied")
    many_files: int = threshold(
        100, "files", "beyond, the whole file system is flushed once instead of each file",
        "a flush of one file takes some milliseconds",
    )  # fmt: skip


@contextmanager
def replacing(path: str) -> Iterator[str]:
    """Provide a temporary name in the folder of ``path``; at the end the file is flushed and renamed to ``path``.

    Anything raised inside removes the temporary file and leaves ``path`` as it was; failures of the disk become
    `OutputError`. The temporary name keeps the extension, because GDAL and the readers choose by it, and begins
    with a dot; it tells who writes (see `leftovers`). A symbolic link is followed: the file it points to is replaced,
    its permissions and owner stay, and one that is read-only is refused by `InputError`.
    """
    path = os.path.realpath(path)
    require_not_read_only(path)
    temporary = temporary_name(path)
    try:
        yield temporary
        take_permissions(path, temporary)
        folder = os.path.dirname(path)
        if is_unfinished(folder):  # whoever moves its files into place flushes them
            os.replace(temporary, path)
        else:
            flush(temporary)
            os.replace(temporary, path)
            flush(folder)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}): check free space and permissions") from None
    finally:
        for leftover in (temporary, f"{temporary}.aux.xml"):
            with contextlib.suppress(OSError):
                os.remove(leftover)


def require_not_read_only(path: str) -> None:
    """Raise `InputError` where a file is there that its permissions protect; renaming another over it would not ask."""
    with contextlib.suppress(FileNotFoundError):
        mode = stat.S_IMODE(os.stat(path).st_mode)
        if not mode & 0o222 or not os.access(path, os.W_OK):  # root may write everywhere
            raise InputError(
                f"{path} is read-only (mode {mode:o}) and would be changed: give it write permission (chmod u+w), or "
                "write elsewhere; nothing was changed"
            )


def take_permissions(path: str, temporary: str) -> None:
    """Give a new file the mode bits and, as far as the system lets us, the owner of the file that it replaces."""
    with contextlib.suppress(FileNotFoundError):  # nothing is replaced
        old = os.stat(path)
        if hasattr(os, "chown"):
            with contextlib.suppress(OSError):
                os.chown(temporary, old.st_uid, old.st_gid)
        os.chmod(temporary, stat.S_IMODE(old.st_mode))  # behind the owner, whose change takes bits away


def flush(path: str) -> None:
    """Have a file or folder written to the disk itself."""
    # some network file systems, and Windows, cannot flush folders
    is_folder = os.path.isdir(path)
    with contextlib.suppress(OSError) if is_folder else contextlib.nullcontext():
        descriptor = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def flush_files(paths: Sequence[str]) -> None:
    """Have files written to the disk itself; of many all at once, where the system waits for that."""
    if len(paths) > REPLACING.many_files and sys.platform == "linux":  # POSIX only promises to begin; Linux waits
        os.sync()
        return
    for path in paths:
        flush(path)


def copy_bytes(source_path: str, target_path: str, progress: Progress = silent, message: str = "") -> None:
    """Copy a file byte for byte, with its permissions; shares the blocks where the file system can."""
    total = max(os.path.getsize(source_path), 1)
    with open(source_path, "rb") as source, open(target_path, "wb") as target:
        done = 0
        while moved := _copy_part(source.fileno(), target.fileno()):
            done += moved
            advance(progress, min(done / total, 1.0), message)
    shutil.copymode(source_path, target_path)
    os.chmod(target_path, os.stat(target_path).st_mode | 0o200)  # the copy of a read-only file is edited next


def _copy_part(source: int, target: int) -> int:
    """Copy the next part from one open file to the other; return its length in bytes, 0 at the end."""
    if hasattr(os, "copy_file_range"):
        with contextlib.suppress(OSError):  # not across file systems of different kinds
            return os.copy_file_range(source, target, REPLACING.copy_bytes)
    content = os.read(source, REPLACING.copy_bytes)
    written = 0
    while written < len(content):
        written += os.write(target, content[written:])
    return written


def remove_write_ahead_log(path: str) -> None:
    """Remove the write-ahead log of an SQLite file that is replaced: SQLite would play it into the new one.

    QGIS leaves one beside every GeoPackage that it has open.
    """
    for suffix in WRITE_AHEAD_LOG:
        with contextlib.suppress(FileNotFoundError):
            os.remove(path + suffix)

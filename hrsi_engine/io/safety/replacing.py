"""Files that are replaced in one step: a killed process leaves the old file or the new one, never a partial one.

The hidden name of a file that is being written identifies its writer: the machine, the process and its start time. So a
later run can distinguish files of a running process, which it must not change, from those of a killed one.
"""

import contextlib
import os
import re
import secrets
import shutil
import socket
import stat
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache

from ...foundation.errors import InputError, OutputError
from ...foundation.interruption import holding_signals
from ...foundation.progress import Progress, advance, silent
from ...foundation.thresholds import LISTS, threshold, thresholds
from .content_marks import CONTENT_SAMPLING

WRITE_AHEAD_LOG = ("-wal", "-shm")  #: suffixes of the name of an SQLite file


@thresholds
class REPLACING:
    """Copying, locking and flushing of files, and when an unfinished file is regarded as left over."""

    old_s: float = threshold(
        7 * 86_400.0, "s", "age at which unfinished files of another machine on a shared disk are abandoned"
    )


@contextmanager
def replacing(path: str) -> Iterator[str]:
    """Provide a temporary name in the folder of ``path``; at the end the file is flushed and renamed to ``path``.

    After an exception the temporary file is removed and ``path`` is unchanged; errors of the disk become `OutputError`.
    The temporary name keeps the extension, because GDAL and the readers use it, begins with a dot, and identifies the
    writer. A symbolic link is followed: the file that it refers to is replaced, with the same permissions and owner; a
    read-only file raises `InputError`.
    """
    path = os.path.realpath(path)
    require_not_read_only(path)
    temporary = temporary_name(path)
    try:
        yield temporary
        take_permissions(path, temporary)
        folder = os.path.dirname(path)
        if is_unfinished(folder):  # its files are flushed when they are moved into place
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
    """Raise `InputError` for an existing read-only file, over which another file could be renamed without a message."""
    with contextlib.suppress(FileNotFoundError):
        mode = stat.S_IMODE(os.stat(path).st_mode)
        if not mode & 0o222 or not os.access(path, os.W_OK):  # root may write to every file
            raise InputError(
                f"{path} is read-only (mode {mode:o}) and would be changed: give it write permission (chmod u+w), or "
                "write elsewhere; nothing was changed"
            )


def take_permissions(path: str, temporary: str) -> None:
    """Give a new file the mode bits and, if the system permits it, the owner of the file that it replaces."""
    with contextlib.suppress(FileNotFoundError):  # nothing is replaced
        old = os.stat(path)
        if hasattr(os, "chown"):
            with contextlib.suppress(OSError):
                os.chown(temporary, old.st_uid, old.st_gid)
        os.chmod(temporary, stat.S_IMODE(old.st_mode))  # after the owner, whose change clears bits


def flush(path: str) -> None:
    """Flush a file or folder to the disk."""
    # some network file systems, and Windows, cannot flush folders
    is_folder = os.path.isdir(path)
    with contextlib.suppress(OSError) if is_folder else contextlib.nullcontext():
        descriptor = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def flush_files(paths: Sequence[str]) -> None:
    """Flush files to the disk; many files at once by `os.sync`, if the system waits until that is complete."""
    if len(paths) > LISTS.images and sys.platform == "linux":  # POSIX does not wait; Linux does
        os.sync()
        return
    for path in paths:
        flush(path)


def copy_bytes(source_path: str, target_path: str, progress: Progress = silent, message: str = "") -> None:
    """Copy a file byte for byte, with its permissions; the file system shares the blocks if it can."""
    total = max(os.path.getsize(source_path), 1)
    with open(source_path, "rb") as source, open(target_path, "wb") as target:
        completed = 0
        while copied := _copy_part(source.fileno(), target.fileno()):
            completed += copied
            advance(progress, min(completed / total, 1.0), message)
    shutil.copymode(source_path, target_path)
    os.chmod(target_path, os.stat(target_path).st_mode | 0o200)  # a copy is edited next


def _copy_part(source: int, target: int) -> int:
    """Copy the next part from one open file to the other; return its length in bytes, 0 at the end."""
    if hasattr(os, "copy_file_range"):
        with contextlib.suppress(OSError):  # not between all file systems
            return os.copy_file_range(source, target, CONTENT_SAMPLING.whole_bytes)
    content = os.read(source, CONTENT_SAMPLING.whole_bytes)
    count = 0
    while count < len(content):
        count += os.write(target, content[count:])
    return count


def remove_write_ahead_log(path: str) -> None:
    """Remove the write-ahead log of an SQLite file that is replaced: SQLite would apply it to the new file.

    QGIS leaves such a log for every GeoPackage that it has open.
    """
    for suffix in WRITE_AHEAD_LOG:
        with contextlib.suppress(FileNotFoundError):
            os.remove(path + suffix)


FOLDER_PREFIX = ".hrsi-unfinished-"
_WRITER = r"([0-9a-f]{8})-(\d+)-(\d+)"  # machine, process, its start time
_NAMES = rf"{re.escape(FOLDER_PREFIX)}{_WRITER}-.*", rf"\..*\.{_WRITER}-[0-9a-f]{{8}}\.tmp.*"


def temporary_name(path: str) -> str:
    """Return a hidden file name in the folder of ``path``, with its extension and the writing process in it."""
    folder, name = os.path.split(path)
    stem, extension = os.path.splitext(name)
    return os.path.join(folder, f".{stem[:100]}.{writer()}-{secrets.token_hex(4)}.tmp{extension}")


def temporary_folder(folder: str) -> str:
    """Create a hidden folder inside ``folder``; raise `OutputError` if that is not possible."""
    try:
        return tempfile.mkdtemp(prefix=f"{FOLDER_PREFIX}{writer()}-", dir=folder)
    except OSError as error:
        raise OutputError(f"{folder} cannot be written ({error.strerror}): choose another `output_dir`") from None


@contextmanager
def open_hidden_folder(folder: str) -> Iterator[str]:
    """Provide a temporary hidden folder inside ``folder``, which is removed with its content at the end.

    Raises `OutputError` if the folder takes no files.
    """
    concealed = None
    try:
        with holding_signals():  # a signal in between would leave it behind
            concealed = temporary_folder(folder)
        yield concealed
    finally:
        with holding_signals():
            if concealed is not None:
                shutil.rmtree(concealed, ignore_errors=True)


def is_unfinished(folder: str) -> bool:
    """Return whether a folder was created by `temporary_folder`, so that its files are unfinished."""
    return os.path.basename(folder).startswith(FOLDER_PREFIX)


def sweep(folder: str) -> list[str]:
    """Remove unfinished files of ended writers from a folder; return their names. What cannot be removed remains."""
    try:
        names = [name for name in os.listdir(folder or ".") if name.startswith(".")]
    except OSError:
        return []
    removed = []
    for name in names:
        path = os.path.join(folder, name)
        if not is_dead(path):
            continue
        with contextlib.suppress(OSError):
            if os.path.isdir(path):
                shutil.rmtree(path)
            else:
                os.remove(path)
            removed.append(name)
    return removed


def is_dead(path: str) -> bool:
    """Return whether a name is that of an unfinished file or folder whose writer is not running any more."""
    result = next((match for pattern in _NAMES if (match := re.fullmatch(pattern, os.path.basename(path)))), None)
    if result is None:
        return False
    machine, pid, began = result.groups()
    if machine != _machine_name():
        with contextlib.suppress(OSError):
            return time.time() - os.stat(path).st_mtime > REPLACING.old_s
        return False
    return not is_running(int(pid), int(began))


def is_writer_running(words: str) -> bool:
    """Return whether the process that `writer` identifies is running; on another machine it is assumed to be."""
    result = re.fullmatch(_WRITER, words)
    if result is None:
        return False
    machine, pid, began = result.groups()
    return machine != _machine_name() or is_running(int(pid), int(began))


def is_running(pid: int, began: int) -> bool:
    """Return whether a process with this number and start time is running (0: unknown)."""
    if pid == os.getpid():
        return began == _began_at(pid)
    if sys.platform == "win32":  # signal 0 would end it there; files in use cannot be removed anyway
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # it belongs to another user
    now = _began_at(pid)
    return not (began and now) or now == began


def writer() -> str:
    """Return the identifier of this process: machine, process number and start time."""
    return _words_of(os.getpid())


@cache
def _words_of(pid: int) -> str:
    """Return the identifier of this process; cached by its number, which differs after a fork."""
    return f"{_machine_name()}-{pid}-{_began_at(pid)}"


@cache
def _machine_name() -> str:
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _began_at(pid: int) -> int:
    """Return the start time of a process in clock ticks since boot; 0 if the system does not state it."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii", errors="replace") as file:
            return int(file.read().rpartition(")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return 0

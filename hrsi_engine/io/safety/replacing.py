"""Files that are replaced in one step: a killed process leaves the old file or the new one, never a torn one.

A file that is being written has a hidden name that tells who writes it: the machine, the process and when that process
began. So a later run can tell the work of a living process, which it must leave alone, from what a killed one left.
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
from ...foundation.thresholds import threshold, thresholds

WRITE_AHEAD_LOG = ("-wal", "-shm")  #: what follows the name of an SQLite file


@thresholds
class REPLACING:
    """How files are copied, locked and brought to the disk, and when an unfinished one counts as left over."""

    copy_bytes: int = threshold(64 * 2**20, "byte", "length of the parts in which a file is copied")
    many_files: int = threshold(
        100, "files", "beyond, the whole file system is flushed once instead of each file", "a flush takes some ms"
    )
    lock_patience_s: float = threshold(0.1, "s", "a lock held for longer is that of a run, not of one that looks")
    old_s: float = threshold(
        7 * 86_400.0, "s", "age beyond which what another machine left unfinished on a shared disk counts as dead"
    )


@contextmanager
def replacing(path: str) -> Iterator[str]:
    """Provide a temporary name in the folder of ``path``; at the end the file is flushed and renamed to ``path``.

    Anything raised inside removes the temporary file and leaves ``path`` as it was; failures of the disk become
    `OutputError`. The temporary name keeps the extension, because GDAL and the readers choose by it, and begins
    with a dot; it tells who writes. A symbolic link is followed: the file it points to is replaced, its permissions and
    owner stay, and one that is read-only is refused by `InputError`.
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


FOLDER_PREFIX = ".hrsi-unfinished-"
_WRITER = r"([0-9a-f]{8})-(\d+)-(\d+)"  # machine, process, its beginning
_NAMES = rf"{re.escape(FOLDER_PREFIX)}{_WRITER}-.*", rf"\..*\.{_WRITER}-[0-9a-f]{{8}}\.tmp.*"


def temporary_name(path: str) -> str:
    """Return a hidden file name in the folder of ``path``, with its extension and the writing process in it."""
    folder, name = os.path.split(path)
    stem, extension = os.path.splitext(name)
    return os.path.join(folder, f".{stem[:100]}.{writer()}-{secrets.token_hex(4)}.tmp{extension}")


def temporary_folder(folder: str) -> str:
    """Make a hidden folder inside ``folder``; raise `OutputError` where that is not possible."""
    try:
        return tempfile.mkdtemp(prefix=f"{FOLDER_PREFIX}{writer()}-", dir=folder)
    except OSError as error:
        raise OutputError(f"{folder} cannot be written ({error.strerror}): choose another `output_dir`") from None


@contextmanager
def open_hidden_folder(folder: str) -> Iterator[str]:
    """Provide a temporary hidden folder inside ``folder``, which is removed with its content at the end.

    Raises `OutputError` where the folder takes no files.
    """
    hidden = None
    try:
        with holding_signals():  # one between making it and knowing of it would leave it behind
            hidden = temporary_folder(folder)
        yield hidden
    finally:
        with holding_signals():
            if hidden is not None:
                shutil.rmtree(hidden, ignore_errors=True)


def is_unfinished(folder: str) -> bool:
    """Return whether a folder was made by `temporary_folder` and holds unfinished files."""
    return os.path.basename(folder).startswith(FOLDER_PREFIX)


def sweep(folder: str) -> list[str]:
    """Remove what dead writers left unfinished in a folder; return the names. What cannot be removed stays."""
    try:
        names = [name for name in os.listdir(folder or ".") if name.startswith(".")]
    except OSError:
        return []
    swept = []
    for name in names:
        path = os.path.join(folder, name)
        if not is_dead(path):
            continue
        with contextlib.suppress(OSError):
            if os.path.isdir(path):
                shutil.rmtree(path)
            else:
                os.remove(path)
            swept.append(name)
    return swept


def is_dead(path: str) -> bool:
    """Return whether a name is that of an unfinished file or folder whose writer does not run any more."""
    found = next((match for pattern in _NAMES if (match := re.fullmatch(pattern, os.path.basename(path)))), None)
    if found is None:
        return False
    machine, pid, began = found.groups()
    if machine != _machine_name():
        with contextlib.suppress(OSError):
            return time.time() - os.stat(path).st_mtime > REPLACING.old_s
        return False
    return not is_running(int(pid), int(began))


def is_writer_running(words: str) -> bool:
    """Return whether the process that `writer` names still runs; one of another machine is taken for running."""
    found = re.fullmatch(_WRITER, words)
    if found is None:
        return False
    machine, pid, began = found.groups()
    return machine != _machine_name() or is_running(int(pid), int(began))


def is_running(pid: int, began: int) -> bool:
    """Return whether a process runs that has this number and began then (0: not known)."""
    if pid == os.getpid():
        return began == _began_at(pid)
    if sys.platform == "win32":  # signal 0 would end the process there; files in use cannot be removed anyway
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # it runs for another user
    now = _began_at(pid)
    return not (began and now) or now == began


def writer() -> str:
    """Return the identifier of this process: machine, process number and start time."""
    return _words_of(os.getpid())


@cache
def _words_of(own: int) -> str:
    """Return the words of this process by its number, which a fork has another of; they never change."""
    return f"{_machine_name()}-{own}-{_began_at(own)}"


@cache
def _machine_name() -> str:
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _began_at(pid: int) -> int:
    """Return the start time of a process in clock ticks since boot; 0 where the system does not state it."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii", errors="replace") as file:
            return int(file.read().rpartition(")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return 0

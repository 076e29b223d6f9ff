"""Unfinished files: how they are named, and how those of a writer that is gone are found and removed.

A file that is being written has a hidden name that tells who writes it: the machine, the process and when that process
began. So a later run can tell the work of a living process, which it must leave alone, from what a killed one left.
"""

import contextlib
import os
import re
import secrets
import shutil
import socket
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from ...foundation.errors import OutputError
from ...foundation.interruption import holding_signals
from ...foundation.thresholds import threshold, thresholds

FOLDER_PREFIX = ".hrsi-unfinished-"
_WRITER = r"([0-9a-f]{8})-(\d+)-(\d+)"  # machine, process, its beginning
_NAMES = rf"{re.escape(FOLDER_PREFIX)}{_WRITER}-.*", rf"\..*\.{_WRITER}-[0-9a-f]{{8}}\.tmp.*"


@thresholds
class LEFTOVERS:
    """When an unfinished file counts as left by a process that is gone."""

    old_s: float = threshold(
        7 * 86_400.0, "s", "age beyond which what another machine left on a shared disk counts as dead"
    )


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
            return time.time() - os.stat(path).st_mtime > LEFTOVERS.old_s
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

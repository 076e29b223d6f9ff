"""One writer at a time in a folder: a lock that the system releases when its owner ends, however it ends."""

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from ...foundation.errors import InputError
from ...foundation.interruption import holding_signals

LOCK = ".hrsi-lock"
_BUSY = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)


@contextmanager
def only_writer(folder: str | None) -> Iterator[None]:
    """Lock a folder against other runs; it is made where missing, and removed again where it stays empty.

    Nothing is locked where it is None, or in one of GDAL's virtual file systems. Raises `InputError` where another run
    writes into the folder, or it cannot be made.
    """
    if not folder or folder.startswith("/vsi"):
        yield
        return
    made: list[str] = []
    lock = None
    try:
        with holding_signals():  # one between making something and knowing of it would leave it behind
            made = _make_folders(folder)
            lock = _take_lock(os.path.join(folder, LOCK))
        yield
    finally:
        with holding_signals():
            if lock is not None:
                _release_lock(lock, os.path.join(folder, LOCK))
            for path in reversed(made):
                with contextlib.suppress(OSError):  # it holds results
                    os.rmdir(path)


def require_writable(folder: str) -> None:
    """Raise `InputError` where a folder takes no files, or cannot be made; nothing is made to find that out."""
    if folder.startswith("/vsi"):
        return
    there = os.path.abspath(folder)
    while not os.path.lexists(there):
        there = os.path.dirname(there)
    if not os.path.isdir(there):
        raise InputError(f"{there} is a file: name a directory as `output_dir`")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{there} cannot be written (Permission denied): choose another `output_dir`")


def remove_dead_lock(folder: str) -> None:
    """Remove the lock's file that a killed run left in a folder; that of a living one stays."""
    path = os.path.join(folder, LOCK)
    if os.path.exists(path):
        with contextlib.suppress(InputError, OSError):
            lock = _take_lock(path)
            if lock is not None:
                _release_lock(lock, path)


def _make_folders(folder: str) -> list[str]:
    """Make a folder; return those that were made, the outermost first."""
    missing, path = [], os.path.abspath(folder)
    while not os.path.lexists(path):
        missing.append(path)
        path = os.path.dirname(path)
    _make_all(folder)
    return missing[::-1]


def _make_all(folder: str) -> None:
    """Make a folder and those above it, whoever makes and removes it meanwhile."""
    while True:
        try:
            os.makedirs(folder, exist_ok=True)
            return
        except FileExistsError:
            if os.path.lexists(folder) and not os.path.isdir(folder):
                raise InputError(f"{folder} is a file: name a directory as `output_dir`") from None
            # else it was there when it was to be made, and not when Python looked whether it is a folder
        except OSError as error:
            raise InputError(f"{folder} cannot be made ({error.strerror}): choose another `output_dir`") from None


def _take_lock(path: str) -> int | None:
    """Return the descriptor of a lock's file, locked; None where the file system knows no locks."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:  # another run made the folder, and removed it again
            _make_all(os.path.dirname(path))
            continue
        except OSError as error:
            folder = os.path.dirname(path)
            raise InputError(f"{folder} cannot be written ({error.strerror}): choose another `output_dir`") from None
        try:
            _lock(descriptor)
            if _is_at(descriptor, path):
                return descriptor
        except OSError as error:
            os.close(descriptor)
            if error.errno not in _BUSY:
                return None
            raise InputError(
                f"{os.path.dirname(path)}: another run writes there now: wait until it ends, or choose another "
                "`output_dir`"
            ) from None
        os.close(descriptor)  # its owner removed the file meanwhile: that lock keeps nobody out


def _release_lock(descriptor: int, path: str) -> None:
    """Remove a lock's file and release the lock, in the order that the system allows."""
    if sys.platform == "win32":  # open files cannot be removed there
        os.close(descriptor)
    with contextlib.suppress(OSError):
        os.remove(path)
    if sys.platform != "win32":
        os.close(descriptor)


def _is_at(descriptor: int, path: str) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

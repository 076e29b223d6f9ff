"""Locks, for one writer of a folder or image at a time; the system releases them when their owner ends in any way."""

import contextlib
import errno
import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from ...foundation.errors import InputError
from ...foundation.interruption import PATIENCE, holding_signals

LOCK = ".hrsi-lock"


@contextmanager
def only_writer(folder: str | None, images: Iterable[str] = ()) -> Iterator[None]:
    """Lock a folder, and files that are changed in place, against other runs.

    The folder is created if it is missing, and removed again if it remains empty; nothing is locked for None, or in one
    of GDAL's virtual file systems. Raises `InputError` if another run writes there, or the folder cannot be
    created.
    """
    new_folders: list[str] = []
    paths = [] if not folder or folder.startswith("/vsi") else [os.path.join(folder, LOCK)]
    with contextlib.ExitStack() as locks:
        try:
            with holding_signals():  # a signal between creation and assignment would leave it behind
                new_folders = _make_folders(os.path.dirname(paths[0])) if paths else []
            for image in sorted({os.path.realpath(image) for image in images}):
                paths.append(os.path.join(os.path.dirname(image), f"{LOCK}-{os.path.basename(image)}"))
            for path in paths:
                locks.enter_context(hold_lock(path))
            yield
        finally:
            with holding_signals():
                locks.close()
                for path in reversed(new_folders):
                    with contextlib.suppress(OSError):  # it contains results
                        os.rmdir(path)


@contextmanager
def hold_lock(path: str, patience_s: float = PATIENCE.again_s) -> Iterator[None]:
    """Lock the file of this name; raise `InputError` if another run still has the lock after ``patience_s`` seconds."""
    lock = None
    try:
        with holding_signals():
            lock = _take_lock(path, patience_s)
        yield
    finally:
        with holding_signals():
            if lock is not None:
                # Remove the file and release the lock, in the order that the system allows
                if sys.platform == "win32":  # open files cannot be removed there
                    os.close(lock)
                with contextlib.suppress(OSError):
                    os.remove(path)
                if sys.platform != "win32":
                    os.close(lock)


def require_writable(folder: str) -> None:
    """Raise `InputError` if a folder takes no files or cannot be created; nothing is created to find that out."""
    if folder.startswith("/vsi"):
        return
    existing = os.path.abspath(folder)
    while not os.path.lexists(existing):
        existing = os.path.dirname(existing)
    if not os.path.isdir(existing):
        raise InputError(f"{existing} is a file: name a directory as `output_dir`")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"{existing} cannot be written (Permission denied): choose another `output_dir`")


def remove_dead_locks(folder: str) -> None:
    """Remove the lock files of killed runs from a folder; those of running ones remain."""
    with contextlib.suppress(OSError):
        for name in os.listdir(folder):
            if name.startswith(LOCK) or (name.startswith(".hrsi-journal-") and name.endswith(".lock")):
                with contextlib.suppress(InputError), hold_lock(os.path.join(folder, name), 0.0):
                    pass


def _make_folders(folder: str) -> list[str]:
    """Create a folder; return the folders that were created, the outermost first."""
    missing, path = [], os.path.abspath(folder)
    while not os.path.lexists(path):
        missing.append(path)
        path = os.path.dirname(path)
    _make_all(folder)
    return missing[::-1]


def _make_all(folder: str) -> None:
    """Create a folder and its parents, even if other processes create and remove them at the same time."""
    while True:
        try:
            os.makedirs(folder, exist_ok=True)
            return
        except FileExistsError:
            if os.path.lexists(folder) and not os.path.isdir(folder):
                raise InputError(f"{folder} is a file: name a directory as `output_dir`") from None
            # else another process removed it between `makedirs` and its check that it is a folder
        except OSError as error:
            raise InputError(f"{folder} cannot be made ({error.strerror}): choose another `output_dir`") from None


def _take_lock(path: str, patience_s: float) -> int | None:
    """Return the descriptor of a lock file, locked; None if the file system has no locks."""
    deadline = time.monotonic() + patience_s
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:  # another run created and removed the folder
            _make_all(os.path.dirname(path))
            continue
        except OSError as error:
            folder = os.path.dirname(path)
            raise InputError(f"{folder} cannot be written ({error.strerror}): choose another `output_dir`") from None
        try:
            _lock(descriptor)
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                    return descriptor
        except OSError as error:
            os.close(descriptor)
            if error.errno not in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                return None
            if time.monotonic() < deadline:
                time.sleep(patience_s / 5.0)
                continue
            folder, _, image = path.partition(f"{os.sep}{LOCK}-")
            raise InputError(
                f"{os.path.join(folder, image)}: another run writes it now: wait until it ends"
                if image
                else f"{os.path.dirname(path)}: another run writes there now: wait until it ends, or choose another "
                "`output_dir`"
            ) from None
        os.close(descriptor)  # its owner removed the file meanwhile: a lock on it excludes no other process


if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

"""One writer at a time of a folder or image: locks that the system releases when their owner ends, however it ends."""

import contextlib
import errno
import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from ...foundation.errors import InputError
from ...foundation.interruption import holding_signals
from ...foundation.thresholds import threshold, thresholds

LOCK = ".hrsi-lock"
_BUSY = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)


@thresholds
class LOCKS:
    """How long a run waits for another one's lock."""

    patience_s: float = threshold(0.1, "s", "a lock that is held for longer is that of a run, not of one that looks")


@contextmanager
def only_writer(folder: str | None, images: Iterable[str] = ()) -> Iterator[None]:
    """Lock a folder, and files that are written where they lie, against other runs.

    The folder is made where missing, and removed again where it stays empty; nothing is locked where it is None, or in
    one of GDAL's virtual file systems. Raises `InputError` where another run writes there, or the folder cannot be
    made.
    """
    made: list[str] = []
    paths = [] if not folder or folder.startswith("/vsi") else [os.path.join(folder, LOCK)]
    with contextlib.ExitStack() as locks:
        try:
            with holding_signals():  # one between making something and knowing of it would leave it behind
                made = _make_folders(os.path.dirname(paths[0])) if paths else []
            for image in sorted({os.path.realpath(image) for image in images}):
                paths.append(os.path.join(os.path.dirname(image), f"{LOCK}-{os.path.basename(image)}"))
            for path in paths:
                locks.enter_context(hold_lock(path))
            yield
        finally:
            with holding_signals():
                locks.close()
                for path in reversed(made):
                    with contextlib.suppress(OSError):  # it holds results
                        os.rmdir(path)


@contextmanager
def hold_lock(path: str, patience_s: float = LOCKS.patience_s) -> Iterator[None]:
    """Hold the lock whose file has this name; raise `InputError` where another run holds it for longer."""
    lock = None
    try:
        with holding_signals():
            lock = _take_lock(path, patience_s)
        yield
    finally:
        with holding_signals():
            if lock is not None:
                _release_lock(lock, path)


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


def remove_dead_locks(folder: str) -> None:
    """Remove the locks' files that killed runs left in a folder; those of living ones stay."""
    with contextlib.suppress(OSError):
        for name in os.listdir(folder):
            if name.startswith(LOCK) or (name.startswith(".hrsi-journal-") and name.endswith(".lock")):
                with contextlib.suppress(InputError), hold_lock(os.path.join(folder, name), 0.0):
                    pass


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


def _take_lock(path: str, patience_s: float) -> int | None:
    """Return the descriptor of a lock's file, locked; None where the file system knows no locks."""
    until = time.monotonic() + patience_s
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
            if time.monotonic() < until:
                time.sleep(patience_s / 5.0)
                continue
            folder, _, image = path.partition(f"{os.sep}{LOCK}-")
            raise InputError(
                f"{os.path.join(folder, image)}: another run writes it now: wait until it ends"
                if image
                else f"{os.path.dirname(path)}: another run writes there now: wait until it ends, or choose another "
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

"""Changes of several files that are made completely or not at all, even if the process is killed at any time.

New content is first written under hidden names. Then a journal of the remaining renames and removals is written and
flushed to the disk: from then on the change is regarded as made. Any run that finds the journal of an ended process
completes it (`recover_folders`); a step that is done already has no effect. Without a journal nothing was changed, and
the hidden files are leftovers.

The journal is in one folder: that of inputs that are changed, if there are any, because an unfinished result may be
removed by the user. Every other folder in which a file changes gets a signpost of the same name, so that a later run
finds the journal from any of the files. Each transaction has its own name: several runs may write into one folder.

Locks, for one writer of a folder or image at a time; the system releases them when their owner ends in any way.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import shutil
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from ...foundation.errors import InputError, OutputError
from ...foundation.interruption import PATIENCE, holding_signals
from ...foundation.json_values import json_text
from ..opening.files import read_json
from . import replacing as file_replacing

_JOURNAL_KEYS: dict[str, type] = {"writer": str, "steps": list, "signposts": list}
_SIGNPOST_KEYS: dict[str, type] = {"writer": str, "journal": str}


class Transaction:
    """Collects changes, which `commit` makes. Without a commit, nothing is changed and no hidden file remains.

    home : folder of the results; it gets the journal if nothing outside it changes
    """

    def __init__(self, home: str) -> None:
        self.home = os.path.abspath(home)
        self._steps: list[tuple[str, str, str]] = []
        self._made: list[str] = []
        self._discarded: list[str] = []
        self.is_under_way = False  #: the journal is written, but not completed: its files must remain

    def __enter__(self) -> Transaction:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.abandon()

    def new_file(self, path: str) -> str:
        """Return a hidden name for the new content of a file; `commit` renames it to ``path``."""
        path = os.path.realpath(path)
        temporary = file_replacing.temporary_name(path)
        self._made.append(temporary)
        self._steps.append(("rename", temporary, path))
        return temporary

    @contextmanager
    def replacing(self, path: str) -> Iterator[str]:
        """Provide a hidden name as `new_file`; errors of the disk become `OutputError` with the file's name.

        Raises `InputError` if that file exists and is read-only.
        """
        file_replacing.require_not_read_only(path)
        try:
            yield self.new_file(path)
        except OSError as error:
            raise OutputError(
                f"{path}: cannot be written ({error.strerror}): check free space and permissions"
            ) from None

    def rename(self, old: str, new: str) -> None:
        """Schedule the renaming of a file by `commit`; an existing file of the new name is replaced."""
        self._steps.append(("rename", os.path.abspath(old), os.path.abspath(new)))

    def remove(self, path: str) -> None:
        """Schedule the removal of a file by `commit`."""
        self._steps.append(("remove", os.path.abspath(path), ""))

    def discard(self, folder: str) -> None:
        """Schedule the removal of a folder with its content by `commit`, if it exists."""
        if os.path.isdir(folder):
            self._discarded.append(file_replacing.temporary_name(os.path.abspath(folder)))
            self.rename(folder, self._discarded[-1])

    def commit(self) -> None:
        """Make all changes, in the order in which they were requested.

        A file that replaces another gets its mode bits and owner. Raises `InputError` if that file is read-only, and
        `OutputError` if the journal cannot be written (then nothing is changed), or a step fails (then the next run
        continues).
        """
        if not self._steps:
            return
        with holding_signals():
            self._commit()
        while self._discarded:
            shutil.rmtree(self._discarded.pop(), ignore_errors=True)

    def _commit(self) -> None:
        if file_replacing.is_unfinished(self.home):  # its files are flushed when they are moved into place
            _do_steps(self._steps)
            self.abandon()
            return
        name = f".hrsi-journal-{file_replacing.writer()}-{secrets.token_hex(4)}.json"
        folders = {os.path.dirname(path) for _, old, new in self._steps for path in (old, new) if path}
        inside = {folder for folder in folders if folder == self.home or folder.startswith(self.home + os.sep)}
        home, *other_folders = [*sorted(folders - inside), *([self.home] if os.path.isdir(self.home) else [])]
        journal, signposts = os.path.join(home, name), [os.path.join(folder, name) for folder in other_folders]
        try:
            renamed = [(old, new) for action, old, new in self._steps if action == "rename" and os.path.isfile(old)]
            for old, new in renamed:
                file_replacing.require_not_read_only(new)
                file_replacing.take_permissions(new, old)
            file_replacing.flush_files([old for old, _ in renamed])
            for signpost in signposts:
                _write_journal(signpost, {"journal": journal, "writer": file_replacing.writer()})
            _write_journal(journal, {"writer": file_replacing.writer(), "steps": self._steps, "signposts": signposts})
        except OSError as error:
            for file in signposts:
                with contextlib.suppress(OSError):
                    os.remove(file)
            raise OutputError(
                f"{error.filename or home}: cannot be written ({error.strerror}): nothing was changed"
            ) from None
        self.is_under_way = True
        _carry_out(journal, self._steps, signposts)
        self.is_under_way = False
        self.abandon()

    def abandon(self) -> None:
        """Discard the changes and remove the hidden files; those named in a journal remain for the next run."""
        for file in () if self.is_under_way else self._made:
            for leftover in (file, f"{file}.aux.xml"):
                with contextlib.suppress(OSError):
                    os.remove(leftover)
        self._steps, self._made = [], []


def recover_folders(folders: Iterable[str]) -> list[str]:
    """Complete the committed changes of killed processes in these folders, and remove their hidden files.

    Returns notices for the log. Files of a process that is still running are not changed.
    """
    notices: list[str] = []
    for folder in sorted({os.path.abspath(folder) for folder in folders}):
        with contextlib.suppress(OSError):  # no folder, or not readable
            for name in sorted(os.listdir(folder)):
                if not re.fullmatch(r"\.hrsi-journal-.*-[0-9a-f]{8}\.json", name):
                    continue
                own_journal = os.path.join(folder, name)
                signpost = _read_journal(own_journal, _SIGNPOST_KEYS)
                journal = own_journal if signpost is None else signpost["journal"]
                if signpost is None or os.path.exists(journal):
                    notices += _finish(journal)
                elif not file_replacing.is_writer_running(signpost["writer"]):
                    os.remove(own_journal)  # the writer ended before the journal: nothing was changed
        file_replacing.sweep(folder)
        with contextlib.suppress(OSError):  # lock files of killed runs; those of running ones remain
            for name in os.listdir(folder):
                if name.startswith(LOCK) or (name.startswith(".hrsi-journal-") and name.endswith(".lock")):
                    with contextlib.suppress(InputError), hold_lock(os.path.join(folder, name), 0.0):
                        pass
    return notices


def _finish(journal: str) -> list[str]:
    """Complete the steps of a journal, one process at a time, unless its writer is running; return notices."""
    left = _read_journal(journal, _JOURNAL_KEYS)
    if left is None or (left["writer"] != file_replacing.writer() and file_replacing.is_writer_running(left["writer"])):
        return []  # a journal of this process has failed; repeating a step has no effect
    with hold_lock(f"{journal}.lock"):
        if not os.path.exists(journal):  # completed by another run, which may have changed the files since
            return []
        # Steps in the journal's own folder, and in folders with a signpost to it
        home = os.path.dirname(journal)

        def is_own(path: str) -> bool:  # new files of a folder are in a hidden folder inside it
            folder = os.path.dirname(path)
            return any(place == home or _leads_to(place, journal) for place in (folder, os.path.dirname(folder)))

        entries = [
            (str(action), str(old), str(new)) for action, old, new in (step for step in left["steps"] if len(step) == 3)
        ]
        steps = [(action, old, new) for action, old, new in entries if all(is_own(path) for path in (old, new) if path)]
        signposts = [str(file) for file in left["signposts"]]
        _carry_out(journal, steps, [file for file in signposts if _leads_to(os.path.dirname(file), journal, file)])
    count = len({new for _, _, new in steps if new})
    return [f"{os.path.dirname(journal)}: an earlier run was stopped while it put {count} files in place; finished now"]


def _leads_to(folder: str, journal: str, file: str = "") -> bool:
    """Return whether a folder has a signpost to this journal, whose path is ``file`` if that is given."""
    path = os.path.join(folder, os.path.basename(journal))
    signpost = _read_journal(path, _SIGNPOST_KEYS)
    return signpost is not None and signpost["journal"] == journal and file in ("", path)


def _carry_out(journal: str, steps: list[tuple[str, str, str]], signposts: list[str]) -> None:
    """Make the steps that are not made yet, flush the folders, and remove signposts and journal."""
    try:
        _do_steps(steps)
        for folder in {os.path.dirname(path) for _, old, new in steps for path in (old, new) if path}:
            if os.path.isdir(folder):
                file_replacing.flush(folder)
        for file in (*signposts, journal):
            with contextlib.suppress(FileNotFoundError):
                os.remove(file)
    except OSError as error:
        raise OutputError(
            f"{error.filename}: cannot be put in place ({error.strerror}): correct this and run again to finish"
        ) from None


def _do_steps(steps: Iterable[tuple[str, str, str]]) -> None:
    for action, old, new in steps:
        with contextlib.suppress(FileNotFoundError):  # made already, by an interrupted run
            if action == "rename":
                os.replace(old, new)
            else:
                os.remove(old)


def _write_journal(path: str, content: dict[str, object]) -> None:
    temporary = file_replacing.temporary_name(path)
    try:
        with open(temporary, "w", encoding="utf-8") as file:
            file.write(json_text(content))
        file_replacing.flush(temporary)
        os.replace(temporary, path)
        file_replacing.flush(os.path.dirname(path))
    finally:
        with contextlib.suppress(OSError):
            os.remove(temporary)


def _read_journal(path: str, keys: dict[str, type]) -> dict[str, Any] | None:
    """Return the content of a journal or signpost; None if it does not exist or is incomplete."""
    try:
        content = read_json(path, "report")
    except InputError:
        return None
    if not isinstance(content, dict) or not all(isinstance(content.get(key), kind) for key, kind in keys.items()):
        return None
    return content


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
            places = map(os.path.split, sorted({os.path.realpath(image) for image in images}))
            paths += [os.path.join(place, f"{LOCK}-{name}") for place, name in places]
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


def _make_folders(folder: str) -> list[str]:
    """Create a folder; return the folders that were created, the outermost first."""
    missing, path = [], os.path.abspath(folder)
    while not os.path.lexists(path):
        missing.append(path)
        path = os.path.dirname(path)
    make_folder(folder)
    return missing[::-1]


def make_folder(folder: str) -> None:
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
            make_folder(os.path.dirname(path))
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

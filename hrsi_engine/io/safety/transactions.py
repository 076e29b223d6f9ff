"""Changes of several files that happen all or not at all, whenever the process is killed.

New content is written under hidden names first. Then a journal of the renames and removals that are left is written
and flushed to disk: from that moment on the change counts as made. Whoever finds the journal of a process that is gone
carries out what is left of it (`recover_folders`), each step being harmless when it is done already; without a
journal nothing was changed, and the hidden files are leftovers.

The journal lies in one folder, beside the inputs that change where there are such: somebody may remove an unfinished
result. Every other folder in which a file changes gets a signpost of the same name, so that a later run finds the
journal from any of the files. Each transaction has a name of its own: several runs may write into one folder.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from ...foundation.errors import InputError, OutputError
from ...foundation.interruption import holding_signals
from ...foundation.json_values import json_text
from ..opening.files import read_json
from . import replacing as file_replacing
from .folder_lock import hold_lock, remove_dead_locks

_JOURNAL_KEYS: dict[str, type] = {"writer": str, "steps": list, "signposts": list}
_SIGNPOST_KEYS: dict[str, type] = {"writer": str, "journal": str}


class Transaction:
    """Collects changes; `commit` makes them. Left without a commit, nothing has changed and nothing is left.

    home : folder of the results; it gets the journal where nothing outside it changes
    """

    def __init__(self, home: str) -> None:
        self.home = os.path.abspath(home)
        self._steps: list[tuple[str, str, str]] = []
        self._made: list[str] = []
        self._discarded: list[str] = []
        self.is_under_way = False  #: the journal is written, and not all is done: what it names must stay

    def __enter__(self) -> Transaction:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.abandon()

    def new_file(self, path: str) -> str:
        """Return a hidden name to write a file's new content to; `commit` gives it the name ``path``."""
        path = os.path.realpath(path)
        temporary = file_replacing.temporary_name(path)
        self._made.append(temporary)
        self._steps.append(("rename", temporary, path))
        return temporary

    @contextmanager
    def replacing(self, path: str) -> Iterator[str]:
        """Provide a hidden name as `new_file`; failures of the disk become `OutputError`s that name the file.

        Raises `InputError` where that file is there and read-only.
        """
        file_replacing.require_not_read_only(path)
        try:
            yield self.new_file(path)
        except OSError as error:
            raise OutputError(
                f"{path}: cannot be written ({error.strerror}): check free space and permissions"
            ) from None

    def rename(self, old: str, new: str) -> None:
        """Have `commit` rename a file; what has the new name is replaced."""
        self._steps.append(("rename", os.path.abspath(old), os.path.abspath(new)))

    def remove(self, path: str) -> None:
        """Have `commit` remove a file."""
        self._steps.append(("remove", os.path.abspath(path), ""))

    def discard(self, folder: str) -> None:
        """Have `commit` remove a folder with all that it holds, where there is one."""
        if os.path.isdir(folder):
            self._discarded.append(file_replacing.temporary_name(os.path.abspath(folder)))
            self.rename(folder, self._discarded[-1])

    def commit(self) -> None:
        """Make all changes, in the order in which they were asked for.

        What replaces a file gets its mode bits and owner. Raises `InputError` where that file is read-only, and
        `OutputError` where the journal cannot be written (then nothing has changed), or a step fails (then the next run
        goes on).
        """
        if not self._steps:
            return
        with holding_signals():
            self._commit()
        while self._discarded:
            shutil.rmtree(self._discarded.pop(), ignore_errors=True)

    def _commit(self) -> None:
        if file_replacing.is_unfinished(self.home):  # whoever moves its files into place flushes them
            _do_steps(self._steps)
            self.abandon()
            return
        name = f".hrsi-journal-{file_replacing.writer()}-{secrets.token_hex(4)}.json"
        folders = {os.path.dirname(path) for _, old, new in self._steps for path in (old, new) if path}
        inside = {folder for folder in folders if folder == self.home or folder.startswith(self.home + os.sep)}
        home, *others = [*sorted(folders - inside), *([self.home] if os.path.isdir(self.home) else [])]
        journal, signposts = os.path.join(home, name), [os.path.join(folder, name) for folder in others]
        try:
            renamed = [(old, new) for what, old, new in self._steps if what == "rename" and os.path.isfile(old)]
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
        """Forget the changes and remove the hidden files; what a journal names is left for the next run."""
        for file in () if self.is_under_way else self._made:
            for leftover in (file, f"{file}.aux.xml"):
                with contextlib.suppress(OSError):
                    os.remove(leftover)
        self._steps, self._made = [], []


def recover_folders(folders: Iterable[str]) -> list[str]:
    """Complete the committed changes of killed processes in these folders, and remove their hidden files.

    Returns notices for the log. What belongs to a process that still runs is left alone.
    """
    notices: list[str] = []
    for folder in sorted({os.path.abspath(folder) for folder in folders}):
        with contextlib.suppress(OSError):  # no folder, or none that may be read
            for name in sorted(os.listdir(folder)):
                if not re.fullmatch(r"\.hrsi-journal-.*-[0-9a-f]{8}\.json", name):
                    continue
                own = os.path.join(folder, name)
                signpost = _read_journal(own, _SIGNPOST_KEYS)
                journal = own if signpost is None else signpost["journal"]
                if signpost is None or os.path.exists(journal):
                    notices += _finish(journal)
                elif not file_replacing.is_writer_running(signpost["writer"]):
                    os.remove(own)  # the writer had not come to the journal: nothing was changed
        file_replacing.sweep(folder)
        remove_dead_locks(folder)
    return notices


def _finish(journal: str) -> list[str]:
    """Carry out what is left of a journal, one process at a time, unless its writer runs; return notices."""
    left = _read_journal(journal, _JOURNAL_KEYS)
    if left is None or (left["writer"] != file_replacing.writer() and file_replacing.is_writer_running(left["writer"])):
        return []  # one of this process is what failed: where it still goes on, doing a step twice harms nothing
    with hold_lock(f"{journal}.lock"):
        if not os.path.exists(journal):  # another run has finished it, and may have changed the files since
            return []
        # Steps in the journal's own folder and in those with a signpost to it
        home = os.path.dirname(journal)

        def is_own(path: str) -> bool:  # new files of a folder lie in a hidden one inside
            folder = os.path.dirname(path)
            return any(place == home or _leads_to(place, journal) for place in (folder, os.path.dirname(folder)))

        told = [
            (str(what), str(old), str(new)) for what, old, new in (step for step in left["steps"] if len(step) == 3)
        ]
        steps = [(what, old, new) for what, old, new in told if all(is_own(path) for path in (old, new) if path)]
        signposts = [str(file) for file in left["signposts"]]
        _carry_out(journal, steps, [file for file in signposts if _leads_to(os.path.dirname(file), journal, file)])
    count = len({new for _, _, new in steps if new})
    return [f"{os.path.dirname(journal)}: an earlier run was stopped while it put {count} files in place; finished now"]


def _leads_to(folder: str, journal: str, file: str = "") -> bool:
    """Return whether a folder's signpost leads to this journal, and is this file where one is named."""
    path = os.path.join(folder, os.path.basename(journal))
    signpost = _read_journal(path, _SIGNPOST_KEYS)
    return signpost is not None and signpost["journal"] == journal and file in ("", path)


def _carry_out(journal: str, steps: list[tuple[str, str, str]], signposts: list[str]) -> None:
    """Do the steps that are not done yet, flush the folders, and remove signposts and journal."""
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
    for what, old, new in steps:
        with contextlib.suppress(FileNotFoundError):  # done already, by a run that was interrupted
            if what == "rename":
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
    """Return a journal's or signpost's content; None where there is none, or one that is not whole."""
    try:
        content = read_json(path, "report")
    except InputError:
        return None
    if not isinstance(content, dict) or not all(isinstance(content.get(key), kind) for key, kind in keys.items()):
        return None
    return content

"""Journals that outlive the program: each entry is on the disk before the next one is made.

A journal is a file of JSON lines in a folder of its own, which its program locks. What a program left that was killed
is found by `find_orphan_journals`.
"""

import json
import os
import shutil
import time
import uuid
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ...foundation.errors import InputError
from ...foundation.json_values import json_text
from ..opening.budgets import require_size
from .folder_lock import only_writer

FILE = "journal.jsonl"


class LineJournal:
    """A journal in a new folder below ``root``, made with the first entry."""

    def __init__(self, root: str | Path) -> None:
        self._root = Path(root)
        self._lock = ExitStack()
        self._folder = self._root
        self._file: IO[str] | None = None

    @property
    def is_begun(self) -> bool:
        """Whether there is an entry."""
        return self._file is not None

    def append(self, entry: dict[str, Any]) -> None:
        """Write an entry; raise OSError or `InputError` where that cannot be done."""
        if self._file is None:
            self._folder = self._root / f"{time.strftime('%Y%m%d-%H%M%S')}-{uuid.uuid4().hex[:8]}"
            self._lock.enter_context(only_writer(str(self._folder)))
            self._file = (self._folder / FILE).open("w", encoding="utf-8")
        self._file.write(json_text(entry) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def discard(self) -> None:
        """Remove the journal: its entries are saved elsewhere or no longer needed."""
        begun = self.is_begun
        self.leave()
        if begun:
            remove_journal(self._folder)

    def leave(self) -> None:
        """Close the journal and leave it on the disk for `find_orphan_journals`."""
        if self._file is not None:
            self._file.close()
        self._file = None
        self._lock.close()


@dataclass(frozen=True)
class OrphanJournal:
    """A journal that its program has left: the folder, the entries, and the time of the last one (s since 1970)."""

    folder: Path
    entries: list[dict[str, Any]]
    time_s: float


def find_orphan_journals(root: str | Path) -> list[OrphanJournal]:
    """Return the journals below a folder whose programs have ended, the oldest first."""
    found = []
    for folder in sorted(Path(root).glob("*/")):
        try:
            with only_writer(str(folder)):
                # The entries; the last line may have been cut off when the program ended
                path = folder / FILE
                require_size(str(path), "journal")
                with path.open(encoding="utf-8") as file:
                    entries = [json.loads(line) for line in file if line.endswith("\n")]
                entries = [entry for entry in entries if isinstance(entry, dict)]
        except (InputError, OSError, ValueError):  # another program is at work on it, or no journal
            continue
        if entries:
            found.append(OrphanJournal(folder, entries, (folder / FILE).stat().st_mtime))
    return found


def remove_journal(folder: Path) -> None:
    """Remove a journal that its program has left."""
    shutil.rmtree(folder, ignore_errors=True)

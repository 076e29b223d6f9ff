"""Recovery of measurements: every unsaved edit of a session is written to a journal, which outlives the program.

A journal is a file of JSON lines in a folder of its own, which its program locks; each entry is on the disk before the
next one is made. The first entry has all points and measurements, the others have the changes. The journal is removed
when the session is saved or discarded. Journals of killed programs are found by `find_journals` and restored by
`recover`.
"""

import json
import os
import shutil
import time
import uuid
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.io.opening.files import require_size
from ...hrsi_engine.io.safety.transactions import only_writer
from .files import new_session, open_block
from .rows import Change, ImageMeasurement, Key, SurveyPoint
from .session import PointSession

FILE = "journal.jsonl"


class EditJournal:
    """Writes the edits of one session to a journal in a new folder below ``root``, created with the first edit.

    ``failure`` is the reason if that fails (no space, no permission), otherwise empty. Editing continues in any case.
    """

    def __init__(self, root: str | Path) -> None:
        self._root = self._folder = Path(root)
        self._lock = ExitStack()
        self._file: IO[str] | None = None
        self._session = PointSession()
        self.failure = ""

    def follow(self, session: PointSession) -> None:
        """Discard the journal of the present session, and record the edits of another."""
        self.discard()
        self._session, session.on_change = session, self._keep
        if session.changed:
            self._keep(Change({}))

    def discard(self) -> None:
        """Remove the journal: the edits are saved or not wanted any more."""
        has_entries = self._file is not None
        self.leave()
        if has_entries:
            shutil.rmtree(self._folder, ignore_errors=True)

    def leave(self) -> None:
        """Stop recording, and keep the journal for `find_journals`."""
        if self._file is not None:
            self._file.close()
        self._file = None
        self._lock.close()

    def _keep(self, change: Change) -> None:
        """Write a change; the first one with all that the session contains, so that the journal is complete."""
        try:
            if not self._session.changed:
                self.discard()
            elif self._file is None:
                self._folder = self._root / f"{time.strftime('%Y%m%d-%H%M%S')}-{uuid.uuid4().hex[:8]}"
                self._lock.enter_context(only_writer(str(self._folder)))
                self._file = (self._folder / FILE).open("w", encoding="utf-8")
                self._append(
                    self._file,
                    Change(self._session.measured, self._session.points),
                    path=os.path.abspath(self._session.path) if self._session.path else "",
                    images=[os.path.abspath(image.path) for image in self._session.images.values()],
                    sources=dict(self._session.sources),
                )
            else:
                self._append(self._file, change)
            self.failure = ""
        except (OSError, InputError) as error:
            self.failure = f"what is measured is not kept in {self._root} ({error}): save often"

    @staticmethod
    def _append(file: IO[str], change: Change, **session: Any) -> None:
        """Write an entry, and wait until it is on the disk."""
        session["points"] = None if change.points is None else list(map(_drop_defaults, change.points.values()))
        session["measured"] = [
            [*key, None if measured is None else _drop_defaults(measured)] for key, measured in change.measured.items()
        ]
        file.write(json_text(session) + "\n")
        file.flush()
        os.fsync(file.fileno())


@dataclass(frozen=True)
class JournalSession:
    """Unsaved session of a program that has ended.

    path : the block's GeoPackage, empty if it was never saved; images : their files; sources : the arguments of
    `new_session`, if it was made by that; time_s : time of the last edit, seconds since 1970
    """

    folder: Path
    path: str
    images: tuple[str, ...]
    sources: Mapping[str, Any]
    points: Mapping[str, SurveyPoint]
    measured: Mapping[Key, ImageMeasurement]
    time_s: float


def find_journals(root: str | Path) -> list[JournalSession]:
    """Return the unsaved sessions of programs that have ended, the oldest first."""
    sessions = []
    for folder in sorted(Path(root).glob("*/")):
        points, measured = dict[str, SurveyPoint](), dict[Key, ImageMeasurement]()
        # In use by another program, or no journal of a session
        with suppress(InputError, OSError, IndexError, KeyError, TypeError, ValueError), only_writer(str(folder)):
            require_size(str(folder / FILE), "journal")
            with (folder / FILE).open(encoding="utf-8") as file:
                # Complete lines: the last one may have been cut off when the program ended
                entries = [json.loads(line) for line in file if line.endswith("\n")]
            for entry in entries:
                if entry["points"] is not None:
                    points = {values["id"]: SurveyPoint(**_drop_nulls(values)) for values in entry["points"]}
                for name, image, values in entry["measured"]:
                    if values is None:
                        measured.pop((name, image), None)
                    else:
                        measured[(name, image)] = ImageMeasurement(**_drop_nulls(values))
            first, time_s = entries[0], (folder / FILE).stat().st_mtime
            images, sources = tuple(first["images"]), first["sources"]
            sessions.append(
                JournalSession(
                    folder=folder,
                    path=first["path"],
                    images=images,
                    sources=sources,
                    points=points,
                    measured=measured,
                    time_s=time_s,
                )
            )
    return sessions


def recover(unsaved: JournalSession) -> PointSession:
    """Return the session as it was, with its tie points if their file still exists.

    Call `forget` when another journal, or a file, contains the session.
    Raises `InputError` if the block or its images do not exist any more.
    """
    session = None
    if unsaved.path and os.path.exists(unsaved.path):
        session = open_block(unsaved.path)
    elif unsaved.sources:
        with suppress(InputError):  # QGIS may have removed the file of a project layer
            session = new_session(**unsaved.sources)
    session = session or new_session(list(unsaved.images))
    session.restore(unsaved.points, unsaved.measured)
    return session


def forget(unsaved: JournalSession) -> None:
    """Remove the journal of an unsaved session."""
    shutil.rmtree(unsaved.folder, ignore_errors=True)


def _drop_nulls(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values without null, which JSON has for NaN, the default."""
    return {name: value for name, value in values.items() if value is not None}


def _drop_defaults(row: SurveyPoint | ImageMeasurement) -> dict[str, Any]:
    """Return the values of a row without defaults; faster than ``asdict`` for many thousand rows."""
    return {name: value for name, value in vars(row).items() if value == value and value != ""}  # NaN differs from NaN

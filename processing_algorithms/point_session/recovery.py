"""Recovery of measurements: every unsaved edit of a session is written to a journal.

The first entry of the journal has all points and measurements, the others have the changes. The journal is removed when
the session is saved or discarded. Journals of killed programs are found by `find_journals` and restored by `recover`.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.safety.folder_lock import LineJournal, find_orphan_journals, remove_journal
from .files import new_session, open_block
from .rows import Change, ImageMeasurement, Key, SurveyPoint
from .session import PointSession


class EditJournal:
    """Writes the edits of one session to a journal below a folder.

    ``failure`` is the reason if that fails (no space, no permission), otherwise empty. Editing continues in any case.
    """

    def __init__(self, root: str | Path) -> None:
        self._root, self._journal = str(root), LineJournal(root)
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
        self._journal.discard()

    def leave(self) -> None:
        """Stop recording, and keep the journal for `find_journals`."""
        self._journal.leave()

    def _keep(self, change: Change) -> None:
        try:
            if not self._session.changed:
                self.discard()
            elif self._journal.is_begun:
                self._journal.append(_entry(change))
            else:
                self._journal.append(
                    {
                        "path": os.path.abspath(self._session.path) if self._session.path else "",
                        "images": [os.path.abspath(image.path) for image in self._session.images.values()],
                        "sources": dict(self._session.sources),
                        **_entry(Change(self._session.measured, self._session.points)),
                    }
                )
            self.failure = ""
        except (OSError, InputError) as error:
            self.failure = f"what is measured is not kept in {self._root} ({error}): save often"


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
    found = []
    for left in find_orphan_journals(root):
        points, measured = dict[str, SurveyPoint](), dict[Key, ImageMeasurement]()
        with suppress(KeyError, TypeError, ValueError):  # no journal of a session
            for entry in left.entries:
                if entry["points"] is not None:
                    points = {values["id"]: SurveyPoint(**_drop_nulls(values)) for values in entry["points"]}
                for name, image, values in entry["measured"]:
                    if values is None:
                        measured.pop((name, image), None)
                    else:
                        measured[(name, image)] = ImageMeasurement(**_drop_nulls(values))
            first = left.entries[0]
            path, images, sources = first["path"], tuple(first["images"]), first["sources"]
            found.append(JournalSession(left.folder, path, images, sources, points, measured, left.time_s))
    return found


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
    remove_journal(unsaved.folder)


def _drop_nulls(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values without null, which JSON has for NaN, the default."""
    return {name: value for name, value in values.items() if value is not None}


def _drop_defaults(row: SurveyPoint | ImageMeasurement) -> dict[str, Any]:
    """Return the values of a row without defaults; faster than ``asdict`` for many thousand rows."""
    return {name: value for name, value in vars(row).items() if value == value and value != ""}  # NaN differs from NaN


def _entry(change: Change) -> dict[str, Any]:
    return {
        "points": None if change.points is None else [_drop_defaults(point) for point in change.points.values()],
        "measured": [
            [name, image, None if measured is None else _drop_defaults(measured)]
            for (name, image), measured in change.measured.items()
        ],
    }  # fmt: skip

"""What was edited, so that it can be undone, done again, and kept for the case that the program ends without saving."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .rows import PANEL, ImageMeasurement, SurveyPoint

Key = tuple[str, str]  #: point and image


@dataclass(frozen=True)
class Change:
    """New entries of a session.

    measured : by point and image; None takes a measurement away. points : all known points in their order, or None
    where they stay
    """

    measured: Mapping[Key, ImageMeasurement | None]
    points: Mapping[str, SurveyPoint] | None = None


@dataclass(frozen=True)
class Edit:
    """One thing that the user did: its name for a menu, and how to take it back and do it again."""

    title: str
    back: Change
    forth: Change


class History:
    """The edits of a session, and where in them it stands.

    ``state`` is a number that every state has of its own: after undoing it is that of the state before.
    """

    def __init__(self, apply: Callable[[Change], None]) -> None:
        self._apply = apply
        self._done: list[tuple[int, Edit]] = []  # the state before each edit, and the edit
        self._undone: list[tuple[int, Edit]] = []  # the state after each, the next to be done again last
        self.state = self._states = 0

    def do(self, edit: Edit) -> None:
        """Make an edit; what was undone before it cannot be done again."""
        self._apply(edit.forth)
        self._undone.clear()
        self._done = [*self._done[1 - PANEL.longest_history :], (self.state, edit)]
        self._states += 1
        self.state = self._states

    def undo(self) -> Edit | None:
        """Take the last edit back and return it; None without any."""
        if not self._done:
            return None
        before, edit = self._done.pop()
        self._apply(edit.back)
        self._undone.append((self.state, edit))
        self.state = before
        return edit

    def redo(self) -> Edit | None:
        """Do again what was taken back last and return it; None without any."""
        if not self._undone:
            return None
        after, edit = self._undone.pop()
        self._apply(edit.forth)
        self._done.append((self.state, edit))
        self.state = after
        return edit

    @property
    def undo_title(self) -> str:
        """What `undo` would take back, empty for nothing."""
        return self._done[-1][1].title if self._done else ""

    @property
    def redo_title(self) -> str:
        """What `redo` would do again, empty for nothing."""
        return self._undone[-1][1].title if self._undone else ""

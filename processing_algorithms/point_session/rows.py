"""Rows that a point session contains and shows: ground points, measurements; and its edits, with undo and redo."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.foundation.thresholds import SAMPLES, threshold, thresholds
from ..interface.declare import params_of

#: A point that is ``off`` keeps its measurements and is not used.
ROLES = ("gcp", "check", "off")
TIE = "tie"  #: role of a point without survey, at the intersection of its rays; it cannot be changed
TRANSFERRED = "transfer"  #: kind of a measurement that was found by matching
CLICK_KINDS = ("center", "corner", "point")  #: how a click is measured; ``point`` uses the click itself
#: The option of the adjustment that the panel offers; all others have their defaults.
MODEL = next(param for param in params_of(AdjustOptions) if param.argument == "model")


@thresholds
class PANEL:
    """Limits of the panel, and a priori errors in the search of a point in other images."""

    vendor_px: float = threshold(150.0, "px", "error of given RPCs: 75 m at 0.5 m pixels")
    adjusted_px: float = threshold(2.0, "px", "error of adjusted cameras")
    half_view_px: float = threshold(60.0, "px", "half side of a view of an image with corrected RPC")
    shifted_px: float = threshold(10.0, "px", "error of RPCs corrected by a shift: drift, heights")


@dataclass(frozen=True)
class SurveyPoint:
    """A ground point with a surveyed position, or a tie point at the intersection of its rays; NaN sigma: default.

    ``operation`` is its operation to WGS84, as in ``crs_operations`` of a report (JSON); ``photo`` is a photograph, or
    a folder with photographs whose names begin with ids.
    """

    id: str
    lon: float
    lat: float
    height: float
    role: str = "gcp"
    sigma_xy: float = nan
    sigma_h: float = nan
    operation: str = ""
    photo: str = ""


@dataclass(frozen=True)
class ImageMeasurement:
    """Position at which a point was measured in an image; NaN sigma: default."""

    sample: float
    line: float
    sigma: float = nan
    kind: str = ""
    quality: float = nan


@dataclass(frozen=True)
class PointRow:
    """A ground point, its residuals (survey - computed, metres east, north, up; else NaN), and why it is suspicious."""

    point: SurveyPoint
    images: int
    residual_m: tuple[float, float, float]
    suspicion: str


@dataclass(frozen=True)
class MeasurementRow:
    """A point in one image: predicted and measured position, residual (px), and why it is suspicious, if it is."""

    image: str
    predicted: tuple[float, float]
    is_inside: bool
    measured: ImageMeasurement | None
    residual_px: tuple[float, float]
    suspicion: str


@dataclass(frozen=True)
class ResidualRow:
    """A measurement with its residual (px), its length in standard deviations, and why it is suspicious, if it is."""

    point: SurveyPoint
    image: str
    kind: str
    residual_px: tuple[float, float]
    statistic: float
    suspicion: str


Key = tuple[str, str]  #: point and image


@dataclass(frozen=True)
class Change:
    """Changed entries of a session.

    measured : by point and image; None removes a measurement. points : all known points in their order, or None if
    they are not changed
    """

    measured: Mapping[Key, ImageMeasurement | None]
    points: Mapping[str, SurveyPoint] | None = None


@dataclass(frozen=True)
class Edit:
    """One edit of the user: its name for a menu, and the changes that undo and redo it."""

    title: str
    back: Change
    forth: Change


class History:
    """The edits of a session, and the present state among them.

    ``state`` is a unique number of each state: after undoing it is that of the state before.
    """

    def __init__(self, apply: Callable[[Change], None]) -> None:
        self._apply = apply
        self._done: list[tuple[int, Edit]] = []  # the state before each edit, and the edit
        self._undone: list[tuple[int, Edit]] = []  # the state after each, the next to be redone last
        self.state = self._states = 0

    def do(self, edit: Edit) -> None:
        """Make an edit; edits that were undone before cannot be redone any more."""
        self._undone.clear()
        self._done = [*self._done[1 - SAMPLES.large :], (self.state, edit)]
        self._states += 1
        self.state = self._states
        self._apply(edit.forth)

    def undo(self) -> str:
        """Undo the last edit and return its title; empty if there is none."""
        return self._step(self._done, self._undone, "back")

    def redo(self) -> str:
        """Redo the edit that was undone last and return its title; empty if there is none."""
        return self._step(self._undone, self._done, "forth")

    def _step(self, source: list[tuple[int, Edit]], target: list[tuple[int, Edit]], way: str) -> str:
        """Move the last edit from one list to the other, apply it ``back`` or ``forth``, and return its title."""
        if not source:
            return ""
        state, edit = source.pop()
        target.append((self.state, edit))
        self.state = state
        self._apply(getattr(edit, way))
        return edit.title

    @property
    def undo_title(self) -> str:
        """Title of the edit that `undo` would undo, empty if there is none."""
        return self._done[-1][1].title if self._done else ""

    @property
    def redo_title(self) -> str:
        """Title of the edit that `redo` would redo, empty if there is none."""
        return self._undone[-1][1].title if self._undone else ""

"""Search of the chosen point in other images by matching: proposals that the user accepts or rejects."""

from collections.abc import Sequence
from typing import Any

from qgis.PyQt.QtCore import QObject, pyqtSignal

from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession
from .actions import make_pause


class TransferSearch(QObject):
    """Searches one image at a time, so that the click is shown first. ``proposals`` has the positions by image."""

    due = pyqtSignal(str)  #: the next image to be searched

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.session, self.point = PointSession(), ""
        self.proposals: dict[str, Any] = {}  # one object, which the views show
        self._queue: list[str] = []
        self._timer = make_pause(self, 0, self._continue)

    def show_point(self, session: PointSession, point: str) -> None:
        """Search this point from now on."""
        self.session, self.point = session, point
        self.proposals.clear()
        self._queue.clear()

    def begin(self, shown: Sequence[str]) -> None:
        """Search all images that should contain the point and in which it is not measured, those ``shown`` first."""
        rows = [row for row in self.session.measurements(self.point) if row.is_inside and row.measured is None]
        wanted = [row.image for row in rows if row.image not in self.proposals]
        self._queue[:] = sorted(wanted, key=lambda image: image not in shown)
        self._timer.start()

    def is_running(self) -> bool:
        return bool(self._queue) or self._timer.isActive()

    def find(self, images: Sequence[str] = ()) -> dict[str, Any]:
        """Search images (default: all), and add what is found to the proposals; return the results of these images."""
        results = point_session.find_transfers(self.session, self.point, images)
        self.proposals.update({image: one for image, one in results.items() if not one.refusal})
        return results

    def accept(self, image: str | None = None) -> list[str]:
        """Enter the proposals of all images, or of one, as measurements; return these images."""
        accepted = {name: one for name, one in self.proposals.items() if image in (None, name)}
        if accepted:
            self.session.accept_transfers(self.point, accepted)
        for name in accepted:
            del self.proposals[name]
        return list(accepted)

    def reject(self, image: str) -> bool:
        """Remove the proposal of an image; return False if there is none."""
        return self.proposals.pop(image, None) is not None

    def _continue(self) -> None:
        if self._queue:
            self.due.emit(self._queue.pop(0))
            self._timer.start()

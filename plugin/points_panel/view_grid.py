"""The image views of the panel, in rows that fill their space; the keyboard acts on the active one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import islice
from typing import Any

from qgis.PyQt import sip
from qgis.PyQt.QtCore import pyqtSignal
from qgis.PyQt.QtGui import QResizeEvent
from qgis.PyQt.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession
from .image_view import ImageView, Marker


class ViewGrid(QWidget):
    """Shows images of a session around its chosen point.

    A view moves only if the user asks for another place: by choosing a point or an image, `show_ground`, or the wheel.
    ``proposals`` has the positions of the point found by matching, by image.
    """

    clicked = pyqtSignal(str, float, float)  #: image id, sample, line

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.session, self.point = PointSession(), ""
        self.proposals: Mapping[str, Any] = {}
        self.views: list[ImageView] = []
        self.is_linked, self.is_north_up = True, True
        self._active: ImageView | None = None
        self._gammas: dict[str, float] = {}  # of the images, by id
        self._most = 1  # number of views that the user has chosen
        self._arrangement = 0, 0  # number of views and of rows
        self._rows = QVBoxLayout(self)
        self._rows.setContentsMargins(0, 0, 0, 0)

    def list_views(self) -> list[ImageView]:
        return [view for view in self.views if view.isVisibleTo(self)]

    def list_images(self) -> list[str]:
        """Return the images that are shown."""
        return [view.image() for view in self.list_views() if view.image() in self.session.images]

    def find_view(self, image: str) -> ImageView | None:
        """Return the view of an image, None if it is not shown."""
        return next((view for view in self.list_views() if view.image() == image), None)

    def show_session(self, session: PointSession) -> None:
        """Show the images of another session."""
        self.session, self.point = session, ""
        self._gammas.clear()
        self.set_number(self._most)

    def set_number(self, number: int) -> None:
        """Show this number of views, or as many as there are images."""
        self._most, number = number, max(min(number, len(self.session.images)), 1)
        for _ in range(len(self.views), number):
            self._add_view()
        for index, view in enumerate(self.views):
            view.setVisible(index < number)
        self._arrange(number)
        self._choose_images()
        self.show_images()
        self.activate(self.views[0])

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._arrange(sum(not view.isHidden() for view in self.views))

    def _arrange(self, number: int) -> None:
        """Arrange the views in rows of equal height, the views of a row with equal widths; none stays empty."""
        sides_px = {
            rows: min(self.width() / math.ceil(number / rows), self.height() / rows) for rows in range(1, number + 1)
        }
        rows = max(sides_px, key=lambda rows: sides_px[rows], default=0)
        if (number, rows) == self._arrangement:
            return
        self._arrangement = number, rows
        while (old := self._rows.takeAt(0)) is not None:
            while old.layout().takeAt(0) is not None:
                pass
            sip.delete(old)
        views = iter(self.views)
        for row in range(rows):
            cells = QHBoxLayout()
            self._rows.addLayout(cells, 1)
            for view in islice(views, number // rows + (row < number % rows)):
                cells.addWidget(view, 1)

    def _add_view(self) -> None:
        view = ImageView(self, self._gammas)
        view.clicked.connect(self.clicked)
        view.image_chosen.connect(lambda _name: self._show_image(view))
        view.whole_asked.connect(lambda _name: self._show_whole(view))
        view.canvas.zoomed.connect(lambda factor: self._zoom_others(view, factor))
        self.views.append(view)

    # ---- the active view ---------------------------------------------------------------------------------------

    def activate(self, view: ImageView | None) -> None:
        """Make a view the one on which the keyboard acts."""
        self._active = view
        for other in self.views:
            other.mark_active(other is view)

    def active_image(self) -> str:
        """Return the image of the active view, empty if there is none."""
        return self._active.image() if self._active is not None else ""

    def activate_proposal(self) -> str:
        """Return the image of the proposal that is answered next, and make its view active; empty if there is none."""
        waiting = [view for view in self.list_views() if view.image() in self.proposals]
        if waiting and self._active not in waiting:
            self.activate(waiting[0])
        return self.active_image() if waiting else ""

    def activate_gap(self) -> None:
        """Make the first view active in whose image the point is not measured."""
        if gaps := [image for image in self.list_images() if (self.point, image) not in self.session.measured]:
            self.activate(self.find_view(gaps[0]))

    def frame_image(self, image: str) -> None:
        """Make the view of an image active; the image is shown if it was not."""
        view = self.find_view(image)
        if view is None:
            view = self.list_views()[-1]
            view.show_choice(list(self.session.images), image)
            self._show_image(view)
        self.activate(view)

    # ---- what the views show -----------------------------------------------------------------------------------

    def show_point(self, point: str, clicked: str = "") -> None:
        """Show a point at its measured or predicted position; the image in which it was ``clicked`` does not move."""
        self.point = point
        self._choose_images()
        self.show_images(clicked)

    def show_images(self, unmoved: str = "") -> None:
        """Show all images around the point, but leave an image where it is."""
        for view in self.list_views():
            if view.image() != unmoved:
                self._show_image(view)

    def _show_image(self, view: ImageView) -> None:
        """Show a view's image around the present point, with the markers of all points."""
        is_known = self.point in self.session.points and view.image()
        shown = point_session.view_of(self.session, self.point, view.image()) if is_known else None
        view.show_view(shown, self._list_markers(view.image()), self.is_north_up)

    def show_proposals(self) -> None:
        """Show the proposals that are not in view."""
        for view in self.list_views():
            if (proposal := self.proposals.get(view.image())) is not None and not view.is_in_view(proposal.xy):
                view.show_place(proposal.xy)

    def list_hidden_proposals(self) -> list[str]:
        """Return the images whose proposals are not in view."""
        views = {view.image(): view for view in self.list_views()}
        return [
            image for image, one in self.proposals.items() if image not in views or not views[image].is_in_view(one.xy)
        ]

    def show_ground(self, lonlat: tuple[float, float]) -> None:
        """Show a position on the ground, at the median height of the points, in all images."""
        height = self.session.middle_height_m()
        for view in self.list_views():
            if view.image():
                view.show_place(point_session.place_on(self.session, view.image(), lonlat, height))

    def set_north_up(self, is_north_up: bool) -> None:
        """Turn the images around the middles of their views."""
        self.is_north_up = is_north_up
        for view in self.list_views():
            view.turn(is_north_up)

    def link_zoom(self, is_linked: bool) -> None:
        """Let the wheel zoom all images, or one."""
        self.is_linked = is_linked

    def refresh(self) -> None:
        """Show the present markers, and the fits that are still those of the measurements."""
        for view in self.list_views():
            view.markers.show_markers(self._list_markers(view.image()))
            view.check_fit(self.session.measured.get((self.point, view.image())))

    def release_images(self) -> None:
        """Stop drawing, before the views are deleted."""
        for view in self.views:
            view.release_images()

    def _choose_images(self) -> None:
        """Choose images that contain the point, those with a measurement first; no image is shown twice."""
        names, views = list(self.session.images), self.list_views()
        listed = self.session.measurements(self.point) if self.point in self.session.points else []
        rows = [row for row in listed if row.is_inside or row.measured]
        fitting = [row.image for row in sorted(rows, key=lambda row: row.measured is None)] if rows else names
        kept = {view.image() for view in views if view.image() in fitting}
        others = [image for image in names if image not in fitting]
        free = iter([*(image for image in fitting if image not in kept), *others])
        shown = set[str]()
        for view in views:
            image = view.image()
            if image not in fitting or image in shown:
                image = next(free, "")
            shown.add(image)
            view.show_choice(names if image else [], image)

    def _zoom_others(self, view: ImageView, factor: float) -> None:
        """Zoom the other images by the same factor."""
        for other in self.list_views():
            if other is not view and self.is_linked:
                other.canvas.zoomByFactor(factor)

    def _show_whole(self, view: ImageView) -> None:
        """Show the whole domain of a view's image."""
        if view.image() in self.session.images:
            first_sample, last_sample, first_line, last_line = self.session.images[view.image()].domain_px
            middle = ((first_sample + last_sample) / 2.0, (first_line + last_line) / 2.0)
            view.show_place(middle, ((last_sample - first_sample) / 2.0, (last_line - first_line) / 2.0))

    def _list_markers(self, image: str) -> list[Marker]:
        """Return the markers of all points in an image."""
        markers = []
        for name, row in self.session.on_image(image).items() if image in self.session.images else ():
            measured = (row.measured.sample, row.measured.line) if row.measured else None
            residual = None if math.isnan(row.residual_px[0]) else row.residual_px
            is_chosen = name == self.point
            proposal = self.proposals.get(image) if is_chosen else None
            markers.append(
                Marker(
                    name,
                    row.predicted,
                    measured,
                    residual,
                    is_suspicious=bool(row.suspicion),
                    is_off=self.session.points[name].role == "off",
                    is_chosen=is_chosen,
                    proposed=None if proposal is None else proposal.xy,
                )
            )
        return markers

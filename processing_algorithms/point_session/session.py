"""The state of a point session and all its edits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from ...hrsi_engine.camera.rpc_terms import EVALUATION
from ...hrsi_engine.foundation.errors import InputError
from .rows import (
    CLICK_KINDS,
    PANEL,
    ROLES,
    TIE,
    TRANSFERRED,
    Change,
    Edit,
    History,
    ImageMeasurement,
    Key,
    MeasurementRow,
    PointRow,
    SurveyPoint,
)

if TYPE_CHECKING:
    from ...hrsi_engine.block.block import Image
    from ...hrsi_engine.block.points import ImagePoints
    from ...hrsi_engine.measurement.point_transfer import Transfer
    from .adjusted import AdjustmentView, CurrentView
    from .chip_library import ChipLibrary
    from .targets import Fit

TRANSFER_PX = 0.05  # relief within the window and interpolation, not included in the sigma of the fit
NO_POSITION = (math.nan, math.nan, math.nan)


class PointSession:
    """Images, known points with their measurements, tie points (which are not edited), and the last adjustment.

    ``path`` is the GeoPackage from which it was opened or to which it was saved, else empty; ``model`` that of the
    adjustment in it; ``sources`` the arguments of `files.new_session`, if it was made by that. ``on_change`` is called
    with every change of points and measurements.
    """

    def __init__(
        self,
        images: Sequence[Image] = (),
        points: Sequence[SurveyPoint] = (),
        measured: Mapping[Key, ImageMeasurement] | None = None,
        ties: ImagePoints | None = None,
        path: str = "",
    ) -> None:
        self.images: dict[str, Image] = {image.id: image for image in images}
        self.points: dict[str, SurveyPoint] = {point.id: point for point in points}
        self.measured: dict[Key, ImageMeasurement] = dict(measured or {})
        self.ties = ties
        self.path, self.model = path, ""
        self.sources: dict[str, Any] = {}
        self.library: ChipLibrary | None = None  # of GCPs that were measured in other blocks
        self.on_change: Callable[[Change], None] = lambda change: None
        self.history = History(self._apply)
        self._saved: int | None = 0  # the state in the file
        self.adjusted: AdjustmentView | None = None
        self._adjusted_from = Snapshot(self)  # state that was adjusted
        self.shown: CurrentView | None = None  # shown in tables: the adjustment, or its continuation
        self._shown_from = self._adjusted_from
        self._predicted: dict[str, dict[str, tuple[float, float]]] = {}  # by image and point, cached
        self._shifts: dict[str, np.ndarray] | None = None  # by image, cached

    @property
    def changed(self) -> bool:
        """Whether there are edits that are not in the file."""
        return self.history.state != self._saved

    @property
    def is_adjusted(self) -> bool:
        """Whether the adjustment is of the present points and measurements."""
        return self.adjusted is not None and self.history.state == self._adjusted_from.state

    def note_save(self, path: str) -> None:
        """Record that a file contains the present session."""
        self.path, self._saved = path, self.history.state
        self.on_change(Change({}))

    # ---- content of tables -------------------------------------------------------------------------------------

    def rows(self) -> list[PointRow]:
        """Return all known points, in the order in which they were added."""
        counts = Counter(map(itemgetter(0), self.measured))
        stale = self._shown_from.list_edits(self.points)
        rows = []
        for name, point in self.points.items():
            residual_m, why = NO_POSITION, ""
            if self.shown is not None and name not in stale:
                residual_m = self.shown.residual_m.get(name, NO_POSITION)
                reasons = self.shown.point_suspicions.get(name, ""), *self.shown.measurement_suspicions.get(name, ())
                why = "; ".join(dict.fromkeys(filter(None, reasons)))
            rows.append(PointRow(point, counts[name], residual_m, why))
        return rows

    def measurements(self, name: str) -> list[MeasurementRow]:
        """Return a point in every image; ``is_inside`` is False for images that do not contain it."""
        return [self.measurement(name, image) for image in self.images]

    def on_image(self, image_id: str) -> dict[str, MeasurementRow]:
        """Return the points that are inside an image, or are measured in it."""
        self._predict_all(image_id)
        rows = {name: self.measurement(name, image_id) for name in self.points}
        return {name: row for name, row in rows.items() if row.is_inside or row.measured}

    def measurement(self, name: str, image_id: str) -> MeasurementRow:
        """Return a point in one image."""
        sample, line = self.predict_place(name, image_id)
        first_sample, last_sample, first_line, last_line = self.images[image_id].domain_px
        inside = first_sample <= sample <= last_sample and first_line <= line <= last_line
        key = (name, image_id)
        residual, _, suspicion = self.judge(key)
        return MeasurementRow(image_id, (sample, line), inside, self.measured.get(key), residual, suspicion)

    def judge(self, key: Key) -> tuple[tuple[float, float], float, str]:
        """Return a measurement's residual (px), its length in standard deviations, and why it is suspicious, if so."""
        if self.shown is None or key in self._shown_from.edited:
            return NO_POSITION[:2], math.nan, ""
        left, length = self.shown.residual_px.get(key, NO_POSITION[:2]), self.shown.statistics.get(key, math.nan)
        return left, length, self.shown.image_suspicions.get(key, "")

    def predict_place(self, name: str, image_id: str) -> tuple[float, float]:
        """Return the predicted position of a point in an image, by `project`."""
        known = self._predicted.setdefault(image_id, {})
        if name not in known:
            point = self._point(name)
            sample, line = self.project(image_id, np.array([[point.lon, point.lat, point.height]]))[0].tolist()
            known[name] = sample, line
        return known[name]

    def find_next_gap(self, name: str, step: int) -> str:
        """Return the next point (``step`` 1; -1: the previous one) that is not measured in an image that contains it.

        Points with the role off are skipped. The point itself is returned if there is no other.
        """
        names = list(self.points)
        if not names:
            return name
        for image_id in self.images:
            self._predict_all(image_id)
        start = names.index(name) if name in self.points else 0
        for away in range(1, len(names) + 1):
            other = names[(start + step * away) % len(names)]
            if self.points[other].role != "off" and any(
                row.is_inside and row.measured is None for row in self.measurements(other)
            ):
                return other
        return name

    def project(self, image_id: str, ground: np.ndarray) -> np.ndarray:
        """Return the positions of ground points ``(n, 3)`` in an image, sample and line ``(n, 2)``.

        By the last adjustment, otherwise by the image's RPC; without an adjusted GCP with the measured shift added.
        """
        if self._shifts is None:
            self._shifts = self._estimate_shifts()
        return self._project_by_camera(image_id, ground) + self._shifts.get(image_id, 0.0)

    def _project_by_camera(self, image_id: str, ground: np.ndarray) -> np.ndarray:
        """Return sample, line ``(n, 2)`` of ground points by the shown adjustment, or by the image's RPC."""
        image = self.images[image_id]
        if self.shown is not None and image_id in self.shown.corrections:
            return self.shown.model.project(image, self.shown.corrections[image_id], ground)
        return image.rpc.project(ground)

    def _estimate_shifts(self) -> dict[str, np.ndarray]:
        """Return the median offset (px) of measured surveyed points from their image's camera ``(2,)``, by image.

        Only for images without an adjusted GCP: check points do not change the camera.
        """
        surveyed: dict[str, list[float]] = {}  # five numbers for each point, flat: the fastest way into an array
        followed = set[str]()  # images with an adjusted GCP
        for (name, image_id), measured in self.measured.items():
            point = self.points[name]
            if point.role in ROLES[:2]:
                place = (measured.sample, measured.line, point.lon, point.lat, point.height)
                surveyed.setdefault(image_id, []).extend(place)
                if (
                    point.role == ROLES[0]
                    and self.shown is not None
                    and (name, image_id) not in self._shown_from.edited
                ):
                    followed.add(image_id)
        known = {
            image_id: np.array(flat).reshape(-1, 5) for image_id, flat in surveyed.items() if image_id not in followed
        }
        return {
            image_id: np.median(rows[:, :2] - self._project_by_camera(image_id, rows[:, 2:]), axis=0)
            for image_id, rows in known.items()
        }

    def is_located(self, image_id: str) -> bool:
        """Whether measurements in an image determine the error of its RPC."""
        ties = self.adjusted is not None and self.ties is not None and image_id in self.ties.image_ids
        return ties or any(image == image_id for _, image in self.measured)

    def estimate_margin_px(self, image_id: str) -> float:
        """Return the expected largest error (px) of predicted positions in an image."""
        located_px = PANEL.shifted_px if self.shown is None else PANEL.adjusted_px
        return located_px if self.is_located(image_id) else PANEL.vendor_px

    def is_seen(self, point: SurveyPoint) -> bool:
        """Whether a point, in the list or not, is inside any image."""
        ground = np.array([[point.lon, point.lat, point.height]])
        return any(
            abs(point.lon - image.rpc.long_off)
            < EVALUATION.domain_margin * image.rpc.long_scale  # RPCs are not valid far outside
            and abs(point.lat - image.rpc.lat_off) < EVALUATION.domain_margin * image.rpc.lat_scale
            and (np.abs(self.project(name, ground)[0] - image.centre_px) <= image.half_size_px).all()
            for name, image in self.images.items()
        )

    def middle_height_m(self) -> float:
        """Return the median height of the ground; if it is unknown, that of the images' RPCs."""
        heights = self.ground_heights_m()
        if not len(heights):
            heights = np.array([image.middle_height_m for image in self.images.values()] or [0.0])
        return float(np.median(heights))

    def ground_heights_m(self) -> np.ndarray:
        """Return ground heights ``(n,)``: of the known points, or if there are none, of the adjusted tie points."""
        known = [point.height for point in self.points.values() if point.role != TIE]
        if known or self.adjusted is None:
            return np.array(known)
        ties = self.adjusted.result.ground[:, 2]
        return ties[np.isfinite(ties)]

    def _predict_all(self, image_id: str) -> None:
        """Predict all points in an image at once: one by one takes seconds with many images and points."""
        known = self._predicted.setdefault(image_id, {})
        points = [point for name, point in self.points.items() if name not in known]
        if points:
            ground = np.array([[point.lon, point.lat, point.height] for point in points])
            xy = self.project(image_id, ground).tolist()
            known.update({point.id: (sample, line) for point, (sample, line) in zip(points, xy, strict=True)})

    def list_edits(self) -> set[str]:
        """Return the points that differ from those in the adjustment, including removed ones."""
        return self._adjusted_from.list_edits(self.points)

    def find_free_id(self, letter: str) -> str:
        """Return an id that is neither in the list nor among the tie points in the background."""
        taken = self.points.keys() | set([] if self.ties is None else self.ties.ids.tolist())
        return next(name for name in (f"{letter}{number}" for number in count(1)) if name not in taken)

    # ---- edits -------------------------------------------------------------------------------------------------

    def add_points(self, points: Sequence[SurveyPoint]) -> None:
        """Add known points; raise `InputError` if an id exists already."""
        if taken := [point.id for point in points if point.id in self.points]:
            raise InputError(f"ground point {taken[0]} is in the list already: rename one of them")
        many = f"{len(points)} points" if len(points) != 1 else points[0].id
        self._edit(f"add {many}", points=self.points | {point.id: point for point in points})

    def remove_point(self, name: str) -> None:
        """Remove a known point and its measurements."""
        kept = {other: point for other, point in self.points.items() if other != self._point(name).id}
        self._edit(f"remove {name}", {key: None for key in self.measured if key[0] == name}, kept)

    def set_role(self, name: str, role: str) -> None:
        """Make a point a GCP or check point, or switch it off; a tie point has no survey, and remains a tie point."""
        if TIE in (role, self._point(name).role) and role != self._point(name).role:
            what = "has no survey" if self._point(name).role == TIE else "has a survey"
            raise InputError(f"point {name} {what}: remove it, and begin one of the other kind")
        if role not in (*ROLES, TIE):
            raise InputError(
                f"ground point {name}: role {role!r} is unknown: use {', '.join(ROLES[:-1])} or {ROLES[-1]}"
            )
        self._set_point(f"{name} as {role}", replace(self._point(name), role=role))

    def set_sigma(self, name: str, field: str, sigma_m: float | None) -> None:
        """Set ``sigma_xy`` or ``sigma_h`` of a point; None: the default of the adjustment."""
        sigma: dict[str, Any] = {field: _sigma(f"ground point {name}", field, sigma_m)}
        self._set_point(f"{field} of {name}", replace(self._point(name), **sigma))

    def set_measurement(self, name: str, image_id: str, measured: ImageMeasurement) -> None:
        """Enter the measured position of a point in an image; raise `InputError` if a coordinate is not finite."""
        where = f"ground point {self._point(name).id} on {image_id}"
        if not (math.isfinite(measured.sample) and math.isfinite(measured.line)):
            raise InputError(f"{where}: sample and line must be numbers: enter both")
        new = replace(measured, sigma=_sigma(where, "sigma", measured.sigma))
        self._edit(f"{name} on {image_id}", {(name, image_id): new})

    def remove_measurement(self, name: str, image_id: str) -> None:
        """Remove the measurement of a point in an image, if there is one."""
        if (name, image_id) in self.measured:
            self._edit(f"forget {name} on {image_id}", {(name, image_id): None})

    def fit(self, image_id: str, click: tuple[float, float], kind: str, is_seen: bool = True) -> Fit:
        """Measure the target near a position, clicked (``is_seen``) or predicted, without changing the session."""
        from .targets import fit_target  # imported when first needed: it loads SciPy

        if kind not in CLICK_KINDS:
            raise InputError(f"kind {kind!r} is unknown: use one of {', '.join(CLICK_KINDS)}")
        return fit_target(self.images[image_id], click, kind, is_seen)

    def measure(self, name: str, image_id: str, click: tuple[float, float], kind: str, is_seen: bool = True) -> Fit:
        """Measure the target near a position; if it is refused, nothing is changed, and the fit has the reason."""
        fit = self.fit(image_id, click, kind, is_seen)
        if not fit.refusal:
            self.set_measurement(name, image_id, fit.measured)
        return fit

    def add_tie(self, point: SurveyPoint, image_id: str, measured: ImageMeasurement) -> None:
        """Add a tie point with its first measurement, in one edit."""
        if point.id in self.points:
            raise InputError(f"point {point.id} is in the list already: choose another name")
        title = f"tie point {point.id} on {image_id}"
        self._edit(title, {(point.id, image_id): measured}, self.points | {point.id: point})

    def accept_transfers(self, name: str, found: Mapping[str, Transfer]) -> None:
        """Enter measurements of a point that matching has found in images, in one edit."""
        new = {
            (name, image): ImageMeasurement(
                *one.xy, math.hypot(one.sigma_px, TRANSFER_PX), TRANSFERRED, one.correlation
            )
            for image, one in found.items()
            if not one.refusal
        }
        if new:
            self._edit(f"{name} transferred to {', '.join(image for _, image in new)}", new)

    def move_point(self, point: SurveyPoint) -> None:
        """Set the position of a point that follows from its measurements; this is not an edit."""
        self.points = {name: point if name == point.id else old for name, old in self.points.items()}
        for known in self._predicted.values():
            known.pop(point.id, None)

    def restore(self, points: Mapping[str, SurveyPoint], measured: Mapping[Key, ImageMeasurement]) -> None:
        """Replace points and measurements in one edit; no file contains them."""
        gone = {key: None for key in self.measured.keys() - measured.keys()}
        self._edit("recover", gone | dict(measured), points)
        self._saved = None

    def accept(self, adjusted: AdjustmentView, seen: Snapshot | None = None) -> None:
        """Set an adjustment of the state ``seen`` (default: now); its cameras predict, its residuals are shown."""
        self.adjusted, self._adjusted_from = adjusted, seen or Snapshot(self)
        before = self._adjusted_from.measured
        self._adjusted_from.edited = {
            key for key in self.measured.keys() | before.keys() if self.measured.get(key) is not before.get(key)
        }
        self._show(adjusted, self._adjusted_from)

    def follow(self, followed: CurrentView) -> None:
        """Show the continuation of the adjustment with the present points and measurements."""
        self._show(followed, Snapshot(self))

    def _show(self, shown: CurrentView, seen: Snapshot) -> None:
        """Show an adjustment or its continuation of the state ``seen``; predictions are computed again."""
        self.shown, self._shown_from = shown, seen
        self._predicted.clear()
        self._shifts = None

    def _set_point(self, title: str, point: SurveyPoint) -> None:
        self._edit(title, points={name: point if name == point.id else old for name, old in self.points.items()})

    def _edit(
        self,
        title: str,
        measured: Mapping[Key, ImageMeasurement | None] | None = None,
        points: Mapping[str, SurveyPoint] | None = None,
    ) -> None:
        """Make an edit that can be undone: measurements to set (None: to remove), and all points if they change."""
        new = measured or {}
        back = Change({key: self.measured.get(key) for key in new}, None if points is None else self.points)
        self.history.do(Edit(title, back, Change(new, points)))

    def _apply(self, change: Change) -> None:
        """Apply a change that an edit, undo or redo makes, note what differs from the adjustment, and report it."""
        for key, measured in change.measured.items():
            if measured is None:
                self.measured.pop(key, None)
            else:
                self.measured[key] = measured
            for before in (self._adjusted_from, self._shown_from):
                if before.measured.get(key) is measured:
                    before.edited.discard(key)
                else:
                    before.edited.add(key)
        if change.points is not None:
            self.points = dict(change.points)
            self._predicted.clear()
        self._shifts = None
        for image_id in {image for _, image in change.measured}:
            self._predicted.pop(image_id, None)
        self.on_change(change)

    def _point(self, name: str) -> SurveyPoint:
        """Return a ground point; raises `InputError` for an unknown name."""
        if name not in self.points:
            raise InputError(f"there is no ground point {name!r}: choose one of the list")
        return self.points[name]


class Snapshot:
    """Points and measurements of a session at one time, and the measurements that were ``edited`` since."""

    def __init__(self, session: PointSession) -> None:
        self.state = session.history.state
        self.points, self.measured = session.points, dict(session.measured)  # points are replaced, never changed
        self.edited: set[Key] = set()

    def list_edits(self, points: Mapping[str, SurveyPoint]) -> set[str]:
        """Return the points whose measurements were edited, or that differ from the present ``points``."""
        names = {name for name, _ in self.edited}
        if self.points is not points:
            names |= {name for name, point in points.items() if self.points.get(name) is not point}
            names |= self.points.keys() - points.keys()
        return names


def _sigma(where: str, field: str, sigma: float | None) -> float:
    """Return a standard deviation, NaN for the default; raise `InputError` if it is not above 0."""
    if sigma is None or math.isnan(sigma):
        return math.nan
    if not 0.0 < sigma < math.inf:
        raise InputError(f"{where}: {field} {sigma:g}: give a number above 0, or leave it empty for the default")
    return sigma

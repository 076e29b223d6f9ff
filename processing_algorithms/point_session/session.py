"""The state of a point session and every way to change it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...hrsi_engine.foundation.errors import InputError
from .rows import CLICK_KINDS, ROLES, KnownPoint, Measured, MeasurementRow, PointRow

if TYPE_CHECKING:
    from ...hrsi_engine.block.block import Image
    from ...hrsi_engine.block.points import ImagePoints
    from .adjusted import Adjusted
    from .targets import Fit

NO_POSITION = (math.nan, math.nan, math.nan)


class PointSession:
    """Images, known points with their measurements, tie points (which are not edited), and the last adjustment.

    ``path`` is the GeoPackage that it was opened from or saved to, empty before. ``changed`` tells of edits since.
    """

    def __init__(
        self,
        images: Sequence[Image] = (),
        points: Sequence[KnownPoint] = (),
        measured: Mapping[tuple[str, str], Measured] | None = None,
        ties: ImagePoints | None = None,
        path: str = "",
    ) -> None:
        self.images: dict[str, Image] = {image.id: image for image in images}
        self.points: dict[str, KnownPoint] = {point.id: point for point in points}
        self.measured: dict[tuple[str, str], Measured] = dict(measured or {})
        self.ties = ties
        self.path = path
        self.changed = False
        self.adjusted: Adjusted | None = None
        self._edited: set[tuple[str, str]] = set()  # measurements whose residuals are not of this adjustment any more

    # ---- what the tables show ----------------------------------------------------------------------------------

    def rows(self) -> list[PointRow]:
        """Return all known points, in the order in which they came."""
        counts: dict[str, int] = {}
        for name, _ in self.measured:
            counts[name] = counts.get(name, 0) + 1
        return [
            PointRow(point, counts.get(name, 0), self._ground_residual(name), self.suspicion(name))
            for name, point in self.points.items()
        ]

    def measurements(self, name: str) -> list[MeasurementRow]:
        """Return a point on every image; those in which it does not lie are told by ``is_inside``."""
        return [self._measurement(name, image) for image in self.images]

    def suspicion(self, name: str) -> str:
        """Return why a point is suspicious, empty where it is not."""
        if self.adjusted is None or self._is_edited(name):
            return ""
        reasons = [self.adjusted.point_suspicions.get(name, "")]
        reasons += [self.adjusted.image_suspicions.get((name, image), "") for image in self.images]
        return "; ".join(dict.fromkeys(reason for reason in reasons if reason))

    def predicted(self, name: str, image_id: str) -> tuple[float, float]:
        """Return where a point should be on an image: by the last adjustment, else by the image's own RPC."""
        point, image = self._point(name), self.images[image_id]
        ground = np.array([[point.lon, point.lat, point.height]])
        if self.adjusted is not None and image_id in self.adjusted.corrections:
            xy = self.adjusted.model.project(image, self.adjusted.corrections[image_id], ground)[0]
        else:
            xy = image.rpc.project(ground)[0]
        return float(xy[0]), float(xy[1])

    def _measurement(self, name: str, image_id: str) -> MeasurementRow:
        sample, line = self.predicted(name, image_id)
        first_sample, last_sample, first_line, last_line = self.images[image_id].domain_px
        inside = first_sample <= sample <= last_sample and first_line <= line <= last_line
        key = (name, image_id)
        known = self.adjusted is not None and key not in self._edited
        residual = self.adjusted.residual_px.get(key, NO_POSITION[:2]) if known and self.adjusted else NO_POSITION[:2]
        suspicion = self.adjusted.image_suspicions.get(key, "") if known and self.adjusted else ""
        return MeasurementRow(image_id, (sample, line), inside, self.measured.get(key), residual, suspicion)

    def _ground_residual(self, name: str) -> tuple[float, float, float]:
        if self.adjusted is None or self._is_edited(name):
            return NO_POSITION
        return self.adjusted.residual_m.get(name, NO_POSITION)

    def _is_edited(self, name: str) -> bool:
        return any(point == name for point, _ in self._edited)

    # ---- edits -------------------------------------------------------------------------------------------------

    def add_points(self, points: Sequence[KnownPoint]) -> None:
        """Add known points; raise `InputError` for an id that is there already."""
        for point in points:
            if point.id in self.points:
                raise InputError(f"ground point {point.id} is in the list already: rename one of them")
        self.points |= {point.id: point for point in points}
        self.changed = True

    def remove_point(self, name: str) -> None:
        """Remove a known point and its measurements."""
        del self.points[self._point(name).id]
        for key in [key for key in self.measured if key[0] == name]:
            del self.measured[key]
        self.changed = True

    def set_role(self, name: str, role: str) -> None:
        """Make a point control or check point."""
        if role not in ROLES:
            raise InputError(f"ground point {name}: role {role!r} is unknown: use {' or '.join(ROLES)}")
        self._point(name).role = role
        self.changed = True

    def set_sigma(self, name: str, field: str, sigma_m: float | None) -> None:
        """Set ``sigma_xy`` or ``sigma_h`` of a point; None takes the default of the adjustment."""
        setattr(self._point(name), field, _sigma(f"ground point {name}", field, sigma_m))
        self.changed = True

    def set_measurement(self, name: str, image_id: str, measured: Measured) -> None:
        """Enter where a point is on an image; raise `InputError` for coordinates that are no numbers."""
        where = f"ground point {self._point(name).id} on {image_id}"
        if not (math.isfinite(measured.sample) and math.isfinite(measured.line)):
            raise InputError(f"{where}: sample and line must be numbers: enter both")
        measured.sigma = _sigma(where, "sigma", measured.sigma)
        self.measured[(name, image_id)] = measured
        self._edited.add((name, image_id))
        self.changed = True

    def remove_measurement(self, name: str, image_id: str) -> None:
        """Forget where a point is on an image, if that was known."""
        self.measured.pop((name, image_id), None)
        self._edited.add((name, image_id))
        self.changed = True

    def measure(self, name: str, image_id: str, click: tuple[float, float], kind: str) -> Fit:
        """Measure the target near a click; where it is refused, nothing changes and the fit says why."""
        from .targets import fit_target  # needs OpenCV, which a QGIS may lack until something is measured

        if kind not in CLICK_KINDS:
            raise InputError(f"kind {kind!r} is unknown: use one of {', '.join(CLICK_KINDS)}")
        fit = fit_target(self.images[image_id], click, kind)
        if not fit.refusal:
            self.set_measurement(name, image_id, fit.measured)
        return fit

    def accept(self, adjusted: Adjusted) -> None:
        """Take over an adjustment: its cameras predict, its residuals are shown."""
        self.adjusted = adjusted
        self._edited = set()

    def _point(self, name: str) -> KnownPoint:
        if name not in self.points:
            raise InputError(f"there is no ground point {name!r}: choose one of the list")
        return self.points[name]


def _sigma(where: str, field: str, sigma: float | None) -> float:
    """Return a standard deviation, NaN for the default; raise `InputError` for what is none."""
    if sigma is None or math.isnan(sigma):
        return math.nan
    if not 0.0 < sigma < math.inf:
        raise InputError(f"{where}: {field} {sigma:g}: give a number above 0, or leave it empty for the default")
    return sigma

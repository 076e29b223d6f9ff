"""Corrections of the ground coordinates (thesis eqs. 4.5 and 5.6; Di et al. 2003).

In metres east, north and up about the middle of the image, scaled by half its extent R to X = (E, N, U) / R::

    E' = E + c + M X         image = RPC(E')

with c the shift and M full (affine), diagonal (scale-shift) or absent (shift). The thesis corrects the ground that an
RPC gives; this is its inverse, of the same family. On a single image a shift in height looks like one in position:
the priors share the correction between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..block.block import Image
from ..ground.geodesy import LocalFrame
from .ground_area import ground_area, px_per_m
from .model import Equations, Linearise, Priors, RefinedRPC
from .refit import refit

AXES = ("east", "north", "up")


@dataclass(frozen=True, eq=False)
class GroundCorrection:
    """A correction of ground coordinates.

    entries : (p, 2) which coordinate each parameter corrects, and by which: 0 shift, 1 east, 2 north, 3 up
    """

    name: str
    title: str
    parameters: tuple[str, ...]
    entries: np.ndarray
    least_points: int

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return metres: of the shift, and of the drift from the middle of the image to its edge."""
        metres = 1.0 / px_per_m(image)
        drift = priors.drift * float(image.half_size_px.max()) * metres
        return np.where(self.entries[:, 1] == 0, priors.shift_px * metres, drift)

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the observation equations; they do not depend on where the points were observed."""
        frame, reach = _frame(image)

        def linearise(values: np.ndarray, ground: np.ndarray) -> Equations:
            matrix = self._matrix(values)
            terms = self._terms(frame, reach, ground)
            moved = frame.to_ground(reach * terms[:, 1:] + terms @ matrix.T) if np.any(values) else ground
            computed, by_moved = image.rpc.project_with_metric_jacobian(moved)
            by_frame = by_moved @ frame.rotation_to(moved).transpose(0, 2, 1)
            by_values = by_frame[:, :, self.entries[:, 0]] * terms[:, self.entries[:, 1]][:, None, :]
            growth = np.eye(3) + matrix[:, 1:] / reach
            return Equations(computed, by_values, by_frame @ growth @ frame.rotation_to(ground))

        return linearise

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the corrected projection of ground points."""
        if not np.any(values):
            return image.rpc.project(ground)
        frame, reach = _frame(image)
        terms = self._terms(frame, reach, ground)
        return image.rpc.project(frame.to_ground(reach * terms[:, 1:] + terms @ self._matrix(values).T))

    def refined_rpc(self, image: Image, values: np.ndarray) -> RefinedRPC:
        """Fit a new RPC."""
        if not np.any(values):
            return RefinedRPC(image.rpc, 0.0)
        return refit(image, lambda ground: self.project(image, values, ground))

    def _terms(self, frame: LocalFrame, reach: float, ground: np.ndarray) -> np.ndarray:
        """Return 1 and the frame's coordinates over R, ``(n, 4)``."""
        return np.column_stack([np.ones(len(ground)), frame.from_ground(ground) / reach])

    def _matrix(self, values: np.ndarray) -> np.ndarray:
        """Return c and M, ``(3, 4)``."""
        matrix = np.zeros((3, 4))
        matrix[self.entries[:, 0], self.entries[:, 1]] = values
        return matrix


def _frame(image: Image) -> tuple[LocalFrame, float]:
    """Return the frame about the middle of the image, and half its extent in metres."""
    area = ground_area(image)
    return LocalFrame(*(float(value) for value in area.middle)), area.reach_m


def _correction(name: str, title: str, entries: list[tuple[int, int]], least_points: int) -> GroundCorrection:
    names = tuple(f"{AXES[axis]}_{('0', *AXES)[by]}" for axis, by in entries)
    return GroundCorrection(name, title, names, np.array(entries), least_points)


SHIFTS = [(axis, 0) for axis in range(3)]
OBJECT_SPACE = {
    model.name: model
    for model in (
        _correction("object-shift", "a shift of the ground coordinates", SHIFTS, 1),
        _correction(
            "object-scale-shift", "a shift and a scale of each ground coordinate",
            SHIFTS + [(axis, axis + 1) for axis in range(3)], 2,
        ),
        _correction(
            "object-affine", "an affine transformation of the ground coordinates",
            SHIFTS + [(axis, by) for axis in range(3) for by in range(1, 4)], 4,
        ),
    )
}  # fmt: skip

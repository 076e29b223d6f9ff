"""Displacement of an image's lines by vibration of the attitude (jitter), which an RPC cannot represent.

With the position ``p`` that the RPC computes for a ground point and the curve ``c`` at the line of ``p``, the point is
in the image at ``p + c``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

INVERSE_STEPS = 6  # fixed-point iterations: with a slope of 0.1 px per line the error is 1e-6 of the displacement


@dataclass(frozen=True, eq=False)
class JitterCurve:
    """Displacements of the lines ``first_line``, ``first_line + 1`` … of an image; constant beyond its ends.

    shift_px : (n, 2) displacements in sample and line
    sigma_px : (n, 2) standard deviations; the prior's where observations cannot separate the jitter from the ground
    """

    first_line: int
    shift_px: np.ndarray
    sigma_px: np.ndarray

    def evaluate(self, line: np.ndarray) -> np.ndarray:
        """Return the displacements ``(n, 2)`` in px at lines ``(n,)`` computed by the RPC; NaN if unknown."""
        place = np.clip(np.asarray(line) - self.first_line, 0.0, len(self.shift_px) - 1.0)
        at = np.clip(np.nan_to_num(place).astype(np.int64), 0, max(len(self.shift_px) - 2, 0))
        part, near = (place - at)[:, None], self.shift_px[at]
        return np.asarray(near + part * (self.shift_px[np.minimum(at + 1, len(self.shift_px) - 1)] - near))

    def remove_from(self, xy: np.ndarray) -> np.ndarray:
        """Return the positions without jitter, as the RPC computes them, of measured image points ``(n, 2)``."""
        without = np.array(xy, dtype=np.float64)
        for _ in range(INVERSE_STEPS):
            without = xy - self.evaluate(without[:, 1])
        return without


@dataclass(frozen=True, eq=False)
class JitterEstimate:
    """Jitter curves of the images of a block, with samples of their errors.

    curves : by image id; images without a curve have no jitter
    samples : errors of the curves, sampled from their posterior distribution
    prior : angular frequency (1/lines), damping and standard deviation (px) of the prior
    """

    curves: Mapping[str, JitterCurve]
    samples: tuple[Mapping[str, JitterCurve], ...]
    prior: tuple[float, float, float]

    def add(self, other: "JitterEstimate") -> "JitterEstimate":
        """Return the sum of two estimates, the second one, whose prior it takes, made without the first."""
        samples = tuple(_add_curves(*both) for both in zip(self.samples, other.samples, strict=True))
        return JitterEstimate(_add_curves(self.curves, other.curves), samples, other.prior)

    def displace(self, ids: Sequence[str], image: np.ndarray, xy: np.ndarray, remove: bool = False) -> np.ndarray:
        """Return measurements ``xy (n, 2)`` with the jitter added, or removed.

        ids : of the block's images; image : (n,) index of each measurement's image
        remove : whether to remove the jitter instead of adding it
        """
        moved = xy.copy()
        for number, name in enumerate(ids):
            if name in self.curves:
                here, curve = np.flatnonzero(image == number), self.curves[name]
                moved[here] = curve.remove_from(xy[here]) if remove else xy[here] + curve.evaluate(xy[here, 1])
        return moved

    def add_sigmas(
        self, ids: Sequence[str], image: np.ndarray, xy: np.ndarray, sigma_px: np.ndarray, chosen: np.ndarray
    ) -> np.ndarray:
        """Return the sigmas ``(n,)`` of measurements, those of the ``chosen (n,)`` with the error of the curves."""
        widened = sigma_px.copy()
        for number, name in enumerate(ids):
            if name in self.curves:
                here, curve = np.flatnonzero(chosen & (image == number)), self.curves[name]
                of_curve = replace(curve, shift_px=curve.sigma_px).evaluate(xy[here, 1])
                widened[here] = np.sqrt(sigma_px[here] ** 2 + np.mean(of_curve**2, axis=1))
        return widened


def _add_curves(one: Mapping[str, JitterCurve], other: Mapping[str, JitterCurve]) -> dict[str, JitterCurve]:
    """Return the sums of two sets of curves; two curves of an image have the same lines."""
    return {**one, **other} | {
        name: JitterCurve(
            curve.first_line, curve.shift_px + other[name].shift_px, np.hypot(curve.sigma_px, other[name].sigma_px)
        )
        for name, curve in one.items() if name in other
    }  # fmt: skip

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
        knot = np.clip(np.nan_to_num(place).astype(np.int64), 0, max(len(self.shift_px) - 2, 0))
        part, neighbours = (place - knot)[:, None], self.shift_px[knot]
        return np.asarray(
            neighbours + part * (self.shift_px[np.minimum(knot + 1, len(self.shift_px) - 1)] - neighbours)
        )

    def remove_from(self, xy: np.ndarray) -> np.ndarray:
        """Return the positions without jitter, as the RPC computes them, of measured image points ``(n, 2)``."""
        remaining = np.array(xy, dtype=np.float64)
        for _ in range(INVERSE_STEPS):
            remaining = xy - self.evaluate(remaining[:, 1])
        return remaining


@dataclass(frozen=True, eq=False)
class JitterEstimate:
    """Jitter curves of the images of a block, with samples of their errors.

    curves : by image id; images without a curve have no jitter
    samples : errors of the curves, sampled from their posterior distribution
    priors : (1 + samples, 6) angular frequency (1/lines), damping and standard deviation (px) of either axis, of the
        most likely prior and of that of each sample
    """

    curves: Mapping[str, JitterCurve]
    samples: tuple[Mapping[str, JitterCurve], ...]
    priors: np.ndarray

    def add(self, addend: "JitterEstimate") -> "JitterEstimate":
        """Return the sum of two estimates, the second one, whose priors it takes, made without the first."""
        samples = tuple(_add_curves(*pair) for pair in zip(self.samples, addend.samples, strict=True))
        return JitterEstimate(_add_curves(self.curves, addend.curves), samples, addend.priors)

    def displace(self, ids: Sequence[str], image: np.ndarray, xy: np.ndarray, remove: bool = False) -> np.ndarray:
        """Return measurements ``xy (n, 2)`` with the jitter added, or removed.

        ids : of the block's images; image : (n,) index of each measurement's image
        remove : whether to remove the jitter instead of adding it
        """
        displaced_xy = xy.copy()
        for number, name in enumerate(ids):
            if name in self.curves:
                rows, curve = np.flatnonzero(image == number), self.curves[name]
                displaced_xy[rows] = curve.remove_from(xy[rows]) if remove else xy[rows] + curve.evaluate(xy[rows, 1])
        return displaced_xy

    def add_sigmas(
        self, ids: Sequence[str], image: np.ndarray, xy: np.ndarray, sigma_px: np.ndarray, selection: np.ndarray
    ) -> np.ndarray:
        """Return the sigmas ``(n,)`` of measurements, those of the ``selection (n,)`` with the error of the curves."""
        widened = sigma_px.copy()
        for number, name in enumerate(ids):
            if name in self.curves:
                rows, curve = np.flatnonzero(selection & (image == number)), self.curves[name]
                of_curve = replace(curve, shift_px=curve.sigma_px).evaluate(xy[rows, 1])
                widened[rows] = np.sqrt(sigma_px[rows] ** 2 + np.mean(of_curve**2, axis=1))
        return widened


def _add_curves(one: Mapping[str, JitterCurve], second: Mapping[str, JitterCurve]) -> dict[str, JitterCurve]:
    """Return the sums of two sets of curves; two curves of an image have the same lines."""
    return {**one, **second} | {
        name: JitterCurve(
            curve.first_line, curve.shift_px + second[name].shift_px, np.hypot(curve.sigma_px, second[name].sigma_px)
        )
        for name, curve in one.items()
        if name in second
    }

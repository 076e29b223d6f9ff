"""Displacement of an image's lines by vibration of the attitude (jitter), which an RPC cannot represent.

With the position ``p`` that the RPC computes for a ground point and the curve ``c`` at the line of ``p``, the point is
in the image at ``p + c``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

INVERSE_STEPS = 6  # fixed-point iterations: with a slope of 0.1 px per line the error is 1e-6 of the displacement


@dataclass(frozen=True, eq=False)
class JitterCurve:
    """Displacements of the lines ``first_line``, ``first_line + 1`` … of an image; constant beyond its ends.

    Parameters
    ----------
    first_line : int
        Line of the first displacement.
    shift_px : (n, 2) ndarray
        Displacements in sample and line.
    sigma_px : (n, 2) ndarray
        Standard deviations; those of the prior where the observations cannot separate the jitter from the ground.
    """

    first_line: int
    shift_px: np.ndarray
    sigma_px: np.ndarray

    def evaluate(self, line: np.ndarray) -> np.ndarray:
        """Return the displacements at computed lines.

        Parameters
        ----------
        line : (n,) ndarray
            Lines computed by the RPC; NaN if unknown.

        Returns
        -------
        (n, 2) ndarray
            Displacements in sample and line, px.
        """
        place = np.clip(np.asarray(line) - self.first_line, 0.0, len(self.shift_px) - 1.0)
        at = np.clip(np.nan_to_num(place).astype(np.int64), 0, max(len(self.shift_px) - 2, 0))
        part, near = (place - at)[:, None], self.shift_px[at]
        return np.asarray(near + part * (self.shift_px[np.minimum(at + 1, len(self.shift_px) - 1)] - near))

    def remove_from(self, xy: np.ndarray) -> np.ndarray:
        """Return the positions without jitter, as the RPC computes them, of measured image points.

        Parameters
        ----------
        xy : (n, 2) ndarray
            Measured sample and line.

        Returns
        -------
        (n, 2) ndarray
            Sample and line without jitter.
        """
        without = np.array(xy, dtype=np.float64)
        for _ in range(INVERSE_STEPS):
            without = xy - self.evaluate(without[:, 1])
        return without


@dataclass(frozen=True, eq=False)
class JitterEstimate:
    """Jitter curves of the images of a block, with samples of their errors.

    Parameters
    ----------
    curves : dict of JitterCurve
        By image id; images without a curve have no jitter.
    samples : tuple of dict of JitterCurve
        Errors of the curves, sampled from their posterior distribution.
    prior : tuple of float
        Angular frequency (1/lines), damping and standard deviation (px) of the prior.
    """

    curves: Mapping[str, JitterCurve]
    samples: tuple[Mapping[str, JitterCurve], ...]
    prior: tuple[float, float, float]

    def add(self, other: "JitterEstimate") -> "JitterEstimate":
        """Return the sum of two estimates, the second one made after the first was removed.

        Parameters
        ----------
        other : JitterEstimate
            The second estimate, whose prior the sum takes.

        Returns
        -------
        JitterEstimate
            The sums of the curves and of their errors.
        """
        samples = tuple(_add_curves(*both) for both in zip(self.samples, other.samples, strict=True))
        return JitterEstimate(_add_curves(self.curves, other.curves), samples, other.prior)

    def displace(self, ids: Sequence[str], image: np.ndarray, xy: np.ndarray, remove: bool = False) -> np.ndarray:
        """Return measurements with the jitter added, or removed.

        Parameters
        ----------
        ids : sequence of str
            The ids of the block's images.
        image : (n,) ndarray of int
            Index of each measurement's image.
        xy : (n, 2) ndarray
            Sample and line.
        remove : bool
            Whether to remove the jitter instead of adding it.

        Returns
        -------
        (n, 2) ndarray
            Sample and line.
        """
        moved = xy.copy()
        for number, name in enumerate(ids):
            if name in self.curves:
                here, curve = np.flatnonzero(image == number), self.curves[name]
                moved[here] = curve.remove_from(xy[here]) if remove else xy[here] + curve.evaluate(xy[here, 1])
        return moved


def _add_curves(one: Mapping[str, JitterCurve], other: Mapping[str, JitterCurve]) -> dict[str, JitterCurve]:
    """Return the sums of two sets of curves; two curves of an image have the same lines."""
    return {**one, **other} | {
        name: JitterCurve(
            curve.first_line, curve.shift_px + other[name].shift_px, np.hypot(curve.sigma_px, other[name].sigma_px)
        )
        for name, curve in one.items() if name in other
    }  # fmt: skip

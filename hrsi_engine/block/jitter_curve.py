"""Displacement of an image's lines by vibration of the attitude, which no RPC holds.

With the position ``p`` that the RPC computes for a ground point and the curve ``c`` at the line of ``p``, the image
shows the point at ``p + c``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

INVERSE_STEPS = 6  # of the fixed point: a slope of 0.1 px a line leaves 1e-6 of the displacement


@dataclass(frozen=True, eq=False)
class JitterCurve:
    """Displacements of the lines ``first_line``, ``first_line + 1`` … of an image; beyond its ends those of the ends.

    Parameters
    ----------
    first_line : int
        Line of the first displacement.
    shift_px : (n, 2) ndarray
        In sample and line.
    sigma_px : (n, 2) ndarray
        Standard deviations: of what the observations do not separate from the ground, the prior's.
    """

    first_line: int
    shift_px: np.ndarray
    sigma_px: np.ndarray

    def evaluate(self, line: np.ndarray) -> np.ndarray:
        """Return the displacements at computed lines.

        Parameters
        ----------
        line : (n,) ndarray
            Lines as the RPC computes them; NaN where not known.

        Returns
        -------
        (n, 2) ndarray
            In sample and line, px.
        """
        place = np.clip(np.asarray(line) - self.first_line, 0.0, len(self.shift_px) - 1.0)
        at = np.clip(np.nan_to_num(place).astype(np.int64), 0, max(len(self.shift_px) - 2, 0))
        part, near = (place - at)[:, None], self.shift_px[at]
        return np.asarray(near + part * (self.shift_px[np.minimum(at + 1, len(self.shift_px) - 1)] - near))

    def remove_from(self, xy: np.ndarray) -> np.ndarray:
        """Return where points of the image would lie without jitter, as the RPC computes them.

        Parameters
        ----------
        xy : (n, 2) ndarray
            Measured sample and line.

        Returns
        -------
        (n, 2) ndarray
            Sample and line.
        """
        without = np.array(xy, dtype=np.float64)
        for _ in range(INVERSE_STEPS):
            without = xy - self.evaluate(without[:, 1])
        return without


@dataclass(frozen=True, eq=False)
class JitterEstimate:
    """Curves of the images of a block, and what may be wrong with them.

    Parameters
    ----------
    curves : dict of JitterCurve
        By the images' ids; images without one have no jitter.
    samples : tuple of dict of JitterCurve
        Errors of the curves, drawn from their posterior.
    prior : tuple of float
        Angular frequency (1/lines), damping and standard deviation (px) of the prior.
    """

    curves: Mapping[str, JitterCurve]
    samples: tuple[Mapping[str, JitterCurve], ...]
    prior: tuple[float, float, float]

    def add(self, other: "JitterEstimate") -> "JitterEstimate":
        """Return the sum of two estimates, the second of what the first leaves.

        Parameters
        ----------
        other : JitterEstimate
            The second estimate, whose prior the sum has.

        Returns
        -------
        JitterEstimate
            With the sums of the curves and of their errors.
        """
        samples = tuple(_add_curves(*both) for both in zip(self.samples, other.samples, strict=True))
        return JitterEstimate(_add_curves(self.curves, other.curves), samples, other.prior)

    def displace(self, ids: Sequence[str], image: np.ndarray, xy: np.ndarray, remove: bool = False) -> np.ndarray:
        """Return measurements with jitter added, or removed.

        Parameters
        ----------
        ids : sequence of str
            The block's images.
        image : (n,) ndarray of int
            Number of each measurement's image.
        xy : (n, 2) ndarray
            Sample and line.
        remove : bool
            Whether the measurements have jitter, which is removed.

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
    """Return the sums of curves, which have the same lines where an image has both."""
    return {**one, **other} | {
        name: JitterCurve(
            curve.first_line, curve.shift_px + other[name].shift_px, np.hypot(curve.sigma_px, other[name].sigma_px)
        )
        for name, curve in one.items() if name in other
    }  # fmt: skip

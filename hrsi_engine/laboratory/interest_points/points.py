"""The table of interest points, and spreading them over an image."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ...block.block import ImagePoints
from ...block.columns import Columns, rank_in_groups

CORNER, SUPER = "corner", "super"


@dataclass(frozen=True, eq=False)
class InterestPoints(Columns):
    """Interest points of one image, columns of length n.

    Parameters
    ----------
    xy : (n, 2) ndarray
        Sample, line in pixels.
    kind : (n,) ndarray of str
        ``super``, ``corner``, ``ellipse``, ``rectangle``, ``region`` or ``blob``.
    covariance_px2 : (n, 2, 2) ndarray
        Of the position.
    strength : (n,) ndarray
        Of the detector, larger is better.
    quality : (n,) ndarray
        0 … 1; of a centre, its chance to be found again in another view.
    size_px : (n, 2) ndarray
        Longer and shorter diameter or side, NaN for corners.
    azimuth_rad : (n,) ndarray
        Of the longer one.
    contrast : (n,) ndarray
        Grey values inside - outside, NaN for corners.
    rmse_px : (n,) ndarray
        Of the outline about the shape, NaN for corners.
    """

    xy: np.ndarray
    kind: np.ndarray
    covariance_px2: np.ndarray
    strength: np.ndarray
    quality: np.ndarray
    size_px: np.ndarray
    azimuth_rad: np.ndarray
    contrast: np.ndarray
    rmse_px: np.ndarray

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def sigma_px(self) -> np.ndarray:
        """Standard deviation of a coordinate, ``(n,)`` (mean of the two axes)."""
        return np.sqrt(np.trace(self.covariance_px2, axis1=1, axis2=2) / 2.0)

    @property
    def is_centre(self) -> np.ndarray:
        """Mask of gravity centres, ``(n,)``."""
        return ~np.isin(self.kind, (CORNER, SUPER))

    def to_image_points(self, image_id: str, prefix: str = "P") -> ImagePoints:
        """Return the points as image points of a block.

        Parameters
        ----------
        image_id : str
            The image's name.
        prefix : str
            Of the points' ids ``P1 …``.

        Returns
        -------
        ImagePoints
            With the sigmas of the covariances.
        """
        width = len(str(max(len(self), 1)))
        ids = [f"{prefix}{number + 1:0{width}d}" for number in range(len(self))]
        return ImagePoints(
            ids=ids,
            image_ids=[image_id] * len(self),
            xy=self.xy,
            sigma_px=self.sigma_px,
            kind=self.kind,
            quality=self.quality,
            source="interest points",
        )


def join_points(tables: Sequence[InterestPoints]) -> InterestPoints:
    """Return several tables as one; an empty table for none."""
    if not tables:
        return make_empty_points()
    return InterestPoints(
        *(np.concatenate([getattr(table, field.name) for table in tables]) for field in fields(InterestPoints))
    )


def make_empty_points() -> InterestPoints:
    """Return a table without rows."""
    nothing = np.empty(0)
    return InterestPoints(
        xy=np.empty((0, 2)),
        kind=np.empty(0, dtype="U9"),
        covariance_px2=np.empty((0, 2, 2)),
        strength=nothing,
        quality=nothing,
        size_px=np.empty((0, 2)),
        azimuth_rad=nothing,
        contrast=nothing,
        rmse_px=nothing,
    )


def select_best_per_cell(points: InterestPoints, cell_px: float, per_cell: int) -> np.ndarray:
    """Return indices, ascending, of the ``per_cell`` best points in every cell of a grid; best by quality, strength."""
    cell = np.floor((points.xy + 0.5) / cell_px).astype(np.int64)
    order = np.lexsort((-points.strength, -points.quality, cell[:, 0], cell[:, 1]))
    number = np.unique(cell[order], axis=0, return_inverse=True)[1].ravel()
    return np.sort(order[rank_in_groups(number) < per_cell])

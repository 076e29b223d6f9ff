"""Columns of points: on the ground, and measured on images. What files and matchers deliver, and what a block holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from .columns import Columns


class Role(IntEnum):
    """What the known position of a ground point is used for."""

    GCP = 0  #: weighted observation of the adjustment
    CHECK = 1  #: compared with the result, never used
    TIE = 2  #: not known, or only a starting value

    @classmethod
    def parse(cls, text: str) -> Role | None:
        """Return the role named in a file, None for an empty field; raise KeyError for anything else."""
        return None if not text.strip() else _ROLE_NAMES[text.strip().lower()]

    @property
    def label(self) -> str:
        return self.name.lower()


#: The roles' words, to be indexed by an array of roles.
ROLE_LABELS = np.array([role.label for role in Role])
_ROLE_NAMES = {
    "gcp": Role.GCP, "control": Role.GCP, "check": Role.CHECK, "chk": Role.CHECK, "checkpoint": Role.CHECK,
    "tie": Role.TIE,
}  # fmt: skip
UNSET = -1  #: role column of `GroundPoints`: the file says nothing


@dataclass(frozen=True, eq=False)
class GroundPoints(Columns):
    """Points on the ground.

    ids : (m,) str
    ground : (m, 3) lon, lat, ellipsoidal height; NaN where not known
    role : (m,) int, a `Role` or `UNSET`
    sigma_m : (m, 2) standard deviation of each horizontal coordinate and of the height; NaN takes the default
    covariance_m2 : (m, 3, 3) of east, north and height; where an element is NaN, or for None, ``sigma_m`` says it. An
        infinite variance is a coordinate that was not surveyed
    """

    ids: np.ndarray
    ground: np.ndarray
    role: np.ndarray
    sigma_m: np.ndarray
    source: str = ""
    covariance_m2: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.ids)

    def survey_covariance_m2(self, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the covariance of some points' positions ``(k, 3, 3)``: its given elements, else of the sigmas."""
        covariance = np.zeros((len(self.ids[rows]), 3, 3))
        covariance[:, range(3), range(3)] = self.sigma_m[rows][:, [0, 0, 1]] ** 2
        if self.covariance_m2 is not None:
            given = self.covariance_m2[rows]
            covariance = np.where(np.isnan(given), covariance, given)
        return covariance

    @classmethod
    def create(
        cls,
        ids: Sequence[str] | np.ndarray,
        ground: np.ndarray,
        role: np.ndarray | int = UNSET,
        sigma_m: np.ndarray | float = np.nan,
        source: str = "",
        covariance_m2: np.ndarray | None = None,
    ) -> GroundPoints:
        """Make columns of matching length from arrays or single values."""
        count = len(ids)
        return cls(
            np.asarray(ids, dtype=str),
            np.asarray(ground, dtype=np.float64).reshape(count, 3),
            np.broadcast_to(np.asarray(role, dtype=np.int8), (count,)).copy(),
            np.broadcast_to(np.asarray(sigma_m, dtype=np.float64), (count, 2)).copy(),
            source,
            None if covariance_m2 is None else np.array(covariance_m2, dtype=np.float64).reshape(count, 3, 3),
        )


@dataclass(frozen=True, eq=False)
class ImagePoints(Columns):
    """Measurements of points on images, as files and matchers deliver them.

    ids, image_ids : (n,) str; xy : (n, 2) sample, line; sigma_px : (n,), NaN takes the default;
    kind : (n,) str (``corner``, ``center`` …); quality : (n,), larger is better, NaN where not known
    """

    ids: np.ndarray
    image_ids: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray
    kind: np.ndarray
    quality: np.ndarray
    source: str = ""

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def create(
        cls,
        ids: Sequence[str] | np.ndarray,
        image_ids: Sequence[str] | np.ndarray,
        xy: np.ndarray,
        sigma_px: np.ndarray | float = np.nan,
        kind: Sequence[str] | np.ndarray | str = "",
        quality: np.ndarray | float = np.nan,
        source: str = "",
    ) -> ImagePoints:
        """Make columns of matching length from arrays or single values."""
        count = len(ids)
        return cls(
            np.asarray(ids, dtype=str),
            np.asarray(image_ids, dtype=str),
            np.asarray(xy, dtype=np.float64).reshape(count, 2),
            np.broadcast_to(np.asarray(sigma_px, dtype=np.float64), (count,)).copy(),
            np.broadcast_to(np.asarray(kind, dtype=str), (count,)).copy(),
            np.broadcast_to(np.asarray(quality, dtype=np.float64), (count,)).copy(),
            source,
        )


@dataclass(frozen=True, eq=False)
class Measurements(Columns):
    """Image points of a block, ids resolved: ``point`` and ``image`` index the block's points and images.

    Sorted by point, then by image.
    """

    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray
    kind: np.ndarray
    quality: np.ndarray

    def __len__(self) -> int:
        return len(self.point)


def unique_ids(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct ids, sorted, and the index of each row's id; quick where equal ids stand together."""
    if not len(ids):
        return ids, np.zeros(0, dtype=np.int64)
    head = np.r_[True, ids[1:] != ids[:-1]]
    distinct, inverse = np.unique(ids[head], return_inverse=True)
    return distinct, inverse.astype(np.int64)[np.cumsum(head) - 1]

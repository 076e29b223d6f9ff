"""The geometry of a pair within one window, as polynomials: a window asks for it fifty times, at a few points each.

Where a point of the first image at some height appears in the second is a smooth function of sample, line and height.
Over a window it is a cubic to far less than a thousandth of a pixel (checked at every window), and evaluating that
costs a tenth of localizing and projecting.
"""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from ...camera.rpc import RPC, Localization
from ...camera.rpc_terms import monomials
from ..tile_matching.epipolar import transfer
from ..tile_matching.types import TilePairGeometry
from .windows import TIE_WINDOWS, ImageWindow, compute_height_limits

_AXIS = -np.cos(np.pi * np.arange(5) / 4.0)  # Chebyshev nodes, ends included
_NODES = np.stack(np.meshgrid(_AXIS, _AXIS, _AXIS), axis=-1).reshape(-1, 3)
_TERMS = monomials(_NODES.T)
_FIT = np.linalg.pinv(_TERMS.T)


@dataclass(frozen=True, eq=False)
class _FirstImage:
    """Stands for the first RPC: its ground coordinates are sample, line and height themselves."""

    height_range: tuple[float, float]

    def localize(self, image: np.ndarray, height_m: np.ndarray | float) -> Localization:
        ground = np.empty((len(image), 3))
        ground[:, :2], ground[:, 2] = image, height_m
        return Localization(ground, np.ones(len(image), dtype=bool))


@dataclass(frozen=True, eq=False)
class _SecondImage:
    """Stands for the second RPC: a cubic of sample, line and height of the first image."""

    middle: np.ndarray
    reach: np.ndarray
    coefficients: np.ndarray  #: (20, 2)

    def project(self, ground: np.ndarray) -> np.ndarray:
        return np.asarray(monomials(((ground - self.middle) / self.reach).T).T @ self.coefficients)


def fit_local_geometry(geometry: TilePairGeometry, window: ImageWindow, border: int = 32) -> TilePairGeometry:
    """Return the geometry of a pair as polynomials that hold in a window of the first image and around its heights.

    The pair's own geometry comes back where a cubic is not enough.
    """
    corners = np.array([(window.sample, window.line), (window.sample + window.samples, window.line + window.lines)])
    low, high = compute_height_limits(geometry, corners.astype(np.float64))
    bottom, top = float(low.min()) - TIE_WINDOWS.height_margin_m, float(high.max()) + TIE_WINDOWS.height_margin_m
    middle = np.array([*corners.mean(axis=0), 0.5 * (bottom + top)])
    reach = np.array([0.5 * window.samples + border, 0.5 * window.lines + border, 0.5 * (top - bottom)])
    nodes = middle + reach * _NODES
    positions = transfer(geometry.first, geometry.second, nodes[:, :2], nodes[:, 2])
    if not np.isfinite(positions).all():
        return geometry
    coefficients = _FIT @ positions
    if np.abs(_TERMS.T @ coefficients - positions).max() > TIE_WINDOWS.miss_px:
        return geometry
    return replace(
        geometry,
        first=cast(RPC, _FirstImage(geometry.first.height_range)),
        second=cast(RPC, _SecondImage(middle, reach, coefficients)),
    )

"""An orthoimage as everybody can have it: pixels of 10 m, from another time of the year, some metres from the truth.

Most of the displacement of Sentinel-2 and similar images is the same for all of a scene; some changes from part to
part, where a mosaic has its seams or the orbit was adjusted by itself, and the rest, by the heights of rectification,
from place to place. The shares of the variance are 64, 16 and 20 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from .landscape import SPECTRAL_BANDS
from .options import FreeOrthoSpec
from .render import RENDERING, OrthoRenderer, make_orthophoto
from .scene import Scene
from .terrain import make_fractal_relief
from .world import constant, constants


@constants
class ORTHO_ERROR:
    """Correlation of the errors of a free orthoimage."""

    common_share: float = constant(0.8, "", "share of the error common to a scene")
    part_share: float = constant(0.4, "", "share of the error common to a part of the mosaic")
    parts: int = constant(3, "parts", "parts of the mosaic along each side")
    nodes: int = constant(32, "nodes", "nodes of the local error along each side")
    roughness: float = constant(0.3, "", "Hurst exponent of the local error")
    corner_from: float = constant(
        0.5, "", "distance from the centre, in half scenes, at which the north-eastern corner begins"
    )


OTHER_DATE = 1
ORTHO_BANDS = tuple(range(1, len(SPECTRAL_BANDS)))  #: blue, green, red, near infrared


class OrthoErrors(NamedTuple):
    """Displacement of an orthoimage from the truth: east and north ``(2, rows, columns)`` at nodes over the scene."""

    at_nodes_m: np.ndarray
    half_extent_m: float
    corner_m: np.ndarray

    @property
    def mean_m(self) -> tuple[float, float]:
        """East and north in the mean of the scene, without its corner."""
        east, north = self.at_nodes_m.mean(axis=(1, 2))
        return float(east), float(north)

    def errors_at(self, east: np.ndarray, north: np.ndarray) -> np.ndarray:
        """Return stated - true place.

        Parameters
        ----------
        east, north : ndarray
            Chart metres, of any shape.

        Returns
        -------
        (2, ...) ndarray
            East and north in metres.
        """
        count = self.at_nodes_m.shape[1]
        row, column = (0.5 * (count - 1) * (1.0 + axis / self.half_extent_m) for axis in (north, east))
        shift_m = np.stack(
            [ndimage.map_coordinates(one, [row, column], order=1, mode="nearest") for one in self.at_nodes_m]
        )
        corner = np.minimum(east, north) > ORTHO_ERROR.corner_from * self.half_extent_m
        return np.asarray(shift_m + self.corner_m.reshape(2, *(1 for _ in corner.shape)) * corner)


def draw_ortho_errors(half_extent_m: float, spec: FreeOrthoSpec, seed: list[int]) -> OrthoErrors:
    """Return the errors of an orthoimage.

    Parameters
    ----------
    half_extent_m : float
        Half the side of the scene.
    spec : FreeOrthoSpec
        How large they are.
    seed : list of int
        The same seed gives the same errors.

    Returns
    -------
    OrthoErrors
        As a function of the place.
    """
    rng = np.random.default_rng(seed)
    sigma = spec.error_m / np.sqrt(2.0)
    part = np.minimum(np.arange(ORTHO_ERROR.nodes) * ORTHO_ERROR.parts // ORTHO_ERROR.nodes, ORTHO_ERROR.parts - 1)
    of_parts = rng.normal(0.0, ORTHO_ERROR.part_share, (2, ORTHO_ERROR.parts, ORTHO_ERROR.parts))[:, part][:, :, part]
    of_places = np.sqrt(1.0 - ORTHO_ERROR.common_share**2 - ORTHO_ERROR.part_share**2) * np.stack(
        [make_fractal_relief(ORTHO_ERROR.nodes, ORTHO_ERROR.roughness, rng) for _ in range(2)]
    )
    of_all = rng.normal(0.0, ORTHO_ERROR.common_share, (2, 1, 1))
    direction = rng.uniform(-np.pi, np.pi)
    corner = spec.corner_m * np.array([np.cos(direction), np.sin(direction)])
    return OrthoErrors(sigma * (of_all + of_parts + of_places), half_extent_m, corner)


@dataclass(frozen=True, eq=False)
class FreeOrthoRenderer(OrthoRenderer):
    """The ground from above at another time, displaced."""

    errors: OrthoErrors

    def ground_of(self, east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the chart positions that pixels at stated ones show.

        Parameters
        ----------
        east, north : ndarray
            Chart metres, as the orthoimage states them.

        Returns
        -------
        tuple of ndarray
            East and north.
        """
        shift_m = self.errors.errors_at(east, north)
        return east - shift_m[0], north - shift_m[1]


def simulate_free_orthoimage(scene: Scene, spec: FreeOrthoSpec, errors: OrthoErrors) -> tuple[FreeOrthoRenderer, ...]:
    """Return the bands of a free orthoimage: blue, green, red, near infrared.

    Parameters
    ----------
    scene : Scene
        What is seen.
    spec : FreeOrthoSpec
        Pixels and change.
    errors : OrthoErrors
        Displacement from the truth.

    Returns
    -------
    tuple of FreeOrthoRenderer
        They render windows.
    """
    plain = make_orthophoto(scene, spec.pixel_m)
    blur_m = RENDERING.ortho_blur_px * spec.pixel_m
    textures = (scene.texture.blur(blur_m, band, OTHER_DATE, spec.change) for band in ORTHO_BANDS)
    return tuple(
        FreeOrthoRenderer(
            scene, replace(plain.painter, texture=texture), plain.west_m, plain.north_m, plain.gsd_m, errors
        )
        for texture in textures
    )

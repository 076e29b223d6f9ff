"""Linearised observation equations of any part of a block, for all models.

Models with a compiled formula are evaluated when needed, a few thousand image points at a time; only equations that are
costly (pseudo sensors) are cached, because they are needed again when the points are solved for. All others are
evaluated image by image with NumPy, the whole block at once, and the equations of the last state are cached.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...refinement.model import RefinementModel, Structure
from ..observations import Observations
from .states import State


class Portion(NamedTuple):
    """Points ``(k,)`` of a block, and the first row of each one's image points in the arrays, ``place (k + 1,)``.

    ``number`` identifies a part of the block's fixed division; None for any other selection of points.
    """

    points: np.ndarray
    place: np.ndarray
    number: int | None = None

    @classmethod
    def select(cls, observations: Observations, points: np.ndarray) -> Portion:
        """Return the part that consists of the given points (indices)."""
        lengths = observations.first[points + 1] - observations.first[points]
        return cls(points, np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(lengths)]))


class Linearisation(NamedTuple):
    """Residuals and derivatives of the image points of a part, in the order of its points.

    residual : (r, 2) observed - computed, px
    by_ground : (r, 2, 3) px per metre east, north, up
    by_quantity : (r, 2, q), None if the quantities are sample and line; terms : (r, t): see `Structure`
    """

    residual: np.ndarray
    by_ground: np.ndarray
    by_quantity: np.ndarray | None
    terms: np.ndarray


LinearisePortion = Callable[[Portion], Linearisation]


def take_whole_block(observations: Observations) -> Portion:
    """Return all points as one part."""
    return Portion(np.arange(len(observations.points)), observations.first)


class NumbaCameras:
    """Cameras of a family that has a compiled loop (`refinement.compiled_cameras`)."""

    by_parts = True  # parts are evaluated on request, with the ground at that time

    def __init__(self, observations: Observations, model: Any) -> None:
        from ...refinement.compiled_cameras import FAMILIES, tabulate_rpcs  # need numba, and take a second

        family, images, by_image = FAMILIES[type(model)], observations.images, observations.by_image
        self.structure: Structure = model.structure
        self._model, self._camera_of_image = model, observations.camera_of_image
        self._loop, self._table = family.loop, family.table(model)
        self._rpcs = tabulate_rpcs(images)
        self._constants = np.stack([model.constants(image) for image in images])
        of_images = [family.rays(image, observations.xy[rows]) for image, rows in zip(images, by_image, strict=True)]
        rays = np.empty((observations.count, of_images[0].shape[1]))
        rays[np.concatenate(by_image)] = np.concatenate(of_images)
        self._is_costly = rays.shape[1] > 0  # costly to evaluate: its equations are cached
        self._observed = observations.first, observations.image, observations.xy, rays
        self._kept: tuple[State, dict[int | None, Linearisation]] | None = None

    def linearise_at(self, state: State, keep: bool = False) -> LinearisePortion:
        """Return the function that linearises parts of the block at a state.

        ``keep`` announces that the equations of this state are needed again, and permits to cache them.
        """
        if self._kept is not None and self._kept[0].values is state.values and self._kept[0].ground is state.ground:
            cached = self._kept[1]
        else:
            cached = {}
            if keep and self._is_costly:
                self._kept = state, cached
        coefficients = np.asarray(self._model.coefficients(state.values))[self._camera_of_image]
        q, t = self.structure.quantities, self.structure.terms

        def linearise(part: Portion) -> Linearisation:
            if part.number in cached:
                return cached[part.number]
            rows = int(part.place[-1])
            by_quantity = np.empty((0, 2, 0)) if q is None else np.empty((rows, 2, q))
            arrays = np.empty((rows, 2)), np.empty((rows, 2, 3)), by_quantity, np.empty((rows, t))
            formula = self._constants, coefficients, self._table
            self._loop(part.points, part.place, self._observed, state.ground, self._rpcs, formula, arrays)
            linearised = Linearisation(arrays[0], arrays[1], None if q is None else by_quantity, arrays[3])
            if keep and self._is_costly and part.number is not None:
                cached[part.number] = linearised
            return linearised

        return linearise


class CamerasByImage:
    """Cameras of any model, image by image with NumPy.

    structure : of the derivatives by the parameters
    """

    by_parts = False  # the whole block is evaluated at once

    def __init__(self, observations: Observations, model: RefinementModel) -> None:
        count = len(model.parameters)
        self.structure = Structure(count, 1, np.eye(count))
        self._observations = observations
        self._linearisers = [
            model.equations(image, observations.xy[rows])
            for image, rows in zip(observations.images, observations.by_image, strict=True)
        ]
        self._last: tuple[State, Linearisation] | None = None

    def linearise_at(self, state: State, keep: bool = False) -> LinearisePortion:
        """Return the function that linearises parts of the block at a state; its equations are always cached."""
        if self._last is None or self._last[0].values is not state.values or self._last[0].ground is not state.ground:
            self._last = None  # frees memory before the next is computed
            observations, count = self._observations, self._observations.count
            by_values = np.empty((count, 2, self.structure.size))
            new = Linearisation(np.empty((count, 2)), np.empty((count, 2, 3)), by_values, np.ones((count, 1)))
            for index, (rows, equations) in enumerate(zip(observations.by_image, self._linearisers, strict=True)):
                if len(rows):
                    values = state.values[observations.camera_of_image[index]]
                    equations_here = equations(values, state.ground[observations.point[rows]])
                    new.residual[rows] = observations.xy[rows] - equations_here.computed
                    by_values[rows], new.by_ground[rows] = equations_here.by_values, equations_here.by_ground
            self._last = state, new
        linearised = self._last[1]

        def linearise(part: Portion) -> Linearisation:
            if len(part.points) == len(self._observations.points):
                return linearised
            rows, _ = self._observations.find_rows(part.points)
            by_quantity = None if linearised.by_quantity is None else linearised.by_quantity[rows]
            return Linearisation(
                linearised.residual[rows], linearised.by_ground[rows], by_quantity, linearised.terms[rows]
            )

        return linearise


Cameras = NumbaCameras | CamerasByImage

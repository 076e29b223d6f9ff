"""Corrected cameras of many images with few points on each, vectorised over images.

The formulas of polynomials take one image's index or an array of them (`correct_in_image`), the RPCs are those of
`camera.rpc_stack`. Models of other families are evaluated image by image. Both ways agree to rounding errors;
docs/developing/decisions.md has the reason for both.

Arguments that the functions share
    images : those of a block; which (n,) : index of each point's image
    values (images, p) : of the model's parameters
    ground (n, 3) : lon, lat in degrees, ellipsoidal height in metres
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ..block.block import Image, stack_rpcs
from .image_space import ImagePolynomial
from .model import Equations, RefinementModel
from .object_coordinates import GroundPolynomial


def linearise_images(
    model: RefinementModel,
    images: Sequence[Image],
    image_index: np.ndarray,
    xy: np.ndarray,
    values: np.ndarray,
    ground: np.ndarray,
) -> Equations:
    """Return the linearised equations of points that were observed at ``xy (n, 2)``; see `RefinementModel.equations`.

    model, images, which, values, ground : see the module
    xy : (n, 2) sample, line
    """
    if isinstance(model, ImagePolynomial | GroundPolynomial):
        constants = np.array([model.constants(image) for image in images])
        return model.linearise(
            constants,
            image_index,
            values,
            ground,
            *stack_rpcs(images).project_with_metric_jacobian(image_index, ground),
        )
    n, p = len(ground), len(model.parameters)
    result = Equations(np.empty((n, 2)), np.empty((n, 2, p)), np.empty((n, 2, 3)))
    for index, rows in _group_by_image(image_index):
        of_image = model.equations(images[index], xy[rows])(values[index], ground[rows])
        for column, part in zip(result, of_image, strict=True):
            column[rows] = part
    return result


def project_to_images(
    model: RefinementModel, images: Sequence[Image], image_index: np.ndarray, values: np.ndarray, ground: np.ndarray
) -> np.ndarray:
    """Return the image points ``(n, 2)`` of ground points by the corrected cameras; see `RefinementModel.project`."""
    if isinstance(model, ImagePolynomial | GroundPolynomial):
        return linearise_images(model, images, image_index, np.empty((len(ground), 2)), values, ground).computed
    result = np.empty((len(ground), 2))
    for index, rows in _group_by_image(image_index):
        result[rows] = model.project(images[index], values[index], ground[rows])
    return result


def _group_by_image(image_of_row: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index of each image and the rows of its points."""
    order = np.argsort(image_of_row, kind="stable")
    numbers, first = np.unique(image_of_row[order], return_index=True)
    yield from zip(numbers.tolist(), np.split(order, first[1:]), strict=True) if len(image_of_row) else ()

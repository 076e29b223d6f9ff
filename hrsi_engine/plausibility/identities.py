"""Permuted ids of images or ground points, and ids that differ in spelling only.

The cost of every id with every image (or survey) is computed, and the best assignment is found by the Hungarian method
(Kuhn 1955). Shifts of the images need not be known: they are small against the distances between points.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..block.assembly import find_similar_ids
from ..block.block import Block
from ..block.points import Role
from ..foundation.errors import list_ids
from ..foundation.reasons import Level, Reason
from ..foundation.thresholds import SAMPLES, SIGNIFICANCE
from .accuracy import ImageAccuracy
from .control import ControlMeasurements, StraightRays, compute_sightlines


def find_spelling_reasons(block: Block, accuracies: Sequence[ImageAccuracy]) -> list[Reason]:
    """Return the reason for surveyed points that are measured under another spelling of their id, or not at all.

    Similar ids alone prove nothing, because tie points are numbered too: at least half of them must also be measured at
    the surveyed positions, up to the errors of the RPCs. A block with no measured GCP is reported as well.
    """
    unmeasured = block.unmeasured.select(~np.isin(block.unmeasured.role, [Role.TIE, Role.HELD_OUT]))
    gcps = int((unmeasured.role == Role.GCP).sum())
    if not len(unmeasured):
        return []
    has_gcps = bool((block.points.role == Role.GCP).any())
    # Similar ids by surveyed id; kept only if at least half of them are measured at their surveyed positions
    similar = find_similar_ids(unmeasured.ids, block.points.ids[~block.known])
    names = {name: names_alike[0] for name, names_alike in similar.items() if len(names_alike) == 1}
    pairs: dict[str, str] = {}
    if names:
        row = {name: index for index, name in enumerate(unmeasured.ids.tolist())}
        index_of = {name: index for index, name in enumerate(block.points.ids.tolist())}
        first = np.searchsorted(block.measurements.point, [index_of[name] for name in names.values()])
        image = block.measurements.image[first]
        rays = compute_sightlines(block.images, image, block.measurements.xy[first])
        distance = np.hypot(*rays.distance_m(unmeasured.ground[[row[name] for name in names]]).T)
        is_near = distance < SIGNIFICANCE.certain * np.array([accuracy.sigma_m for accuracy in accuracies])[image]
        if 2 * is_near.sum() >= len(is_near):
            pairs = {name: names[name] for name, is_there in zip(names, is_near.tolist(), strict=True) if is_there}
    if pairs:
        pair_text = ", ".join(f"{surveyed!r} is measured as {name!r}" for surveyed, name in list(pairs.items())[:4])
        return [
            Reason(
                "control-unmeasured",
                Level.DOUBTFUL if has_gcps or not gcps else Level.UNUSABLE,
                f"{len(pairs)} surveyed points are not used, because ids are compared as text: {pair_text}"
                f"{' …' if len(pairs) > 4 else ''}; the measurements are at their surveyed positions",
                "use the same ids in both files",
                points=tuple(pairs),
            )
        ]
    if has_gcps or not gcps:
        return []
    ids = tuple(unmeasured.ids[unmeasured.role == Role.GCP].tolist())
    message = (
        f"none of the {gcps} GCPs is measured on an image ({list_ids(ids)}): no GCP determines the position of "
        "the block"
    )
    advice = "check the ids in both files, and that the image points are those of these GCPs"
    return [Reason("control-unmeasured", Level.DOUBTFUL, message, advice, points=ids)]


def find_image_permutation(
    control: ControlMeasurements, suspects: np.ndarray
) -> tuple[np.ndarray, StraightRays] | None:
    """Return the image of each measurement ``(n,)`` by the best permutation of the ``suspects`` images, and its rays.

    None where no permutation is better than the ids as given, and for a single image.
    """
    if len(suspects) < 2:
        return None
    images = control.block.images
    cost = np.empty((len(suspects), len(suspects)))
    for row, label in enumerate(suspects):
        rows_of_image = np.flatnonzero(control.image == label)
        for column, owner in enumerate(suspects):
            rays = compute_sightlines(images, np.full(len(rows_of_image), owner), control.xy[rows_of_image])
            distance = np.hypot(*rays.distance_m(control.ground[rows_of_image]).T) / control.accuracies[owner].sigma_m
            cost[row, column] = np.mean(np.log1p(distance**2))
    owners = suspects[linear_sum_assignment(cost)[1]]
    if (owners == suspects).all():
        return None
    image = control.image.copy()
    for label, owner in zip(suspects, owners, strict=True):
        image[control.image == label] = owner
    return image, compute_sightlines(images, image, control.xy)


def find_point_permutation(control: ControlMeasurements) -> np.ndarray | None:
    """Return, for each of `ControlMeasurements.points`, the point whose survey fits its measurements, ``(p,)``.

    None for a single point, for too many, and where every point fits its own survey best.
    """
    points = control.points
    if not 2 <= len(points) <= SAMPLES.large:
        return None
    survey = control.block.points.ground[points]
    place = np.searchsorted(points, control.point)
    sigma = control.get_figures("sigma_m")
    # squared distance of every measurement from every survey, in sigmas of the image's shift
    cost = np.zeros((len(points), len(points)))
    for owner in range(len(points)):
        distance = control.sights.distance_m(np.broadcast_to(survey[owner], (len(control), 3)))
        cost_of_row = np.log1p(np.sum(distance**2, axis=1) / sigma[control.image] ** 2)
        cost[:, owner] = np.bincount(place, cost_of_row, len(points)) / np.bincount(place, minlength=len(points))
    owners = linear_sum_assignment(cost)[1]
    return None if (owners == np.arange(len(points))).all() else owners

"""Ids that were mixed up: which image or which ground point the measurements really belong to.

Every label is tried with every owner, and the best assignment of all is taken (Kuhn 1955). A right assignment needs no
guess of the images' shifts: these are small against the distances between points, or the assignment fits nothing.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from .control import SurveyedRows
from .sights import Sights, sights

MOST_PERMUTED_POINTS = 400  # the costs grow with their square
MOST_PERMUTED_IMAGES = 12
TRIED_PER_IMAGE = 12


def permuted_images(control: SurveyedRows, wrong: np.ndarray) -> tuple[np.ndarray, Sights] | None:
    """Return the image that each measurement was really made on ``(n,)``, and its rays.

    ``wrong`` are the images that do not fit; only these are exchanged. None where they stay as they are.
    """
    if not 2 <= len(wrong) <= MOST_PERMUTED_IMAGES:
        return None
    images = control.block.images
    cost = np.empty((len(wrong), len(wrong)))
    for row, label in enumerate(wrong):
        some = np.flatnonzero(control.image == label)
        some = some[:: max(1, len(some) // TRIED_PER_IMAGE)]
        for column, owner in enumerate(wrong):
            seen = sights(images, np.full(len(some), owner), control.xy[some])
            away = np.hypot(*seen.distance_m(control.ground[some]).T) / control.accuracies[owner].sigma_m
            cost[row, column] = np.mean(np.log1p(away**2))
    owners = wrong[linear_sum_assignment(cost)[1]]
    if (owners == wrong).all():
        return None
    image = control.image.copy()
    for label, owner in zip(wrong, owners, strict=True):
        image[control.image == label] = owner
    return image, sights(images, image, control.xy)


def permuted_points(control: SurveyedRows) -> np.ndarray | None:
    """Return for every surveyed point of `SurveyedRows.points` the one whose survey fits its measurements, ``(p,)``.

    None for a single point, for too many, and where every point fits its own survey best.
    """
    points = control.points
    if not 2 <= len(points) <= MOST_PERMUTED_POINTS:
        return None
    survey = control.block.points.ground[points]
    place = np.searchsorted(points, control.point)
    sigma = control.of_images("sigma_m")
    # squared distance of every measurement from every survey, in sigmas of the image's shift
    cost = np.zeros((len(points), len(points)))
    for owner in range(len(points)):
        distance = control.sights.distance_m(np.broadcast_to(survey[owner], (len(control), 3)))
        away = np.log1p(np.sum(distance**2, axis=1) / sigma[control.image] ** 2)
        cost[:, owner] = np.bincount(place, away, len(points)) / np.bincount(place, minlength=len(points))
    owners = linear_sum_assignment(cost)[1]
    return None if (owners == np.arange(len(points))).all() else owners

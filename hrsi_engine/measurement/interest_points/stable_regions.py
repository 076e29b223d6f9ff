"""Maximally stable extremal regions (Matas et al. 2002): by OpenCV, or where it is missing by labels level by level.

A region is a connected part of the pixels that are at least as bright as a level. As the level falls, regions grow and
merge; one is stable where it has grown least since some levels before, as a share of what it was then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

LEVELS_PER_DELTA = 2  # every so many levels of a delta are labelled


class MserLimits(NamedTuple):
    """Levels over which a region must change little; its area in pixels; largest change; difference of nested ones."""

    delta: int
    fewest: int
    most: int
    largest_change: float
    different: float


def mser_by_opencv(image: np.ndarray, limits: MserLimits) -> list[np.ndarray]:
    """Return column and row ``(k, 2)`` of the pixels of each stable region that is brighter than its surroundings."""
    import cv2

    finder = cv2.MSER_create(
        delta=limits.delta, min_area=limits.fewest, max_area=limits.most, max_variation=limits.largest_change,
        min_diversity=limits.different,
    )  # fmt: skip
    finder.setPass2Only(True)
    return list(finder.detectRegions(image)[0])


class _Level(NamedTuple):
    """The regions of a level: labels of the pixels (0: darker); area of each, its main part at the level before (0:
    none), how much it grew, and the area of the last stable region in it."""

    labels: np.ndarray
    area: np.ndarray
    main: np.ndarray
    change: np.ndarray
    reported: np.ndarray


def mser_by_labels(image: np.ndarray, limits: MserLimits) -> list[np.ndarray]:
    """As `mser_by_opencv`, at every few levels."""
    step = max(limits.delta // LEVELS_PER_DELTA, 1)
    found: list[np.ndarray] = []
    levels: list[_Level] = []
    for threshold in range(int(image.max()), int(image.min()) - 1, -step):
        levels.append(_next_level(image >= threshold, levels, limits))
        if len(levels) >= 3:
            found += _stable_of(levels[-3], levels[-2], levels[-1], limits)
        if len(levels) > LEVELS_PER_DELTA + 1:
            del levels[0]
    return found


def _next_level(mask: np.ndarray, before: list[_Level], limits: MserLimits) -> _Level:
    """Return the regions of a level, after those of higher levels."""
    labels, count = ndimage.label(mask)
    area = np.bincount(labels.ravel(), minlength=count + 1)
    area[0] = 0
    main, reported = np.zeros(count + 1, np.int64), np.zeros(count + 1)
    change = np.full(count + 1, np.inf)
    if before:
        last = before[-1]
        one_pixel = np.zeros(len(last.area), np.int64)
        place = np.flatnonzero(last.labels)
        one_pixel[last.labels.ravel()[place]] = place
        into = labels.ravel()[one_pixel[1:]]
        order = np.argsort(last.area[1:], kind="stable")  # the largest part comes last and stays
        main[into[order]] = 1 + order
        np.maximum.at(reported, into, last.reported[1:])
    if len(before) >= LEVELS_PER_DELTA:
        part = main
        for level in reversed(before[-LEVELS_PER_DELTA + 1 :]) if LEVELS_PER_DELTA > 1 else ():
            part = level.main[part]
        then = before[-LEVELS_PER_DELTA].area[part]
        known = then > 0
        change[known] = (area[known] - then[known]) / then[known]
    change[(area < limits.fewest) | (area > limits.most)] = np.inf
    return _Level(labels, area, main, change, reported)


def _stable_of(inner: _Level, level: _Level, outer: _Level, limits: MserLimits) -> list[np.ndarray]:
    """Return the pixels of the regions of a level that change less than the same at the levels beside it."""
    into = np.zeros(len(level.area), np.int64)  # region of the outer level whose main part each one is
    into[outer.main[1:]] = np.arange(1, len(outer.main))
    after = np.where(into > 0, outer.change[into], np.inf)
    stable = (level.change <= limits.largest_change) & (level.change <= after)
    stable &= level.change < inner.change[level.main]
    stable &= level.reported <= (1.0 - limits.different) * level.area
    stable[0] = False
    if not stable.any():
        return []
    level.reported[stable] = level.area[stable]
    np.maximum.at(outer.reported, into, level.reported)
    labels = level.labels.ravel()
    place = np.flatnonzero(stable[labels])
    order = np.argsort(labels[place], kind="stable")
    place = place[order]
    bounds = np.flatnonzero(np.diff(labels[place])) + 1
    row, column = np.divmod(place, level.labels.shape[1])
    return np.split(np.column_stack([column, row]).astype(np.int32), bounds)

"""Surveyed points that disagree with the others: single points, or a group with a common offset.

Each point has one vector: the mean over its images of its misfit on the ground. Two clusters of these vectors, whose
gap is several times their spread, show that two surveys were mixed.
"""

from dataclasses import dataclass

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from .accuracy import SIMULATED
from .control import CONTROL_FIT, MEDIAN_LENGTH, ControlFit


@thresholds
class GROUP:
    """When surveyed points disagree with the others: single ones, or two clusters of misfits."""

    gap_ratio: float = threshold(8.0, "", "gap of two clusters, or distance of a point, over their spread", SIMULATED)
    least_gap_sigmas: float = threshold(8.0, "sigma", "smallest gap, in expected misfits", SIMULATED)
    least_gap_px: float = threshold(2.0, "px", "smallest gap, in pixels on the ground", SIMULATED)
    fewest_points: int = threshold(4, "points", "fewer cannot be told apart")
    directions: int = threshold(12, "directions", "horizontal directions along which clusters are sought")
    least_lean: float = threshold(0.02, "m/m", "rays that lean less from the others' mean tell no height")


@dataclass(frozen=True, eq=False)
class Disagreement:
    """Points that disagree with the rest.

    points : (k,) indices into the block's points
    step_m : (3,) their median offset east, north, up; NaN height where the rays do not determine it
    gap : distance over the spread within; group : True if they have the same offset
    """

    points: np.ndarray
    step_m: np.ndarray
    gap: float
    group: bool


def find_disagreement(given: ControlFit) -> Disagreement | None:
    """Return the smaller part of the surveyed points that disagrees with the rest; None where all agree."""
    control = given.control
    points = control.points
    if len(points) < GROUP.fewest_points:
        return None
    vector, expected = compute_point_misfits(given)
    least = np.maximum(GROUP.least_gap_sigmas * expected, GROUP.least_gap_px * _compute_median_gsd(given))
    two = _find_two_clusters(vector, expected, float(least.max()))
    if two is not None:
        smaller, gap = two
        return _describe_disagreement(given, points, vector, smaller, gap, group=True)
    middle = np.median(vector, axis=0)
    away = np.abs(vector - middle).max(axis=1)
    spread = np.maximum(np.median(np.hypot(*(vector - middle)[:, :2].T)) / MEDIAN_LENGTH, expected)
    off = (away > GROUP.gap_ratio * spread) & (away > least)
    if not off.any() or off.sum() > len(points) / 2:
        return None
    return _describe_disagreement(given, points, vector, off, float((away / spread)[off].min()), group=False)


def compute_point_misfits(given: ControlFit) -> tuple[np.ndarray, np.ndarray]:
    """Return each point's mean misfit east and north and its parallax ``(p, 3)`` m, and their noise ``(p,)`` m.

    The parallax is the mean over the images of the misfit along the direction in which the image's ray leans from the
    point's mean ray. It shows a wrong height, which moves images of different directions against each other.
    """
    control = given.control
    place = np.searchsorted(control.points, control.point)
    count = np.bincount(place)
    mean = np.column_stack([np.bincount(place, given.misfit_m[:, axis]) / count for axis in (0, 1)])
    lean = control.sights.slope - np.column_stack(
        [(np.bincount(place, control.sights.slope[:, axis]) / count)[place] for axis in (0, 1)]
    )
    length = np.hypot(*lean.T)
    along = np.sum(given.misfit_m * lean, axis=1) / np.maximum(length, 1e-9)
    along[length < GROUP.least_lean] = 0.0
    parallax = np.bincount(place, along) / count
    expected = np.sqrt(np.bincount(place, control.noise_m**2) / count)
    return np.column_stack([mean, parallax]), np.maximum(
        expected, CONTROL_FIT.least_noise_px * _compute_median_gsd(given)
    )


def _compute_median_gsd(given: ControlFit) -> float:
    control = given.control
    return float(np.median(control.get_figures("gsd_m")[control.images]))


def _find_two_clusters(vector: np.ndarray, expected: np.ndarray, least_m: float) -> tuple[np.ndarray, float] | None:
    """Return the smaller of two clusters of points (mask), and the gap between them over their spread."""
    best: tuple[np.ndarray, float] | None = None
    angles = np.pi * np.arange(GROUP.directions) / GROUP.directions
    directions = np.vstack(
        [np.column_stack([np.cos(angles), np.sin(angles), np.zeros(GROUP.directions)]), [[0.0, 0.0, 1.0]]]
    )
    count = len(vector)
    for direction in directions:
        along = vector @ direction
        order = np.argsort(along)
        step = np.diff(along[order])
        step[[0, -1]] = 0.0  # a cluster has at least two points
        cut = int(np.argmax(step))
        if step[cut] < least_m:
            continue
        low, high = order[: cut + 1], order[cut + 1 :]
        # The standard deviation within a cluster, doubled for two or three points, whose range says little
        spreads = [float(np.std(along[part], ddof=1)) * (2.0 if len(part) < 4 else 1.0) for part in (low, high)]
        within = max(*spreads, float(np.median(expected)))
        gap = float(step[cut] / within)
        if gap > GROUP.gap_ratio and (best is None or gap > best[1]):
            smaller = np.zeros(count, dtype=bool)
            smaller[low if len(low) <= len(high) else high] = True
            best = smaller, gap
    return best


def _describe_disagreement(
    given: ControlFit, points: np.ndarray, vector: np.ndarray, off: np.ndarray, gap: float, group: bool
) -> Disagreement:
    step = -(np.median(vector[off], axis=0) - np.median(vector[~off], axis=0))
    control = given.control
    place = np.searchsorted(points, control.point)
    lean = np.hypot(*(control.sights.slope - np.median(control.sights.slope, axis=0)).T)[off[place]]
    typical = float(np.median(lean)) if len(lean) else 0.0
    height = -step[2] / typical if typical > GROUP.least_lean else np.nan
    return Disagreement(points[off], np.array([step[0], step[1], height]), gap, group)

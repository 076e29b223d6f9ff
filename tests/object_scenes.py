"""Rendered scenes with tanks, roundabout islands, roofs and targets whose centres and corners are known.

Shared by the tests and the benchmarks of interest points.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.laboratory.interest_points import InterestPoints, detect_interest_points
from hrsi.hrsi_engine.laboratory.interest_points.options import DetectionOptions
from hrsi.hrsi_engine.laboratory.simulation.landscape import Objects
from hrsi.hrsi_engine.measurement.interest_points.options import CANDIDATE_QUALITY, CentreOptions

#: As matching gets them: the partner of a strong centre may be weaker.
CANDIDATES = DetectionOptions(centres=CentreOptions(quality=CANDIDATE_QUALITY))
VIEWS = ("image_1", "image_2")


@dataclass(frozen=True, eq=False)
class TrueObjects:
    """Objects wholly inside one image: kind (n,), centre (n, 2) px, corners (n, 4, 2) px, diameter (n,) px.

    The centre is the centre of gravity of the outline as the camera sees it. On ground that is not plane the image of
    the object's middle is up to 0.1 px away from it where the object is 40 px large.
    """

    kind: np.ndarray
    centre: np.ndarray
    corners: np.ndarray
    diameter: np.ndarray


def scene(
    scale: float, size: int = 1200, relief_m: float = 30.0, seed: int = 1, change: float = 0.0
) -> lab.BlockSimulation:
    """Return a pair, 24 degrees apart, of 0.7 m pixels; ``scale`` multiplies objects: tanks are 18 to 37 px at 1.

    With a ``change``, 0 … 1, the second view is of another date: soil and plants look different, the light comes from
    elsewhere, the image is less sharp and less bright.
    """
    first, second = lab.make_along_track_views(lab.SENSORS["pleiades"], 2, (size, size))
    if change:
        second = replace(second, date=1, radiometry=lab.Radiometry(gain=0.8, offset=40.0, psf_px=0.6))
    views = (first, second)
    spec = lab.SceneSpec(relief_m=relief_m, seed=seed, scale=scale, change=change)
    return lab.simulate_block(spec, views, lab.PointCounts(4, 4, 0), lab.Noise(vendor=0.0))


def true_objects(simulated: lab.BlockSimulation, image: lab.ImageRenderer) -> TrueObjects:
    """Return where an image's own camera sees the objects (pixels of that image, PAN or MS)."""
    objects, chart, terrain = simulated.scene.objects, simulated.scene.chart, simulated.scene.terrain

    def seen(chart_m: np.ndarray) -> np.ndarray:
        flat = chart_m.reshape(-1, 2)
        return image.camera.ground_to_image(chart.to_ground(flat, terrain.height(*flat.T))).reshape(chart_m.shape)

    corner_px = seen(objects.corners_m())
    centre = _centroids(seen(_outlines_m(objects)))
    gsd = float(np.sqrt(np.prod(image.camera.gsd_m())))
    diameter = np.sqrt(np.prod(objects.size_m, axis=1)) / gsd
    margin = objects.size_m.max(axis=1)[:, None] / gsd + 2.0
    inside = np.all((centre > margin) & (centre < np.array(image.size) - margin), axis=1)
    inside &= ~_painted_over(simulated)
    return TrueObjects(objects.kind[inside], centre[inside], corner_px[inside], diameter[inside])


def _outlines_m(objects: Objects, points: int = 64) -> np.ndarray:
    """Return points around the objects in chart metres, ``(n, points, 2)``: four sides of roofs, else circles."""
    corners = objects.corners_m()
    side = np.repeat(np.arange(4), points // 4)
    share = np.tile(np.arange(points // 4) / (points // 4), 4)[None, :, None]
    square = (1.0 - share) * corners[:, side] + share * corners[:, (side + 1) % 4]
    t = 2.0 * np.pi * np.arange(points) / points
    circle = objects.position_m[:, None] + objects.size_m[:, :1, None] / 2.0 * np.column_stack([np.sin(t), np.cos(t)])
    return np.where((objects.kind == "roof")[:, None, None], square, circle)


def _centroids(rings: np.ndarray) -> np.ndarray:
    """Return the centres of gravity ``(n, 2)`` of the insides of rings ``(n, k, 2)``."""
    middle = rings.mean(axis=1, keepdims=True)
    a, b = rings - middle, np.roll(rings, -1, axis=1) - middle
    cross = a[..., 0] * b[..., 1] - b[..., 0] * a[..., 1]
    return middle[:, 0] + np.sum((a + b) * cross[..., None], axis=1) / (3.0 * cross.sum(axis=1)[:, None])


def _painted_over(simulated: lab.BlockSimulation) -> np.ndarray:
    """Return the mask of objects that a surveyed target with its apron covers in part."""
    objects = simulated.scene.objects
    apron = objects.kind == "apron"
    reach = objects.size_m.max(axis=1) / 2.0
    away = np.hypot(*np.moveaxis(objects.position_m[:, None] - objects.position_m[None, apron], 2, 0))
    covered = np.any(away < reach[:, None] + reach[None, apron], axis=1)
    return covered & ~np.isin(objects.kind, ("apron", "target"))


@lru_cache(maxsize=4)
def rendered(simulated: lab.BlockSimulation, view: str, band: str = "pan") -> lab.ImageRenderer:
    """Return the renderer of a view, remembered: making one blurs the textures of the whole scene."""
    return lab.make_renderer(simulated, view, band)


@lru_cache(maxsize=4)
def detected(simulated: lab.BlockSimulation, detector: str) -> list[InterestPoints]:
    """Return the points of both views, remembered."""
    return [detect_interest_points(rendered(simulated, view), detector, CANDIDATES) for view in VIEWS]


def centre_errors(truth: TrueObjects, points: InterestPoints, kinds: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (n, 2) of the centres found of objects of some kinds, and the mask of the objects found.

    A centre belongs to an object when it is of its size (within a third) and nearer than a fifth of it, at least 2 px.
    """
    wanted = np.flatnonzero(np.isin(truth.kind, kinds))
    size = np.sqrt(np.prod(points.size_px, axis=1))
    errors, found = [], np.zeros(len(wanted), dtype=bool)
    for row, index in enumerate(wanted):
        away = np.hypot(*(points.xy - truth.centre[index]).T)
        ratio = size / truth.diameter[index]
        away = np.where((ratio > 0.75) & (ratio < 1.33), away, np.inf)
        if len(away) and away.min() < max(2.0, 0.2 * truth.diameter[index]):
            errors.append(points.xy[np.argmin(away)] - truth.centre[index])
            found[row] = True
    return np.array(errors).reshape(-1, 2), found


def carried(
    simulated: lab.BlockSimulation, points: np.ndarray, first: lab.ImageRenderer, second: lab.ImageRenderer
) -> np.ndarray:
    """Return where points of one image truly are in another, ``(n, 2)``; NaN where they are not inside it."""
    ground = lab.locate_on_surface(first.camera, simulated.scene.terrain, points)
    xy = second.camera.ground_to_image(ground)
    margin = 8.0
    inside = np.all((xy > margin) & (xy < np.array(second.size) - 1.0 - margin), axis=1)
    return np.where(inside[:, None], xy, np.nan)


def pairs(expected: np.ndarray, points: np.ndarray, tolerance_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return indices of expected positions and of the detected points nearest to them within a tolerance."""
    from scipy.spatial import cKDTree

    usable = np.flatnonzero(np.isfinite(expected).all(axis=1))
    distance, nearest = cKDTree(points).query(expected[usable])
    close = distance < tolerance_px
    return usable[close], nearest[close]


def alike(first: InterestPoints, second: InterestPoints, scale: float = 1.0) -> np.ndarray:
    """Return the mask of pairs that may be the same object: size within 1.35, both bright or both dark.

    ``scale`` is the size of the first image's pixels in pixels of the second. Corners have no size: all are alike.
    """
    ratio = np.sqrt(np.prod(first.size_px, axis=1)) * scale / np.sqrt(np.prod(second.size_px, axis=1))
    same = (np.abs(np.log(ratio)) < np.log(1.35)) & (first.contrast * second.contrast > 0.0)
    return np.where(np.isfinite(ratio), same, True)


def repeatability(
    simulated: lab.BlockSimulation, first: np.ndarray, second: np.ndarray, tolerance_px: float = 1.5
) -> float:
    """Return the share of points of the smaller set that the other view has too, where both views see the ground.

    Schmid, Mohr and Bauckhage (2000): repeated points over the smaller number of points in the common part.
    """
    images = [rendered(simulated, view) for view in VIEWS]
    there = carried(simulated, first, *images)
    back = carried(simulated, second, *images[::-1])
    repeated, _ = pairs(there, second, tolerance_px)
    common = min(int(np.isfinite(there[:, 0]).sum()), int(np.isfinite(back[:, 0]).sum()))
    return min(len(repeated) / max(common, 1), 1.0)


def rms(errors: np.ndarray) -> float:
    """Return the root mean square of a coordinate."""
    return float(np.sqrt(np.mean(errors**2)))

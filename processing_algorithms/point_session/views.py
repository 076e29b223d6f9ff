"""View of an image around a ground position, and search ranges of points in other images.

Both use the present cameras.

All residuals of a session in one list, the largest first, and their statistics by role.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...hrsi_engine.adjustment.observations import select_points
from ...hrsi_engine.adjustment.starting_values.intersection import intersect_points
from ...hrsi_engine.block.assembly import assemble
from ...hrsi_engine.block.points import GroundPoints, Role
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import EQUALITY, GROUND, ITERATIONS
from ...hrsi_engine.ground.crs_operations import operations_of as operations_of
from ...hrsi_engine.ground.geodesy import move_ground
from ...hrsi_engine.io.rasters.cropping import pixel_view
from ...hrsi_engine.io.rasters.images import close_images
from ...hrsi_engine.io.surfaces import open_dtm
from ...hrsi_engine.measurement.point_transfer import Transfer, transfer_point
from ...hrsi_engine.refinement.models import MODELS
from ...hrsi_engine.surface.dem import surface_heights
from .chips import differentiate_by_metres, find_by_chips, project_with_slopes
from .files import image_points
from .rows import PANEL, ROLES, TIE, ResidualRow, SurveyPoint
from .session import PointSession


@dataclass(frozen=True)
class View:
    """An image around a position (sample, line): a source in which map x is the sample and map y the negative line.

    ``source`` is empty for an image without pixels; ``half_px`` is half the side of the view, which is rotated by
    ``north_deg`` clockwise so that north is up; ``segment`` has the positions of the point at its possible heights
    ``(3, 2)``, None if no other image determines them.
    """

    source: str
    middle: tuple[float, float]
    half_px: float
    north_deg: float
    segment: np.ndarray | None


def view_of(session: PointSession, name: str, image_id: str) -> View:
    """Return the view of a point in an image, around its measured or, without a measurement, its predicted position."""
    measured, point, image = session.measured.get((name, image_id)), session.points[name], session.images[image_id]
    middle = session.predict_place(name, image_id) if measured is None else (measured.sample, measured.line)
    north = differentiate_by_metres(session, image_id, point)[:, 1]
    others = [other for other, seen in session.measured if other == name and seen != image_id]
    first = next((seen for other, seen in session.measured if other == name), image_id)
    return View(
        "" if image.raster is None else pixel_view(image.path),
        middle,
        PANEL.half_view_px if session.is_located(image_id) else PANEL.vendor_px,
        math.degrees(math.atan2(north[0], -north[1])),
        trace_heights(session, name, first, image_id) if others and measured is None else None,
    )


def trace_heights(session: PointSession, name: str, first_id: str, second_id: str) -> np.ndarray:
    """Return the positions ``(3, 2)`` in one image of a point that is measured in another, by the present cameras.

    They are those at its lowest, highest and most probable height.
    """
    measured, heights = session.measured[(name, first_id)], np.array(list_heights(session, name))
    xy = np.array([[measured.sample, measured.line]] * len(heights))
    return session.project(second_id, locate_ground(session, first_id, xy, heights))


def list_heights(session: PointSession, name: str) -> tuple[float, float, float]:
    """Return the lowest, the highest and the most probable height of a point (m)."""
    point, rays = session.points[name], sum(other == name for other, _ in session.measured)
    if point.role != TIE or rays > 1:
        margin = 2.0 * GROUND.margin_m / 3.0
        return point.height - margin, point.height + margin, point.height
    heights, middle = session.ground_heights_m(), session.middle_height_m()
    if len(heights):
        return float(heights.min()) - GROUND.margin_m, float(heights.max()) + GROUND.margin_m, middle
    ranges = np.array([image.rpc.height_range for image in session.images.values()])
    return float(ranges.min()), float(ranges.max()), middle


def place_on(session: PointSession, image_id: str, lonlat: tuple[float, float], height_m: float) -> tuple[float, float]:
    """Return the position (sample, line) of a ground position in an image, by the last adjustment if there is one."""
    (xy,) = session.project(image_id, np.array([[*lonlat, height_m]]))
    return float(xy[0]), float(xy[1])


def dem_height(dem: str, height_datum: str, lonlat: tuple[float, float]) -> float:
    """Return the ellipsoidal height (m) of a DEM at a position; raise `InputError` if it has none."""
    (height,) = surface_heights(open_dtm(dem, height_datum), np.array([lonlat]))
    if not np.isfinite(height):
        raise InputError(f"{dem}: has no height at {lonlat[0]:.6f}, {lonlat[1]:.6f}: type one")
    return float(height)


def locate_ground(session: PointSession, image_id: str, xy: np.ndarray, heights_m: np.ndarray) -> np.ndarray:
    """Return lon, lat, height ``(n, 3)`` of image positions ``(n, 2)`` at given heights ``(n,)``.

    By the last adjustment if there is one.
    """
    ground = session.images[image_id].rpc.localize(xy, heights_m).ground
    for _ in range(ITERATIONS.most):
        seen, slopes = project_with_slopes(session, image_id, ground)
        if not np.abs(xy - seen).max() > EQUALITY.written_px:
            break
        move = np.linalg.solve(slopes, (xy - seen)[..., None])[..., 0]
        ground = move_ground(ground, np.column_stack([move, np.zeros(len(ground))]))
    return np.asarray(ground)


def new_tie(session: PointSession, name: str, image_id: str, xy: tuple[float, float]) -> SurveyPoint:
    """Return a tie point at an image position, at the median height of the points."""
    ground = locate_ground(session, image_id, np.array([xy]), np.array([session.middle_height_m()]))
    lon, lat, height = ground[0].tolist()
    return SurveyPoint(name, lon, lat, height, TIE)


def place_tie(session: PointSession, name: str) -> SurveyPoint:
    """Return a tie point at the intersection of its rays; unchanged if it has only one, or they do not intersect."""
    point = session.points[name]
    known = GroundPoints([name], np.array([[point.lon, point.lat, point.height]]), np.array([int(Role.TIE)]))
    block = assemble(list(session.images.values()), [known], [image_points(session, {name})])
    observations = select_points(block, block.rays_per_point() >= 2)
    if not observations.count:
        return point
    shown = session.shown
    model = MODELS["none"] if shown is None else shown.model
    values = np.array([() if shown is None else shown.corrections[image.id] for image in block.images])
    lon, lat, height = intersect_points(observations, model, values, block.points.ground)[0].tolist()
    return SurveyPoint(name, lon, lat, height, TIE) if np.isfinite((lon, lat, height)).all() else point


def find_transfers(session: PointSession, name: str, images: Sequence[str] = ()) -> dict[str, Transfer]:
    """Measure a point by matching in those images (default: all) that contain it and in which it is not measured.

    It is matched from the image in which it was measured first; if there is none, from the chips of the library.
    Raises `InputError` if there are no chips either.
    """
    here = [image for (other, image) in session.measured if other == name]
    rows = [row for row in session.measurements(name) if row.is_inside and row.measured is None]
    wanted = [row.image for row in rows if not images or row.image in images]
    try:
        if not here:
            if (found := find_by_chips(session, name, wanted)) or not wanted:
                return found
            raise InputError(f"{name}: it is not measured on any image yet: click on it in one first")
        if session.images[here[0]].raster is None:
            raise InputError(f"{here[0]} has no pixels: there is nothing to match")
        return {image_id: _transfer_to_image(session, name, here[0], image_id) for image_id in wanted}
    finally:
        close_images()  # as in `fit_target`


def _transfer_to_image(session: PointSession, name: str, first_id: str, second_id: str) -> Transfer:
    """Match a point from the image in which it is measured to another one, along the line of its possible heights."""
    first, second = session.images[first_id].raster, session.images[second_id].raster
    if first is None or second is None:
        return Transfer(refusal="no pixels")
    measured = session.measured[(name, first_id)]
    xy = np.array([measured.sample, measured.line])
    line = trace_heights(session, name, first_id, second_id)[:2]
    ground = locate_ground(session, first_id, xy[None], np.array(list_heights(session, name)[-1:]))
    slopes = {image_id: project_with_slopes(session, image_id, ground)[1][0] for image_id in (first_id, second_id)}
    by_first = slopes[second_id] @ np.linalg.inv(slopes[first_id])
    margin_px = max(session.estimate_margin_px(first_id), session.estimate_margin_px(second_id))
    return transfer_point(first, xy, second, line, by_first, margin_px)


def list_residuals(session: PointSession) -> list[ResidualRow]:
    """Return the measurements that have a residual, sorted by its length in standard deviations, the largest first."""
    rows = [
        ResidualRow(session.points[name], image_id, measured.kind, *session.judge((name, image_id)))
        for (name, image_id), measured in session.measured.items()
    ]
    rows = [row for row in rows if not math.isnan(row.residual_px[0])]
    return sorted(rows, key=lambda row: -math.inf if math.isnan(row.statistic) else row.statistic, reverse=True)


def summarise_roles(session: PointSession) -> list[str]:
    """Return one line for each role: numbers of points and measurements, and the RMSE of their residuals."""
    lines, of_points, of_images = [], session.rows(), list_residuals(session)
    for role in (*ROLES[:2], TIE):
        rows = [row for row in of_images if row.point.role == role]
        if not rows:
            continue
        across, down = np.sqrt(np.mean(np.square([row.residual_px for row in rows]), axis=0))
        names = {row.point.id for row in rows}
        text = f"{role}: {len(names)} points, {len(rows)} rays, RMSE {across:.2f}, {down:.2f} px"
        left = [row.residual_m for row in of_points if row.point.role == role and not math.isnan(row.residual_m[0])]
        if left:
            text += ", E {:.2f}, N {:.2f}, H {:.2f} m".format(*np.sqrt(np.mean(np.square(left), axis=0)))
        lines.append(text)
    return lines

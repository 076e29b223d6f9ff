"""A session as the engine's tables, and as layers in the fields of a block's GeoPackage."""

import json
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ...hrsi_engine.block.assembly import stack_image_points
from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.block.points import GroundPoints, ImagePoints, Role
from ...hrsi_engine.ground.geodesy import WGS84
from ...hrsi_engine.ground.operation_uses import read_entry
from ...hrsi_engine.io.geopackage.declared_layers import GroundPointRows, ImagePointRows, ImageRows
from ...hrsi_engine.io.geopackage.layers import Layer
from ...hrsi_engine.results.layers import name_point_operations
from .session import PointSession


def ground_points(session: PointSession, names: Collection[str] | None = None) -> GroundPoints:
    """Return the points of the list, or those of them that are named."""
    points = [point for point in session.points.values() if names is None or point.id in names]
    operations = list(dict.fromkeys(point.operation for point in points if point.operation))
    number = np.array([operations.index(one.operation) if one.operation else -1 for one in points], dtype=np.int16)
    uses = [read_entry(json.loads(one), int((number == k).sum())) for k, one in enumerate(operations)]
    table = GroundPoints.create(
        [point.id for point in points],
        np.array([[point.lon, point.lat, point.height] for point in points]).reshape(-1, 3),
        np.array([int(Role[point.role.upper()]) for point in points], dtype=np.int8),
        np.array([[point.sigma_xy, point.sigma_h] for point in points]).reshape(-1, 2),
        "the list of points",
    )
    return replace(table, operation=number, operations=tuple(uses))


def image_points(session: PointSession, names: Collection[str] | None = None) -> ImagePoints:
    """Return the measurements of the points of the list, or of those of them that are named."""
    keys = [key for key in session.measured if names is None or key[0] in names]
    rows = [session.measured[key] for key in keys]
    return ImagePoints.create(
        [name for name, _ in keys], [image for _, image in keys],
        np.array([[row.sample, row.line] for row in rows]).reshape(-1, 2),
        np.array([row.sigma for row in rows], dtype=np.float64), np.array([row.kind for row in rows], dtype=str),
        np.array([row.quality for row in rows], dtype=np.float64),
    )  # fmt: skip


def images_layer(session: PointSession) -> Layer:
    """Return the images' footprints at the mean height of the points."""
    images = list(session.images.values())
    heights = [point.height for point in session.points.values()]
    height = float(np.mean(heights)) if heights else float(np.mean([image.middle_height_m for image in images]))
    columns = ImageRows(
        id=np.array([image.id for image in images], dtype=str),
        path=np.array([image.path for image in images], dtype=str),
        samples=np.array([image.size[0] if image.size else 0 for image in images], dtype=np.int64),
        lines=np.array([image.size[1] if image.size else 0 for image in images], dtype=np.int64),
        observations=np.zeros(len(images), dtype=np.int64),
        footprint_height_m=np.full(len(images), height),
    )
    return Layer("images", "Polygon", WGS84, [compute_footprint(image, height) for image in images], columns)


def point_layers(session: PointSession) -> list[Layer]:
    """Return ``ground_points`` and ``image_points`` as they stand, without any residual."""
    known = ground_points(session)
    unknown = np.full(len(known), np.nan)
    # All measurements, of tie points too, at the surveyed positions where there are such
    measured = stack_image_points([image_points(session), *([] if session.ties is None else [session.ties])])
    ids, xy = np.asarray(measured.ids), measured.xy
    index = {name: row for row, name in enumerate(known.ids.tolist())}
    at = np.array([index.get(name, -1) for name in ids.tolist()], dtype=np.int64)
    ground = GroundPointRows(
        id=known.ids, role=_role_labels(known.role), height=known.ground[:, 2],
        sigma_east_m=unknown, sigma_north_m=unknown, sigma_height_m=unknown,
        rays=np.bincount(at[at >= 0], minlength=len(known)),
        # The survey, whatever the geometry is
        survey_lon=known.ground[:, 0], survey_lat=known.ground[:, 1], survey_height=known.ground[:, 2],
        sigma_xy=known.sigma_m[:, 0], sigma_h=known.sigma_m[:, 1],
    )  # fmt: skip
    place = np.vstack([known.ground, np.full((1, 3), np.nan)])[at]
    roles = np.append(_role_labels(known.role), "tie")[at]
    nothing = np.full(len(ids), np.nan)
    columns = ImagePointRows(
        id=ids, role=roles, image=np.asarray(measured.image_ids), sample=xy[:, 0], line=xy[:, 1],
        sigma_px=measured.sigma_px, kind=measured.kind, quality=measured.quality,
        residual_sample_px=nothing, residual_line_px=nothing, sigma_sample_px=nothing, sigma_line_px=nothing,
        weight=nothing, flag=np.full(len(ids), ""),
    )  # fmt: skip
    image_points_layer = Layer("image_points", "PointZ", WGS84, place, columns)
    operations = name_point_operations(known)
    return [Layer("ground_points", "PointZ", WGS84, known.ground, ground, operations), image_points_layer]


def _role_labels(role: np.ndarray) -> np.ndarray:
    return np.array([Role(value).label for value in role.tolist()], dtype=str)

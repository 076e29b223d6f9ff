"""The layers of an adjusted block, from the engine's tables."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..adjustment.result import Adjustment
from ..block.block import Image
from ..block.points import POINT_OPERATIONS, GroundPoints, describe_operations
from ..ground.geodesy import WGS84, WGS84_3D
from ..ground.map_crs import map_epsg, project_to_map
from ..io.geopackage.layers import Layer
from . import tables
from .residuals import Residuals
from .surface_figures import surface_residuals_table

RESIDUAL_LAYERS = ("residuals_wgs84", "residuals_utm")


def block_layers(
    result: Adjustment, left: Residuals, delivered: Sequence[Image] = (), selection: tables.LayerSelection | None = None
) -> list[Layer]:
    """Return the layers of ``block.gpkg``.

    result : the adjustment; left : its residuals
    delivered : the images with their refined RPCs, for the footprints; by default those with the original RPCs
    selection : points and measurements in the layers; by default all
    Result: footprints, points, measurements and residuals; laser points, and tie points on a surface, if there are any.
    """
    selection = selection or tables.select_rows(result, left, largest=len(result.block.measurements))
    residuals = tables.residuals_table(result, left, selection.measurements, selection.flags)
    image_points = tables.image_points_table(result, left, selection.measurements, selection.flags)
    footprints = tables.images_table(result, delivered or result.block.images, result.middle[2])
    residual_crs = dict(zip(RESIDUAL_LAYERS, (WGS84_3D, residuals_epsg(result)), strict=True))
    laser = [] if result.laser is None else [tables.laser_points_table(result.laser)]
    ground_points = _point_layer("ground_points", tables.ground_points_table(result, selection.points), WGS84_3D)
    return [
        Layer("images", "Polygon", WGS84, footprints.positions, footprints.columns),
        replace(ground_points, metadata=name_point_operations(result.block.points)),
        _point_layer("image_points", image_points, WGS84_3D),
        *(_point_layer(name, residuals, crs) for name, crs in residual_crs.items()),
        *([_point_layer("surface_residuals", surface_residuals_table(result), WGS84_3D)] if result.surfaces else []),
        *(_point_layer("laser_points", table, WGS84_3D) for table in laser),
    ]


def residuals_epsg(result: Adjustment) -> int:
    """Return the EPSG code of the projected CRS at the middle of a block, for the residual layer."""
    return map_epsg(*result.middle[:2])


def name_point_operations(points: GroundPoints) -> dict[str, str]:
    """Return metadata for a layer of ground points: the coordinate operations from the surveys' CRS to WGS84."""
    described = describe_operations(points)
    return {POINT_OPERATIONS: described} if described else {}


def _point_layer(name: str, table: tables.Table, epsg: int) -> Layer:
    """Return a layer of points; in a projected CRS they have easting and northing, and ellipsoidal heights."""
    place = table.positions
    if epsg != WGS84_3D:
        place = np.column_stack([project_to_map(place, epsg), place[:, 2]])
    return Layer(name, "PointZ", epsg, place, table.columns)

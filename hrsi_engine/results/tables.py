"""An adjusted block as tables for a GIS: footprints, points, measurements and residuals, each with a position.

Every table is its positions (longitude, latitude, height) and the columns that its class of rows declares
(`io.geopackage.declared_layers`, where a new column is declared first). Words and positions that many rows share are
stored once (`Words`, `PickedColumn`), and columns in two parts are not copied into one (`StackedColumn`): as plain
arrays, a million measurements would take hundreds of megabytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment, LaserOutcome
from ..block.block import Block, Image
from ..block.imaging_geometry import compute_footprints
from ..block.points import ROLE_LABELS
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import threshold, thresholds
from ..io.geopackage.declared_layers import GroundPointRows, ImagePointRows, ImageRows, LaserPointRows, ResidualRows
from ..io.geopackage.typed_rows import Column, LayerRows, PickedColumn, StackedColumn, Words, is_any, make_shared_words
from .outliers import ground_flags, measurement_flags
from .residuals import Residuals


@thresholds
class TABLE:
    """Limit for the length of result layers."""

    most_image_residuals: int = threshold(1_000_000, "rows", "largest number of rows of a layer (each takes 200 bytes)")


@dataclass(frozen=True, eq=False)
class Table:
    """Positions ``(n, 3)`` lon, lat, height (array, `PickedColumn` or `StackedColumn`; or polygons) and n rows."""

    positions: Any
    columns: LayerRows


def images_table(result: Adjustment, images: Sequence[Image], height_m: float) -> Table:
    """Return footprints of images at a height, with id, path, size and the image's number of measurements."""
    used = result.has_residual
    count = np.bincount(result.block.measurements.image[used], minlength=len(images))
    columns = ImageRows(
        id=np.array([image.id for image in images]),
        path=np.array([image.path for image in images]),
        samples=np.array([image.size[0] if image.size else 0 for image in images]),
        lines=np.array([image.size[1] if image.size else 0 for image in images]),
        observations=count,
        footprint_height_m=np.full(len(images), height_m),
    )
    return Table(compute_footprints(images, height_m), columns)


def laser_points_table(found: LaserOutcome) -> Table:
    """Return all laser points with the values of their file, whether they constrain the block, and why not."""
    points = found.points
    columns = LaserPointRows(
        id=points.ids,
        track=points.track,
        used=found.reason == "",
        reason=found.reason,
        residual_height_m=found.residual_m,
        ties=found.ties,
        sigma_m=found.sigma_m,
        stated_sigma_m=points.sigma_m,
        misfit_m=points.misfit_m,
        photons=points.photons,
        slope=points.slope,
        canopy_m=points.canopy_m,
    )
    return Table(points.ground, columns)


def choose_positions(result: Adjustment) -> np.ndarray:
    """Return the best known position of each point: adjusted, else surveyed; NaN without either."""
    return np.where(np.isfinite(result.ground), result.ground, result.block.points.ground)


def ground_points_table(result: Adjustment) -> Table:
    """Return all points at their adjusted positions, with sigmas; known ones also with their surveyed positions."""
    points = result.block.points
    place = choose_positions(result)
    here = finite_rows(place)
    surveyed = np.where(result.block.known[:, None], points.ground, np.nan)
    sigma_survey = np.where(result.block.known[:, None], points.sigma_m, np.nan)
    columns = GroundPointRows(
        id=points.ids,
        role=Words(ROLE_LABELS, points.role),
        height=place[:, 2],
        sigma_east_m=result.ground_sigma_m[:, 0],
        sigma_north_m=result.ground_sigma_m[:, 1],
        sigma_height_m=result.ground_sigma_m[:, 2],
        rays=result.block.rays_per_point(),
        survey_lon=surveyed[:, 0],
        survey_lat=surveyed[:, 1],
        survey_height=surveyed[:, 2],
        sigma_xy=sigma_survey[:, 0],
        sigma_h=sigma_survey[:, 1],
    )
    return _select_positions(place, here, columns)


def image_points_table(result: Adjustment, left: Residuals) -> Table:
    """Return all measurements at the position of their point, with residuals, weights and flags."""
    rows = result.block.measurements
    place = choose_positions(result)
    here = finite_rows(place)[rows.point]
    columns = ImagePointRows(
        **_identity_columns(result.block, rows.point, rows.image),
        sample=result.measured_xy[:, 0],
        line=result.measured_xy[:, 1],
        sigma_px=rows.sigma_px,
        kind=rows.kind,
        quality=rows.quality,
        residual_sample_px=left.measured_px[:, 0],
        residual_line_px=left.measured_px[:, 1],
        sigma_sample_px=left.measured_sigma_px[:, 0],
        sigma_line_px=left.measured_sigma_px[:, 1],
        weight=result.weight,
        flag=measurement_flags(result, left),
    )
    return _select_positions(PickedColumn(place, rows.point), here, columns)


def residuals_table(result: Adjustment, left: Residuals, most: int = TABLE.most_image_residuals) -> Table:
    """Return ground residuals (one row per known point) and image residuals (one row per measurement).

    Of more than ``most`` image residuals an even selection is taken, with those of all known points and all outliers;
    the table of image points has all of them.
    """
    # The ground residuals of known points, with their surveyed positions
    points = result.block.points
    here = np.flatnonzero(result.block.known & finite_rows(left.ground_m[:, :2]))
    rows = ResidualRows.of_level(
        "ground",
        len(here),
        id=Words(points.ids, here),
        role=Words(ROLE_LABELS, points.role[here]),
        image=make_shared_words("", len(here)),
        residual_east_m=left.ground_m[here, 0],
        residual_north_m=left.ground_m[here, 1],
        residual_height_m=left.ground_m[here, 2],
        sigma_east_m=left.ground_sigma_m[here, 0],
        sigma_north_m=left.ground_sigma_m[here, 1],
        sigma_height_m=left.ground_sigma_m[here, 2],
        flag=ground_flags(left)[here],
    )
    estimated, in_images = _image_rows(result, left, most)
    return Table(StackedColumn((points.ground[here], estimated)), rows.concatenate(in_images))


def thinning_warnings(result: Adjustment) -> list[str]:
    """Return the warning that the residual layers do not contain every image point."""
    count = len(result.block.measurements)
    if count <= TABLE.most_image_residuals:
        return []
    return [
        f"the residual layers contain about {TABLE.most_image_residuals} of the {count} image points, including all "
        "GCPs, check points and outliers; the layer image_points contains all of them"
    ]


def _select_positions(place: np.ndarray | PickedColumn, here: np.ndarray, columns: LayerRows) -> Table:
    """Return the rows that have a position; the columns themselves if all have one."""
    return Table(place, columns) if here.all() else Table(place[here], columns.select(here))


def _identity_columns(block: Block, point: np.ndarray, image: np.ndarray) -> dict[str, Column]:
    return {
        "id": Words(block.points.ids, point),
        "role": Words(ROLE_LABELS, block.points.role[point]),
        "image": Words(np.array([image.id for image in block.images]), image),
    }


def _image_rows(result: Adjustment, left: Residuals, most: int) -> tuple[PickedColumn, ResidualRows]:
    """Return the positions and the image residuals of measurements whose point has a position."""
    rows = result.block.measurements
    residual, sigma = left.measured_px, left.measured_sigma_px
    place = choose_positions(result)
    here: Any = np.flatnonzero(finite_rows(residual) & finite_rows(place)[rows.point])
    flags = measurement_flags(result, left)
    if len(here) > most:
        shown = ~is_any(flags[here], ("ok",)) | result.block.known[rows.point[here]]
        shown[:: -(-len(here) // most)] = True
        here = here[shown]
    count = len(here)
    here = slice(None) if count == len(rows) else here  # no copy if all rows are used
    found = ResidualRows.of_level(
        "image",
        count,
        **_identity_columns(result.block, rows.point[here], rows.image[here]),
        residual_sample_px=residual[here, 0],
        residual_line_px=residual[here, 1],
        sigma_sample_px=sigma[here, 0],
        sigma_line_px=sigma[here, 1],
        flag=flags[here],
    )
    return PickedColumn(place, rows.point[here]), found

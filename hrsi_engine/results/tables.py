"""An adjusted block as tables for a GIS: footprints, points, measurements and residuals, each with a position.

Every table is its positions (longitude, latitude, height) and the columns that its class of rows declares
(`io.geopackage.declared_layers`, where a new column is declared first). The layers of a large block show a selection
of its measurements; a table of their own has all of them (`iterate_tables`).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..adjustment.source_results import LaserOutcome
from ..block.block import Block, Image
from ..block.imaging_geometry import compute_footprints
from ..block.points import ROLE_LABELS
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import MEMORY, threshold, thresholds
from ..io.geopackage.declared_layers import GroundPointRows, ImagePointRows, ImageRows, LaserPointRows, ResidualRows
from ..io.geopackage.typed_rows import LayerRows
from ..io.point_files.kept_columns import COMPLETE_FILES
from .outliers import FLAGS, classify_measurements, ground_flags
from .residuals import Residuals

TablePart = Mapping[str, np.ndarray]


@thresholds
class TABLE:
    """Limit for the length of result layers."""

    most_image_residuals: int = threshold(200_000, "rows", "largest number of image points that layers have completely")
    image_sample: int = threshold(50_000, "rows", "image points in the layers of a larger block, half the worst")


@dataclass(frozen=True, eq=False)
class Table:
    """Positions ``(n, 3)`` lon, lat, height (or polygons) and n rows."""

    positions: Any
    columns: LayerRows


def images_table(result: Adjustment, images: Sequence[Image], height_m: float) -> Table:
    """Return footprints of images at a height, with id, path, size and the image's number of measurements."""
    count = np.bincount(result.block.measurements.image[result.has_residual], minlength=len(images))
    columns = ImageRows(
        id=np.array([image.id for image in images]),
        path=np.array([image.path for image in images]),
        samples=np.array([image.size[0] if image.size else 0 for image in images]),
        lines=np.array([image.size[1] if image.size else 0 for image in images]),
        observations=count,
        footprint_height_m=np.full(len(images), height_m),
    )
    return Table(compute_footprints(images, height_m), columns)


def laser_points_table(result: LaserOutcome) -> Table:
    """Return all laser points with the values of their file, whether they constrain the block, and why not."""
    points = result.points
    columns = LaserPointRows(
        id=points.ids,
        track=points.track,
        used=result.reason == "",
        reason=result.reason,
        residual_height_m=result.residual_m,
        ties=result.ties,
        sigma_m=result.sigma_m,
        stated_sigma_m=points.sigma_m,
        misfit_m=points.misfit_m,
        photons=points.photons,
        slope=points.slope,
        canopy_m=points.canopy_m,
    )
    return Table(points.ground, columns)


def ground_points_table(result: Adjustment, rows: np.ndarray) -> Table:
    """Return some points ``(n,)`` at their adjusted positions, with sigmas; known ones also with their surveys."""
    points, place = result.block.points, result.positions[rows]
    is_surveyed = result.block.known[rows, None]
    surveyed = np.where(is_surveyed, points.ground[rows], np.nan)
    sigma_survey = np.where(is_surveyed, points.sigma_m[rows], np.nan)
    sigma = result.ground_sigma_m[rows]
    columns = GroundPointRows(
        id=points.ids[rows],
        role=ROLE_LABELS[points.role[rows]],
        height=place[:, 2],
        sigma_east_m=sigma[:, 0],
        sigma_north_m=sigma[:, 1],
        sigma_height_m=sigma[:, 2],
        rays=result.block.rays_per_point()[rows],
        survey_lon=surveyed[:, 0],
        survey_lat=surveyed[:, 1],
        survey_height=surveyed[:, 2],
        sigma_xy=sigma_survey[:, 0],
        sigma_h=sigma_survey[:, 1],
    )
    return Table(place, columns)


@dataclass(frozen=True, eq=False)
class LayerSelection:
    """The points and measurements that layers contain: those with a position, and of many a selection.

    points, measurements : (n,) indices; flags : (all measurements,) index into `FLAGS`
    count : number of all measurements whose point has a position
    """

    points: np.ndarray
    measurements: np.ndarray
    flags: np.ndarray
    count: int

    @property
    def is_complete(self) -> bool:
        """True if the layers contain every measurement."""
        return len(self.measurements) == self.count


def select_rows(
    result: Adjustment, left: Residuals, largest: int = TABLE.most_image_residuals, sample: int = TABLE.image_sample
) -> LayerSelection:
    """Return the rows of the layers; of more than ``largest``: the worst, an even sample, and known points."""
    measured, located = result.block.measurements, finite_rows(result.positions)
    points, rows = np.flatnonzero(located), np.flatnonzero(located[measured.point])
    flags, count = classify_measurements(result, left), len(rows)
    if count > largest:
        statistic = np.nan_to_num(left.statistic[rows])
        displayed = result.block.known[measured.point[rows]]
        displayed[np.argpartition(-statistic, sample // 2)[: sample // 2]] = True
        displayed[:: -(-count // (sample // 2))] = True
        rows = rows[displayed]
        is_listed = result.block.known.copy()
        is_listed[measured.point[rows]] = True
        points = np.flatnonzero(located & is_listed)
    return LayerSelection(points, rows, flags, count)


def selection_warnings(visible: LayerSelection) -> list[str]:
    """Return the warning that the layers do not contain every image point."""
    if visible.is_complete:
        return []
    return [
        f"the layers contain {len(visible.measurements)} of the {visible.count} image points: GCPs, check points, the "
        f"worst, and an even sample; {' and '.join(COMPLETE_FILES.values())} contain all"
    ]


def image_points_table(result: Adjustment, left: Residuals, rows: np.ndarray, flags: np.ndarray) -> Table:
    """Return some measurements ``(n,)`` at the position of their point, with residuals, weights and flags."""
    measured = result.block.measurements
    columns = ImagePointRows(
        **_identity_columns(result.block, rows),
        sample=result.measured_xy[rows, 0],
        line=result.measured_xy[rows, 1],
        sigma_px=measured.sigma_px[rows],
        kind=np.asarray(measured.kind[rows]),
        quality=measured.quality[rows],
        residual_sample_px=left.measured_px[rows, 0],
        residual_line_px=left.measured_px[rows, 1],
        sigma_sample_px=left.measured_sigma_px[rows, 0],
        sigma_line_px=left.measured_sigma_px[rows, 1],
        weight=result.weight[rows],
        flag=FLAGS[flags[rows]],
    )
    return Table(result.positions[measured.point[rows]], columns)


def iterate_tables(result: Adjustment, left: Residuals, selection: LayerSelection) -> dict[str, Iterable[TablePart]]:
    """Return the complete tables of image points and ground points by layer, each in parts with their positions."""
    full = select_rows(result, left, largest=selection.count)
    makers = {
        "image_points": (full.measurements, lambda rows: image_points_table(result, left, rows, selection.flags)),
        "ground_points": (full.points, lambda rows: ground_points_table(result, rows)),
    }
    return {name: _iterate_parts(rows, make) for name, (rows, make) in makers.items()}


def _iterate_parts(rows: np.ndarray, make: Callable[[np.ndarray], Table]) -> Iterator[TablePart]:
    for begin in range(0, len(rows), MEMORY.rows):
        table = make(rows[begin : begin + MEMORY.rows])
        yield {**table.columns, **dict(zip(("lon", "lat", "height"), table.positions.T, strict=True))}


def residuals_table(result: Adjustment, left: Residuals, rows: np.ndarray, flags: np.ndarray) -> Table:
    """Return ground residuals (one row per known point) and image residuals of some measurements ``(n,)``."""
    # The ground residuals of known points, with their surveyed positions
    points = result.block.points
    surveyed = np.flatnonzero(result.block.known & finite_rows(left.ground_m[:, :2]))
    on_ground = ResidualRows.of_level(
        "ground",
        len(surveyed),
        id=points.ids[surveyed],
        role=ROLE_LABELS[points.role[surveyed]],
        image=np.full(len(surveyed), ""),
        residual_east_m=left.ground_m[surveyed, 0],
        residual_north_m=left.ground_m[surveyed, 1],
        residual_height_m=left.ground_m[surveyed, 2],
        sigma_east_m=left.ground_sigma_m[surveyed, 0],
        sigma_north_m=left.ground_sigma_m[surveyed, 1],
        sigma_height_m=left.ground_sigma_m[surveyed, 2],
        flag=ground_flags(left)[surveyed],
    )
    residual, sigma = left.measured_px, left.measured_sigma_px
    rows = rows[finite_rows(residual[rows])]
    in_images = ResidualRows.of_level(
        "image",
        len(rows),
        **_identity_columns(result.block, rows),
        residual_sample_px=residual[rows, 0],
        residual_line_px=residual[rows, 1],
        sigma_sample_px=sigma[rows, 0],
        sigma_line_px=sigma[rows, 1],
        flag=FLAGS[flags[rows]],
    )
    positions = result.positions[result.block.measurements.point[rows]]
    return Table(np.concatenate([points.ground[surveyed], positions]), on_ground.concatenate(in_images))


def _identity_columns(block: Block, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return id, role and image of some measurements."""
    point = block.measurements.point[rows]
    return {
        "id": block.points.ids[point],
        "role": ROLE_LABELS[block.points.role[point]],
        "image": np.array([image.id for image in block.images])[block.measurements.image[rows]],
    }

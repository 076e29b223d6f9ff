"""Data for the figures of a block's report: thinned, so that the page stays small for blocks of any size.

Known points and outliers are always drawn singly, up to some thousand. So are tie points, if they are few; of many, the
worst are drawn, and all of them as cells of the map and of the images.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..block.block import Block, Image
from ..block.columns import group_by_number
from ..block.imaging_geometry import compute_footprint, compute_footprints
from ..block.points import ROLE_LABELS, Role
from ..drawing.block_figures import ImageCard, Picture, PointChip, ReportFigures
from ..drawing.block_map import BlockMap, GroundPicture, TieField
from ..drawing.target_chips import TargetChip
from ..foundation.large_arrays import finite_rows, square_lengths
from ..foundation.thresholds import EQUALITY, GRIDS, LISTS, MEMORY, SAMPLES, threshold, thresholds
from ..io.pages.report import read_picture
from ..io.rasters.images import GdalRaster
from .figures import normalise_residuals, rank_survey_points
from .outliers import is_outlier
from .residuals import Residuals
from .surface_figures import draw_surfaces


@thresholds
class REPORT_PAGE:
    """Limits for the amount of data on the page of the report."""

    chip_half_px: int = threshold(12, "px", "smallest half side of a chip of a point")
    largest_chip_px: int = threshold(36, "px", "largest half side of a chip")
    most_picture_pixels: int = threshold(400_000_000, "px", "largest number read for all pictures: some seconds")


MOST_CHIPS = {Role.GCP: 120, Role.CHECK: 120, Role.TIE: 24}  # the worst of each role
PICTURE_SIDES_PX = {6: 640, 24: 320, 60: 180}  # longer side of a picture, by the largest number of images
LARGEST_PICTURE_PX = max(PICTURE_SIDES_PX.values())

#: Function that finds a target's outline near a position of an image: polylines in pixels, none without a target.
Outline = Callable[[Image, np.ndarray], Sequence[np.ndarray]]


@dataclass(frozen=True, eq=False)
class _PointSelection:
    """Common data of all figures: residuals and statistics of measurements, and the points with a number on the page.

    points : (m,) the points on the page; number : (points,) the number of each, -1 without
    """

    residual_px: np.ndarray
    statistic: np.ndarray
    points: np.ndarray
    number: np.ndarray


def report_figures(
    result: Adjustment, left: Residuals, refined: Sequence[Image] = (), outline: Outline | None = None
) -> ReportFigures:
    """Return the figures of an adjusted block, which `io.pages.report` writes.

    refined : the block's images with their refined RPCs, which determine positions on the map; by default the block's
    outline : finds the outline of a target that was measured: with image and position it gives polylines
    """
    visible = _choose_points(result, left)
    images = refined or result.block.images
    cards = _make_cards(result, visible)
    pictures = _read_pictures(result.block.images, [card.image for card in cards])
    # The map has footprints, points with their residuals, and a field of tie points by cells if they are many
    block, place = result.block, result.positions
    height = result.middle[2]
    ties = np.flatnonzero(~block.known & finite_rows(place))
    is_crowded = len(ties) > SAMPLES.large
    field = TieField(
        place[ties, :2],
        _point_rms(block, visible)[ties],
        np.hypot(*result.ground_sigma_m[ties, :2].T),
        block.rays_per_point()[ties],
    )
    residual = left.ground_m[visible.points]
    return ReportFigures(
        map=BlockMap(
            footprints={image.id: area for image, area in zip(images, compute_footprints(images, height), strict=True)},
            lonlat=place[visible.points, :2],
            roles=block.points.role[visible.points],
            residual_en_m=residual[:, :2],
            ids=block.points.ids[visible.points],
            residual_h_m=residual[:, 2],
            ties=field if is_crowded else None,
            pictures=_lay_out([image for image in images if image.id in pictures], pictures, height),
        ),
        points=_point_columns(result, left, visible),
        pictures=list(pictures.values()),
        cards=[
            replace(card, picture=part.name, picture_size=part.covers) if (part := pictures.get(card.image)) else card
            for card in cards
        ],
        chips=_make_chips(result, visible, outline),
        normalised={
            axis: values[:: max(1, len(values) // MEMORY.values)]
            for axis, values in normalise_residuals(result).items()
        },
        surfaces=draw_surfaces(result),
    )


# ---- points ----------------------------------------------------------------------------------------------------


def _choose_points(result: Adjustment, left: Residuals) -> _PointSelection:
    """Select the points that are drawn singly: known ones, including those of the report's tables, then tie points."""
    block, statistic = result.block, np.nan_to_num(left.statistic)
    worst = np.zeros(len(block.points))
    np.maximum.at(worst, block.measurements.point, statistic)
    placed = finite_rows(result.positions)
    surveyed = _select_worst(np.flatnonzero(placed & block.known), worst, SAMPLES.large)
    names = np.concatenate([rank_survey_points(result, left, role) for role in (Role.GCP, Role.CHECK)])
    surveyed = np.union1d(surveyed, names)  # rows of the page's tables link to their points
    ties = np.flatnonzero(placed & ~block.known)
    if len(ties) > SAMPLES.large:
        ties = _select_worst(ties, worst, LISTS.rows)
    points = np.concatenate([surveyed, ties])
    number = np.full(len(block.points), -1)
    number[points] = np.arange(len(points))
    return _PointSelection(left.measured_px, statistic, points, number)


def _select_worst(points: np.ndarray, worst: np.ndarray, largest: int) -> np.ndarray:
    """Return the points with the largest statistics, in their order."""
    return np.sort(points[np.argsort(-worst[points], kind="stable")[:largest]])


def _point_columns(result: Adjustment, left: Residuals, selection: _PointSelection) -> dict[str, Any]:
    """Return the data of points and of their measurements for the page's script, by columns."""
    block, rows, points = result.block, result.block.measurements, selection.points
    indices = np.flatnonzero(selection.number[rows.point] >= 0)
    indices = indices[np.argsort(selection.number[rows.point[indices]], kind="stable")]
    outlier, is_used = is_outlier(selection.statistic), result.has_residual
    unused = ~is_used & (block.points.role[rows.point] == Role.TIE)
    flag = np.select([unused, outlier], [2, 1], 0)
    worst = np.zeros(len(block.points), dtype=np.int64)
    np.maximum.at(worst, rows.point, flag)
    place = result.positions[points]
    return {
        "images": [image.id for image in block.images],
        "roles": [role.label for role in Role],
        "points": {
            "id": block.points.ids[points].tolist(),
            "role": block.points.role[points].tolist(),
            "lon": np.round(place[:, 0], 7).tolist(),
            "lat": np.round(place[:, 1], 7).tolist(),
            "height": _round_numbers(place[:, 2], 2),
            "east": _round_numbers(left.ground_m[points, 0]),
            "north": _round_numbers(left.ground_m[points, 1]),
            "up": _round_numbers(left.ground_m[points, 2]),
            "residual": _round_numbers(_point_rms(block, selection)[points]),
            "sigma": _round_numbers(np.hypot(*result.ground_sigma_m[points, :2].T)),
            "rays": block.rays_per_point()[points].tolist(),
            "flag": worst[points].tolist(),
        },
        "measurements": {
            "point": selection.number[rows.point[indices]].tolist(),
            "image": rows.image[indices].tolist(),
            "sample": _round_numbers(rows.xy[indices, 0], 2),
            "line": _round_numbers(rows.xy[indices, 1], 2),
            "dx": _round_numbers(selection.residual_px[indices, 0]),
            "dy": _round_numbers(selection.residual_px[indices, 1]),
            "flag": flag[indices].tolist(),
        },
    }


def _round_numbers(values: np.ndarray, digits: int = 3) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in np.round(values, digits).tolist()]


def _point_rms(block: Block, selection: _PointSelection) -> np.ndarray:
    """Return sqrt(mean(dx² + dy²)) over the measurements of each point; NaN without measurements."""
    square = square_lengths(selection.residual_px)
    finite = np.isfinite(square)
    point = block.measurements.point[finite]
    with np.errstate(invalid="ignore"):
        total = np.bincount(point, square[finite], len(block.points))
        return np.sqrt(total / np.bincount(point, minlength=len(block.points)))


# ---- images ----------------------------------------------------------------------------------------------------


def _make_cards(result: Adjustment, visible: _PointSelection) -> list[ImageCard]:
    """Return cards of the images with the largest residuals; known points and outliers first, then some tie points.

    Held-out tie points are not drawn, because their wrong matches were not rejected.
    """
    rows = result.block.measurements
    held_out = (result.block.points.role == Role.HELD_OUT)[rows.point]
    indices = np.flatnonzero(finite_rows(visible.residual_px) & ~held_out)
    if not len(indices):
        return []
    order, bounds = group_by_number(rows.image[indices], len(result.block.images))
    indices = indices[order]
    image = rows.image[indices]
    with np.errstate(invalid="ignore"):
        size = np.bincount(image, square_lengths(visible.residual_px[indices])) / np.bincount(image)
    largest = np.argsort(-size, kind="stable")[: min(LISTS.images, np.count_nonzero(np.isfinite(size)))]
    return [
        _make_card(result, index, indices[bounds[index] : bounds[index + 1]], visible)
        for index in np.sort(largest).tolist()
    ]


def _make_card(result: Adjustment, index: int, part: np.ndarray, visible: _PointSelection) -> ImageCard:
    rows, image = result.block.measurements, result.block.images[index]
    groups = ROLE_LABELS[result.block.points.role[rows.point[part]]].astype("U8")
    groups[is_outlier(visible.statistic[part])] = "outlier"
    ties, other_groups = np.flatnonzero(groups == "tie"), np.flatnonzero(groups != "tie")[: LISTS.rows]
    room = max(LISTS.rows - len(other_groups), 0)
    step = max(1, -(-len(ties) // room)) if room else len(ties) + 1
    vectors = np.concatenate([ties[::step], other_groups])
    first_sample, last_sample, first_line, last_line = image.domain_px
    # Cells of the image, with the mean residual of all measurements in each
    share = (rows.xy[part] - image.centre_px) / (2.0 * image.half_size_px + 1.0) + 0.5
    column, row = np.clip((share * GRIDS.cells).astype(np.int64), 0, GRIDS.cells - 1).T
    cell, shape = row * GRIDS.cells + column, (GRIDS.cells, GRIDS.cells)
    with np.errstate(invalid="ignore", divide="ignore"):
        # The mean residual of each cell and its standard error, NaN with too few residuals
        residual, count = visible.residual_px[part], _sum_cells(cell, None, shape)[:, :, None]
        total, square = (
            np.stack([_sum_cells(cell, values, shape) for values in columns.T], axis=2)
            for columns in (residual, residual**2)
        )
        means = np.where(count >= SAMPLES.plane, total / count, np.nan)
        errors = np.sqrt(np.maximum(square / count - means**2, 0.0) / (count - 1))
    plotted = part[vectors]
    return ImageCard(
        image=image.id,
        extent=np.array([[first_sample, first_line], [last_sample, last_line]]),
        xy=rows.xy[plotted],
        residual_px=visible.residual_px[plotted],
        groups=groups[vectors],
        points=visible.number[rows.point[plotted]],
        total=len(part),
        means=means,
        mean_sigmas=errors,
    )


def _sum_cells(cell: np.ndarray, weights: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    return np.bincount(cell, weights, shape[0] * shape[1]).reshape(shape)


def _read_pictures(images: Sequence[Image], image_ids: Sequence[str]) -> dict[str, Picture]:
    """Return pictures of the wanted images with pixels in files, by image id, as long as reading them is fast."""
    side = next((side for largest, side in PICTURE_SIDES_PX.items() if len(image_ids) <= largest), 0)
    result: dict[str, Picture] = {}
    pixels = 0
    for image in images:
        if image.id not in image_ids or not isinstance(image.raster, GdalRaster):
            continue
        pixels += image.raster.size[0] * image.raster.size[1]
        if pixels > REPORT_PAGE.most_picture_pixels:
            break
        picture = read_picture(image.raster, image.id, len(result), side)
        if picture is not None:
            result[image.id] = picture
    return result


def _lay_out(images: Sequence[Image], pictures: Mapping[str, Picture], height_m: float) -> list[GroundPicture]:
    """Return the pictures on the ground; those covered by others are hidden until their image is selected."""
    result, covered = [], None
    for image in images:
        first_sample, last_sample, first_line, last_line = image.domain_px
        left, right, top, bottom = first_sample - 0.5, last_sample + 0.5, first_line - 0.5, last_line + 0.5
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        ground = image.rpc.localize(corners, height_m).ground[:, :2]
        if not np.isfinite(ground).all():
            continue
        area = compute_footprint(image, height_m)
        new = area if covered is None else area.difference(covered)
        adds = new.area > EQUALITY.negligible * area.area
        covered = area if covered is None else covered.union(area)
        picture = pictures[image.id]
        result.append(GroundPicture(picture.name, image.id, picture.covers, ground, hidden=not adds))
    return result


# ---- chips -----------------------------------------------------------------------------------------------------


def _make_chips(result: Adjustment, visible: _PointSelection, outline: Outline | None) -> list[PointChip]:
    """Return chips of GCPs, check points and the worst tie points, the worst first, each on all of its images."""
    block, rows = result.block, result.block.measurements
    pixels = np.array([image.raster is not None for image in block.images], dtype=bool)
    is_drawn = finite_rows(visible.residual_px) & pixels[rows.image]
    role, outlier = block.points.role[rows.point], is_outlier(visible.statistic)
    worst = np.zeros(len(block.points))
    np.maximum.at(worst, rows.point[is_drawn], visible.statistic[is_drawn])
    chip_rows: list[int] = []
    for index, largest in MOST_CHIPS.items():
        indices = np.flatnonzero(is_drawn & (role == index))
        indices = indices[np.lexsort((rows.image[indices], rows.point[indices], -worst[rows.point[indices]]))]
        cut = (
            indices[largest] if len(indices) > largest else -1
        )  # a point that would not have chips on all of its images
        chip_rows += (
            indices[:largest][rows.point[indices[:largest]] != rows.point[cut]].tolist()
            if cut >= 0
            else indices.tolist()
        )
    chips = []
    for row in chip_rows:
        image, point, xy = block.images[rows.image[row]], rows.point[row], result.measured_xy[row]
        residual = visible.residual_px[row]
        curves = tuple(outline(image, xy)) if outline is not None and role[row] == Role.GCP else ()
        # The pixels around a measurement, with its outline and, if near, the computed position
        reach = [1.5 * float(np.abs(residual).max()), *(float(np.abs(curve - xy).max()) + 3.0 for curve in curves)]
        half = int(np.clip(max(reach), REPORT_PAGE.chip_half_px, REPORT_PAGE.largest_chip_px))
        low = np.round(xy).astype(int) - half
        grey, _ = image.pixels.read(int(low[0]), int(low[1]), 2 * half + 1, 2 * half + 1)
        nothing = np.empty((0, 2))
        unused = np.empty(0, dtype=bool)
        chip = TargetChip(grey, low.astype(np.float64), nothing, unused, curves, xy, computed=xy - residual)
        chips.append(
            PointChip(
                id=str(block.points.ids[point]),
                image=image.id,
                role=Role(role[row]).label,
                point=int(visible.number[point]),
                residual_px=residual,
                outlier=bool(outlier[row]),
                chip=chip,
            )
        )
    return chips

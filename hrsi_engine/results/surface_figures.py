"""Results of matching a block with a surface, for report, layer and page."""

import base64
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..adjustment.source_results import SurfaceOutcome
from ..drawing.block_figures import SurfacePicture
from ..drawing.target_chips import encode_png
from ..foundation.thresholds import GRIDS, SIGNIFICANCE, threshold, thresholds
from ..ground.geodesy import ground_difference_m
from ..io.geopackage.declared_layers import SurfaceResidualRows
from ..surface.dem import surface_heights
from .tables import Table


@thresholds
class SURFACE_PICTURE:
    """Sizes of the pictures of the match with a surface."""

    pixel: int = threshold(5, "px", "side of a cell or displacement in the picture")


def describe_surface(one: SurfaceOutcome) -> dict[str, Any]:
    """Return the report's entry of a part of the block that was matched with a surface."""
    match, sigma = one.match, np.sqrt(one.covariance_m2.diagonal())
    squares, axes = np.linalg.eigh(one.covariance_m2[:2, :2])
    return {
        "images": list(one.images),
        "holds_plan": not one.open,
        "why_not": one.open or None,
        "displacement_m": match.displacement_m.tolist(),
        "sigma_m": sigma.tolist(),
        "left_m": one.left_m.tolist(),
        "ellipse": {
            "semi_major_m": float(np.sqrt(squares[1])),
            "semi_minor_m": float(np.sqrt(squares[0])),
            "azimuth_deg": float(np.degrees(np.arctan2(axes[0, 1], axes[1, 1])) % 180.0),
        },
        "points": match.points,
        "independent_cells": match.cells,
        "score_m": match.scatter_m,
        "score_before_m": match.before_m if np.isfinite(match.before_m) else None,
        "second_m": None if match.second_m is None else match.second_m.tolist(),
        "second_ratio": match.second_ratio if np.isfinite(match.second_ratio) else None,
        "pointing_m": one.pointing_m,
        "beyond_pointing": one.beyond_pointing,
    }


def compute_surface_residuals(result: Adjustment, one: SurfaceOutcome) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return adjusted positions ``(k, 3)`` of tie points, and their heights above the surface before and after, m."""
    adjusted = result.positions[one.points]
    before_m, after_m = (
        positions[:, 2] - surface_heights(one.surface, positions[:, :2]) for positions in (one.before, adjusted)
    )
    return adjusted, before_m, after_m


def surface_residuals_table(result: Adjustment) -> Table:
    """Return the tie points that were matched with surfaces, and their heights above these."""
    parts = [compute_surface_residuals(result, one) for one in result.surfaces]
    adjusted, before_m, after_m = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    points = np.concatenate([one.points for one in result.surfaces])
    valid = np.flatnonzero(np.isfinite(adjusted).all(axis=1) & np.isfinite(after_m))
    rows = SurfaceResidualRows(
        id=result.block.points.ids[points[valid]],
        residual_before_m=before_m[valid],
        residual_height_m=after_m[valid],
        holds=np.repeat([not one.open for one in result.surfaces], [len(one.points) for one in result.surfaces])[valid],
    )
    return Table(adjusted[valid], rows)


def draw_surfaces(result: Adjustment) -> list[SurfacePicture]:
    """Return pictures of the score over all displacements searched, and of the residuals before and after."""
    outcome = []
    for one in result.surfaces:
        scores, following, before_m, after_m = one.match.scores_m, *compute_surface_residuals(result, one)
        if scores is None or one.match.offsets_m is None:
            continue
        side = int(np.sqrt(len(scores)))
        square = scores.reshape(side, side)[::-1]  # north up
        limit_m = SIGNIFICANCE.sigmas * one.match.scatter_m
        places_m = ground_difference_m(following, np.broadcast_to(following[0], following.shape))[:, :2]
        maps = [_average_residuals(places_m, np.clip(values, -limit_m, limit_m)) for values in (before_m, after_m)]
        outcome.append(
            SurfacePicture(
                one.images,
                _picture(square, np.nanmin(square), np.nanmax(square)),
                [_picture(values, -limit_m, limit_m) for values in maps],
                float(np.abs(one.match.offsets_m).max()),
                limit_m,
            )
        )
    return outcome


def _average_residuals(places_m: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return mean values of cells of the ground ``(rows, columns)``, north up; NaN for cells without points."""
    finite = np.isfinite(places_m).all(axis=1) & np.isfinite(values)
    low, size = np.nanmin(places_m, axis=0), np.ptp(places_m[np.isfinite(places_m).all(axis=1)], axis=0)
    cell = max(float(size.max()) / GRIDS.fine, 1e-3)
    columns, rows = (np.floor(size / cell).astype(int) + 1).tolist()
    column, row = np.floor((places_m[finite] - low) / cell).astype(np.int64).T
    place, shape = (rows - 1 - row) * columns + column, rows * columns
    with np.errstate(invalid="ignore"):
        means = np.bincount(place, values[finite], shape) / np.bincount(place, minlength=shape)
    return np.asarray(means.reshape(rows, columns))


def _picture(values: np.ndarray, low: float, high: float) -> tuple[str, int, int]:
    """Return a picture of values as a ``data:`` URI, its width and height; white is ``high`` or unknown."""
    share = np.nan_to_num((values - low) / max(high - low, 1e-9), nan=1.0)
    grey = np.kron(np.clip(255.0 * share, 0.0, 255.0).astype(np.uint8), np.ones((SURFACE_PICTURE.pixel,) * 2, np.uint8))
    return f"data:image/png;base64,{base64.b64encode(encode_png(grey)).decode('ascii')}", grey.shape[1], grey.shape[0]

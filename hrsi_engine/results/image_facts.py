"""The report's entries on images and pairs: acquisition, view, tie points, and the change by the refinement.

An image's correction is the difference of the original and the refined RPC, over a grid of its pixels at the height of
the block: in the image, a pixel minus the projection by the original RPC of its ground position by the refined one; on
the ground, the refined position of the pixel minus the original one. The RMS of tie points is that of ``ties``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse

from ..adjustment.result import Adjustment
from ..block.block import Image, Role
from ..block.imaging_geometry import ViewDirection, compute_footprint, compute_pair_geometry, find_touching_pairs
from ..block.pointing import find_image_sensor
from ..foundation.errors import SolveError
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import ground_difference_m
from ..ground.map_crs import middle_position
from ..io.rasters.sun_angles import read_time
from ..refinement.model import RefitRPC
from ..refinement.parameter_names import describe_parameter
from ..surface.grid_surface import ConstantHeight
from .residuals import Residuals, by_image, radial_rmse
from .tables import choose_positions


@thresholds
class IMAGE_FACTS:
    """Limits for facts on images and pairs in the report."""

    grid: int = threshold(5, "positions", "along each side of an image, at which its correction is computed")
    most_pairs: int = threshold(1000, "pairs", "most that are listed, those with most tie points first")


def add_image_facts(
    report: dict[str, Any], result: Adjustment, left: Residuals, refined: Sequence[RefitRPC]
) -> dict[str, Any]:
    """Return a block's report with facts on its images, pairs and parameters, and the position of the block."""
    place = choose_positions(result)
    known = finite_rows(place).any()
    images = result.block.images
    middle = middle_position(place) if known else np.array([images[0].rpc.long_off, images[0].rpc.lat_off, np.nan])
    heights = [float(middle[2]) if known else image.middle_height_m for image in images]
    views = [ViewDirection(image, ConstantHeight(h)) for image, h in zip(images, heights, strict=True)]
    ties = dict(by_image(result.block, _tie_rows(result)))
    for index, (image, view) in enumerate(zip(images, views, strict=True)):
        here = ties.get(index, np.zeros(0, dtype=np.int64))
        # Mean and root mean square of the correction, in the image (px) and on the ground (m); None if undefined
        height_m = heights[index]
        grid = image.grid_px(IMAGE_FACTS.grid, IMAGE_FACTS.grid)
        after, before = refined[index].rpc.localize(grid, height_m).ground, image.rpc.localize(grid, height_m).ground
        finite = finite_rows(after) & finite_rows(before)
        pixels = grid[finite] - image.rpc.project(after[finite])
        metres = ground_difference_m(after[finite], before[finite])[:, :2]
        told = {"mean_sample_px": pixels[:, 0], "mean_line_px": pixels[:, 1],
                "mean_east_m": metres[:, 0], "mean_north_m": metres[:, 1]}  # fmt: skip
        correction = {
            **{name: float(np.mean(values)) if finite.any() else None for name, values in told.items()},
            "rms_px": radial_rmse(pixels), "rms_m": radial_rmse(metres),
        }  # fmt: skip
        try:
            geometry: Any = view.geometry()
        except SolveError:  # a damaged RPC, reported by the verdict
            geometry = None
        names = ("gsd_sample_m", "gsd_line_m", "incidence_deg", "azimuth_deg")
        report["images"][image.id] |= {
            **describe_acquisition(image), **{name: getattr(geometry, name, None) for name in names},
            "tie_points": len(here), "tie_before_rmse_px": radial_rmse(left.tie_before_px[here]),
            "tie_rmse_px": radial_rmse(result.residual_px[here]),
            "correction": correction,
        }  # fmt: skip
        if result.jitter is not None and image.id in result.jitter.curves:
            curve = result.jitter.curves[image.id]
            names = ("rms_sample_px", "rms_line_px", "sigma_sample_px", "sigma_line_px")
            squares = np.concatenate([curve.shift_px, curve.sigma_px], axis=1) ** 2
            rms = np.sqrt(squares.mean(axis=0)).tolist()
            report["images"][image.id]["jitter"] = dict(zip(names, rms, strict=True))
    return report | {
        "place": {"lon": float(middle[0]), "lat": float(middle[1]), "height_m": float(middle[2]) if known else None},
        "pairs": describe_pairs(result, views, heights),
        "parameters": {
            name: describe_parameter(name) for entry in report["images"].values() for name in entry["parameters"]
        },
    }


def describe_acquisition(image: Image) -> dict[str, Any]:
    """Return satellite and time (UTC) of an image; None if neither its metadata nor its name contain them."""
    published = find_image_sensor(image)
    time = read_time(image.path) if image.path else None
    return {
        "sensor": published.title if published else image.sensor or None,
        "acquired": None if time is None else time.strftime("%Y-%m-%dT%H:%M:%SZ"),
    }


def _tie_rows(result: Adjustment) -> np.ndarray:
    """Return True for the measurements of tie points that are used, ``(measurements,)``."""
    tie = result.block.points.role[result.block.measurements.point] == Role.TIE
    return np.asarray(result.has_residual & tie)


def describe_pairs(
    result: Adjustment, views: Sequence[ViewDirection], heights_m: Sequence[float]
) -> list[dict[str, Any]]:
    """Return overlap, geometry, common tie points and their RMSE of pairs that overlap or share tie points."""
    rows, used = result.block.measurements, np.flatnonzero(_tie_rows(result))
    at, shape = (rows.point[used], rows.image[used]), (len(result.block.points), len(views))
    seen = sparse.csr_matrix((np.ones(len(used)), at), shape)
    square = sparse.csr_matrix((np.sum(result.residual_px[used] ** 2, axis=1), at), shape)
    common = sparse.triu(seen.T @ seen, 1).tocsr()
    squares = (square.T @ seen + seen.T @ square).tocsr()
    touching = find_touching_pairs([compute_footprint(view.image, h) for view, h in zip(views, heights_m, strict=True)])
    pairs = {*zip(*(index.tolist() for index in common.nonzero()), strict=True), *touching}
    chosen = sorted(sorted(pairs, key=lambda pair: (-common[pair], pair))[: IMAGE_FACTS.most_pairs])
    found = []
    for first, second in chosen:
        count = int(common[first, second])
        try:
            pair = compute_pair_geometry(views[first], views[second])
            geometry: tuple[float | None, ...] = (*pair.overlap, pair.convergence_deg, pair.base_to_height)
        except SolveError:  # a damaged RPC
            geometry = (None,) * 4
        names = ("overlap_first", "overlap_second", "convergence_deg", "base_to_height")
        found.append(
            {
                "first": views[first].image.id, "second": views[second].image.id, "tie_points": count,
                "tie_rmse_px": float(np.sqrt(squares[first, second] / (2 * count))) if count else None,
                **dict(zip(names, geometry, strict=True)),
            }
        )  # fmt: skip
    return found

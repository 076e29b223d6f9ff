"""The report's entries on images and pairs: acquisition, view, tie points, and the change by the refinement.

An image's correction is the difference of the original and the refined RPC, over a grid of its pixels at the height of
the block: in the image, a pixel minus the projection by the original RPC of its ground position by the refined one; on
the ground, the refined position of the pixel minus the original one. The RMS of tie points is that of ``ties``.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import sparse
from shapely.geometry import Polygon

from ..adjustment.result import Adjustment
from ..block.block import Image, stack_rpcs
from ..block.imaging_geometry import ViewDirection, compute_pair_geometries, describe_views, find_touching_pairs
from ..block.pointing import find_image_sensor
from ..foundation.large_arrays import finite_rows, square_lengths
from ..foundation.thresholds import GRIDS, SAMPLES
from ..ground.geodesy import ground_difference_m
from ..io.rasters.sun_angles import read_time
from ..refinement.model import RefitRPC
from ..refinement.model_table import describe_parameter
from .residuals import Residuals, group_rmse, radial_rmse


def add_image_facts(
    report: dict[str, Any], result: Adjustment, left: Residuals, refined: Sequence[RefitRPC]
) -> dict[str, Any]:
    """Return a block's report with facts on its images, pairs and parameters, and the position of the block."""
    has_position, images = finite_rows(result.positions).any(), result.block.images
    middle = result.middle if has_position else (images[0].rpc.long_off, images[0].rpc.lat_off, np.nan)
    heights = [float(middle[2]) if has_position else image.middle_height_m for image in images]
    views = ViewDirection.at_heights(images, heights)
    sound = [index for index, view in enumerate(views) if view.is_sound]  # damaged RPCs are reported by the verdict
    centres, footprints = ([getattr(views[k], attribute) for k in sound] for attribute in ("centre", "footprint"))
    described = describe_views([images[k] for k in sound], np.concatenate([np.zeros((0, 3)), *centres]), footprints)
    geometry = dict(zip(sound, described, strict=True))
    corrections = _describe_corrections(images, refined, np.array(heights))
    ties = np.flatnonzero(result.is_used_tie)
    owner = result.block.measurements.image[ties]
    tie_counts = np.bincount(owner, minlength=len(images)).tolist()
    before_px, after_px = (group_rmse(px[ties], owner, len(images)) for px in (left.tie_before_px, result.residual_px))
    for index, image in enumerate(images):
        names = ("gsd_sample_m", "gsd_line_m", "incidence_deg", "azimuth_deg")
        report["images"][image.id] |= {
            **describe_acquisition(image),
            **{name: getattr(geometry.get(index), name, None) for name in names},
            "tie_points": tie_counts[index],
            "tie_before_rmse_px": before_px[index],
            "tie_rmse_px": after_px[index],
            "correction": corrections[index],
        }
        if result.jitter is not None and image.id in result.jitter.curves:
            curve = result.jitter.curves[image.id]
            names = ("rms_sample_px", "rms_line_px", "sigma_sample_px", "sigma_line_px")
            squares = np.concatenate([curve.shift_px, curve.sigma_px], axis=1) ** 2
            rms = np.sqrt(squares.mean(axis=0)).tolist()
            report["images"][image.id]["jitter"] = dict(zip(names, rms, strict=True))
    return report | {
        "place": {
            "lon": float(middle[0]),
            "lat": float(middle[1]),
            "height_m": float(middle[2]) if has_position else None,
        },
        "pairs": describe_pairs(result, views),
        "parameters": {
            name: describe_parameter(name) for entry in report["images"].values() for name in entry["parameters"]
        },
    }


def _describe_corrections(
    images: Sequence[Image], refined: Sequence[RefitRPC], heights_m: np.ndarray
) -> list[dict[str, float | None]]:
    """Return mean and root mean square of each image's correction, in px and on the ground in m; None if undefined."""
    grids = np.stack([image.grid_px(GRIDS.coarse, GRIDS.coarse) for image in images])
    grid, index = grids.reshape(-1, 2), np.repeat(np.arange(len(images)), grids.shape[1])
    original = stack_rpcs(images)
    final = stack_rpcs([replace(image, rpc=new.rpc) for image, new in zip(images, refined, strict=True)])
    refined_xy, given_xy = (stack.localize(index, grid, heights_m[index]) for stack in (final, original))
    finite = finite_rows(refined_xy) & finite_rows(given_xy)
    pixels, metres = np.full((len(grid), 2), np.nan), np.full((len(grid), 2), np.nan)
    pixels[finite] = grid[finite] - original.project(index[finite], refined_xy[finite])
    metres[finite] = ground_difference_m(refined_xy[finite], given_xy[finite])[:, :2]
    result = []
    for px, m in zip(pixels.reshape(grids.shape), metres.reshape(grids.shape), strict=True):
        means = (
            np.concatenate([one[finite_rows(one)].mean(axis=0) for one in (px, m)]).tolist()
            if finite_rows(px).any()
            else [None] * 4
        )
        names = ("mean_sample_px", "mean_line_px", "mean_east_m", "mean_north_m")
        result.append(dict(zip(names, means, strict=True)) | {"rms_px": radial_rmse(px), "rms_m": radial_rmse(m)})
    return result


def describe_acquisition(image: Image) -> dict[str, Any]:
    """Return satellite and time (UTC) of an image; None if neither its metadata nor its name contain them."""
    published = find_image_sensor(image)
    time = read_time(image.path) if image.path else None
    return {
        "sensor": published.title if published else image.sensor or None,
        "acquired": None if time is None else time.strftime("%Y-%m-%dT%H:%M:%SZ"),
    }


def describe_pairs(result: Adjustment, views: Sequence[ViewDirection]) -> list[dict[str, Any]]:
    """Return overlap, geometry, common tie points and their RMSE of pairs that overlap or share tie points."""
    rows, used_rows = result.block.measurements, np.flatnonzero(result.is_used_tie)
    indices, shape = (rows.point[used_rows], rows.image[used_rows]), (len(result.block.points), len(views))
    incidence = sparse.csr_matrix((np.ones(len(used_rows)), indices), shape)
    # One product has the numbers of common tie points as its real part, and their squares on one image as the imaginary
    square = sparse.csr_matrix((1.0 + 1j * square_lengths(result.residual_px[used_rows]), indices), shape)
    one_sided = square.T @ incidence
    joint = sparse.triu(one_sided + one_sided.T, 1).tocoo()
    pairs_sharing = list(zip(joint.row.tolist(), joint.col.tolist(), strict=True))
    common, square_px = (
        dict(zip(pairs_sharing, values.tolist(), strict=True)) for values in (0.5 * joint.data.real, joint.data.imag)
    )
    sound = [view.is_sound for view in views]
    touching = find_touching_pairs([view.footprint if ok else Polygon() for view, ok in zip(views, sound, strict=True)])
    order = sorted({*common, *touching}, key=lambda pair: (-common.get(pair, 0), pair))
    listed_pairs = sorted(order[: SAMPLES.large])
    sound_pairs = [pair for pair in listed_pairs if all(sound[index] for index in pair)]
    geometries = dict(zip(sound_pairs, compute_pair_geometries(views, sound_pairs), strict=True))
    outcome = []
    for first, second in listed_pairs:
        count, pair = int(common.get((first, second), 0)), geometries.get((first, second))
        overlap = (None, None) if pair is None else pair.overlap
        outcome.append(
            {
                "first": views[first].image.id,
                "second": views[second].image.id,
                "tie_points": count,
                "tie_rmse_px": float(np.sqrt(square_px[first, second] / (2 * count))) if count else None,
                "overlap_first": overlap[0],
                "overlap_second": overlap[1],
                "convergence_deg": getattr(pair, "convergence_deg", None),
                "base_to_height": getattr(pair, "base_to_height", None),
            }
        )
    return outcome

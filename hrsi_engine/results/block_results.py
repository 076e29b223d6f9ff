"""All results of an adjustment, assembled once: residuals, refined RPCs, the report's entries and the verdict.

Writers take them from here and do not depend on one another: layers, record, page and RPC files each have their own.

The report's entries on images and pairs are acquisition, view, tie points, and the change by the refinement. An image's
correction is the difference of the original and the refined RPC, over a grid of its pixels at the height of the block:
in the image, a pixel minus the projection by the original RPC of its ground position by the refined one; on the ground,
the refined position of the pixel minus the original one. The RMS of tie points is that of ``ties``.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse
from shapely.geometry import Polygon

from ..adjustment.result import Adjustment
from ..block.block import Image, Role, stack_rpcs
from ..block.imaging_geometry import ViewDirection, compute_pair_geometries, describe_views, find_touching_pairs
from ..block.jitter_curve import JitterCurve
from ..block.pointing import find_image_sensor
from ..drawing.block_figures import draw_figures
from ..foundation.large_arrays import finite_rows, square_lengths
from ..foundation.reasons import Level
from ..foundation.thresholds import GRIDS, SAMPLES, threshold, thresholds
from ..foundation.workers.threads import one_thread_calls
from ..ground.geodesy import ground_difference_m
from ..io.geopackage.layers import Layer
from ..io.rasters.sun_angles import read_time
from ..refinement.model import RefitRPC
from ..refinement.model_table import describe_parameter
from .block_record import joint_arrays, make_record
from .drawings import Outline, report_figures
from .figures import statistic_entries
from .judged_block import JudgedBlock
from .layers import block_layers, residuals_epsg
from .line_profiles import describe_line_profiles
from .lineage import lineage_items
from .residuals import Residuals, group_rmse, radial_rmse, rmse
from .stac import describe_item
from .tables import iterate_tables, select_rows, selection_warnings
from .verdict import Verdict

NSSDA_PLAN, NSSDA_HEIGHT = 2.4477, 1.9600  # 95 % limits in plan and height, in standard deviations


@thresholds
class ACCURACY_STATEMENT:
    """Numbers of check points and ratio of RMSEs in accuracy standards."""

    asprs_points: int = threshold(30, "points", "fewest check points of a test", "ASPRS 2024, edition 2")
    nssda_points: int = threshold(20, "points", "fewest check points of a test", "FGDC-STD-007.3-1998")
    nssda_ratio: float = threshold(
        0.6, "", "smallest ratio of the RMSEs in plan for which the circular error is defined", "FGDC-STD-007.3-1998"
    )


@dataclass(frozen=True, eq=False)
class BlockResult:
    """A block's results before anything is written.

    adjustment, residuals : of the block
    pairs : the images with their original RPCs, and the refined ones
    report : entries of ``report.json``; those on written files are added by the writers
    verdict : level (ok, doubtful, unusable) and its reasons
    lineage : metadata of the refined images, by name
    items : refined images as STAC items without their files, if they were requested
    layers : those of ``block.gpkg``
    tables : parts of complete tables by layer, if the layers contain a selection of the points
    """

    adjustment: Adjustment
    residuals: Residuals
    pairs: Sequence[tuple[Image, RefitRPC]]
    report: dict[str, Any]
    verdict: Verdict
    lineage: Mapping[str, str]
    items: Sequence[dict[str, Any]]
    layers: Sequence[Layer]
    tables: Mapping[str, Iterable[Mapping[str, np.ndarray]]]

    @property
    def is_unusable(self) -> bool:
        """True if no refined RPC should be written."""
        return self.verdict.level is Level.UNUSABLE

    @property
    def record(self) -> dict[str, Any]:
        """Contents of ``block.json``, for images that are added to the block later."""
        return make_record(self.adjustment)

    @property
    def cameras(self) -> dict[str, np.ndarray] | None:
        """The joint estimates of all cameras, as arrays by name; None if images were adjusted separately."""
        return None if self.adjustment.joint is None else joint_arrays(self.adjustment.joint)

    @property
    def jitter_curves(self) -> Mapping[str, JitterCurve] | None:
        """Curves of the removed jitter, by image id; None if it was not estimated."""
        return None if self.adjustment.jitter is None else self.adjustment.jitter.curves

    def draw(self, outline: Outline) -> dict[str, Any]:
        """Return the drawings of the page; ``outline`` finds target outlines."""
        delivered = [replace(image, rpc=new.rpc) for image, new in self.pairs]
        return draw_figures(report_figures(self.adjustment, self.residuals, delivered, outline))


def assemble_result(
    judged: JudgedBlock,
    record: Mapping[str, Any],
    entries: Mapping[str, Any],
    report_path: str = "",
    with_items: bool = False,
) -> BlockResult:
    """Return the results of an adjustment.

    record : the report's entries on the run: version, options, inputs
    entries : further entries of the report, other than those on the block
    report_path : later path of the report; with_items : True if images are described as STAC items
    """
    evidence, adjustment, residuals = judged.evidence, judged.adjustment, judged.residuals
    refined, selection = evidence.refined, select_rows(adjustment, residuals)
    images = adjustment.block.images
    with one_thread_calls():  # many small matrices, for which BLAS threads only cost time
        report = {
            **record,
            "verdict": judged.verdict.entry(),
            "seconds": {},
            "crs": {**record["crs"], "residuals": f"EPSG:{residuals_epsg(adjustment)}"},
            **judged.figures,
            **statistic_entries(adjustment, residuals),
            "accuracy": state_accuracy_by_standards(adjustment, residuals),
            "line_profiles": describe_line_profiles(images, evidence.profiles, evidence.waves),
            "warnings": [*judged.warnings, *selection_warnings(selection)],
            **entries,
        }
        report = add_image_facts(report, adjustment, residuals, refined)
        pairs = list(zip(images, refined, strict=True))
        delivered = [replace(image, rpc=new.rpc) for image, new in pairs]
        layers = block_layers(adjustment, residuals, delivered, selection)
    complete = {} if selection.is_complete else iterate_tables(adjustment, residuals, selection)
    lineage, folder = lineage_items(report, report_path), os.path.dirname(report_path)
    items = [describe_item(image, new, report, folder) for image, new in pairs] if with_items else []
    return BlockResult(
        adjustment=adjustment,
        residuals=residuals,
        pairs=pairs,
        report=report,
        verdict=judged.verdict,
        lineage=lineage,
        items=items,
        layers=layers,
        tables=complete,
    )


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


def state_accuracy_by_standards(result: Adjustment, left: Residuals) -> dict[str, Any] | None:
    """Return mean errors of the check points and the statements of NSSDA and ASPRS, m; None without check points.

    A figure is None if its coordinates were not surveyed. Means are survey - computed.

    * NSSDA (FGDC-STD-007.3-1998, appendix 3-A), at 95 % confidence: 2.4477 · (RMSE_east + RMSE_north) / 2, defined if
        the smaller of the two is at least 0.6 of the larger; 1.9600 · RMSE_height; 20 check points are required.
    * ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (version 2, 2024). The standard adds
      the survey error of the check points to the errors found at them, and requires 30 check points::

          RMSE_H = sqrt(RMSE_H1² + RMSE_H2²)      RMSE_H1 = sqrt(RMSE_east² + RMSE_north²)      RMSE_H2: of the survey
          RMSE_V = sqrt(RMSE_V1² + RMSE_V2²)      RMSE_3D = sqrt(RMSE_H² + RMSE_V²)
    """
    check = np.flatnonzero(result.block.points.role == Role.CHECK)
    error = left.ground_m[check]
    plan = finite_rows(error[:, :2])
    if not plan.any() and not np.isfinite(error[:, 2]).any():
        return None
    variance = result.block.points.survey_covariance_m2(check).diagonal(axis1=1, axis2=2)
    survey = np.sqrt(np.where(np.isfinite(error), variance, np.nan))
    east, north, height = (rmse(error[:, axis]) for axis in range(3))
    of_survey = [rmse(survey[:, axis]) for axis in range(3)]
    plan_m, survey_plan_m = _join(east, north), _join(*of_survey[:2])
    total_h, total_v = _join(plan_m, survey_plan_m), _join(height, of_survey[2])
    nssda_plan, ratio = None, ACCURACY_STATEMENT.nssda_ratio
    if east is not None and north is not None and min(east, north) >= ratio * max(east, north):
        nssda_plan = NSSDA_PLAN * 0.5 * (east + north)
    points = int(max(plan.sum(), np.isfinite(error[:, 2]).sum()))
    return {
        "points_in_plan": int(plan.sum()),
        "points_in_height": int(np.isfinite(error[:, 2]).sum()),
        **{
            f"mean_{name}_m": float(np.nanmean(values)) if np.isfinite(values).any() else None
            for name, values in zip(("east", "north", "height"), error.T, strict=True)
        },
        "asprs": {
            "rmse_h_m": total_h,
            "rmse_v_m": total_v,
            "rmse_3d_m": _join(total_h, total_v),
            "found_rmse_h_m": plan_m,
            "found_rmse_v_m": height,
            "survey_rmse_h_m": survey_plan_m,
            "survey_rmse_v_m": of_survey[2],
            "points_required": ACCURACY_STATEMENT.asprs_points,
            "enough_points": points >= ACCURACY_STATEMENT.asprs_points,
        },
        "nssda": {
            "horizontal_m": nssda_plan,
            "vertical_m": None if height is None else NSSDA_HEIGHT * height,
            "points_required": ACCURACY_STATEMENT.nssda_points,
            "enough_points": points >= ACCURACY_STATEMENT.nssda_points,
        },
    }


def _join(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else float(np.hypot(first, second))

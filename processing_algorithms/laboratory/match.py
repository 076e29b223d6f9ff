"""`match`: two images, or a window of each, without RPC, by control networks (thesis chapter 3)."""

from collections import Counter
from time import perf_counter

import numpy as np

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.progress import stage
from ...hrsi_engine.foundation.robust_scale import MAD_TO_SIGMA
from ...hrsi_engine.ground.geodesy import WGS84_3D
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.pages.report import write_page
from ...hrsi_engine.io.point_files.csv_text import write_csv
from ...hrsi_engine.laboratory.control_network.matching import ControlNetworkMatch, match_windows
from ...hrsi_engine.laboratory.control_network.super_points import FOUND
from ...hrsi_engine.laboratory.interest_points.detectors import clip_to_image
from ..files.opening import ImagePixels, ground_of, ground_warnings, open_pixels, open_terrain, window_area
from ..files.result_folder import PAGE_FILE, check_folder, plan_folder, stage_results
from ..interface.declare import Context, Report
from .declarations.match import MATCH_FILE, MATCH_LAYER, MatchAlgorithmOptions
from .layers import CorrespondenceRows, MatchedPointRows
from .paired_windows import PictureSide, draw_pair

POINTS_LAYER = "matched_points"
TABLE_FILE = "correspondences.csv"


def run(options: MatchAlgorithmOptions, context: Context) -> Report:
    """Match the two images and write correspondences, picture and report."""
    started = perf_counter()
    check_folder(options.folder, context)
    # The images under ids that differ, also where both windows are of one file
    if len(options.images) != 2:
        raise InputError(f"match takes two images, {len(options.images)} are given: name two")
    images = [open_pixels(path, options.band) for path in options.images]
    if images[0].id == images[1].id:
        images = [image._replace(id=f"{image.id}_{number + 1}") for number, image in enumerate(images)]
    windows = {"window_1": options.window_1, "window_2": options.window_2}
    areas = [
        clip_to_image(window_area(text, name), image.raster)
        for (name, text), image in zip(windows.items(), images, strict=True)
    ]
    if context.dry_run:
        return plan_folder(options.folder, MATCH_FILE, {"images": 2}, [], context, options.report)
    found = match_windows(
        images[0].raster, images[1].raster, options.matching, areas[0], areas[1], stage(context.progress, 0.0, 0.9)
    )
    made = found.positions
    report: Report = {
        **context.record, "seconds": {"total": perf_counter() - started}, "status": found.status,
        "first": images[0].id, "second": images[1].id, "correspondences": len(found),
        "rotation_deg": found.rotation_deg, "scale": found.scale, "affine": found.affine.tolist(),
        "sigma_px": _median_or_none(made.sigma_px), "residual_px": _median_or_none(made.residual_px),
        "epipolar_nmad_px": _median_or_none(MAD_TO_SIGMA * np.abs(made.epipolar_px)),
        "correlation": _median_or_none(made.correlation),
        "kinds": dict(sorted(Counter(found.kind.tolist()).items())),
        "network": {"correspondences": found.network, "runner_up": found.runner_up},
        "images": [
            {"id": image.id, "path": image.path, "points": points,
             "window": [area.left, area.top, area.right - area.left, area.bottom - area.top]}
            for image, area, points in zip(images, areas, found.points, strict=True)
        ],
        "unsolved": f"{found.status}: {found.message}" if found.status != FOUND else None, "warnings": [],
    }  # fmt: skip
    surface = open_terrain(options.terrain)
    ground = [ground_of(image, xy, surface) for image, xy in zip(images, (made.first, made.second), strict=True)]
    report["warnings"] += ground_warnings(images, ground)
    layers = _make_layers(images, found, ground)
    with stage_results(options.folder, report, context) as folder:
        write_geopackage(str(folder / MATCH_FILE), layers)
        columns = layers[0].fields
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        write_csv(str(folder / TABLE_FILE), list(columns), rows)
        if options.report:
            sides = []
            for image, area, xy in zip(images, areas, (made.first, made.second), strict=True):
                grey, valid = image.raster.read(area.left, area.top, area.right - area.left, area.bottom - area.top)
                sides.append(PictureSide(grey, valid, np.array([area.left, area.top], dtype=np.float64), xy))
            write_page(str(folder / PAGE_FILE), "match.html.j2", report, picture=draw_pair(*sides))
    return report


def _median_or_none(values: np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) else None


def _make_layers(images: list[ImagePixels], found: ControlNetworkMatch, ground: list[np.ndarray]) -> list[Layer]:
    """Return the correspondences, and the same as image points, on the ground where the images have RPCs."""
    made = found.positions
    ids = np.char.add("M", np.char.zfill(np.arange(1, len(found) + 1).astype(str), len(str(max(len(found), 1)))))
    fields = CorrespondenceRows(
        id=ids,
        first_sample=made.first[:, 0],
        first_line=made.first[:, 1],
        second_sample=made.second[:, 0],
        second_line=made.second[:, 1],
        kind=found.kind,
        sigma=made.sigma_px,
        quality=made.correlation,
        residual_px=made.residual_px,
        epipolar_px=made.epipolar_px,
        generation=found.generation,
        father=np.where(found.father >= 0, ids[found.father], "") if len(found) else ids,
    )
    # As image points: the sigma of a correspondence is shared between both images
    measured = MatchedPointRows(
        id=np.tile(ids, 2),
        image=np.repeat([image.id for image in images], len(found)),
        sample=np.concatenate([made.first[:, 0], made.second[:, 0]]),
        line=np.concatenate([made.first[:, 1], made.second[:, 1]]),
        sigma=np.tile(made.sigma_px, 2) / np.sqrt(2.0),
        kind=np.tile(found.kind, 2),
        quality=np.tile(made.correlation, 2),
    )
    return [
        Layer(MATCH_LAYER, "None" if images[0].rpc is None else "PointZ", WGS84_3D, ground[0], fields),
        Layer(
            POINTS_LAYER,
            "None" if any(image.rpc is None for image in images) else "PointZ",
            WGS84_3D,
            np.concatenate(ground),
            measured,
        ),
    ]


def summarise(report: Report) -> str:
    """Return what was found, in two lines."""
    if report["status"] != FOUND:
        return f"{report['first']} and {report['second']}: {report['status']}"
    return (
        f"{report['first']} and {report['second']}: {report['correspondences']} correspondences in "
        f"{report['seconds']['total']:.1f} s, rotation {report['rotation_deg']:.2f}°, scale {report['scale']:.3f}\n"
        f"sigma {report['sigma_px']:.2f} px, from neighbours {report['residual_px']:.2f} px, "
        f"across epipolar lines {report['epipolar_nmad_px']:.2f} px (NMAD)"
    )

"""`match`: two images, or a window of each, without RPC, by control networks (thesis chapter 3)."""

import colorsys
from collections import Counter
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ...hrsi_engine.drawing.target_chips import encode_grey_png
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.pixel_filters import reduce_by_area, reduce_mask
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

POINTS_LAYER = "matched_points"
TABLE_FILE = "correspondences.csv"
PICTURES_GAP = 12.0  # between the windows in the picture, SVG units


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
    windows = window_area(options.window_1, "window_1"), window_area(options.window_2, "window_2")
    areas = [clip_to_image(window, image.raster) for window, image in zip(windows, images, strict=True)]
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
    surface, positions = open_terrain(options.terrain), (made.first, made.second)
    ground = [ground_of(image, xy, surface) for image, xy in zip(images, positions, strict=True)]
    report["warnings"] += ground_warnings(images, ground)
    layers = _make_layers(images, found, ground)
    with stage_results(options.folder, report, context) as folder:
        write_geopackage(str(folder / MATCH_FILE), layers)
        columns = layers[0].fields
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        write_csv(str(folder / TABLE_FILE), list(columns), rows)
        if options.report:
            sides = [
                PictureSide(
                    *image.raster.read(area.left, area.top, area.right - area.left, area.bottom - area.top),
                    np.array([area.left, area.top], dtype=np.float64),
                    xy,
                )
                for image, area, xy in zip(images, areas, positions, strict=True)
            ]
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


# ---- picture ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PictureSide:
    """One window of a pair of images.

    grey : (lines, samples) grey values; valid : (lines, samples) True where they count
    origin : (2,) sample and line of the first pixel; points : (k, 2) sample, line of the correspondences
    """

    grey: np.ndarray
    valid: np.ndarray
    origin: np.ndarray
    points: np.ndarray


def draw_pair(first: PictureSide, second: PictureSide) -> str:
    """Return the picture: corresponding points have the same colour and some the same number.

    Colours follow the position in the first window, so that wrong neighbours would show.

    first, second : the two windows; row k of their points belongs together
    """
    scale = 900.0 / float(max(*first.grey.shape, *second.grey.shape))
    sizes = [np.array(side.grey.shape[::-1]) * scale for side in (first, second)]
    width, height = sizes[0][0] + PICTURES_GAP + sizes[1][0], max(size[1] for size in sizes)
    # The rows of up to 40 correspondences spread over the window: the first one of each cell, 7 along its longer side
    cell = np.floor((first.points - first.origin) / (max(first.grey.shape) / 7)).astype(int)
    heads = np.unique(cell, axis=0, return_index=True)[1] if len(cell) else np.empty(0, dtype=int)
    number_points = np.sort(heads)[:40]
    # A colour for each point: the hue runs with the sample, the lightness with the line
    share = (first.points - first.origin) / np.maximum(np.array(first.grey.shape[::-1]), 1)
    rgb = [colorsys.hls_to_rgb(0.85 * float(x), 0.4 + 0.3 * float(y), 1.0) for x, y in np.clip(share, 0.0, 1.0)]
    colours = ["#" + "".join(f"{round(255 * channel):02x}" for channel in colour) for colour in rgb]
    parts = [f'<svg class="plot" viewBox="0 0 {width:.1f} {height:.1f}">']
    for left, side, size in zip((0.0, sizes[0][0] + PICTURES_GAP), (first, second), sizes, strict=True):
        places = (side.points - side.origin + 0.5) * scale + (left, 0.0)
        radius = 3.4 if len(places) < 800 else 1.9
        grey, valid = np.where(side.valid, side.grey, 0).astype(np.float32), side.valid
        if scale < 1.0:
            smaller = round(grey.shape[1] * scale), round(grey.shape[0] * scale)
            grey, valid = reduce_by_area(grey, smaller), reduce_mask(valid, smaller)
        parts += [
            f'<image x="{left:.1f}" width="{size[0]:.1f}" height="{size[1]:.1f}" preserveAspectRatio="none" '
            f'href="data:image/png;base64,{encode_grey_png(grey, valid)}"/>',
            *(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="{colour}"/>'
                for (x, y), colour in zip(places, colours, strict=True)
            ),
            *[
                f'<text x="{x + 4:.1f}" y="{y - 4:.1f}" style="font-size:16px;fill:#fff;stroke:#000;stroke-width:3px;'
                f'paint-order:stroke">{number + 1}</text>'
                for number, (x, y) in enumerate(places[number_points])
            ],
        ]
    return "".join([*parts, "</svg>"])

"""`interest-points`: corners, super points and gravity centres of images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .files.image_pixels import IMAGES_WITH_PIXELS, ImagePixels, ground_of, open_pixels, window_area
from .files.result_folder import check_folder, write_folder
from .files.terrain import TERRAIN_PARAMS, open_terrain
from .interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Algorithm, Context, Kind, Param, Report
from .interface.threads import requested_threads

if TYPE_CHECKING:
    from ..hrsi_engine.io.layers import Layer
    from ..hrsi_engine.measurement.interest_points import DetectionOptions, InterestPoints
    from ..hrsi_engine.surface.dem import HeightSurface

LAYERS_FILE = "interest_points.gpkg"
LAYER = "interest_points"
#: Choice of ``--detector`` to the engine's detectors (a test compares the two).
DETECTOR_SETS = {
    "all": ("harris", "centres"),
    "harris": ("harris",),
    "foerstner": ("foerstner",),
    "centres": ("centres",),
}
QUARTERS = ("upper left", "upper right", "lower left", "lower right")


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Detect the points of every image and write them as one layer."""
    from ..hrsi_engine.foundation.progress import stage
    from ..hrsi_engine.foundation.version import VERSION
    from ..hrsi_engine.measurement.interest_points import detect_interest_points
    from ..hrsi_engine.measurement.interest_points.points import join_points

    check_folder(options)
    images = [open_pixels(path, options["band"]) for path in options["images"]]
    surface, settings = open_terrain(options), _detection_options(options)
    names = DETECTOR_SETS[options["detector"]]
    tables = []
    for number, image in enumerate(images):
        region = window_area(options["window"], "--window")
        parts = [
            detect_interest_points(image.raster, name, settings, region, stage(context.progress, *share))
            for name, share in zip(names, _shares(number, len(images), len(names)), strict=True)
        ]
        tables.append(join_points(parts))
    report: Report = {
        "schema": 1, "algorithm": "interest-points", "version": VERSION, "detector": options["detector"],
        "images": {image.id: _summary(image, points) for image, points in zip(images, tables, strict=True)},
        "warnings": [f"{image.id}: no point" for image, table in zip(images, tables, strict=True) if not len(table)],
        "settings": {key: value for key, value in options.items() if value is not None},
    }  # fmt: skip
    layers = [_layer(images, tables, surface)]
    write_folder(options, report, LAYERS_FILE, layers, context)
    return report


def _shares(image: int, images: int, detectors: int) -> list[tuple[float, float]]:
    """Return the shares of the progress bar of each detector on one image."""
    steps = images * detectors
    first = image * detectors
    return [(0.9 * (first + k) / steps, 0.9 * (first + k + 1) / steps) for k in range(detectors)]


def _detection_options(options: Mapping[str, Any]) -> DetectionOptions:
    from ..hrsi_engine.measurement.interest_points import CentreOptions, CornerOptions, DetectionOptions

    corners = CornerOptions(
        options["kappa"], options["radius"], options["threshold"], options["super_threshold"], options["share"],
        options["super_share"],
    )  # fmt: skip
    centres = CentreOptions(options["smallest"], options["largest"], options["contrast"], options["quality"])
    return DetectionOptions(
        corners, centres, options["per_cell"] or None, options["cell"], options["mask_saturated"],
        requested_threads(options),
    )  # fmt: skip


def _summary(image: ImagePixels, points: InterestPoints) -> dict[str, Any]:
    import numpy as np

    from ..hrsi_engine.measurement.interest_points import STRONG_QUALITY

    lower, right = points.xy[:, 1] >= image.raster.size[1] / 2.0, points.xy[:, 0] >= image.raster.size[0] / 2.0
    quarters = np.bincount(2 * lower + right, minlength=4)
    return {
        "path": image.path, "points": len(points), "kinds": dict(sorted(Counter(points.kind.tolist()).items())),
        "strong_centres": int(np.sum(points.is_centre & (points.quality >= STRONG_QUALITY))),
        "quarters": dict(zip(QUARTERS, quarters.tolist(), strict=True)),
    }  # fmt: skip


def _layer(images: list[ImagePixels], tables: list[InterestPoints], surface: HeightSurface | None) -> Layer:
    """Return one layer of all points: at their ground positions where all images have an RPC, else a table."""
    import numpy as np

    from ..hrsi_engine.io.layers import Layer
    from ..hrsi_engine.measurement.interest_points.points import join_points

    points = join_points(tables)
    image_ids = np.repeat([image.id for image in images], [len(table) for table in tables])
    ids = [table.to_image_points(image.id, f"{image.id}_").ids for image, table in zip(images, tables, strict=True)]
    ground = np.concatenate([ground_of(image, table.xy, surface) for image, table in zip(images, tables, strict=True)])
    fields = {
        "id": np.concatenate(ids).astype(str), "image": image_ids.astype(str),
        "sample": points.xy[:, 0], "line": points.xy[:, 1],
        "sigma": points.sigma_px, "kind": points.kind, "quality": points.quality, "strength": points.strength,
        "length_px": points.size_px[:, 0], "width_px": points.size_px[:, 1],
        "azimuth_deg": np.degrees(points.azimuth_rad), "contrast": points.contrast, "rmse_px": points.rmse_px,
    }  # fmt: skip
    everywhere = all(image.rpc is not None for image in images)
    return Layer(LAYER, "PointZ" if everywhere else "None", 4326, ground, fields)


def summarise(report: Report) -> str:
    """Return the numbers of points by image and kind."""
    lines = []
    for name, image in report["images"].items():
        kinds = ", ".join(f"{count} {kind}" for kind, count in image["kinds"].items())
        quarters = ", ".join(f"{count} {where}" for where, count in image["quarters"].items())
        lines.append(
            f"{name}: {image['points']} points ({kinds}; {image['strong_centres']} strong centres); {quarters}"
        )
    return "\n".join(lines)


ALGORITHM = Algorithm(
    name="interest-points",
    title="Detect interest points",
    group="Image points",
    summary="Corners, super points and gravity centres of images as a point layer",
    help=(
        "Finds corners (Harris or Foerstner) and gravity centres of closed bright or dark objects: roundabouts, tanks, "
        "roofs, pools, ponds, trees, plots. Positions are to a fraction of a pixel and come with their standard "
        "deviation, size, orientation and quality. Thresholds follow from each image's own statistics, relative to "
        "the surroundings of every pixel, so that forest, field and city all deliver points. Images of any size are "
        "read in overlapping windows; the result does not depend on them. Nodata and saturated areas are left out.\n\n"
        "The layer lies at the points' ground positions where the image has an RPC (at its mean height, a given "
        "height or a DEM), and it can be used as image points again. Sample 0, line 0 is the CENTRE of the first pixel."
    ),
    declared=(
        IMAGES_WITH_PIXELS,
        Param("detector", Kind.CHOICE, "What to find", default="all", choices=tuple(DETECTOR_SETS)),
        Param("window", Kind.TEXT, "Only this window of the image", metavar="SAMPLE,LINE,SAMPLES,LINES"),
        Param("band", Kind.INTEGER, "Band of the image", default=1, minimum=1),
        Param(
            "per-cell", Kind.INTEGER, "Keep so many of the best points in every cell, to spread them; 0 keeps all",
            default=0, minimum=0,
        ),
        Param("cell", Kind.NUMBER, "Side of the cells", default=256.0, minimum=8.0, unit="px"),
        Param(
            "smallest", Kind.NUMBER, "Smallest diameter of an object with a gravity centre", default=5.0, minimum=4.0,
            unit="px",
        ),
        Param("largest", Kind.NUMBER, "Largest diameter", default=160.0, minimum=8.0, maximum=512.0, unit="px"),
        Param(
            "contrast", Kind.NUMBER, "Smallest contrast of an object, in standard deviations of its surroundings",
            default=0.8, minimum=0.0, advanced=True,
        ),
        Param(
            "quality", Kind.NUMBER, "Smallest quality of a gravity centre. Of those from 0.75 on another view has nine "
            "in ten; 0.5 doubles their number, fewer of the additional ones are found again",
            default=0.75, minimum=0.0, maximum=1.0,
        ),
        Param(
            "radius", Kind.NUMBER, "Corners are the strongest within this radius", default=4.0, minimum=1.0,
            maximum=50.0, unit="px",
        ),
        Param(
            "share", Kind.NUMBER, "Share of all local maxima that become interest points (sets the threshold TB)",
            default=0.5, minimum=0.0, maximum=1.0,
        ),
        Param(
            "super-share", Kind.NUMBER, "Share of all local maxima that become super points (sets the threshold TA)",
            default=0.07, minimum=0.0, maximum=1.0,
        ),
        Param("threshold", Kind.NUMBER, "The threshold TB itself", advanced=True),
        Param("super-threshold", Kind.NUMBER, "The threshold TA itself", advanced=True),
        Param("kappa", Kind.NUMBER, "Harris's kappa", default=0.04, minimum=0.0, maximum=0.25, advanced=True),
        Param(
            "mask-saturated", Kind.FLAG, "Leave out areas of the largest grey value, where many pixels have it",
            default=True, advanced=True,
        ),
        *TERRAIN_PARAMS,
        *OUTPUT_PARAMS,
        *COMMON_PARAMS,
    ),
    run=run,
    packages=("cv2",),
    summarise=summarise,
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip

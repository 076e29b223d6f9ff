"""`interest-points`: corners, super points and gravity centres of images."""

from collections import Counter
from itertools import pairwise

import numpy as np

from ...hrsi_engine.foundation.progress import stage
from ...hrsi_engine.ground.sun import SunAngles
from ...hrsi_engine.io.geopackage.layers import Layer
from ...hrsi_engine.io.rasters.sun_angles import SunReading, read_sun
from ...hrsi_engine.laboratory.interest_points.detectors import detect_interest_points
from ...hrsi_engine.laboratory.interest_points.options import DETECTOR_SETS
from ...hrsi_engine.laboratory.interest_points.points import InterestPoints, join_points
from ...hrsi_engine.laboratory.interest_points.shadows import compute_image_direction, find_shadows
from ...hrsi_engine.measurement.interest_points.options import STRONG_QUALITY
from ..files.opening import ImagePixels, ground_of, ground_warnings, open_pixels, open_terrain, require_ids, window_area
from ..files.result_folder import check_folder, plan_folder, tell, write_folder
from ..interface.declare import Context, Report
from .declarations.interest_points import INTEREST_POINTS_FILE, INTEREST_POINTS_LAYER, InterestPointsOptions
from .layers import InterestPointRows

QUARTERS = ("upper left", "upper right", "lower left", "lower right")


def run(options: InterestPointsOptions, context: Context) -> Report:
    """Detect the points of every image and write them as one layer."""
    check_folder(options.folder, context)
    images = [open_pixels(path, options.band) for path in options.images]
    require_ids([image.path for image in images], [image.id for image in images])
    surface = open_terrain(options.terrain)
    region = window_area(options.window, "window")
    if context.dry_run:
        return plan_folder(options.folder, INTEREST_POINTS_FILE, {"images": len(images)}, [], context)
    names = DETECTOR_SETS[options.detector]
    tables = []
    steps = np.linspace(0.0, 0.9, len(images) * len(names) + 1).tolist()
    for first, image in zip(range(0, len(steps) - 1, len(names)), images, strict=True):
        stages = [stage(context.progress, *ends) for ends in pairwise(steps[first : first + len(names) + 1])]
        parts = [
            detect_interest_points(image.raster, name, options.detection, region, part)
            for name, part in zip(names, stages, strict=True)
        ]
        tables.append(join_points(parts))
    # Direction of the sun: that of the delivery, else as given, because its elevation is not known then
    given = None if options.sun_azimuth is None else SunReading(SunAngles(options.sun_azimuth, float("nan")), "given")
    suns = [None if image.rpc is None else read_sun(image.path, image.rpc) or given for image in images]
    # Of each point ``yes`` or ``no``, whether it is a dark centre on the shadow side; else ``unknown``
    shadows = [np.full(len(table), "unknown") for table in tables]
    for number, (image, table, sun) in enumerate(zip(images, tables, suns, strict=True)):
        if image.rpc is not None and sun is not None:
            direction = compute_image_direction(image.rpc, image.raster.size, sun.angles.azimuth_deg)
            shadows[number] = np.where(find_shadows(image.raster, table, direction), "yes", "no")
    grounds = [ground_of(image, table.xy, surface) for image, table in zip(images, tables, strict=True)]
    warnings = [f"{image.id}: no point" for image, table in zip(images, tables, strict=True) if not len(table)]
    warnings += ground_warnings(images, grounds)
    tell(warnings, context)
    report: Report = {
        **context.record,
        "detector": options.detector,
        "images": {
            image.id: _image_entry(image, points, sun, words)
            for image, points, sun, words in zip(images, tables, suns, shadows, strict=True)
        },
        "warnings": warnings,
    }
    # One layer of all points: at their ground positions where all images have an RPC, else a table
    joined = join_points(tables)
    image_ids = np.repeat([image.id for image in images], [len(table) for table in tables])
    ids = [table.to_image_points(image.id, f"{image.id}_").ids for image, table in zip(images, tables, strict=True)]
    ground = np.concatenate(grounds)
    fields = InterestPointRows(
        id=np.concatenate(ids).astype(str), image=image_ids.astype(str), sample=joined.xy[:, 0], line=joined.xy[:, 1],
        sigma=joined.sigma_px, kind=joined.kind, quality=joined.quality, strength=joined.strength,
        length_px=joined.size_px[:, 0], width_px=joined.size_px[:, 1], azimuth_deg=np.degrees(joined.azimuth_rad),
        contrast=joined.contrast, rmse_px=joined.rmse_px, shadow=np.concatenate(shadows).astype(str),
    )  # fmt: skip
    geometry = "PointZ" if all(image.rpc is not None for image in images) else "None"
    layers = [Layer(INTEREST_POINTS_LAYER, geometry, 4326, ground, fields)]
    write_folder(options.folder, report, INTEREST_POINTS_FILE, layers, context)
    return report


def _image_entry(image: ImagePixels, points: InterestPoints, sun: SunReading | None, words: np.ndarray) -> Report:
    """Return the entry of an image; ``words`` are yes, no or unknown: whether a point is a shadow ``(n,)``."""
    lower, right = points.xy[:, 1] >= image.raster.size[1] / 2.0, points.xy[:, 0] >= image.raster.size[0] / 2.0
    quarters = np.bincount(2 * lower + right, minlength=4)
    entry: Report = {
        "path": image.path,
        "points": len(points),
        "kinds": dict(sorted(Counter(points.kind.tolist()).items())),
        "strong_centres": int(np.sum(points.is_centre & (points.quality >= STRONG_QUALITY))),
        "quarters": dict(zip(QUARTERS, quarters.tolist(), strict=True)),
        "sun": None,
    }
    if sun is not None:
        elevation = None if np.isnan(sun.angles.elevation_deg) else sun.angles.elevation_deg
        entry["sun"] = {"azimuth_deg": sun.angles.azimuth_deg, "elevation_deg": elevation, "source": sun.source}
        entry["shadows"] = int(np.sum(words == "yes"))
    return entry


def summarise(report: Report) -> str:
    """Return the numbers of points by image and kind."""
    lines = []
    for name, image in report["images"].items():
        kinds = ", ".join(f"{count} {kind}" for kind, count in image["kinds"].items())
        quarters = ", ".join(f"{count} {where}" for where, count in image["quarters"].items())
        lines.append(
            f"{name}: {image['points']} points ({kinds}; {image['strong_centres']} strong centres); {quarters}"
        )
        if image["sun"] is not None:
            lines[-1] += f"; {image['shadows']} dark centres are shadows"
    return "\n".join(lines)

"""`match`: two images, or a window of each, without RPC, by control networks (thesis chapter 3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .files.image_pixels import IMAGES_WITH_PIXELS, ImagePixels, ground_of, open_pixels, window_area
from .files.result_folder import check_folder, tell
from .files.terrain import TERRAIN_PARAMS, open_terrain
from .interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Algorithm, Context, Kind, Param, Report
from .interface.threads import requested_threads

if TYPE_CHECKING:
    import numpy as np

    from ..hrsi_engine.block.points import ImagePoints
    from ..hrsi_engine.drawing.pair_pictures import PictureSide
    from ..hrsi_engine.io.layers import Layer
    from ..hrsi_engine.measurement.control_network import ControlNetworkMatch, ControlNetworkOptions
    from ..hrsi_engine.measurement.interest_points import Area

LAYERS_FILE, LAYER, POINTS_LAYER = "match.gpkg", "correspondences", "matched_points"
TABLE_FILE, PAGE_FILE = "correspondences.csv", "report.html"
#: Choice of ``--detector`` to the engine's detectors (a test compares the two).
DETECTOR_SETS = {
    "harris": ("harris",),
    "foerstner": ("foerstner",),
    "centres": ("centres",),
    "all": ("harris", "centres"),
}


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Match the two images and write correspondences, picture and report."""
    from time import perf_counter

    from ..hrsi_engine.foundation.progress import stage
    from ..hrsi_engine.measurement.control_network import match_windows
    from ..hrsi_engine.measurement.interest_points import inside

    started = perf_counter()
    check_folder(options)
    images = _two_images(options)
    areas = [
        inside(window_area(options[f"window_{k + 1}"], f"--window-{k + 1}"), image.raster)
        for k, image in enumerate(images)
    ]
    found = match_windows(
        images[0].raster, images[1].raster, _match_options(options), *areas, progress=stage(context.progress, 0.0, 0.9)
    )
    report = _report(images, areas, found, options, perf_counter() - started)
    _write(options, report, images, areas, found, context)
    tell(report["warnings"], context)
    return report


def _two_images(options: Mapping[str, Any]) -> list[ImagePixels]:
    """Return the images under ids that differ, also where both windows are of one file."""
    from ..hrsi_engine.foundation.errors import InputError

    if len(options["images"]) != 2:
        raise InputError(f"match takes two images, {len(options['images'])} are given: name two")
    images = [open_pixels(path, options["band"]) for path in options["images"]]
    if images[0].id == images[1].id:
        images = [image._replace(id=f"{image.id}_{number + 1}") for number, image in enumerate(images)]
    return images


def _match_options(options: Mapping[str, Any]) -> ControlNetworkOptions:
    from ..hrsi_engine.measurement.control_network import ControlNetworkOptions

    return ControlNetworkOptions(
        DETECTOR_SETS[options["detector"]], options["radius"], options["share"], options["incidence"],
        options["max_slope"], _scales(options["scale"]), options["reach"], options["correlation"],
        options["consistency"], options["least"], options["mask_saturated"], requested_threads(options),
    )  # fmt: skip


def _scales(text: str) -> tuple[float, float]:
    """Return lowest and highest of ``LOW,HIGH`` or one number; raises `InputError` for another text."""
    from ..hrsi_engine.foundation.errors import InputError

    try:
        numbers = [float(part) for part in text.split(",")]
        low, high = numbers if len(numbers) == 2 else numbers * 2
    except ValueError:
        raise InputError(f"--scale {text!r} is not a number or LOW,HIGH: give 1, or 0.8,1.25") from None
    if not 0.05 <= low <= high <= 20.0:
        raise InputError(f"--scale {text!r}: give the lower one first, both between 0.05 and 20")
    return low, high


def _report(
    images: list[ImagePixels], areas: list[Area], found: ControlNetworkMatch, options: Mapping[str, Any], seconds: float
) -> Report:
    import numpy as np

    from ..hrsi_engine.foundation.robust_scale import MAD_TO_SIGMA
    from ..hrsi_engine.foundation.version import VERSION

    made = found.positions
    return {
        "schema": 1, "algorithm": "match", "version": VERSION, "seconds": {"total": seconds}, "status": found.status,
        "first": images[0].id, "second": images[1].id, "correspondences": len(found),
        "rotation_deg": found.rotation_deg, "scale": found.scale, "affine": found.affine.tolist(),
        "sigma_px": _median(made.sigma_px), "residual_px": _median(made.residual_px),
        "epipolar_nmad_px": _median(MAD_TO_SIGMA * np.abs(made.epipolar_px)), "correlation": _median(made.correlation),
        "kinds": dict(sorted(Counter(found.kind.tolist()).items())),
        "network": {"correspondences": found.network, "runner_up": found.runner_up},
        "images": [
            {"id": image.id, "path": image.path, "points": points,
             "window": [area.left, area.top, area.right - area.left, area.bottom - area.top]}
            for image, area, points in zip(images, areas, found.points, strict=True)
        ],
        "warnings": [f"{found.status}: {found.message}"] if found.message else [],
        "settings": {key: value for key, value in options.items() if value is not None},
    }  # fmt: skip


def _median(values: np.ndarray) -> float | None:
    import numpy as np

    return float(np.median(values)) if len(values) else None


def _write(
    options: Mapping[str, Any], report: Report, images: list[ImagePixels], areas: list[Area],
    found: ControlNetworkMatch, context: Context,
) -> None:  # fmt: skip
    from ..hrsi_engine.drawing.pair_pictures import pair_svg
    from ..hrsi_engine.foundation.progress import advance
    from ..hrsi_engine.io.csv_tables import write_csv
    from ..hrsi_engine.io.layers import write_geopackage
    from ..hrsi_engine.io.output_dir import stage_folder
    from ..hrsi_engine.io.pages import write_page
    from ..hrsi_engine.io.report import write_report_json

    layers = _layers(options, images, found)
    with stage_folder(options["output_dir"], context.inputs, options["overwrite"]) as folder:
        write_geopackage(str(folder / LAYERS_FILE), layers)
        columns = layers[0].fields
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        write_csv(str(folder / TABLE_FILE), list(columns), rows)
        if options["report"]:
            sides = [
                _side(image, area, xy)
                for image, area, xy in zip(images, areas, (found.positions.first, found.positions.second), strict=True)
            ]
            write_page(str(folder / PAGE_FILE), "match.html.j2", report, picture=pair_svg(*sides))
        write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")


def _side(image: ImagePixels, area: Area, xy: np.ndarray) -> PictureSide:
    import numpy as np

    from ..hrsi_engine.drawing.pair_pictures import PictureSide

    grey, valid = image.raster.read(area.left, area.top, area.right - area.left, area.bottom - area.top)
    return PictureSide(grey, valid, np.array([area.left, area.top], dtype=np.float64), xy)


def _layers(options: Mapping[str, Any], images: list[ImagePixels], found: ControlNetworkMatch) -> list[Layer]:
    """Return the correspondences, and the same as image points, on the ground where the images have RPCs."""
    import numpy as np

    from ..hrsi_engine.io.layers import Layer

    surface, made = open_terrain(options), found.positions
    ids = np.char.add("M", np.char.zfill(np.arange(1, len(found) + 1).astype(str), len(str(max(len(found), 1)))))
    ground = [ground_of(image, xy, surface) for image, xy in zip(images, (made.first, made.second), strict=True)]
    fields = {
        "id": ids, "first_sample": made.first[:, 0], "first_line": made.first[:, 1],
        "second_sample": made.second[:, 0], "second_line": made.second[:, 1], "kind": found.kind,
        "sigma": made.sigma_px, "quality": made.correlation, "residual_px": made.residual_px,
        "epipolar_px": made.epipolar_px, "generation": found.generation,
        "father": np.where(found.father >= 0, ids[found.father], "") if len(found) else ids,
    }  # fmt: skip
    points = _image_points(images, ids, found)
    measured = {
        "id": points.ids, "image": points.image_ids, "sample": points.xy[:, 0], "line": points.xy[:, 1],
        "sigma": points.sigma_px, "kind": points.kind, "quality": points.quality,
    }  # fmt: skip
    return [
        Layer(LAYER, "None" if images[0].rpc is None else "PointZ", 4326, ground[0], fields),
        Layer(
            POINTS_LAYER, "None" if any(image.rpc is None for image in images) else "PointZ", 4326,
            np.concatenate(ground), measured,
        ),
    ]  # fmt: skip


def _image_points(images: list[ImagePixels], ids: np.ndarray, found: ControlNetworkMatch) -> ImagePoints:
    """Return the image points of both images; the sigma of a correspondence is shared between them."""
    import numpy as np

    from ..hrsi_engine.block.points import ImagePoints

    made, count = found.positions, len(found)
    return ImagePoints.create(
        np.tile(ids, 2), np.repeat([image.id for image in images], count), np.concatenate([made.first, made.second]),
        np.tile(made.sigma_px, 2) / np.sqrt(2.0), np.tile(found.kind, 2), np.tile(made.correlation, 2), "match",
    )  # fmt: skip


def summarise(report: Report) -> str:
    """Return what was found, in two lines."""
    if report["status"] != "found":
        return "\n".join(report["warnings"])
    return (
        f"{report['first']} and {report['second']}: {report['correspondences']} correspondences in "
        f"{report['seconds']['total']:.1f} s, rotation {report['rotation_deg']:.2f}°, scale {report['scale']:.3f}\n"
        f"sigma {report['sigma_px']:.2f} px, from neighbours {report['residual_px']:.2f} px, "
        f"across epipolar lines {report['epipolar_nmad_px']:.2f} px (NMAD)"
    )


ALGORITHM = Algorithm(
    name="match",
    title="Match two images",
    group="Image points",
    summary="Corresponding points of two images or windows without RPC, by control networks",
    help=(
        "Finds hundreds to thousands of corresponding points in two images of the same ground, whatever their "
        "rotation: the strongest interest points form a network whose shape is looked for in the other image; all "
        "others are found from its nodes, compared by their grey values and measured to a fraction of a pixel. No RPC "
        "is needed. "
        "Where the texture repeats, so that the network fits in several places, the status is 'ambiguous'; where it "
        "fits nowhere, 'no match'; then there are no correspondences.\n\n"
        "Windows are read as a whole: choose them with --window-1 and --window-2 in large images. Sample 0, line 0 is "
        "the CENTRE of the first pixel."
    ),
    declared=(
        IMAGES_WITH_PIXELS,
        Param("window-1", Kind.TEXT, "Only this window of the first image", metavar="SAMPLE,LINE,SAMPLES,LINES"),
        Param("window-2", Kind.TEXT, "Only this window of the second image", metavar="SAMPLE,LINE,SAMPLES,LINES"),
        Param("band", Kind.INTEGER, "Band of the images", default=1, minimum=1),
        Param(
            "scale", Kind.TEXT, "Pixels of the second image for one of the first, or the range to search",
            default="1", metavar="LOW,HIGH",
        ),
        Param("detector", Kind.CHOICE, "Interest points to match", default="harris", choices=tuple(DETECTOR_SETS)),
        Param(
            "radius", Kind.NUMBER, "Corners are the strongest within this radius; it sets the tolerance too",
            default=3.0, minimum=1.0, maximum=50.0, unit="px",
        ),
        Param(
            "share", Kind.NUMBER, "Share of all local maxima that become interest points", default=0.9, minimum=0.0,
            maximum=1.0,
        ),
        Param(
            "max-slope", Kind.NUMBER, "Slope of the ground that the tolerance of the networks allows for", default=5.0,
            minimum=0.0, maximum=60.0, unit="°",
        ),
        Param(
            "incidence", Kind.NUMBER, "Incidence angle of both images that it allows for", default=10.0, minimum=0.0,
            maximum=60.0, unit="°",
        ),
        Param(
            "reach", Kind.NUMBER, "Longest distance of a super point from its root", default=200.0, minimum=20.0,
            unit="px", advanced=True,
        ),
        Param(
            "correlation", Kind.NUMBER, "Smallest correlation of two interest points' surroundings", default=0.6,
            minimum=0.0, maximum=1.0,
        ),
        Param(
            "consistency", Kind.NUMBER, "Largest difference from the neighbours, beyond their own spread", default=1.5,
            minimum=0.1, unit="px",
        ),
        Param(
            "least", Kind.INTEGER, "Fewer correspondences than these are no match", default=12, minimum=6, advanced=True
        ),
        Param(
            "mask-saturated", Kind.FLAG, "Leave out areas of the largest grey value, where many pixels have it",
            default=True, advanced=True,
        ),
        *TERRAIN_PARAMS,
        *OUTPUT_PARAMS,
        Param("report", Kind.FLAG, "Write report.html with a picture of both windows", default=True),
        *COMMON_PARAMS,
    ),
    run=run,
    packages=("cv2",),
    summarise=summarise,
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip

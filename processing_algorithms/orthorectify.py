"""`orthorectify`: orthoimages of a whole block on one map grid, through GDAL's warper."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from .files.image_files import open_images
from .files.terrain import GROUND_CRS, TERRAIN_PARAMS
from .interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Algorithm, Context, Kind, Param, Report

#: GDAL's kernels; `io.ortho_warp.RESAMPLING` holds them (a test compares the two).
RESAMPLING_CHOICES = (
    "near", "bilinear", "cubic", "cubicspline", "lanczos", "average", "rms", "mode", "max", "min", "med", "q1", "q3",
)  # fmt: skip
#: `io.orthoimages` holds these (a test compares them).
FORMAT_CHOICES, COMPRESSION_CHOICES = ("cog", "gtiff"), ("deflate", "lzw", "zstd", "none")


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Plan the grids, make the orthoimages that are not there yet, write the report."""
    from .ortho_steps import inputs as ortho_inputs
    from .ortho_steps import outputs as ortho_outputs

    start = time.monotonic()
    images = open_images(options["images"], context.log)
    terrain = ortho_inputs.open_ortho_terrain(options)
    plan = ortho_inputs.plan_block(images, terrain, options)
    jobs = ortho_outputs.jobs_of(plan, options)
    ortho_outputs.check_folder(options, jobs)
    entries = ortho_outputs.make_all(jobs, options, context)
    return ortho_outputs.write_report(plan, entries, options, time.monotonic() - start, context)


def summarise(report: Report) -> str:
    """Return a line for each orthoimage."""
    grid = report["grid"]
    lines = [f"{grid['crs']}, pixels of {grid['resolution']:g}, {report['resampling']}"]
    for name, entry in report["images"].items():
        error = entry["position_error_max_px"]
        lines.append(
            f"{name}: {entry['columns']} x {entry['rows']} px, {entry['status']}"
            + ("" if error is None else f", position error at most {error:.3f} px of {entry['checked']} checked")
        )
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])


ALGORITHM = Algorithm(
    name="orthorectify",
    title="Orthorectify block",
    group="Orthoimages",
    summary="Orthoimages from (refined) RPCs and a DEM, all on one map grid",
    help=(
        "Makes an orthoimage of every image with GDAL's warper: all bands, data type and nodata kept, as "
        "cloud-optimised GeoTIFF. All pixels lie on one lattice, so that the orthoimages of a block register pixel to "
        "pixel. Heights of the DEM are brought to the ellipsoid. Positions are right to --error-px; the report states "
        "what was found at random pixels. Orthoimages that were made before from the same files with the same options "
        "are kept, so a stopped run goes on where it was. Ground hidden from the sensor shows what hides it."
    ),
    declared=(
        Param("images", Kind.IMAGES, "Images with RPC", required=True, metavar="IMAGE"),
        *TERRAIN_PARAMS,
        Param(
            "terrain-points", Kind.POINTS,
            "Points whose heights make the terrain, instead of a DEM: the layer ground_points of a triangulation",
            metavar="FILE[|layername=L]",
        ),
        GROUND_CRS,
        Param(
            "fill-gaps", Kind.INTEGER,
            "Interpolate gaps of the DEM up to so many of its cells wide; 0 leaves them nodata",
            default=0, minimum=0, maximum=1000, unit="cells", advanced=True, metavar="N",
        ),
        Param("crs", Kind.TEXT, "CRS of the orthoimages; by default the UTM zone of the block's middle", metavar="CRS"),
        Param(
            "resolution", Kind.NUMBER,
            "Pixel size, in units of the CRS; by default the finest pixel of the block on the ground, rounded",
            minimum=1e-9, metavar="R",
        ),
        Param(
            "extent", Kind.TEXT,
            "each: what the image shows; union or overlap: of all images; or west,south,east,north in the CRS. Widened "
            "to whole pixels",
            default="each", metavar="each|union|overlap|W,S,E,N",
        ),
        Param("resampling", Kind.CHOICE, "GDAL's resampling kernel", default="cubic", choices=RESAMPLING_CHOICES),
        Param(
            "error-px", Kind.NUMBER, "Largest error of a pixel's position in the image; 0 computes every pixel exactly",
            default=0.05, minimum=0.0, maximum=10.0, unit="px", metavar="PX",
        ),
        Param(
            "nodata", Kind.TEXT,
            "Value of pixels that the image does not show, or mask for a mask band; by default the image's own, else a "
            "mask where the image has one, else 0 (NaN for floating point)",
            metavar="VALUE|mask",
        ),
        Param("format", Kind.CHOICE, "Cloud-optimised GeoTIFF with overviews, or a plain tiled GeoTIFF", default="cog",
              choices=FORMAT_CHOICES),
        Param("compression", Kind.CHOICE, "Compression, all of them lossless", default="deflate",
              choices=COMPRESSION_CHOICES, advanced=True),
        *OUTPUT_PARAMS,
        Param("report", Kind.FLAG, "Write report.html", default=True),
        *COMMON_PARAMS,
    ),
    run=run,
    summarise=summarise,
)  # fmt: skip

"""`ortho-check`: how well orthoimages fit one another, or a reference, before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Algorithm, Context, Kind, Param, Report
from .ortho_steps.layer_names import LAYERS, LAYERS_FILE


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Match windows of every overlapping pair and write figures, arrows and maps."""
    from ..hrsi_engine.io.output_dir import check_output_dir
    from .interface.threads import requested_threads
    from .ortho_steps import pairs as ortho_pairs

    check_output_dir(options["output_dir"], options["overwrite"])
    pairs, warnings = ortho_pairs.open_pairs(options)
    part = context.stage(0.0, 0.9)
    found = ortho_pairs.match_pairs(pairs, ortho_pairs.match_options(options), requested_threads(options), part)
    return ortho_pairs.write_results(found, options, warnings, context)


def summarise(report: Report) -> str:
    """Return the table of misregistration, before and after."""
    entries = [*report["pairs"], report["all"]]
    names = [f"{entry['first']} - {entry['second']}" if "first" in entry else "all pairs" for entry in entries]
    width = max(map(len, names))
    lines = [
        f"{'pair':<{width}}{'windows':>9}"
        + "".join(f"{f'{state} {name}':>18}" for state in report["states"] for name in ("median px", "90 % px"))
    ]
    for name, entry in zip(names, entries, strict=True):
        cells = "".join(
            f"{'-' if entry[state][key] is None else format(entry[state][key], '.3f'):>18}"
            for state in report["states"]
            for key in ("median_px", "p90_px")
        )
        lines.append(f"{name:<{width}}{entry['after']['windows']:>9}{cells}")
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])


ALGORITHM = Algorithm(
    name="ortho-check",
    title="Check orthoimages",
    group="Orthoimages",
    summary="Misregistration between overlapping orthoimages, as numbers and arrows",
    help=(
        "Compares orthoimages of one map grid, each with each that overlaps it, or all with a reference. In windows "
        "spread over the common ground the shift is measured to a few hundredths of a pixel by correlation and least "
        "squares, around the shift that the pair has in common (up to 256 px). Reports medians, robust spreads and "
        "90th percentiles, and writes a layer of arrows. --before names the folder of the orthoimages made with the "
        "original RPCs: both are then compared in the same windows."
    ),
    declared=(
        Param("images", Kind.IMAGES, "Orthoimages", required=True, metavar="ORTHO"),
        Param("reference", Kind.RASTER, "Compare with this orthoimage instead of with one another", metavar="FILE"),
        Param(
            "before", Kind.TEXT, "Folder with orthoimages of the same names, made before", metavar="DIR"
        ),
        Param("window", Kind.INTEGER, "Side of a window", default=48, minimum=16, maximum=512, unit="px", metavar="PX"),
        Param(
            "search", Kind.INTEGER, "Largest difference of a window's shift from the one common to the pair",
            default=8, minimum=1, maximum=256, unit="px", metavar="PX",
        ),
        Param(
            "min-correlation", Kind.NUMBER, "Windows less alike than this do not count", default=0.6, minimum=0.0,
            maximum=1.0, advanced=True,
        ),
        Param(
            "most", Kind.INTEGER, "Windows along the longer side of the common ground", default=40, minimum=1,
            maximum=1000, advanced=True, metavar="N",
        ),
        *OUTPUT_PARAMS,
        Param("report", Kind.FLAG, "Write report.html", default=True),
        *COMMON_PARAMS,
    ),
    run=run,
    packages=("cv2",),
    summarise=summarise,
    layers=(f"{LAYERS_FILE}|layername={LAYERS[0]}",),
)  # fmt: skip

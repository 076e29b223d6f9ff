"""`ortho-check`: how well orthoimages fit one another, or a reference, before and after."""

from dataclasses import replace

from ..hrsi_engine.foundation.workers.threads import thread_count
from ..hrsi_engine.io.output_dir import check_output_dir
from .declarations.ortho_check import OrthoCheckOptions
from .files.result_folder import plan_page
from .interface.declare import Context, Report
from .ortho_steps import pairs as ortho_pairs


def run(options: OrthoCheckOptions, context: Context) -> Report:
    """Match windows of every overlapping pair and write figures, arrows and maps."""
    check_output_dir(options.folder.output_dir, options.folder.overwrite, inputs=context.inputs)
    pairs, warnings = ortho_pairs.open_pairs(options)
    if context.dry_run:
        counts = {"orthoimages": len(options.images), "overlapping pairs": len(pairs)}
        return plan_page(options.folder, ortho_pairs.LAYERS_FILE, options.report, counts, warnings, context)
    part = context.stage(0.0, 0.9)
    window_px = options.matching.window_px + options.matching.window_px % 2  # windows have an even side
    how = replace(options.matching, window_px=window_px)
    found = ortho_pairs.match_pairs(pairs, how, thread_count(options.common.threads), part)
    return ortho_pairs.write_pair_results(found, options, warnings, context)


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

"""`orthorectify`: orthoimages of a whole block on one map grid, through GDAL's warper."""

import time

from .declarations.orthorectify import OrthorectifyOptions
from .files.image_files import open_input_images
from .interface.declare import Context, Report
from .ortho_steps import inputs as ortho_inputs
from .ortho_steps import jobs as ortho_jobs
from .ortho_steps import outputs as ortho_outputs


def run(options: OrthorectifyOptions, context: Context) -> Report:
    """Plan the grids, make the orthoimages that are not there yet, write the report."""
    start = time.monotonic()
    images = open_input_images(options.images, context)
    terrain = ortho_inputs.open_ortho_terrain(options)
    plan = ortho_inputs.plan_block(images, terrain, options)
    jobs = ortho_jobs.jobs_of(plan, options)
    ortho_outputs.check_ortho_folder(options, jobs, context.inputs)
    if context.dry_run:
        return ortho_outputs.plan_orthoimages(plan, jobs, options, context)
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

"""`simulate`: a synthetic block with images, DEM, GCPs, noise and full truth."""

from __future__ import annotations

import os

from ...hrsi_engine.foundation.progress import stage
from ...hrsi_engine.io.output_dir import check_output_dir, stage_folder
from ...hrsi_engine.io.pages.report import write_report_json
from ...hrsi_engine.io.safety.transactions import Transaction
from ...hrsi_engine.laboratory.simulation.synthesis import simulate_block
from ..files.result_folder import plan
from ..interface.declare import Context, Report
from .declarations.simulate import SimulateOptions
from .simulation_steps import inputs as simulation_inputs
from .simulation_steps import outputs as simulation_outputs


def run(options: SimulateOptions, context: Context) -> Report:
    """Simulate a block and write its files."""
    folder = options.folder.output_dir
    check_output_dir(folder, options.folder.overwrite)
    views = simulation_inputs.make_views(options.views, options.vendor, options.scene)
    if context.dry_run:
        names = ["report.json", *simulation_outputs.files_of_simulation(views, options)]
        return plan(context, folder, names, {"images": len(views), "GCPs": options.points.gcps})
    simulated = simulate_block(options.scene, views, options.points, options.noise, stage(context.progress, 0.0, 0.1))
    report = simulation_outputs.report_simulated_block(simulated, context.record)
    free_dem = simulation_outputs.make_free_dem(simulated, options)
    changes = Transaction(folder)
    with changes, stage_folder(folder, context.inputs, options.folder.overwrite, changes) as temporary:
        names = simulation_outputs.write_points_and_truth(temporary, simulated, free_dem)
        names += simulation_outputs.write_laser(temporary, simulated, options)
        names += simulation_outputs.write_free_dem(temporary, free_dem)
        names += simulation_outputs.write_cameras(temporary, simulated, options, stage(context.progress, 0.1, 1.0))
        if options.free_ortho.pixel_m:
            errors = simulation_outputs.write_free_ortho(temporary, simulated, options, context.progress)
            names.append(simulation_outputs.FREE_ORTHO)
            report["free_ortho"] = errors
        earlier = simulation_outputs.files_of_earlier_run(folder)
        for name in earlier - {*names} if options.folder.overwrite else ():
            changes.remove(os.path.join(folder, name))
        report["outputs"] = [os.path.join(folder, name) for name in names]
        write_report_json(str(temporary / "report.json"), report)
    return report


def summarise(report: Report) -> str:
    points, lines = report["points"], []
    lines.append(
        f"{len(report['images'])} images, {points['gcp']} GCPs, {points['check']} check points, "
        f"{points['tie']} tie points, {report['observations']} observations"
    )
    for name, image in report["images"].items():
        (samples, rows), (across, along) = image["size"], image["gsd_m"]
        lines.append(
            f"{name}: {samples} x {rows} px of {across:.2f} x {along:.2f} m, "
            f"RPC fits its camera to {image['rpc_fit_max_px']:.1e} px"
        )
    return "\n".join([*lines, *report["outputs"]])

"""`simulate`: a synthetic block with images, DEM, GCPs, noise and full truth."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from .interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Algorithm, Context, Kind, Param, Report

#: Sensors that the engine knows; its `SENSORS` holds them (a test compares the two).
SENSOR_CHOICES = ("ikonos", "quickbird", "worldview-2", "pleiades", "spot5", "wide-field")


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Simulate a block and write its files."""
    from ..hrsi_engine.foundation.progress import stage
    from ..hrsi_engine.io.output_dir import check_output_dir, stage_folder
    from ..hrsi_engine.io.report import write_report_json
    from ..hrsi_engine.simulation import simulate_block
    from .simulation_steps import inputs as simulation_inputs
    from .simulation_steps import outputs as simulation_outputs

    folder = options["output_dir"]
    check_output_dir(folder, options["overwrite"])
    simulated = simulate_block(*simulation_inputs.arguments(options), stage(context.progress, 0.0, 0.1))
    report = simulation_outputs.block_report(simulated, options)
    with stage_folder(folder, context.inputs, options["overwrite"]) as temporary:
        names = simulation_outputs.write_points_and_truth(temporary, simulated)
        names += simulation_outputs.write_cameras(temporary, simulated, options, stage(context.progress, 0.1, 1.0))
        report["outputs"] = [os.path.join(folder, name) for name in names]
        write_report_json(str(temporary / "report.json"), report)
    return report


def _summarise(report: Report) -> str:
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


def _errors(name: str, what: str, unit: str) -> Param:
    return Param(
        name, Kind.IDS, f"Error of the vendor's {what}, the same for all images, instead of a random one",
        unit=unit, advanced=True, metavar="A,B,C",
    )  # fmt: skip


VIEW_PARAMS = (
    Param("sensor", Kind.CHOICE, "Sensor that takes the images", default="pleiades", choices=SENSOR_CHOICES),
    Param("images", Kind.INTEGER, "Number of images of each place", default=2, minimum=1, maximum=50, metavar="N"),
    Param("size", Kind.INTEGER, "Samples, and lines where those are not given, of each image", default=2000, minimum=64,
          unit="px", metavar="PX"),
    Param("lines", Kind.INTEGER, "Lines of each image; 0 takes the samples", default=0, minimum=0, unit="px",
          metavar="PX"),
    Param("along", Kind.IDS, "Off-nadir angles along the track, one for each image of a place", unit="deg",
          metavar="A,B,…"),
    Param("across", Kind.NUMBER, "Off-nadir angle to the right of the track", default=0.0, minimum=-50.0, maximum=50.0,
          unit="deg", metavar="DEG"),
    Param("heading", Kind.NUMBER, "Azimuth of the flight, and of the lines", default=190.0, unit="deg", metavar="DEG"),
    Param("strips", Kind.INTEGER, "Strips beside each other", default=1, minimum=1, advanced=True, metavar="N"),
    Param("places", Kind.INTEGER, "Places along each strip", default=1, minimum=1, advanced=True, metavar="N"),
    Param("overlap", Kind.NUMBER, "Share by which neighbouring places overlap", default=0.2, minimum=0.0, maximum=0.9,
          advanced=True, metavar="SHARE"),
)  # fmt: skip
SCENE_PARAMS = (
    Param("lon", Kind.NUMBER, "Longitude of the scene's centre", default=5.45, unit="deg", metavar="DEG"),
    Param("lat", Kind.NUMBER, "Latitude of the scene's centre", default=43.53, unit="deg", metavar="DEG"),
    Param("height", Kind.NUMBER, "Mean ellipsoidal height", default=250.0, unit="m", metavar="M"),
    Param("relief", Kind.NUMBER, "Range of heights of the hills", default=100.0, minimum=0.0, unit="m", metavar="M"),
    Param("cliffs", Kind.NUMBER, "Height of cliffs; 0 makes none", default=0.0, minimum=0.0, unit="m", metavar="M"),
    Param("seed", Kind.INTEGER, "The same seed and options give the same block", default=1, minimum=0, metavar="N"),
)
POINT_PARAMS = (
    Param("gcps", Kind.INTEGER, "Number of GCPs, each a disc on the ground", default=10, minimum=0, metavar="N"),
    Param("checks", Kind.INTEGER, "Number of check points", default=50, minimum=0, metavar="N"),
    Param("ties", Kind.INTEGER, "Number of tie points", default=200, minimum=0, metavar="N"),
)
NOISE_PARAMS = (
    Param("noise-image", Kind.NUMBER, "Standard deviation of image coordinates", default=0.3, minimum=0.0, unit="px",
          metavar="PX"),
    Param("noise-gcp-xy", Kind.NUMBER, "Standard deviation of each horizontal coordinate of known points", default=0.1,
          minimum=0.0, unit="m", metavar="M"),
    Param("noise-gcp-h", Kind.NUMBER, "Standard deviation of the height of known points", default=0.15, minimum=0.0,
          unit="m", metavar="M"),
    Param("blunders", Kind.NUMBER, "Share of tie measurements that are gross errors", default=0.0, minimum=0.0,
          maximum=1.0, metavar="SHARE"),
    Param("gcp-blunders", Kind.NUMBER, "Share of GCP measurements that are gross errors", default=0.0, minimum=0.0,
          maximum=1.0, metavar="SHARE"),
    Param("blunder-size", Kind.NUMBER, "Mean size of gross errors", default=30.0, minimum=0.0, unit="px", advanced=True,
          metavar="PX"),
    Param("wrong-heights", Kind.NUMBER, "Share of GCPs with a wrong height", default=0.0, minimum=0.0, maximum=1.0,
          metavar="SHARE"),
    Param("wrong-height-size", Kind.NUMBER, "Size of wrong heights", default=25.0, minimum=0.0, unit="m", advanced=True,
          metavar="M"),
    Param("vendor-error", Kind.NUMBER, "Errors of the vendor's orbit and attitude, as a multiple of the sensor's usual "
          "ones; 0 gives exact RPCs", default=1.0, minimum=0.0, metavar="FACTOR"),
    _errors("vendor-position", "position east, north and up", "m"),
    _errors("vendor-position-drift", "position, its change over the image", "m"),
    _errors("vendor-attitude", "roll, pitch and yaw", "rad"),
    _errors("vendor-attitude-drift", "roll, pitch and yaw, their change over the image", "rad"),
    Param("jitter", Kind.NUMBER, "Amplitude of the attitude's vibration, unknown to the vendor", default=0.0,
          minimum=0.0, unit="px", advanced=True, metavar="PX"),
    Param("jitter-period", Kind.NUMBER, "Period of the vibration", default=2000.0, minimum=50.0, unit="lines",
          advanced=True, metavar="LINES"),
)  # fmt: skip
OUTPUT_CHOICES = (
    Param("pixels", Kind.FLAG, "Render the images; without, RPC files stand for them", default=True),
    Param("ms", Kind.FLAG, "Render multispectral images of larger pixels too", default=False),
    Param("ortho", Kind.FLAG, "Write an orthophoto of the scene, georeferenced and free of errors", default=False),
)

ALGORITHM = Algorithm(
    name="simulate",
    title="Simulate block",
    group="Simulation",
    summary="A synthetic block with images, DEM, GCPs, noise and full truth",
    help=(
        "Takes pushbroom images of a fractal, textured ground through an exact physical camera, with RPCs whose "
        "orbit and attitude are wrong as a vendor's are. Writes images, terrain (ellipsoidal heights), ground points, "
        "image points and the truth of all of them, to test methods and to plan blocks."
    ),
    declared=(
        *VIEW_PARAMS, *SCENE_PARAMS, *POINT_PARAMS, *NOISE_PARAMS, *OUTPUT_CHOICES, *OUTPUT_PARAMS, *COMMON_PARAMS,
    ),
    run=run,
    summarise=_summarise,
    layers=(
        "truth.gpkg|layername=true_ground_points",
        "truth.gpkg|layername=true_image_points",
        "truth.gpkg|layername=objects",
    ),
)  # fmt: skip

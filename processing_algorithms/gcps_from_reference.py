"""`gcps-from-reference`: GCPs by matching raw images to a reference orthoimage and DEM."""

import numpy as np

from ..hrsi_engine.block.orthoimage import REFERENCE_KIND
from ..hrsi_engine.foundation.errors import SolveError
from ..hrsi_engine.ground.geodesy import WGS84_3D
from ..hrsi_engine.ground.operation_uses import list_operation_warnings
from ..hrsi_engine.io.geopackage.declared_layers import ReferenceGcpRows, RejectedMatchRows
from ..hrsi_engine.io.geopackage.layers import Layer
from .block_steps import reference_control
from .block_steps.reference_control import PREFIX, FromReference
from .declarations.image_points import GCPS_FILE, GCPS_LAYER, GcpsFromReferenceOptions
from .files.opening import dem_surface, open_images
from .files.result_folder import check_folder, plan_folder, write_folder
from .interface.declare import Context, Report

REJECTED = "rejected"


def run(options: GcpsFromReferenceOptions, context: Context) -> Report:
    """Match the images with the reference and write the GCPs."""
    check_folder(options.folder, context)
    images = open_images(options.images, context)
    dem = dem_surface(options.dem, options.height_datum, strict_datum=options.strict_datum)
    if context.dry_run:
        reference_control.open_reference(options.reference.reference, options.reference.reference_band)
        return plan_folder(options.folder, GCPS_FILE, {"images": len(images)}, [], context)
    found = reference_control.find_reference_control(
        images, options.reference, dem, options.sigma_dem, context.stage(0.0, 0.9)
    )
    ground, measured = reference_control.reference_points(found)
    if not len(ground):
        raise SolveError(f"{options.reference.reference}: no GCP was found: {'; '.join(found.warnings)}")
    report: Report = {
        **context.record,
        "points": len(ground),
        "measurements": len(measured),
        "reference": found.entries,
        "warnings": [*found.warnings, *list_operation_warnings(found.operations)],
        "crs_operations": [use.entry() for use in found.operations],
    }
    sigma_m = tuple(ground.sigma_m[0])
    layers = [_make_layer(found, sigma_m, used=True), _make_layer(found, sigma_m, used=False)]
    write_folder(options.folder, report, GCPS_FILE, layers, context)
    return report


def _make_layer(found: FromReference, sigma_m: tuple[float, float], used: bool) -> Layer:
    """Return a layer of the matches that were used, or of those that were rejected, at their positions.

    ``sigma_m`` has the standard deviations of a horizontal coordinate and of the height of each place.
    """
    rows = [(part, part.used == used) for part in found.control.images]
    place = np.concatenate([part.places[here] for part, here in rows])
    ground = found.control.ground[place]
    residual = [
        part.offset_px[here] - (part.agreement.bias(part.xy[here]) if part.agreement else 0.0) for part, here in rows
    ]
    xy, left = np.concatenate([part.xy[here] for part, here in rows]), np.concatenate(residual)
    fields = (ReferenceGcpRows if used else RejectedMatchRows)(
        id=np.char.add(PREFIX, np.char.lstrip(found.control.ids[place], "R")),
        image=np.concatenate([np.full(int(here.sum()), part.image_id) for part, here in rows]),
        sample=xy[:, 0],
        line=xy[:, 1],
        sigma=np.concatenate([part.sigma_px[here] for part, here in rows]),
        kind=np.full(len(place), REFERENCE_KIND),
        quality=np.concatenate([part.score[here] for part, here in rows]),
        role=np.full(len(place), "gcp" if used else "tie"),
        sigma_xy=np.full(len(place), sigma_m[0]),
        sigma_h=np.full(len(place), sigma_m[1]),
        survey_lon=ground[:, 0],
        survey_lat=ground[:, 1],
        survey_height=ground[:, 2],
        residual_sample_px=left[:, 0],
        residual_line_px=left[:, 1],
    )
    return Layer(GCPS_LAYER if used else REJECTED, "PointZ", WGS84_3D, ground, fields)


def summarise(report: Report) -> str:
    """Return the number of GCPs, and the matches and bias of each image."""
    reference = report["reference"]
    lines = [
        f"{report['points']} GCPs, {report['measurements']} measurements; reference {reference['gsd_m']:.2f} m per "
        f"pixel, sigma {reference['sigma_xy_m']:.2f} m, heights {reference['sigma_h_m']:.2f} m"
    ]
    lines += [
        f"{name}: {image['used']} of {image['matched']} matches agree to {image['spread_px']:.2f} px; error of its RPC "
        f"{image['bias_sample_px']:+.1f} {image['bias_line_px']:+.1f} px ({image['east_m']:+.1f} m east, "
        f"{image['north_m']:+.1f} m north)"
        for name, image in reference["images"].items()
        if not image["refusal"]
    ]
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])

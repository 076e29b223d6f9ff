"""`gcps-from-reference`: GCPs by matching raw images to a reference orthoimage and DEM."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..hrsi_engine.foundation.options import nested, option
from .block_steps.options import images_option
from .block_steps.reference_control import FromReference, ReferenceImage
from .files.image_files import open_images
from .files.result_folder import check_folder, write_folder
from .files.terrain import DemOptions, height_datum_option
from .interface.declare import Algorithm, Context, Kind, Report, ResultFolder, settings_of

if TYPE_CHECKING:
    from ..hrsi_engine.io.layers import Layer

LAYERS_FILE, LAYER, REJECTED = "gcps.gpkg", "gcps", "rejected"
WGS84_3D = 4979


@dataclass(frozen=True, kw_only=True)
class RequiredReference(ReferenceImage):
    """A reference orthoimage that has to be named."""

    reference: str = option(
        help="Orthoimage in which GCPs are found by matching, in any CRS", kind=Kind.RASTER, metavar="FILE"
    )


@dataclass(frozen=True, kw_only=True)
class RequiredDem(DemOptions):
    """A DEM that has to be named."""

    dem: str = option(help="DEM of the ground, in any CRS", kind=Kind.RASTER, metavar="FILE")


@dataclass(frozen=True, kw_only=True)
class GcpsFromReferenceOptions:
    """What `gcps-from-reference` takes."""

    images: tuple[str, ...] = images_option("Images with RPC and pixels")
    reference: RequiredReference = nested(RequiredReference)
    dem: RequiredDem = nested(RequiredDem)
    height_datum: str = height_datum_option()
    sigma_dem: float | None = option(
        None,
        "Standard deviation of the DEM's heights; by default from the size of its cells",
        minimum=1e-6,
        unit="m",
        metavar="M",
    )
    folder: ResultFolder = nested(ResultFolder)


def run(options: GcpsFromReferenceOptions, context: Context) -> Report:
    """Match the images with the reference and write the GCPs."""
    from ..hrsi_engine.foundation.errors import SolveError
    from ..hrsi_engine.foundation.version import VERSION
    from .block_steps import reference_control

    check_folder(options.folder)
    images = open_images(options.images, context.log)
    matching = context.stage(0.0, 0.9)
    found = reference_control.match(
        images, options.reference, options.dem.surface(options.height_datum), options.sigma_dem, matching
    )
    ground, measured = reference_control.points(found)
    if not len(ground):
        raise SolveError(f"{options.reference.reference}: no GCP was found: {'; '.join(found.warnings)}")
    report: Report = {
        "schema": 1, "algorithm": "gcps-from-reference", "version": VERSION, "points": len(ground),
        "measurements": len(measured), "reference": found.entries, "warnings": found.warnings,
        "settings": settings_of(options),
    }  # fmt: skip
    layers = [_layer(LAYER, found, used=True), _layer(REJECTED, found, used=False)]
    write_folder(options.folder, report, LAYERS_FILE, layers, context)
    return report


def _layer(name: str, found: FromReference, used: bool) -> Layer:
    """Return the matches that agree, or those that do not, at the positions of their places in the reference."""
    import numpy as np

    from ..hrsi_engine.io.layers import Layer
    from .block_steps.reference_control import KIND, PREFIX

    control = found.control
    most = max(int(part.used.sum()) for part in control.images)
    sigma_xy, sigma_h = found.accuracy.of_points(most)
    rows = [(part, part.used == used) for part in control.images]
    place = np.concatenate([part.places[here] for part, here in rows])
    ground = control.ground[place]
    residual = [
        part.offset_px[here] - (part.agreement.bias(part.xy[here]) if part.agreement else 0.0) for part, here in rows
    ]
    xy, left = np.concatenate([part.xy[here] for part, here in rows]), np.concatenate(residual)
    fields = {
        "id": np.char.add(PREFIX, np.char.lstrip(control.ids[place], "R")),
        "image": np.concatenate([np.full(int(here.sum()), part.image_id) for part, here in rows]),
        "role": np.full(len(place), "gcp" if used else "tie"), "kind": np.full(len(place), KIND),
        "sample": xy[:, 0], "line": xy[:, 1],
        "sigma": np.concatenate([part.sigma_px[here] for part, here in rows]),
        "quality": np.concatenate([part.score[here] for part, here in rows]),
        "sigma_xy": np.full(len(place), sigma_xy), "sigma_h": np.full(len(place), sigma_h),
        "survey_lon": ground[:, 0], "survey_lat": ground[:, 1], "survey_height": ground[:, 2],
        "residual_sample_px": left[:, 0], "residual_line_px": left[:, 1],
    }  # fmt: skip
    return Layer(name, "PointZ", WGS84_3D, ground, fields)


def summarise(report: Report) -> str:
    """Return what was found in each image."""
    reference = report["reference"]
    lines = [
        f"{report['points']} GCPs, {report['measurements']} measurements; reference {reference['gsd_m']:.2f} m per "
        f"pixel, sigma {reference['sigma_xy_m']:.2f} m, heights {reference['sigma_h_m']:.2f} m"
    ]
    for name, image in reference["images"].items():
        if image["refusal"]:
            continue
        lines.append(
            f"{name}: {image['used']} of {image['matched']} matches agree to {image['spread_px']:.2f} px; its RPC is "
            f"off by {image['bias_sample_px']:+.1f} {image['bias_line_px']:+.1f} px "
            f"({image['east_m']:+.1f} m east, {image['north_m']:+.1f} m north)"
        )
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])


ALGORITHM = Algorithm(
    name="gcps-from-reference",
    title="GCPs from reference image",
    group="Image points",
    summary="GCPs by matching raw images to a reference orthoimage and DEM",
    help=(
        "Finds textured places of an orthoimage in raw images, to a fraction of a pixel: RPC and DEM predict what each "
        "image should show, and matching finds it there. RPCs may be off by hundreds of pixels, the orthoimage may be "
        "of another season or sensor and coarser than the images. Matches that do not follow one bias of the image "
        "are left out. The GCPs have their position from the orthoimage, their height from the DEM (above the "
        "ellipsoid), and sigmas such that all points of the reference together count as four independent ones of its "
        "accuracy, because errors of an orthoimage are alike over wide areas. A reference that lies farther beside the "
        "RPCs than ERR_BIAS and its own sigma explain is named.\n\n"
        "The layer gcps is ready for adjust and triangulate; triangulate with its `reference` does both in one go."
    ),
    options=GcpsFromReferenceOptions,
    run=run,
    summarise=summarise,
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
    packages=("cv2",),
)  # fmt: skip

"""`register`: registration of two images from their matched points, centres against corners (thesis chapter 2)."""

from __future__ import annotations

from ....hrsi_engine.foundation.options import nest_options, option, options
from ....hrsi_engine.laboratory.registration_options import RegistrationOptions
from ...interface.declare import Algorithm, Kind
from ...interface.option_groups import ResultFolder, TerrainOptions, report_option

LAYERS_FILE, LAYER = "registration.gpkg", "residuals"


@options(kw_only=True)
class RegisterOptions:
    """What `register` takes."""

    images: tuple[str, ...] = option((), "The two images; needed for the models with RPC only", kind=Kind.IMAGES)
    image_points: str = option(help="Points measured in both images", kind=Kind.POINTS, metavar="FILE")
    first: str | None = option(None, "Id of the first image; by default the first one", metavar="ID")
    second: str | None = option(None, "Id of the second image; by default the next one", metavar="ID")
    registration: RegistrationOptions = nest_options(RegistrationOptions)
    gsd: float | None = option(None, "Pixel size of the second image, for residuals in metres", minimum=1e-6, unit="m")
    terrain: TerrainOptions = nest_options(TerrainOptions)
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option()


ALGORITHM = Algorithm(
    name="register",
    title="Register two images",
    group="Laboratory",
    summary="Registration of two images from matched points, by kind of point",
    help=(
        "Transforms the points of the first image to the second one, in image space or with the RPCs (on a DEM or at "
        "a height). It reports the residuals of centres and corners, used separately and together. The images can "
        "have different resolutions. Residuals are in pixels of the second image, or in metres with `gsd`."
    ),
    options=RegisterOptions,
    examples=("hrsi register --image-points block/image_points.csv --model affine --output-dir registration",),
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)

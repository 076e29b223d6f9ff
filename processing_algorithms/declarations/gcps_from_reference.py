"""`gcps-from-reference`: GCPs by matching raw images to a reference orthoimage and DEM."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm
from ..interface.option_groups import (
    MandatoryDem,
    MandatoryReference,
    ResultFolder,
    height_datum_option,
    images_option,
    strict_datum_option,
)

LAYERS_FILE, LAYER = "gcps.gpkg", "gcps"


@options(kw_only=True)
class GcpsFromReferenceOptions:
    """What `gcps-from-reference` takes."""

    images: tuple[str, ...] = images_option("Images with RPC and pixels")
    reference: MandatoryReference = nest_options(MandatoryReference)
    dem: MandatoryDem = nest_options(MandatoryDem)
    height_datum: str = height_datum_option()
    strict_datum: bool = strict_datum_option()
    sigma_dem: float | None = option(
        None, "Standard deviation of the DEM's heights; by default from the size of its cells", minimum=1e-6, unit="m",
        metavar="M",
    )  # fmt: skip
    folder: ResultFolder = nest_options(ResultFolder)


ALGORITHM = Algorithm(
    name="gcps-from-reference", title="GCPs from reference image", group="Image points",
    summary="GCPs by matching raw images to a reference orthoimage and DEM",
    help=(
        "Finds textured places of an orthoimage in raw images, to a fraction of a pixel: RPC and DEM predict what each "
        "image should show, and matching finds it there. RPCs may be off by hundreds of pixels, the orthoimage may be "
        "of another season or sensor and coarser than the images. Matches that do not follow one bias of the image "
        "are left out. The GCPs have their position from the orthoimage, their height from the DEM (above the "
        "ellipsoid), and sigmas such that all points of the reference together count as what they share: 0.8 of its "
        "sigma and a little more, because errors of an orthoimage are alike over wide areas. A reference that lies "
        "farther beside the RPCs than ERR_BIAS and its own sigma explain is named.\n\n"
        "The layer gcps is ready for adjust and triangulate; triangulate with its `reference` does both in one go."
    ),
    options=GcpsFromReferenceOptions,
    examples=(
        "hrsi gcps-from-reference block/image_*.tif --reference block/orthophoto.tif "
        "--dem block/dem.tif --height-datum ellipsoidal --output-dir control",
    ),
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip

"""`ortho-check`: how well orthoimages fit one another, or a reference, before and after."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.ortho.options import MisregistrationOptions
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import Common, ResultFolder, report_option

LAYERS_FILE, LAYERS = "misregistration.gpkg", ("misregistration_utm", "misregistration_wgs84")


@options(kw_only=True)
class OrthoCheckOptions:
    """What `ortho-check` takes."""

    images: tuple[str, ...] = option(help="Orthoimages", kind=Kind.IMAGES, metavar="ORTHO")
    reference: str | None = option(
        None, "Compare with this orthoimage instead of with one another", kind=Kind.RASTER, metavar="FILE"
    )
    before: str | None = option(None, "Folder with orthoimages of the same names, made before", metavar="DIR")
    matching: MisregistrationOptions = nest_options(MisregistrationOptions)
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option()
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="ortho-check", title="Check orthoimages", group="Orthoimages",
    summary="Misregistration between overlapping orthoimages, as numbers and arrows",
    help=(
        "Compares orthoimages of one map grid, each with each that overlaps it, or all with a reference. In windows "
        "spread over the common ground the shift is measured to a few hundredths of a pixel by correlation and least "
        "squares, around the shift that the pair has in common (up to 256 px). Reports medians, robust spreads and "
        "90th percentiles, and writes a layer of arrows. `before` names the folder of the orthoimages made with the "
        "original RPCs: both are then compared in the same windows."
    ),
    options=OrthoCheckOptions,
    examples=(
        "hrsi ortho-check ortho/image_*_ortho.tif --output-dir check",
    ),
    layers=(f"{LAYERS_FILE}|layername={LAYERS[0]}",),
)  # fmt: skip

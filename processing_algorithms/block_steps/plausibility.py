"""Whether the inputs of a block can be what they claim, asked once for every algorithm that adjusts."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ...hrsi_engine.block.block import Block
from ...hrsi_engine.foundation.errors import InputError, SolveError
from ...hrsi_engine.foundation.reasons import Level, Reason
from ...hrsi_engine.io.rasters.images import pixel_doubt, resampling_doubt
from ...hrsi_engine.plausibility import check_block
from ..files.terrain import dem_surface
from ..interface.option_groups import DemOptions, PointFiles


def input_reasons(
    block: Block, points: PointFiles, dem: DemOptions | None = None, sigma_shift_px: float | None = None,
    sigma_drift: float | None = None,
) -> list[Reason]:  # fmt: skip
    """Return what in a block's inputs a careful operator would have to look into, worst first.

    The sigmas are those of the RPCs' errors where the user states them.
    """
    surface = None if dem is None else dem_surface(dem, points.height_datum, points.gcp_epoch)
    found = check_block(block, surface=surface, sigma_shift_px=sigma_shift_px or 0.0, sigma_drift=sigma_drift or 0.0)
    for image in block.images:
        if doubt := pixel_doubt(image):
            advice = "name the image as it was taken"
            return [*found, Reason("orthoimage-rpc", Level.DOUBTFUL, f"image {image.id}: {doubt}", advice, (image.id,))]
    for image in block.images:
        ignored = resampling_doubt(image)
        if ignored and ignored.is_gross:
            advice = "make the image again with 'crop', or put the RPC of its pixels into it"
            return [
                *found,
                Reason("resampled-rpc", Level.DOUBTFUL, f"image {image.id}: {ignored}", advice, (image.id,)),
            ]
    return found


@contextmanager
def explain_failures(reasons: Sequence[Reason]) -> Iterator[None]:
    """Say what is wrong with the inputs where an adjustment fails on them, not how the adjustment failed."""
    try:
        yield
    except (SolveError, InputError) as error:
        worst = next(iter(reasons), None)
        if worst is None:
            raise
        raise InputError(f"{worst.message}: {worst.advice} ({worst.code}; {error})") from error

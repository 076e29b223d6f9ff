"""Where the relief of a surface puts the block, against what is believed of its RPCs."""

from collections.abc import Iterator

import numpy as np

from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.thresholds import threshold, thresholds
from .evidence import Evidence


@thresholds
class SURFACE_OFFSET:
    """When a surface displaces a block by more than its RPCs explain."""

    sigmas: float = threshold(3.5, "sigma", "displacement in plan beyond the RPCs' place that is reported")


def find_surface_offsets(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for parts that the relief puts farther off than the pointing of their RPCs explains."""
    for one in evidence.result.surfaces:
        east, north, up = one.match.displacement_m.tolist()
        if not one.open and one.beyond_pointing > SURFACE_OFFSET.sigmas:
            yield Reason(
                "surface-offset", Level.DOUBTFUL,
                f"the relief of the surface puts {list_ids(one.images)} {np.hypot(east, north):.1f} m in plan off "
                f"where the RPCs do ({east:+.1f} m east, {north:+.1f} m north, {up:+.1f} m up), "
                f"{one.beyond_pointing:.1f} standard deviations (of the RPCs: {one.pointing_m:.1f} m a coordinate)",
                "if the surface is right, the block is now: check its place and height datum by a point or two",
                images=one.images,
            )  # fmt: skip


def find_open_surfaces(evidence: Evidence) -> Iterator[Reason]:
    """Yield, for parts that the relief does not hold in plan, why; it accuses nothing."""
    for one in evidence.result.surfaces:
        if one.open:
            yield Reason(
                "surface-open", Level.OK,
                f"the relief of the surface does not hold {list_ids(one.images)} in plan: {one.open}",
                "only the RPCs hold it in plan, as well as its CE90 says: GCPs or a reference orthoimage tell more",
                images=one.images,
            )  # fmt: skip


#: Every check of surfaces.
ON_SURFACES = (find_surface_offsets, find_open_surfaces)

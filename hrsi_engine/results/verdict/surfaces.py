"""Position of the block by the relief of a surface, compared with the a priori accuracy of its RPCs."""

from collections.abc import Iterator

import numpy as np

from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.robust_scale import ROBUST
from .evidence import Evidence


def find_surface_reasons(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for parts that the relief displaces by more than the pointing error of their RPCs explains.

    A relief that does not determine a part in plan is a reason of level OK.
    """
    for one in evidence.result.surfaces:
        east, north, up = one.match.displacement_m.tolist()
        if one.open:
            yield Reason(
                "not-determined",
                Level.OK,
                f"the relief of the surface does not determine {list_ids(one.images)} in plan: {one.open}",
                "the position in plan follows from the RPCs alone, with the stated CE90: add GCPs or a reference "
                "orthoimage",
                images=one.images,
            )
        elif one.beyond_pointing > ROBUST.outlier:
            yield Reason(
                "surface-offset",
                Level.DOUBTFUL,
                f"matching with the relief of the surface shifts {list_ids(one.images)} by "
                f"{np.hypot(east, north):.1f} m in plan ({east:+.1f} m east, {north:+.1f} m north, {up:+.1f} m up), "
                f"{one.beyond_pointing:.1f} times the standard deviation (of the RPCs: {one.pointing_m:.1f} m per "
                "coordinate)",
                "check the georeference and height datum of the surface with one or two surveyed points",
                images=one.images,
            )

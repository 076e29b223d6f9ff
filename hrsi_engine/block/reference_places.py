"""Points of a reference orthoimage: their plan position is known from it, and they are measured on images."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

REFERENCE_KIND = "reference"  # of their image points


@dataclass(frozen=True, eq=False)
class ReferencePlaces:
    """Points of a reference orthoimage that determine a block in plan.

    ids : (k,) their names in the block
    ground : (k, 3) lon, lat in degrees, ellipsoidal height in metres; the height is where to begin
    sigma_m : standard deviation of each horizontal coordinate of the reference
    over_rpcs : True if the reference determines the block like surveyed GCPs, without the RPCs' own accuracy
    name : what reports call it
    """

    ids: np.ndarray
    ground: np.ndarray
    sigma_m: float
    over_rpcs: bool = False
    name: str = "reference"

    def select(self, ids: np.ndarray) -> ReferencePlaces:
        """Return the places with some ids, in their order."""
        order = np.argsort(self.ids)
        rows = order[np.searchsorted(self.ids, ids, sorter=order)]
        return replace(self, ids=self.ids[rows], ground=self.ground[rows])

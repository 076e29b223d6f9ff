"""GCPs that contribute less than their number suggests: outside the images, on nodata, or measured in one image."""

import numpy as np

from ..foundation.thresholds import LISTS, threshold, thresholds
from .block import Block
from .points import Role


@thresholds
class CONTROL_VISIBILITY:
    """Limits for the test whether GCPs are visible."""

    edge_px: float = threshold(1.5, "px", "tolerance at the edge, for coordinates that begin at 1")


def find_weak_control(block: Block) -> dict[str, list[str]]:
    """Return the ids of GCPs by what limits them: ``outside the image``, ``on nodata``, ``in one image only``.

    A GCP outside all its images, or on nodata in all, has no visible target: its measurement cannot be verified. One
    that is measured in one image of a block does not determine the height of a ray.
    """
    measured = block.measurements
    rows = np.flatnonzero(block.points.role[measured.point] == Role.GCP)
    kinds = {"outside the image": np.zeros(len(rows), dtype=bool), "on nodata": np.zeros(len(rows), dtype=bool)}
    for index, row in enumerate(rows.tolist()):
        image, xy = block.images[int(measured.image[row])], measured.xy[row]
        if image.size is None:
            continue
        outside = (np.abs(xy - image.centre_px) > image.half_size_px + 0.5 + CONTROL_VISIBILITY.edge_px).any()
        kinds["outside the image"][index] = outside
        if image.raster is not None and not outside and len(rows) <= LISTS.rows:
            sample, line = np.clip(np.rint(xy).astype(int), 0, np.array(image.size) - 1).tolist()
            kinds["on nodata"][index] = not image.raster.read(sample, line, 1, 1)[1].all()
    points, number = np.unique(measured.point[rows], return_inverse=True)
    rays = np.bincount(number, minlength=len(points))
    result = {
        kind: block.points.ids[points[np.bincount(number, affected, len(points)) == rays]].tolist()
        for kind, affected in kinds.items()
    }
    names_of = {name for names in result.values() for name in names}
    single = block.points.ids[points[rays == 1]].tolist() if len(block.images) > 1 else []
    return {**result, "in one image only": [name for name in single if name not in names_of]}

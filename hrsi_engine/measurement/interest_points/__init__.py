"""Interest points of an image: corners, super points and gravity centres, to a tenth of a pixel.

Layers, each importing only those above it::

    windows          images of any size in overlapping windows, masks
    statistics       what an image is like; grey values relative to their surroundings
    corners          Harris and Förstner strengths, sub-pixel peaks
    level_regions    stable closed regions at many grey levels and scales
    outlines         their sub-pixel outlines
    gravity_centres  ellipses, rectangles and polygons through the outlines, and their centres
    points           the table of points, spreading over a grid
    detectors        `DETECTORS` and `detect_interest_points`
"""

from .corners import CornerOptions
from .detectors import DETECTORS, DetectionOptions, Detector, detect_interest_points
from .gravity_centres import CentreOptions
from .points import InterestPoints, spread_over_grid
from .windows import Area

__all__ = [
    "DETECTORS", "Area", "CentreOptions", "CornerOptions", "DetectionOptions", "Detector", "InterestPoints",
    "detect_interest_points", "spread_over_grid",
]  # fmt: skip

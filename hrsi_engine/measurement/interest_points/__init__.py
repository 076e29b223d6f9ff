"""Interest points of an image: corners, super points and gravity centres, to a tenth of a pixel.

Layers, each importing only those above it::

    windows          images of any size in overlapping windows, masks
    statistics       what an image is like; grey values relative to their surroundings
    corners          Harris and Förstner strengths, sub-pixel peaks
    level_regions    compact regions: brighter, darker or more even than all around them
    outlines         their sub-pixel outlines
    shapes           ellipses, rectangles and polygons through the outlines
    gravity_centres  the best shape of each object, its centre and quality
    points           the table of points, spreading over a grid
    detectors        `DETECTORS` and `detect_interest_points`
"""

from .corners import CornerOptions
from .detectors import DETECTORS, DetectionOptions, Detector, detect_interest_points, inside
from .gravity_centres import STRONG_QUALITY, CentreOptions
from .points import InterestPoints, spread_over_grid
from .windows import Area

__all__ = [
    "DETECTORS", "STRONG_QUALITY", "Area", "CentreOptions", "CornerOptions", "DetectionOptions", "Detector",
    "InterestPoints",
    "detect_interest_points", "inside", "spread_over_grid",
]  # fmt: skip

"""Interest points of an image: corners, super points and gravity centres, to a tenth of a pixel.

Layers, each importing only those above it::

    options          what to look for
    windows          images of any size in overlapping windows, masks, grey values relative to their surroundings
    corners          Harris and Förstner strengths, sub-pixel peaks
    level_regions    compact regions: brighter, darker or more even than all around them
    outlines         their sub-pixel outlines
    shapes           ellipses, rectangles and polygons through the outlines
    find_gravity_centres  the best shape of each object, its centre and quality
    blobs            spots without a shape inside a closed outline, and their grey-weighted centres
    points           the table of points, spreading over a grid
    detectors        `DETECTORS` and `detect_interest_points`
"""

from ...foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "options": "DETECTOR_SETS STRONG_QUALITY CentreOptions CornerOptions DetectionOptions",
    "detectors": "DETECTORS Detector detect_interest_points clip_to_image",
    "points": "InterestPoints select_best_per_cell",
    "windows": "Area",
})  # fmt: skip

"""Interest points of an image as a table: corners, super points, gravity centres and blobs.

Layers, each importing only those above it::

    options          what to look for
    corners          Harris and Förstner strengths, sub-pixel peaks
    blobs            spots without a shape inside a closed outline, and their grey-weighted centres
    points           the table of points, spreading over a grid
    detectors        `DETECTORS` and `detect_interest_points`
    shadows          dark centres that are the shadow side of an object

Windows, the structure tensor and gravity centres are those of `measurement.interest_points`.
"""

from ...foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "options": "DETECTOR_SETS CornerOptions DetectionOptions",
        "detectors": "DETECTORS Detector detect_interest_points clip_to_image",
        "points": "InterestPoints select_best_per_cell",
    },
)

"""Gravity centres of objects, and functions common to all detectors of interest points.

Layers, each importing only those above it::

        options          selection of gravity centres
        windows          images of any size in overlapping windows, masks, normalised grey values
        corners          the structure tensor and its maxima
        level_regions    compact regions: brighter, darker or more homogeneous than their surroundings
        outlines         their sub-pixel outlines
        shapes           ellipses, rectangles and polygons through the outlines
        gravity_centres  the best shape of each object, its centre and quality
"""

from ...foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {"options": "STRONG_QUALITY CentreOptions", "windows": "Area"})

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

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .options import STRONG_QUALITY as STRONG_QUALITY
from .options import CentreOptions as CentreOptions
from .windows import Area as Area

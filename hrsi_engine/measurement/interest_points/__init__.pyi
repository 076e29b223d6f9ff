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

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .detectors import DETECTORS as DETECTORS
from .detectors import Detector as Detector
from .detectors import clip_to_image as clip_to_image
from .detectors import detect_interest_points as detect_interest_points
from .options import DETECTOR_SETS as DETECTOR_SETS
from .options import STRONG_QUALITY as STRONG_QUALITY
from .options import CentreOptions as CentreOptions
from .options import CornerOptions as CornerOptions
from .options import DetectionOptions as DetectionOptions
from .points import InterestPoints as InterestPoints
from .points import select_best_per_cell as select_best_per_cell
from .windows import Area as Area

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

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .detectors import DETECTORS as DETECTORS
from .detectors import Detector as Detector
from .detectors import clip_to_image as clip_to_image
from .detectors import detect_interest_points as detect_interest_points
from .options import DETECTOR_SETS as DETECTOR_SETS
from .options import CornerOptions as CornerOptions
from .options import DetectionOptions as DetectionOptions
from .points import InterestPoints as InterestPoints
from .points import select_best_per_cell as select_best_per_cell

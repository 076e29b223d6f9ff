"""Measurement in images: image matching, gravity centres, targets, tie points and control from a reference."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .reference.matching import ReferenceControl as ReferenceControl
from .reference.matching import match_reference as match_reference
from .reference.options import ReferenceOptions as ReferenceOptions
from .targets.measuring import TargetMeasurement as TargetMeasurement
from .targets.measuring import measure_edges as measure_edges
from .targets.measuring import measure_target as measure_target
from .targets.options import TargetOptions as TargetOptions
from .tie_options import TieOptions as TieOptions
from .tie_points import TiePoints as TiePoints
from .tie_points import find_tie_points as find_tie_points

"""Measurement in images: interest points, matching of all kinds, targets, tie points and control from a reference."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .control_network import ControlNetworkMatch as ControlNetworkMatch
from .control_network import ControlNetworkOptions as ControlNetworkOptions
from .control_network import match_windows as match_windows
from .interest_points import DetectionOptions as DetectionOptions
from .interest_points import InterestPoints as InterestPoints
from .interest_points import detect_interest_points as detect_interest_points
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

"""The laboratory: simulated blocks and the studies of the thesis; nothing else in the engine imports it."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .control_network import ControlNetworkMatch as ControlNetworkMatch
from .control_network import ControlNetworkOptions as ControlNetworkOptions
from .control_network import match_windows as match_windows
from .interest_points import DetectionOptions as DetectionOptions
from .interest_points import InterestPoints as InterestPoints
from .interest_points import detect_interest_points as detect_interest_points
from .registration import MethodComparison as MethodComparison
from .registration import compare_kinds as compare_kinds

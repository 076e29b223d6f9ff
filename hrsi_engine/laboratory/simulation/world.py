"""Constants of the simulated world: sizes of roads, habits of farmers, noise of lasers.

They describe what is simulated, and decide nothing about a result. They are declared like thresholds, with unit,
meaning and origin, and are not listed among these.
"""

from ...foundation.thresholds import threshold as constant
from ...foundation.thresholds import thresholds as constants

__all__ = ["constant", "constants"]

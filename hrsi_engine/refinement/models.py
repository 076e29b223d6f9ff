"""Every model by its name."""

from __future__ import annotations

from .direct_rpc import DIRECT
from .image_space import IMAGE_SPACE
from .model import RefinementModel
from .object_coordinates import OBJECT_COORDINATES
from .object_space import OBJECT_SPACE
from .pseudo_sensor import PSEUDO_SENSOR

#: Models for blocks and single images.
BLOCK_MODELS: dict[str, RefinementModel] = {**IMAGE_SPACE, **OBJECT_COORDINATES, **OBJECT_SPACE, **PSEUDO_SENSOR}
#: Every model; the direct methods are for single images with GCPs.
MODELS: dict[str, RefinementModel] = {**BLOCK_MODELS, **DIRECT}

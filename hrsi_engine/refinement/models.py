"""All refinement models by their names; the laboratory's direct methods are added to this table there."""

from .image_space import IMAGE_SPACE
from .model import RefinementModel
from .object_coordinates import OBJECT_COORDINATES
from .object_space import OBJECT_SPACE
from .pseudo_sensor import PSEUDO_SENSOR

MODELS: dict[str, RefinementModel] = {**IMAGE_SPACE, **OBJECT_COORDINATES, **OBJECT_SPACE, **PSEUDO_SENSOR}

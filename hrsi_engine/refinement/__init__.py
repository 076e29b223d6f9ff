"""Refinement of RPCs: models of what is wrong with a camera, all behind one contract (`model.RefinementModel`).

| module             | holds                                                                            |
|--------------------|----------------------------------------------------------------------------------|
| model              | the contract, priors                                                             |
| image_space        | bias compensation: polynomials of the image position                             |
| object_coordinates | polynomials of the ground position, added in the image                           |
| object_space       | corrections of the ground position                                               |
| pseudo_rays        | pseudo light rays of image points                                                |
| pseudo_sensor      | the generic method: corrections of a pseudo sensor                               |
| direct_rpc         | corrections of the coefficients themselves                                       |
| estimate           | parameters of one image from its GCPs                                            |
| selection          | which model the GCPs support, and which GCPs disagree                            |
| control_checks     | GCPs that cannot be right                                                        |
| refine             | one image from GCPs: checks, selection, estimation, comparison of models         |
"""

from .direct_rpc import DIRECT
from .image_space import IMAGE_SPACE
from .model import Equations, Priors, RefinedRPC, RefinementModel, priors_of
from .object_coordinates import OBJECT_COORDINATES
from .object_space import OBJECT_SPACE
from .pseudo_sensor import PSEUDO_SENSOR

#: Models for blocks and single images, by their names on the command line.
BLOCK_MODELS: dict[str, RefinementModel] = {**IMAGE_SPACE, **OBJECT_COORDINATES, **OBJECT_SPACE, **PSEUDO_SENSOR}
#: Every model; the direct methods are for single images with GCPs.
MODELS: dict[str, RefinementModel] = {**BLOCK_MODELS, **DIRECT}

__all__ = ["BLOCK_MODELS", "MODELS", "Equations", "Priors", "RefinedRPC", "RefinementModel", "priors_of"]

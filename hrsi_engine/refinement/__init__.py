"""Refinement of RPCs: models of what is wrong with a camera, all behind one contract (`model.RefinementModel`)."""

from .image_space import IMAGE_SPACE
from .model import Equations, Priors, RefinedRPC, RefinementModel, priors_of

#: Every model by its name on the command line.
MODELS: dict[str, RefinementModel] = {**IMAGE_SPACE}

__all__ = ["MODELS", "Equations", "Priors", "RefinedRPC", "RefinementModel", "priors_of"]

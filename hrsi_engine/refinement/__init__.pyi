"""Refinement of RPCs: models for correcting a camera, all with one interface (`model.RefinementModel`).

| module             | contains                                                                       |
|--------------------|--------------------------------------------------------------------------------|
| model              | the interface, priors                                                          |
| model_table        | the models' names, titles and settings, how to refine an image; no numerics    |
| models             | all models by their names                                                      |
| image_space        | bias compensation: polynomials of the image position                           |
| object_coordinates | polynomials of the ground position, added in the image                         |
| object_space       | corrections of the ground position                                             |
| pseudo_rays        | pseudo light rays of image points, their corrections and equations             |
| pseudo_sensor      | the generic method: corrections of a pseudo sensor                             |
| compiled_cameras   | the equations of many image points by compiled loops over the models' formulas |
| estimate           | parameters of one image from its GCPs                                          |
| selection          | choice of the model from the GCPs, and contradicting GCPs                      |
| refine             | one image from GCPs: checks of the points, selection of the model, estimation  |
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .model import Equations as Equations
from .model import Priors as Priors
from .model import RefinementModel as RefinementModel
from .model import RefitRPC as RefitRPC
from .model import select_priors as select_priors
from .models import MODELS as MODELS

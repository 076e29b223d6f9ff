"""Refinement of RPCs: models of what is wrong with a camera, all behind one contract (`model.RefinementModel`).

| module             | holds                                                                            |
|--------------------|----------------------------------------------------------------------------------|
| model              | the contract, priors                                                             |
| model_table        | the models' names, titles and settings, how to refine an image; no numerics      |
| models             | every model by its name                                                          |
| image_space        | bias compensation: polynomials of the image position                             |
| object_coordinates | polynomials of the ground position, added in the image                           |
| object_space       | corrections of the ground position                                               |
| pseudo_rays        | pseudo light rays of image points                                                |
| pseudo_sensor      | the generic method: corrections of a pseudo sensor                               |
| corrected_rays     | … its formula: where a corrected ray passes, and the equations of it             |
| compiled_cameras   | the equations of many image points by compiled loops over the models' formulas   |
| estimate           | parameters of one image from its GCPs                                            |
| selection          | which model the GCPs support, and which GCPs disagree                            |
| refine             | one image from GCPs: checks, selection, estimation, comparison of models         |
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .model import Equations as Equations
from .model import Priors as Priors
from .model import RefinementModel as RefinementModel
from .model import RefitRPC as RefitRPC
from .model import select_priors as select_priors
from .models import MODELS as MODELS

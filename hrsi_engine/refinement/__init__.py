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

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__, {"model": "Equations Priors RefitRPC RefinementModel select_priors", "models": "MODELS"}
)

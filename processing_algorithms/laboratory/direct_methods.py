"""The models of `refine-rpc`: those of the engine, and the direct methods of the thesis."""

from __future__ import annotations

from ...hrsi_engine.laboratory.direct_methods import DIRECT
from ...hrsi_engine.refinement.model import RefinementModel
from ...hrsi_engine.refinement.models import MODELS

SINGLE_IMAGE_MODELS: dict[str, RefinementModel] = {**MODELS, **DIRECT}

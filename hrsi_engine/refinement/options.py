"""How to refine an image, and the names of models and rules, which declarations need without the models themselves."""

from __future__ import annotations

from ..foundation.options import option, options
from .model_table import BLOCK_MODEL_NAMES, DIRECT_MODEL_NAMES

#: Rules that choose a model from the GCPs (`selection.RULES`).
RULE_NAMES = ("auto", "generic")


@options
class RefineOptions:
    """How to refine an image from its GCPs."""

    model: str = option(
        "auto", "Correction of each image's RPC", choices=(*RULE_NAMES, *BLOCK_MODEL_NAMES, *DIRECT_MODEL_NAMES)
    )
    leave_out: bool = option(
        True, "GCPs that disagree with the others are left out; they are named in any case", advanced=True
    )

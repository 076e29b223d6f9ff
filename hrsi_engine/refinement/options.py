"""How to refine an image, and the names of models and rules, which declarations need without the models themselves."""

from __future__ import annotations

from ..foundation.options import option, options

#: Rules that choose a model from the GCPs (`selection.RULES`).
RULE_NAMES = ("auto", "generic")
#: Models for blocks and single images (`models.BLOCK_MODELS`).
BLOCK_MODEL_NAMES = (
    "none", "shift", "shift-drift", "conformal", "affine", "quadratic", "ground-linear", "ground-quadratic",
    "object-shift", "object-scale-shift", "object-affine", "generic-position", "generic-shift", "generic-12",
    "generic-affine", "generic-full",
)  # fmt: skip
#: Models for single images with GCPs (`direct_rpc.DIRECT`): new coefficients.
DIRECT_MODEL_NAMES = ("direct", "bils", "idkf", "pg", "upoe", "slss")


@options
class RefineOptions:
    """How to refine an image from its GCPs."""

    model: str = option(
        "auto", "Correction of each image's RPC", choices=(*RULE_NAMES, *BLOCK_MODEL_NAMES, *DIRECT_MODEL_NAMES)
    )
    leave_out: bool = option(
        True, "GCPs that disagree with the others are left out; they are named in any case", advanced=True
    )

"""How two images are registered from their points."""

from __future__ import annotations

from ..foundation.options import option, options

#: The form of a transformation (`registration.FORMS`), and whether the RPCs carry the points first.
REGISTRATION_MODELS = {
    "shift": ("shift", False),
    "conformal": ("conformal", False),
    "affine": ("affine", False),
    "projective": ("projective", False),
    "rpc-shift": ("shift", True),
    "rpc-affine": ("affine", True),
}


@options
class RegistrationOptions:
    """How two images are registered."""

    model: str = option("affine", "Transformation", choices=tuple(REGISTRATION_MODELS))
    reject_sigma: float = option(
        0.0,
        "Leave out points beyond this many robust standard deviations; 0 keeps all",
        name="reject",
        minimum=0.0,
        unit="sigma",
    )

    @property
    def form(self) -> str:
        """The form of the transformation in the images."""
        return REGISTRATION_MODELS[self.model][0]

    @property
    def by_rpcs(self) -> bool:
        """Whether the RPCs carry the points first."""
        return REGISTRATION_MODELS[self.model][1]

"""How to adjust a block."""

from __future__ import annotations

from dataclasses import dataclass

from ..block.block import Image
from ..refinement import Priors, priors_of
from ..refinement.model import UNFOLLOWED_DRIFT
from ..surface.dem import HeightSurface


@dataclass(frozen=True)
class AdjustOptions:
    """How to adjust.

    model, robust : names in `MODELS` and `WEIGHTS`
    sigma_shift_px, sigma_drift : priors of the corrections; None chooses them (`refinement.priors_of`). Drift that an
        image-space model does not follow is an error common to all points of an image, with this sigma
    check_as_ties : the check points' image measurements take part like those of tie points (never their survey)
    reject_sigma : measurements and GCPs that fail their test at this many sigmas are left out; 0 keeps all
    variance_components : estimate the sigmas of the groups of observations
    variance_groups : an entry of `GROUPINGS`: what tells image points apart
    sensor_images : groups of ids whose images come from one sensor; the others are told apart by pixel size
    cross_validate : predict each GCP by an adjustment without it
    fixed_images : ids of reference images, whose RPCs stay as they are
    shared_images : groups of ids that have one set of parameters together (one strip or orbit)
    dem, sigma_dem_m : a surface that holds the heights of tie points, and its standard deviation
    threads : 0 takes all cores
    """

    model: str = "shift"
    robust: str = "none"
    sigma_shift_px: float | None = None
    sigma_drift: float | None = None
    check_as_ties: bool = False
    reject_sigma: float = 0.0
    variance_components: bool = False
    variance_groups: str = "kind-sensor"
    sensor_images: tuple[tuple[str, ...], ...] = ()
    cross_validate: bool = False
    fixed_images: tuple[str, ...] = ()
    shared_images: tuple[tuple[str, ...], ...] = ()
    dem: HeightSurface | None = None
    sigma_dem_m: float = 10.0
    max_iterations: int = 30
    tolerance: float = 1e-9
    threads: int = 0

    def priors(self, image: Image, controlled: bool) -> Priors:
        """Return the priors of an image's corrections."""
        chosen = priors_of(image, controlled)
        if self.sigma_shift_px is None and self.sigma_drift is None:
            return chosen
        return Priors(
            chosen.shift_px if self.sigma_shift_px is None else self.sigma_shift_px,
            chosen.drift if self.sigma_drift is None else self.sigma_drift,
        )

    def unfollowed_drift(self, priors: Priors) -> float:
        """Return the sigma (px/px) of the drift that the model leaves; estimated, it starts as any drift does."""
        if self.sigma_drift is not None:
            return self.sigma_drift
        return priors.drift if self.variance_components else UNFOLLOWED_DRIFT

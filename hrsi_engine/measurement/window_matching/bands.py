"""Band-pass filters of the grey values that are matched.

Differences between images of different dates - shadows, plants, moisture - are strongest at low frequencies, as the
texture itself is. Without low frequencies every frequency is weighted by its information on the position, as
in a generalised least-squares adjustment. Noisy or blurred images need more smoothing: the best band is tried on each
pair.
"""

from dataclasses import dataclass

import numpy as np

from .windows import MatchImage


@dataclass(frozen=True)
class Band:
    """A band-pass of two Gaussians (standard deviations in px): the result of the first less that of the second.

    sigma_factor : true standard deviation of a matched position by that of the normal equations, which take the
    residuals of pixels as independent and Gaussian weights as inverse variances; from simulated windows with noise
    """

    smooth_px: float
    remove_px: float
    sigma_factor: float

    def filter_image(self, pixels: np.ndarray, valid: np.ndarray, coarser: float = 1.0) -> MatchImage:
        """Return an image in this band; ``coarser`` is how much coarser the pixels of the other image are."""
        smooth = float(np.hypot(self.smooth_px * coarser, 0.5 * np.sqrt(coarser**2 - 1.0)))
        return MatchImage(pixels, valid, smooth, self.remove_px * coarser)


MATCHING_BANDS: dict[str, Band] = {
    "fine": Band(0.0, 1.0, 0.77),
    "middle": Band(0.5, 2.0, 0.97),
    "coarse": Band(0.9, 5.0, 1.75),
}
SEARCH_BAND = Band(0.7, 1.5, 1.0)

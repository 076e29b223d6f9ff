"""Selection of image pairs for dense stereo matching: by convergence, sun, season and measured similarity.

The score of a pair is a product of factors from 0 to 1. A larger convergence angle improves heights but makes matching
more difficult: for multi-date pairs the completeness is best from 10 to 25 degrees (Qin 2019, "A critical analysis of
satellite stereo pairs for digital surface model generation"), and pairs from 5 to 45 degrees are useful (Facciolo et
al. 2017, "Automatic 3D reconstruction from multi-date satellite images"; the next important criterion is a small
difference in season). The similarity is measured: the share of the tie points of both images that are common to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from ..ground.sun import SunAngles
from .imaging_geometry import PairGeometry


@thresholds
class STEREO:
    """Score of a stereo pair, and selection of pairs for dense matching."""

    convergence_deg: tuple[float, ...] = threshold(
        (2.0, 10.0, 25.0, 45.0),
        "deg",
        "convergence angles: score 0 at the first and the last, 1 between the middle ones",
        "Qin 2019, Facciolo et al. 2017",
    )
    sun_deg: float = threshold(30.0, "deg", "angle between the sun directions that halves the score")
    season_days: float = threshold(60.0, "days", "difference in days of the year that halves the score")
    least_share: float = threshold(0.25, "", "smallest score of a selected pair relative to the best")
    matching_px: float = threshold(
        0.25, "px", "standard deviation of dense matches along the epipolar line", "usual for semi-global matching"
    )


@dataclass(frozen=True)
class StereoPair:
    """A pair of images for dense matching.

    left, right : ids of the images; the left one has the smaller incidence angle
    geometry : overlap and convergence
    sun_deg, season_days : differences of sun direction and day of the year; None if unknown
    similarity : share of the images' tie points that are common to both, 0 to 1; None without tie points
    score : product of the factors, 0 to 1
    """

    left: str
    right: str
    geometry: PairGeometry
    sun_deg: float | None
    season_days: float | None
    similarity: float | None
    score: float

    def height_sigma_m(self, gsd_m: float) -> float:
        """Return the standard deviation (m) of a matched point's height relative to its neighbours."""
        return STEREO.matching_px * gsd_m / (self.geometry.base_to_height or np.nan)


def choose_stereo_pairs(
    pairs: Sequence[PairGeometry],
    incidence_deg: dict[str, float],
    suns: dict[str, SunAngles | None],
    times: dict[str, datetime | None],
    tie_images: dict[str, set[str]],
    largest: int,
) -> list[StereoPair]:
    """Return the pairs selected for matching, the best first.

    pairs : geometry of the pairs
    incidence_deg, suns, times : of the images, by image id
    tie_images : ids of the tie points in each image, by image id
    largest : largest number of pairs to return
    """
    result: list[StereoPair] = []
    for pair in pairs:
        names = sorted((pair.first, pair.second), key=lambda name: incidence_deg[name])
        first, second = (suns[name] for name in names)
        sun = (
            None
            if first is None or second is None
            else float(np.degrees(np.arccos(np.clip(first.direction @ second.direction, -1.0, 1.0))))
        )
        # Difference of the two dates in days of the year, the shorter way around the year
        days = [time.timetuple().tm_yday for name in names if (time := times[name]) is not None]
        apart = abs(days[0] - days[-1]) if len(days) == 2 else None
        season = None if apart is None else float(min(apart, 365 - apart))
        ties = [tie_images.get(name, set()) for name in names]
        similarity = len(ties[0] & ties[1]) / np.sqrt(len(ties[0]) * len(ties[1])) if all(ties) else None
        angle = 0.0 if pair.convergence_deg is None else pair.convergence_deg
        score = float(np.interp(angle, STEREO.convergence_deg, (0.0, 1.0, 1.0, 0.0))) * min(pair.overlap)
        for difference, half in ((sun, STEREO.sun_deg), (season, STEREO.season_days)):
            score /= 1.0 + ((difference or 0.0) / half) ** 2
        score *= 1.0 if similarity is None else similarity
        result.append(
            StereoPair(names[0], names[1], pair, sun_deg=sun, season_days=season, similarity=similarity, score=score)
        )
    result = sorted((pair for pair in result if pair.score > 0.0), key=lambda pair: -pair.score)
    return [pair for pair in result[:largest] if pair.score >= STEREO.least_share * result[0].score]

"""Options and thresholds of the matching of two windows."""

from dataclasses import dataclass

from ...foundation.thresholds import threshold, thresholds


@thresholds
class TILE_MATCH:
    """Selection of the interest points of a window, their search, and acceptance of matches."""

    expected_sigma_px: float = threshold(
        0.1, "px", "largest expected sigma of a match; as its sigma, it has quality one half"
    )
    weakest_corner: float = threshold(0.02, "", "smallest strength or texture over the median one")
    cells: int = threshold(16, "cells", "cells along each side, with equal numbers of points")
    spread: float = threshold(0.7, "", "half length of the search over the range of the neighbours' parallax")
    slope: float = threshold(0.02, "px/px", "half length of the search per distance of the seeds")
    search_margin_px: int = threshold(3, "px", "margin between search and matching windows")
    seed_margin_px: float = threshold(64.0, "px", "distance from a window up to which known matches are its seeds")
    fewest_seeds: int = threshold(
        20, "seeds", "fewest known matches in place of features, and for the choice of a band"
    )
    trial: int = threshold(150, "matches", "number of matches on which the bands are compared")
    inner: float = threshold(2.0 / 3.0, "", "smaller window of the second matching, relative to the first")
    change_weight: float = threshold(
        0.35, "", "weight of the shift between both in the sigma of a match", "errors of simulated pairs, 2026-11-21"
    )


@dataclass(frozen=True)
class TileMatchOptions:
    """Options of the matching of two windows. Lengths are in pixels of the first tile unless stated otherwise.

    features : largest number of SIFT features of a tile without sufficient known matches; their matches determine the
    bias and the heights; 0 for none: points are searched at the positions predicted by the geometry of the pair
    windows_px : sides (odd) of the windows of least-squares matching, one round of search and matching after the other;
    each round searches the points not found so far, with the matches found as knowledge of the ground
    bands : names in `MATCHING_BANDS`, filters of the grey values of which the best one for the pair is used
    spacing_px : smallest distance of interest points of the first tile
    most_points : largest number of points of a tile, spread over a grid, the best by expected precision; 0 for all
    reach_px : smallest and largest half length of a search along the epipolar line; across_px : half width across it
    min_correlation : of the matched windows, in the band used, after least squares
    largest_rival : correlation of the next best position of the search, as a share of the best
    largest_sigma_px : largest standard deviation of a matched position (pixels of the tile)
    """

    features: int = 4000
    windows_px: tuple[int, ...] = (31, 41, 21)
    bands: tuple[str, ...] = ("fine", "middle", "coarse")
    spacing_px: float = 3.0
    most_points: int = 0
    reach_px: tuple[float, float] = (3.0, 25.0)
    across_px: float = 2.5
    min_correlation: float = 0.35
    largest_rival: float = 0.95
    largest_sigma_px: float = 0.3

    @property
    def point_choice(self) -> tuple[tuple[int, ...], float, int]:
        """The options on which the interest points of the first tile depend."""
        return self.windows_px, self.spacing_px, self.most_points

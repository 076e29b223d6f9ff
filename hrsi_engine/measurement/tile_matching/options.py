"""How two windows are matched."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TileMatchOptions:
    """How two windows are matched. Lengths are in pixels of the first tile unless said otherwise.

    finders : names in `MATCHERS` whose candidates are joined to learn the bias and the shape of the ground
    features : most features of a tile that a finder compares
    windows_px : sides (odd) of the windows of least-squares matching, one round of search and matching after the other;
    each round takes the points that the earlier ones did not find, with what they found as knowledge of the ground
    bands : names in `BANDS`, the filters that grey values may be matched in; the best on the pair is taken
    spacing_px : interest points of the first tile are at least so far apart
    most_points : of a tile, spread over a grid, the best by expected precision; 0 for all
    reach_px : least and largest half length of a search along the epipolar line; across_px : half width across it
    min_correlation : of the matched windows, in the band they were matched in, after least squares
    largest_rival : correlation of the next best position of the search, as a share of the best
    largest_sigma_px : standard deviation of a matched position (pixels of the tile) above which it is dropped
    """

    finders: tuple[str, ...] = ("sift",)
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
        """What the interest points of the first tile depend on."""
        return self.windows_px, self.spacing_px, self.most_points

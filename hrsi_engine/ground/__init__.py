"""Positions on the Earth: the ellipsoid, local frames, projections, and what heights refer to."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "geodesy": "LocalFrame from_ecef geoid_heights ground_difference_m to_ecef to_wgs84",
        "map_crs": "map_epsg to_projected",
        "height_datum": "HeightDifference height_difference",
    },
)

"""Positions on the Earth: the ellipsoid, local frames, projections, and what heights refer to."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "geodesy": "LocalFrame from_ecef ground_difference_m to_ecef",
    "crs_operations": "CrsOperations operations_of",
    "geoids": "HeightDifference geoid_heights height_difference",
    "operation_uses": "CrsOperation OperationUse",
    "map_crs": "map_epsg project_to_map",
})  # fmt: skip

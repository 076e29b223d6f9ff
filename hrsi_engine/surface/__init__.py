"""The surface that rays meet: heights of a DEM, and where a ray intersects it."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "dem": "HeightSurface Status SurfaceIntersection intersect_surface surface_heights",
    "grid_surface": "ConstantHeight GridSurface",
})  # fmt: skip

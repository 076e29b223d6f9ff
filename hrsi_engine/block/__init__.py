"""A block: its images, its ground and image points, and its imaging geometry."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__, {"assembly": "assemble", "block": "Block Image Raster", "points": "GroundPoints ImagePoints Role"}
)

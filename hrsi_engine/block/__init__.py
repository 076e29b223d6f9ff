"""A block: its images, its ground and image points, and how its images see the ground."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "assembly": "assemble",
    "block": "Block Image Raster",
    "points": "GroundPoints ImagePoints Role",
})  # fmt: skip

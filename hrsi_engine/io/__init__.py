"""Files in and out: the only part of the engine that opens paths or imports ``osgeo``."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {"point_files": "PointTables read_points", "rasters.images": "open_image", "rpc_files": "FoundRpc read_rpc"},
)

"""Files in and out: the only part of the engine that opens paths or imports ``osgeo``."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .point_files import PointTables as PointTables
from .point_files import read_points as read_points
from .rasters.images import open_image as open_image
from .rpc_files import FoundRpc as FoundRpc
from .rpc_files import read_rpc as read_rpc

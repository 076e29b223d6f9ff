"""Files in and out: the only part of the engine that opens paths or imports ``osgeo``."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .point_files import PointTables as PointTables
from .point_files import read_points as read_points
from .rasters.dems import open_dem as open_dem
from .rasters.images import open_image as open_image
from .rpc_files import FoundRpc as FoundRpc
from .rpc_files import read_rpc as read_rpc
from .rpc_files import restore as restore
from .rpc_files import write_geotiff_copy as write_geotiff_copy
from .rpc_files import write_rpc_text as write_rpc_text
from .rpc_files import write_vrt as write_vrt

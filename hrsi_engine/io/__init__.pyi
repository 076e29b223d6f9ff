"""Files in and out: the only part of the engine that opens paths or imports ``osgeo``."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .geopackage.layers import Layer as Layer
from .geopackage.layers import write_geopackage as write_geopackage
from .pages.report import write_report_html as write_report_html
from .pages.report import write_report_json as write_report_json
from .point_files import PointTables as PointTables
from .point_files import read_points as read_points
from .point_files.csv_text import write_csv as write_csv
from .rasters.dems import open_dem as open_dem
from .rasters.images import open_image as open_image
from .rasters.ortho_rasters import open_ortho as open_ortho
from .rasters.ortho_rasters import open_reference as open_reference
from .rasters.orthoimages import OrthoFormat as OrthoFormat
from .rasters.orthoimages import write_orthoimage as write_orthoimage
from .rpc_files import FoundRpc as FoundRpc
from .rpc_files import read_rpc as read_rpc
from .rpc_files import restore as restore
from .rpc_files import write_geotiff_copy as write_geotiff_copy
from .rpc_files import write_in_place as write_in_place
from .rpc_files import write_rpb as write_rpb
from .rpc_files import write_rpc_text as write_rpc_text
from .rpc_files import write_vrt as write_vrt

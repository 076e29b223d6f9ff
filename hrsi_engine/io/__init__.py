"""Files in and out: the only part of the engine that opens paths or imports ``osgeo``."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "point_files.csv_text": "write_csv",
    "rasters.dems": "open_dem",
    "geopackage.layers": "Layer write_geopackage",
    "rasters.ortho_rasters": "open_ortho open_reference",
    "rasters.orthoimages": "OrthoFormat write_orthoimage",
    "point_files": "PointTables read_points",
    "rasters.images": "open_image",
    "pages.report": "write_report_html write_report_json",
    "rpc_files": "FoundRpc read_rpc restore write_geotiff_copy write_in_place write_rpb write_rpc_text write_vrt",
})  # fmt: skip

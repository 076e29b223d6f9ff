"""Point files: ground points and image points in all formats that are supported.

`read_points` takes a vector layer, a CSV or a GCP file of another program and returns the columns of
`hrsi_engine.block.block`. `POINT_READERS` is the table of formats; a reader only returns the rows of a file as a
`PointTable` with the field names of `table.FIELDS`, and `interpret` checks them for all formats and makes the points.
"""

from .find import POINT_READERS, read_image_points, read_points, several_specs
from .in_memory import PointsInMemory
from .interpret import PointTables
from .ogr_layer import measurements_of
from .table import PointReader, PointTable

__all__ = [
    "POINT_READERS",
    "PointReader",
    "PointTable",
    "PointTables",
    "PointsInMemory",
    "measurements_of",
    "read_image_points",
    "read_points",
    "several_specs",
]

"""Measuring ground points on the images of a block: the state behind the panel of the QGIS plugin, without any GUI.

`PointSession` holds images, known points and measurements and edits them; `files` opens and saves it as a block's
GeoPackage; `targets` measures where the user clicked; `adjusting` adjusts a snapshot, in a thread of its own.
Importing this package is quick; NumPy, GDAL and OpenCV are imported where they are needed.
"""

from .rows import MeasurementRow, PointRow
from .session import PointSession

__all__ = ["MeasurementRow", "PointRow", "PointSession"]

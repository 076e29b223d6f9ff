"""Measuring ground points on the images of a block: the state behind the panel of the QGIS plugin, without any GUI.

`PointSession` holds images, known points and measurements and edits them; `files` opens and saves it as a block's
GeoPackage; `targets` measures where the user clicked; `adjusting` adjusts a snapshot, in a thread of its own.
Importing this package is quick; NumPy, GDAL and OpenCV are imported where they are needed.
"""

from ...hrsi_engine.adjustment.options import AdjustOptions
from ..interface.declare import params_of
from .rows import MeasurementRow, PointRow
from .session import PointSession

#: The adjustment's option that the panel offers; all others are at their defaults.
MODEL = next(param for param in params_of(AdjustOptions) if param.argument == "model")

__all__ = ["MODEL", "MeasurementRow", "PointRow", "PointSession"]

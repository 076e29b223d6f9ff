"""Orthoimages: the grid they share, where each of their pixels lies in the image, and how well they fit one another.

Layers, each importing only those above it::

    grid            pixels of a map, aligned so that all orthoimages register pixel to pixel; what an image shows
    point_surface   terrain from the adjusted tie points, where there is no DEM
    mapping         image positions of the grid's pixels, exact or within a stated error
    misregistration shifts between two orthoimages, window by window, and the one that most share
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .grid import MapGrid as MapGrid
from .mapping import OrthoMapping as OrthoMapping
from .misregistration import WindowShifts as WindowShifts
from .misregistration import measure_shifts as measure_shifts
from .misregistration import shift_statistics as shift_statistics
from .misregistration import window_centres as window_centres
from .options import MisregistrationOptions as MisregistrationOptions
from .point_surface import surface_of_points as surface_of_points

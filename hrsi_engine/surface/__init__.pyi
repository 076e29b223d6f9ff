"""The surface that rays meet: heights of a DEM, and where a ray intersects it."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .dem import HeightSurface as HeightSurface
from .dem import Status as Status
from .dem import SurfaceIntersection as SurfaceIntersection
from .dem import intersect_surface as intersect_surface
from .dem import surface_heights as surface_heights
from .grid_surface import ConstantHeight as ConstantHeight
from .grid_surface import GridSurface as GridSurface

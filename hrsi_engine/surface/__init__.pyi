"""The surface that rays meet: heights of a DEM, and where a ray intersects it."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .dem import ConstantHeight as ConstantHeight
from .dem import GridSurface as GridSurface
from .dem import HeightSurface as HeightSurface
from .dem import surface_heights as surface_heights
from .ray_intersection import Status as Status
from .ray_intersection import SurfaceIntersection as SurfaceIntersection
from .ray_intersection import intersect_surface as intersect_surface

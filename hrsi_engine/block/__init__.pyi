"""A block: its images, its ground and image points, and its imaging geometry."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .assembly import assemble as assemble
from .block import Block as Block
from .block import Image as Image
from .block import Raster as Raster
from .points import GroundPoints as GroundPoints
from .points import ImagePoints as ImagePoints
from .points import Role as Role

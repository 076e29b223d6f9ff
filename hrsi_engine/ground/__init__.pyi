"""Positions on the Earth: the ellipsoid, local frames, projections, and what heights refer to."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .crs_operations import CrsOperations as CrsOperations
from .crs_operations import operations_of as operations_of
from .geodesy import LocalFrame as LocalFrame
from .geodesy import from_ecef as from_ecef
from .geodesy import ground_difference_m as ground_difference_m
from .geodesy import to_ecef as to_ecef
from .geoids import HeightDifference as HeightDifference
from .geoids import geoid_heights as geoid_heights
from .geoids import height_difference as height_difference
from .map_crs import map_epsg as map_epsg
from .map_crs import project_to_map as project_to_map
from .operation_uses import CrsOperation as CrsOperation
from .operation_uses import OperationUse as OperationUse

"""Projects for other programs: a folder with refined images or RPCs, DEM, configuration, and the commands to run.

`PROJECT_PLANNERS` has one entry for each program; a new one is a file with a function that returns the files of the
project, how each of them is written, and the commands.
"""

from .asp import plan_asp_project
from .cars import plan_cars_project
from .colmap import plan_colmap_project
from .micmac import plan_micmac_project
from .nerf import plan_nerf_project
from .points import plan_points_project
from .project import BlockProject, PlannedProject, ProjectPlanner
from .s2p import plan_s2p_project

__all__ = ["PROJECT_PLANNERS", "BlockProject", "PlannedProject", "ProjectPlanner"]

PROJECT_PLANNERS: dict[str, ProjectPlanner] = {
    "cars": plan_cars_project,
    "s2p": plan_s2p_project,
    "asp": plan_asp_project,
    "micmac": plan_micmac_project,
    "colmap": plan_colmap_project,
    "nerf": plan_nerf_project,
    "points": plan_points_project,
}

"""Projects for other programs: a folder with refined images or RPCs, DEM, configuration, and the commands to run.

`PROJECT_PLANNERS` has one entry for each program; a new one is a function that returns the files of the
project, how each of them is written, and the commands.
"""

from .points import plan_points_project
from .project import BlockProject, PlannedProject, ProjectPlanner
from .stereo_programs import plan_asp_project, plan_cars_project, plan_micmac_project, plan_s2p_project
from .views import plan_colmap_project, plan_nerf_project

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

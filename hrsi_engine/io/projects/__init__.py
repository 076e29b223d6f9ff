"""Projects for the next program: a folder with refined images or RPCs, DEM, configuration and the command to type.

`PROJECT_WRITERS` has one entry for each target; a new target is one file with a function ``write(project, folder)``.
"""

from .asp import write_asp_project
from .cars import write_cars_project
from .micmac import write_micmac_project
from .nerf import write_nerf_project
from .points import write_points_project
from .project import BlockProject, ProjectWriter, WrittenProject
from .s2p import write_s2p_project

__all__ = ["PROJECT_WRITERS", "BlockProject", "ProjectWriter", "WrittenProject"]

PROJECT_WRITERS: dict[str, ProjectWriter] = {
    "cars": write_cars_project,
    "s2p": write_s2p_project,
    "asp": write_asp_project,
    "micmac": write_micmac_project,
    "nerf": write_nerf_project,
    "points": write_points_project,
}

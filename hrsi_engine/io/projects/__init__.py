"""Projects for the next program: a folder with refined images or RPCs, DEM, configuration and the command to type.

`WRITERS` has one entry for each target; a new target is one file with a function ``write(project, folder)``.
"""

from . import cars, s2p
from .project import Handed, Project, Writer

__all__ = ["WRITERS", "Handed", "Project", "Writer"]

WRITERS: dict[str, Writer] = {"cars": cars.write, "s2p": s2p.write}

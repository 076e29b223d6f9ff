"""Ames Stereo Pipeline: images with their refined RPC as XML, and commands for map-projected images.

The session ``rpcmaprpc`` uses the RPC of the XML files; ``.adjust`` files are not needed. The heights of the DEM are
above the WGS84 ellipsoid, as ``mapproject`` and ``parallel_stereo`` expect. Each pair gives a surface model, and
``dem_mosaic`` merges them. Source: https://stereopipeline.readthedocs.io, "Stereo with mapprojected images", "RPC".
"""

from functools import partial

from ..rpc_files.xml_formats import isd_text
from .project import DEM_FILE, PROJECTS, BlockProject, PlannedProject, plan_images, write_initial_dem

_RESULT = "dsm.tif"


def plan_asp_project(project: BlockProject) -> PlannedProject:
    """Return the plan of images, an XML with the RPC of each, and the initial DEM."""
    names, files = plan_images(project, project.paired, project.copy)
    files[DEM_FILE] = partial(write_initial_dem, project)
    crs, cell = f"--t_srs EPSG:{project.epsg}", PROJECTS.node_pixels * project.gsd_m
    files |= {f"{image.id}.xml": isd_text(image.rpc) for image in project.paired}
    commands = [
        f"mapproject -t rpc {crs} --tr {project.gsd_m:.2f} {DEM_FILE} {file} {name}.xml {name}_map.tif"
        for name, file in names.items()
    ]
    runs = [f"{pair.left}__{pair.right}/run" for pair in project.pairs]
    for pair, run in zip(project.pairs, runs, strict=True):
        images = f"{pair.left}_map.tif {pair.right}_map.tif {pair.left}.xml {pair.right}.xml"
        commands.append(f"parallel_stereo -t rpcmaprpc --alignment-method none {images} {run} {DEM_FILE}")
        commands.append(f"point2dem {crs} --tr {cell:.2f} {run}-PC.tif")
    commands.append(f"dem_mosaic {' '.join(f'{run}-DEM.tif' for run in runs)} -o {_RESULT}")
    return PlannedProject(files, tuple(commands), _RESULT)

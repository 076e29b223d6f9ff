"""CARS (CNES): a configuration in JSON. Paths in it are relative to its folder, the output to the working directory.

``geoid: null`` of the initial elevation and ``geoid: false`` of the output: both heights are ellipsoidal.
Source: https://cars.readthedocs.io, "Configuration" (1.3).
"""

from functools import partial

from ...foundation.json_values import json_text
from .project import DEM_FILE, BlockProject, PlannedProject, plan_images, write_initial_dem

_FILE, _RESULT = "cars.json", "out/dsm/dsm.tif"


def plan_cars_project(project: BlockProject) -> PlannedProject:
    """Return images, initial DEM and ``cars.json``."""
    names, files = plan_images(project, project.paired, project.copy)
    inputs = {
        "sensors": {name: {"image": file, "geomodel": file} for name, file in names.items()},
        "pairing": [[pair.left, pair.right] for pair in project.pairs],
        "initial_elevation": {"dem": DEM_FILE, "geoid": None},
    }
    if not project.whole:
        feature = {"type": "Feature", "properties": {}, "geometry": project.outline}
        inputs["roi"] = {"type": "FeatureCollection", "features": [feature]}
    output = {"directory": "out", "epsg": project.epsg, "geoid": False}
    files[DEM_FILE] = partial(write_initial_dem, project)
    files[_FILE] = json_text({"input": inputs, "output": output}, indent=1) + "\n"
    return PlannedProject(files, (f"cars {_FILE}",), _RESULT)

"""CARS (CNES): a configuration in JSON. Paths in it are relative to its folder, the output to the working directory.

``geoid: null`` of the initial elevation and ``geoid: false`` of the output: both heights are ellipsoidal.
Source: https://cars.readthedocs.io, "Configuration" (1.3).
"""

from pathlib import Path

from ...foundation.json_values import json_text
from .project import DEM_FILE, BlockProject, WrittenProject, write_initial_dem, write_project_images

_FILE, _RESULT = "cars.json", "out/dsm/dsm.tif"


def write_cars_project(project: BlockProject, folder: Path) -> WrittenProject:
    """Write images, initial DEM and ``cars.json``."""
    names = write_project_images(project, folder, project.paired)
    write_initial_dem(project, folder)
    inputs = {
        "sensors": {name: {"image": file, "geomodel": file} for name, file in names.items()},
        "pairing": [[pair.left, pair.right] for pair in project.pairs],
        "initial_elevation": {"dem": DEM_FILE, "geoid": None},
    }
    if not project.whole:
        inputs["roi"] = project.geojson
    output = {"directory": "out", "epsg": project.epsg, "geoid": False}
    (folder / _FILE).write_text(json_text({"input": inputs, "output": output}, indent=1) + "\n", encoding="utf-8")
    return WrittenProject((f"cars {_FILE}",), _RESULT)

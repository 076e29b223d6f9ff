"""CARS (CNES): a configuration in JSON. Its paths are relative to its folder, the output to the working directory.

``geoid: false``: heights are ellipsoidal. No initial elevation is given: CARS computes its epipolar grids on it, and
with a surface through the tie points its surface model of the s2p triplet had waves of 10 m at the margin.
Source: https://cars.readthedocs.io, "Configuration" (1.3).
"""

from ...foundation.json_values import json_text
from .project import BlockProject, PlannedProject, plan_images

_FILE, _RESULT = "cars.json", "out/dsm/dsm.tif"


def plan_cars_project(project: BlockProject) -> PlannedProject:
    """Return the plan of images and ``cars.json``."""
    names, files = plan_images(project, project.paired, project.copy)
    inputs: dict[str, object] = {
        "sensors": {name: {"image": file, "geomodel": file} for name, file in names.items()},
        "pairing": [[pair.left, pair.right] for pair in project.pairs],
    }
    if not project.whole:
        feature = {"type": "Feature", "properties": {}, "geometry": project.outline}
        inputs["roi"] = {"type": "FeatureCollection", "features": [feature]}
    output = {"directory": "out", "epsg": project.epsg, "geoid": False}
    files[_FILE] = json_text({"input": inputs, "output": output}, indent=1) + "\n"
    return PlannedProject(files, (f"cars {_FILE}",), _RESULT)

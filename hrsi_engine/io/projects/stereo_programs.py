"""Programs for dense stereo: s2p, Ames Stereo Pipeline, CARS and MicMac.

s2p: a configuration in JSON; its paths are relative to the working directory.

The first image is the reference, and every other image forms a stereo pair with it. The DEM has ellipsoidal heights,
so ``exogenous_dem_geoid_mode`` is false. Source: ``s2p/config.py`` and the README of s2p 1.0b25.

Ames Stereo Pipeline: images with their refined RPC as XML, and commands for map-projected images.

The session ``rpcmaprpc`` uses the RPC of the XML files; ``.adjust`` files are not needed. The heights of the DEM are
above the WGS84 ellipsoid, as ``mapproject`` and ``parallel_stereo`` expect. Each pair gives a surface model, and
``dem_mosaic`` merges them. Source: https://stereopipeline.readthedocs.io, "Stereo with mapprojected images", "RPC".

CARS (CNES): a configuration in JSON. Its paths are relative to its folder, the output to the working directory.

``geoid: false``: heights are ellipsoidal. No initial elevation is given: CARS computes its epipolar grids on it, and
with a surface through the tie points its surface model of the s2p triplet had waves of 10 m at the margin.
Source: https://cars.readthedocs.io, "Configuration" (1.3).

MicMac: images, each with an XML that ``Convert2GenBundle`` reads, and the coordinate system.

The XML is WorldView's: the RPC, and the part of ``IMD`` that MicMac needs: NUMROWS and NUMCOLUMNS, and under BAND_P
the corners of the image. MicMac searches tags by name and needs each once. ``WGS84toUTM.xml`` contains the projection
as a PROJ text; heights remain ellipsoidal. ``Degre=0`` leaves the cameras unchanged. MicMac determines initial heights
itself, so there is no initial DEM. Source: ``RPC::ReadXML`` in ``src/SateLib/CPP_RPC.cpp`` of micmacIGN/micmac.
"""

from collections import Counter
from functools import partial

import numpy as np
from osgeo import osr

from ...foundation.json_values import json_text
from ..rpc_files.xml_formats import isd_text
from .project import DEM_FILE, PROJECTS, BlockProject, PlannedProject, find_window, plan_images, write_initial_dem

_S2P_FILE, _S2P_RESULT = "s2p.json", "out/dsm.tif"


def plan_s2p_project(project: BlockProject) -> PlannedProject:
    """Return the plan of the reference image, its partners, initial DEM and ``s2p.json``."""
    images, score = {image.id: image for image in project.images}, Counter[str]()
    for pair in project.pairs:
        score.update({pair.left: pair.score, pair.right: pair.score})
    reference = max(score, key=lambda name: score[name])
    reference_pairs = [pair for pair in project.pairs if reference in (pair.left, pair.right)]
    partners = [pair.right if pair.left == reference else pair.left for pair in reference_pairs]
    left_out = len(project.pairs) - len(reference_pairs)
    names, files = plan_images(project, [images[name] for name in (reference, *partners)], project.copy)
    x, y, w, h = find_window(images[reference], project.area, project.surface)
    configuration = {
        "out_dir": "out",
        "temporary_dir": "tmp",
        "images": [{"img": file} for file in names.values()],
        "roi": {"x": x, "y": y, "w": w, "h": h},
        "exogenous_dem": DEM_FILE,
        "exogenous_dem_geoid_mode": False,
        "timeout": 3600,
        "mgm_timeout": 3600,
        "dsm_resolution": round(project.gsd_m, 2),
        "out_crs": f"epsg:{project.epsg}",
    }
    files[DEM_FILE] = partial(write_initial_dem, project)
    files[_S2P_FILE] = json_text(configuration, indent=1) + "\n"
    notice = f"s2p pairs all images with {reference}; chosen pairs that are left out: {left_out}"
    return PlannedProject(files, (f"s2p {_S2P_FILE}",), _S2P_RESULT, (notice,) * bool(left_out))


_ASP_RESULT = "dsm.tif"


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
    commands.append(f"dem_mosaic {' '.join(f'{run}-DEM.tif' for run in runs)} -o {_ASP_RESULT}")
    return PlannedProject(files, tuple(commands), _ASP_RESULT)


_CARS_FILE, _CARS_RESULT = "cars.json", "out/dsm/dsm.tif"


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
    files[_CARS_FILE] = json_text({"input": inputs, "output": output}, indent=1) + "\n"
    return PlannedProject(files, (f"cars {_CARS_FILE}",), _CARS_RESULT)


_CORNERS = (("UL", 0, 0), ("UR", 1, 0), ("LR", 1, 1), ("LL", 0, 1))
_SYSTEM = (
    "<SystemeCoord>\n <BSC>\n  <TypeCoord> eTC_Proj4 </TypeCoord>\n  <AuxR> 1 </AuxR>\n  <AuxR> 1 </AuxR>\n"
    "  <AuxR> 1 </AuxR>\n  <AuxStr> {proj} </AuxStr>\n </BSC>\n</SystemeCoord>\n"
)


def plan_micmac_project(project: BlockProject) -> PlannedProject:
    """Return the plan of the images of the chosen pairs, their XML, and the coordinate system."""
    _, files = plan_images(project, project.paired, copy=True)
    for image in project.paired:
        # The part of the XML with the image's size and its corners on the ground
        samples, lines = image.known_size
        last = np.array([samples - 1.0, lines - 1.0])
        ground = image.rpc.localize(np.array([[x, y] for _, x, y in _CORNERS]) * last, image.middle_height_m).ground
        corners = "".join(
            f"   <{name}LON>{lon!r}</{name}LON>\n   <{name}LAT>{lat!r}</{name}LAT>\n"
            for (name, _, _), (lon, lat, _) in zip(_CORNERS, ground.tolist(), strict=True)
        )
        size = f"  <NUMROWS>{lines}</NUMROWS>\n  <NUMCOLUMNS>{samples}</NUMCOLUMNS>\n"
        imd = f" <IMD>\n{size}  <BAND_P>\n{corners}  </BAND_P>\n </IMD>\n"
        files[f"{image.id}.xml"] = isd_text(image.rpc).replace("</isd>", f"{imd}</isd>")
    crs = osr.SpatialReference()
    crs.ImportFromEPSG(project.epsg)
    files["WGS84toUTM.xml"] = _SYSTEM.format(proj=crs.ExportToProj4().strip())
    return PlannedProject(
        files,
        (
            r"""mm3d Convert2GenBundle "(.*).tif" "\$1.xml" RPC-d0 ChSys=WGS84toUTM.xml Degre=0""",
            """mm3d Malt UrbanMNE ".*tif" RPC-d0 SzW=2 Regul=0.2 NbVI=2 EZA=1""",
        ),
        "MEC-Malt",
        () if project.copy else ("MicMac reads no VRTs: the images are copied",),
    )

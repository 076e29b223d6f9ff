"""MicMac: images, each with an XML that ``Convert2GenBundle`` reads, and the coordinate system.

The XML is WorldView's: the RPC, and the part of ``IMD`` that MicMac needs: NUMROWS and NUMCOLUMNS, and under BAND_P
the corners of the image. MicMac searches tags by name and needs each once. ``WGS84toUTM.xml`` contains the projection
as a PROJ text; heights remain ellipsoidal. ``Degre=0`` leaves the cameras unchanged. MicMac determines initial heights
itself, so there is no initial DEM. Source: ``RPC::ReadXML`` in ``src/SateLib/CPP_RPC.cpp`` of micmacIGN/micmac.
"""

import numpy as np
from osgeo import osr

from ..rpc_files.xml_formats import isd_text
from .project import BlockProject, PlannedProject, plan_images

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

"""Deliveries as vendors make them, around the RPC of a simulated image: the files' form is theirs, the camera known."""

from pathlib import Path

from gdal_files import write_raster
from osgeo import gdal

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.io.rpc_files.fields import POLYNOMIALS, SCALARS
from hrsi.hrsi_engine.io.rpc_files.xml_formats import isd_text


def dimap_rpc(rpc: RPC, first: int = 1) -> str:
    """Return a DIMAP RPC file; the first pixel's centre is (1, 1) in version 2 and (0, 0) in version 3."""
    shifted = rpc.shift(first, first)
    model, domain = ("Inverse_Model", "Direct_Model_Validity_Domain") if first else (
        "GroundtoImage_Values", "ImagetoGround_Validity_Domain")  # fmt: skip
    coefficients = "".join(
        f"<{name.upper()}_COEFF_{k}>{value!r}</{name.upper()}_COEFF_{k}>"
        for name in POLYNOMIALS
        for k, value in enumerate(getattr(shifted, name).tolist(), start=1)
    )
    scalars = "".join(f"<{name.upper()}>{getattr(shifted, name)!r}</{name.upper()}>" for name in SCALARS)
    return (
        '<?xml version="1.0" encoding="UTF-8"?><Dimap_Document><Metadata_Identification>'
        f'<METADATA_FORMAT version="{"2.15" if first else "3.0"}">DIMAP</METADATA_FORMAT></Metadata_Identification>'
        f"<Rational_Function_Model><Global_RFM><{model}>{coefficients}</{model}>"
        f"<RFM_Validity><{domain}/>{scalars}</RFM_Validity></Global_RFM></Rational_Function_Model></Dimap_Document>"
    )


def dimap_product(rpc_file: str, size: tuple[int, int], tile: tuple[int, int], images: dict[str, tuple[int, int]],
                  height_m: float = 0.0) -> str:  # fmt: skip
    """Return a ``DIM_*.XML``: it names the RPC file and the tiles by row and column, and the middle's height."""
    files = "".join(
        f'<Data_File tile_R="{row}" tile_C="{column}"><DATA_FILE_PATH href="{name}"/></Data_File>'
        for name, (row, column) in images.items()
    )
    columns, rows = -(-size[0] // tile[0]), -(-size[1] // tile[1])
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<Dimap_Document><Metadata_Identification><METADATA_FORMAT version="2.15">DIMAP</METADATA_FORMAT>
<METADATA_PROFILE>PHR_SENSOR</METADATA_PROFILE><METADATA_SUBPROFILE>PRODUCT</METADATA_SUBPROFILE></Metadata_Identification>
<Dataset_Content><Dataset_Extent><Center><LON>0</LON><LAT>0</LAT><H>{height_m}</H></Center></Dataset_Extent>
</Dataset_Content><Geoposition><Geoposition_Models><Rational_Function_Model><Component>
<COMPONENT_TITLE>RPC Model</COMPONENT_TITLE><COMPONENT_PATH href="{rpc_file}"/></Component></Rational_Function_Model>
</Geoposition_Models></Geoposition><Raster_Data><Raster_Dimensions><NROWS>{size[1]}</NROWS><NCOLS>{size[0]}</NCOLS>
<NBANDS>1</NBANDS><Tile_Set><NTILES>{columns * rows}</NTILES><Regular_Tiling>
<NTILES_SIZE nrows="{tile[1]}" ncols="{tile[0]}"/><NTILES_COUNT ntiles_R="{rows}" ntiles_C="{columns}"/>
<OVERLAP_ROW>0</OVERLAP_ROW><OVERLAP_COL>0</OVERLAP_COL></Regular_Tiling></Tile_Set></Raster_Dimensions>
<Raster_Encoding><DATA_TYPE>INTEGER</DATA_TYPE><NBITS>16</NBITS><SIGN>UNSIGNED</SIGN></Raster_Encoding>
<Data_Access><DATA_FILE_FORMAT>image/tiff</DATA_FILE_FORMAT><DATA_FILE_TILES>true</DATA_FILE_TILES>
<Data_Files>{files}</Data_Files></Data_Access></Raster_Data></Dimap_Document>"""


def spot5_product() -> str:
    """Return the ``METADATA.DIM`` of a SPOT 5 scene of level 1A: orbit and attitudes, no RPC."""
    return """<?xml version="1.0" encoding="ISO-8859-1"?>
<Dimap_Document xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"><Metadata_Id>
<METADATA_FORMAT version="1.1">DIMAP</METADATA_FORMAT></Metadata_Id><Dataset_Sources><Source_Information><Scene_Source>
<MISSION>SPOT</MISSION><MISSION_INDEX>5</MISSION_INDEX></Scene_Source></Source_Information></Dataset_Sources>
<Data_Processing><PROCESSING_LEVEL>1A</PROCESSING_LEVEL></Data_Processing></Dimap_Document>"""


def isd_with_namespace(rpc: RPC, prefix: str) -> str:
    """Return an ISD XML file in a namespace of its own, by prefix or (empty) as the default one."""
    text, uri = isd_text(rpc), "urn:vantor:isd:2026"
    if not prefix:
        return text.replace("<isd>", f'<isd xmlns="{uri}">')
    for element in ("</", "<"):
        text = text.replace(element, f"{element}{prefix}:")
    text = text.replace(f"<{prefix}:/", "</").replace(f"<{prefix}:?", "<?").replace(f"<{prefix}:!", "<!")
    return text.replace(f"<{prefix}:isd>", f'<{prefix}:isd xmlns:{prefix}="{uri}">')


def cut_tile(source: Path, target: Path, window: tuple[int, int, int, int]) -> None:
    """Cut sample, line, samples, lines out of an image, without its RPC, as a tile without place is delivered."""
    write_raster(target, gdal.Open(str(source)).ReadAsArray(*window))

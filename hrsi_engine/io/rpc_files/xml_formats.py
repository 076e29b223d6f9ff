"""RPC files in XML: those of Maxar and Airbus, and GDAL's own.

* ISD XML of DigitalGlobe / Maxar (WorldView, GeoEye): ``<isd>`` with an ``<RPB>`` part. A product in tiles,
``…_R1C2-…_P001.TIF``, has one file ``…-…_P001.XML``, whose ``<TIL>`` part has their positions.
* DIMAP XML of Airbus, the RPC file and the product file ``DIM_*.XML`` that names it. The first pixel is (1, 1) in V2
(SPOT 6/7, Pleiades) and (0, 0) in V3 (Pleiades Neo). The version determines that, as in GDAL: the validity domain
(FIRST_ROW, FIRST_COL) agrees with it in complete scenes, but may also begin at -27 or inside the scene. Only the
ground-to-image coefficients are used (``Inverse_Model`` in V2, ``GroundtoImage_Values`` in V3). ERR_BIAS of these
files is the fit of the RPC in pixels, not the accuracy on the ground, and is not used. HEIGHT_OFF of the RPC may be
arbitrary (4000 m in Pleiades Neo); the product file states the height of the scene's centre.
* GDAL's own side file ``<image>.aux.xml`` (PAM): metadata domain ``RPC``.
"""

import os
import re
from dataclasses import replace

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ..opening.files import Element, parse_finite, read_xml, xml_bytes
from . import fields
from .content import element_text, positive_size, siblings, texts_below
from .fields import ERRORS, POLYNOMIALS, SCALARS, FoundRpc, Origin, RpcReader, shorten
from .text_formats import MARKS, RPB_NAMES

# ---- ISD -----------------------------------------------------------------------------------------------------------

#: The root element, in any namespace.
_ISD_ROOT = re.compile(rb"<([\w.-]+:)?isd[\s>]", re.IGNORECASE)
ISD_NAMES = {name: title.upper() for name, title in RPB_NAMES.items()}
_ISD_TILE = re.compile(r"_(r\d{1,3}c\d{1,3})(?=-)")


def read_isd(path: str) -> FoundRpc:
    """Return the RPC of an ISD XML file and the size of its image (NUMCOLUMNS, NUMROWS)."""
    root = read_xml(path)
    part = next(root.iter("RPB"), None)
    if part is None:
        raise InputError(f"{path}: the RPB element is missing: this product was delivered without RPC")
    rpc = fields.rpc_from_entries(path, texts_below(part), ISD_NAMES, zero_is_unknown=True)
    size = positive_size(element_text(root, "NUMCOLUMNS"), element_text(root, "NUMROWS"))
    return FoundRpc(rpc, stated_size=size, sensor=element_text(root, "SATID") or "")


def isd_text(rpc: RPC) -> str:
    """Return the content of an ISD XML file with only an RPC, with all digits."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<isd>", f" {MARKS['isd']}", " <RPB>"]
    lines += ["  <SPECID>RPC00B</SPECID>", "  <IMAGE>"]
    scalars = {ISD_NAMES[name]: getattr(rpc, name) or 0.0 for name in (*ERRORS, *SCALARS)}  # unknown accuracy: 0
    lines += [f"   <{tag}>{value!r}</{tag}>" for tag, value in scalars.items()]
    for name in POLYNOMIALS:
        numbers, tag = " ".join(map(repr, getattr(rpc, name).tolist())), ISD_NAMES[name]
        lines.append(f"   <{tag}List><{tag}>{numbers}</{tag}></{tag}List>")
    return "\n".join([*lines, "  </IMAGE>", " </RPB>", "</isd>"]) + "\n"


def _find_tile(image_path: str, side_file: str) -> Origin | None:
    """Return the product's (sample, line) of the first pixel of a tile ``…_R1C2-…``; None for other names.

    Raises `InputError` if the product's file does not give the position of the tile.
    """
    tile = _ISD_TILE.search(os.path.basename(image_path).lower())
    if tile is None:
        return None
    for tile_element in read_xml(side_file).iter("TILE"):
        name_match = _ISD_TILE.search((element_text(tile_element, "FILENAME") or "").lower())
        sample, line = (parse_finite(element_text(tile_element, name)) for name in ("ULCOLOFFSET", "ULROWOFFSET"))
        if name_match is not None and name_match[1] == tile[1] and sample is not None and line is not None:
            return sample, line
    raise InputError(f"{image_path}: is a tile that {os.path.basename(side_file)} does not place: get that file again")


ISD = RpcReader(
    "ISD XML",
    lambda stem: tuple(f"{name}.xml" for name in dict.fromkeys([stem, _ISD_TILE.sub("", stem)])),  # of its product, too
    lambda name, head: _ISD_ROOT.search(head[:2000]) is not None,
    read_isd,
    _find_tile,
)

# ---- DIMAP ---------------------------------------------------------------------------------------------------------

DIMAP_NAMES = {name: name.upper() for name in SCALARS} | {name: f"{name.upper()}_COEFF" for name in POLYNOMIALS}
DIMAP_NAMES |= {"err_bias": "ERR_BIAS", "err_rand": "ERR_RAND"}
#: Elements with the ground-to-image coefficients, V2 then V3.
_GROUND_TO_IMAGE = ("Inverse_Model", "GroundtoImage_Values")
#: The root element, in any namespace.
_DIMAP_ROOT = re.compile(rb"<([\w.-]+:)?Dimap_Document[\s>]")
_DIMAP_TILE = re.compile(r"_r(\d{1,3})c(\d{1,3})$")


def read_dimap(path: str) -> FoundRpc:
    """Return the RPC of a DIMAP RPC file, or of the one that a product file names, with the scene's size and height."""
    root = read_xml(path)
    if _find_first(root, _GROUND_TO_IMAGE) is not None:
        _name, product = _find_product(path)
        described = None if product is None else read_xml(product)
    else:
        path, described = _find_rpc_file(path, root), root
        root = read_xml(path)
    model, validity = _find_first(root, _GROUND_TO_IMAGE), next(root.iter("RFM_Validity"), None)
    if model is None or validity is None:
        raise InputError(f"{path}: {' or '.join(_GROUND_TO_IMAGE)} or RFM_Validity is missing: obtain the file again")
    entries = texts_below(model) | texts_below(validity)
    for name in ERRORS:
        entries.pop(DIMAP_NAMES[name], None)
    rpc = fields.rpc_from_entries(path, entries, DIMAP_NAMES, [f"_{number}" for number in range(1, 21)])
    # Sample and line of the centre of the first pixel in this version: 1 or 0
    version = next((element.get("version", "") for element in root.iter("METADATA_FORMAT")), "")
    first = {"2": 1, "3": 0}.get(version.strip()[:1])
    if first is None:
        raise InputError(f"{path}: METADATA_FORMAT version is {shorten(version)!r}: DIMAP versions 2 and 3 are known")
    # The scene's size if the validity domain begins at the first pixel
    domain = _find_first(root, ("Direct_Model_Validity_Domain", "ImagetoGround_Validity_Domain"))
    domain_texts = {child.tag: (child.text or "").strip() for child in (domain if domain is not None else ())}
    begins = domain_texts.get("FIRST_COL") == domain_texts.get("FIRST_ROW") == str(first)
    last = positive_size(domain_texts.get("LAST_COL"), domain_texts.get("LAST_ROW")) if begins else None
    extent = None if last is None else (last[0] - first + 1, last[1] - first + 1)
    sensor = element_text(root, "METADATA_PROFILE") or ""
    reading = FoundRpc(rpc.shift(-first, -first), stated_size=extent, sensor=sensor)
    if described is None:
        return reading
    size = positive_size(element_text(described, "NCOLS"), element_text(described, "NROWS"))
    centre = described.find(".//Dataset_Extent//Center")
    height_m = None if centre is None else parse_finite(element_text(centre, "H"))
    return replace(reading, stated_size=extent or size, height_m=height_m)


def _find_rpc_file(path: str, product: Element) -> str:
    """Return the RPC file that a product file names; if it names none, raise `InputError` with the kind of product."""
    model = product.find(".//Geoposition_Models//COMPONENT_PATH")
    if model is None:
        mission = " ".join(filter(None, (element_text(product, name) for name in ("MISSION", "MISSION_INDEX"))))
        level = element_text(product, "PROCESSING_LEVEL") or element_text(product, "DATA_PROCESSING_LEVEL")
        raise InputError(
            f"{path}: a DIMAP product{f' of {shorten(mission)}' if mission else ''}"
            f"{f', level {shorten(level)}' if level else ''}, which names no RPC file: this product was delivered "
            "with orbit and attitudes or map coordinates instead; make an RPC from a grid of them with fit-rpc, or "
            "order the sensor product with RPC"
        )
    href = model.get("href", "").replace("\\", "/")
    file = siblings(path).get(href.removeprefix("./").lower())
    if file is None:
        raise InputError(f"{path}: names the RPC file {shorten(href, 80)!r}, which is not in its folder: copy it there")
    return file


def _find_product(rpc_file: str) -> tuple[str, str | None]:
    """Return the name of the product file ``dim_x.xml`` of ``RPC_x.XML``, and its path if it is in the same folder."""
    name = "dim_" + os.path.basename(rpc_file).lower().removeprefix("rpc_")
    return name, siblings(rpc_file).get(name)


def _find_first(root: Element, names: tuple[str, ...]) -> Element | None:
    return next((element for name in names for element in root.iter(name)), None)


def _is_dimap(name: str, head: bytes) -> bool:
    is_named = name.startswith("rpc_") and name.endswith(".xml") and not _ISD_ROOT.search(head)
    return is_named or _DIMAP_ROOT.search(head[:4000]) is not None


def _is_product(head: bytes) -> bool:
    return _DIMAP_ROOT.search(head[:4000]) is not None and not any(name.encode() in head for name in _GROUND_TO_IMAGE)


def _dimap_names(stem: str) -> tuple[str, ...]:
    """Return RPC_x.xml for IMG_x, its tiles IMG_x_R1C1 and groups of bands IMG_x_P_R1C1, and the image's own stem."""
    image = stem.removeprefix("img_")
    product = _DIMAP_TILE.sub("", image)
    of_all_bands = re.sub(r"_(p|ms|pms|rgb|ned)$", "", product)  # as for the RPC file of Pleiades Neo
    names = [f"rpc_{name}.xml" for name in (product, of_all_bands, image)]
    return tuple(dict.fromkeys([*names, f"{stem}_rpc.xml", f"{stem}.xml"]))


def _find_dimap_tile(image_path: str, side_file: str) -> Origin | None:
    """Return the scene's (sample, line) of the first pixel of a tile ``IMG_x_R2C3``; None for other names.

    The tile size is in the product's ``DIM_x.XML``. Raises `InputError` if that is missing, except for the first tile,
    which begins with its scene.
    """
    match = _DIMAP_TILE.search(os.path.splitext(os.path.basename(image_path))[0].lower())
    if match is None:
        return None
    row, column = int(match[1]), int(match[2])
    if (row, column) == (1, 1):
        return 0.0, 0.0
    name, product = _find_product(side_file)
    if product is None:
        raise InputError(f"{image_path}: is a tile, and {name} with the tile size is not in its folder: copy it there")
    size = next(read_xml(product).iter("NTILES_SIZE"), None)
    tile = None if size is None else positive_size(size.get("ncols"), size.get("nrows"))
    if tile is None:
        raise InputError(f"{product}: NTILES_SIZE with ncols and nrows is missing: obtain the file again")
    return float((column - 1) * tile[0]), float((row - 1) * tile[1])


DIMAP = RpcReader("DIMAP XML", _dimap_names, _is_dimap, read_dimap, _find_dimap_tile, _is_product)

# ---- PAM -----------------------------------------------------------------------------------------------------------


def read_domain(path: str, domain: str) -> dict[str, str]:
    """Return one metadata domain of the dataset (not of its bands), empty if there is none.

    Raises `InputError` if the file is not well-formed XML.
    """
    for element in read_xml(path).findall("Metadata"):
        if element.get("domain") == domain:
            return {item.get("key", ""): item.text or "" for item in element.findall("MDI")}
    return {}


def without_domain(path: str, domain: str) -> bytes:
    """Return the content of a ``.aux.xml`` file without one metadata domain."""
    root = read_xml(path)
    for element in root.findall("Metadata"):
        if element.get("domain") == domain:
            root.remove(element)
    return xml_bytes(root)

"""DIMAP XML of Airbus, the RPC file and the product file ``DIM_*.XML`` that names it.

The first pixel is (1, 1) in V2 (SPOT 6/7, Pleiades) and (0, 0) in V3 (Pleiades Neo).

The version decides about the origin, as in GDAL: the validity domain (FIRST_ROW, FIRST_COL) agrees with it in
whole scenes, but may also begin at -27 or inside the scene. Only the ground-to-image half is used (``Inverse_Model``
in V2, ``GroundtoImage_Values`` in V3). The ERR_BIAS of these files is the fit of the RPC in pixels, not the accuracy
on the ground: it is not taken over. The RPC's HEIGHT_OFF may be a fiction (4000 m in Pleiades Neo); the product file
states the height of the scene's middle.
"""

import os
import re

from ...foundation.errors import InputError
from . import isd
from .content import Element, element_text, finite_number, positive_size, read_xml, siblings
from .fields import POLYNOMIALS, SCALARS, rpc_from_text, shorten, values_by_number
from .reading import Origin, RpcReader, RpcReading

DIMAP_NAMES = {name: name.upper() for name in SCALARS} | {name: f"{name.upper()}_COEFF" for name in POLYNOMIALS}
DIMAP_NAMES |= {"err_bias": "ERR_BIAS", "err_rand": "ERR_RAND"}
#: Elements with the ground-to-image coefficients and the image's validity domain, V2 then V3.
_GROUND_TO_IMAGE = ("Inverse_Model", "GroundtoImage_Values")
#: The root element, in any namespace.
_DOCUMENT = re.compile(rb"<([\w.-]+:)?Dimap_Document[\s>]")
_TILE = re.compile(r"_r(\d{1,3})c(\d{1,3})$")
_BANDS = re.compile(r"_(p|ms|pms|rgb|ned)$")  # of Pleiades Neo, whose RPC file is that of all of them
_IMAGE_DOMAIN = ("Direct_Model_Validity_Domain", "ImagetoGround_Validity_Domain")


def read(path: str) -> RpcReading:
    """Return the RPC of a DIMAP RPC file, or of the one that a product file names, with the scene's size and height."""
    root = read_xml(path)
    if _first_pixel(root, _GROUND_TO_IMAGE) is not None:
        product = product_beside(path)
        described = None if product is None else read_xml(product)
    else:
        path, described = _find_rpc_file(path, root), root
        root = read_xml(path)
    reading = _read_model(path, root)
    return RpcReading(reading.rpc, reading.size or _product_size(described), _scene_height(described), reading.sensor)


def _read_model(path: str, root: Element) -> RpcReading:
    model, validity = _first_pixel(root, _GROUND_TO_IMAGE), next(root.iter("RFM_Validity"), None)
    if model is None or validity is None:
        raise InputError(f"{path}: {' or '.join(_GROUND_TO_IMAGE)} or RFM_Validity is missing: get the file again")
    coefficients = {element.tag: element.text or "" for element in model}
    values: dict[str, str | list[str] | None] = {name: element_text(validity, DIMAP_NAMES[name]) for name in SCALARS}
    values |= {name: values_by_number(coefficients, f"{DIMAP_NAMES[name]}_", range(1, 21)) for name in POLYNOMIALS}
    rpc = rpc_from_text(path, values, DIMAP_NAMES)
    # Sample and line of the first pixel's centre as this version counts: 1 or 0
    version = next((element.get("version", "") for element in root.iter("METADATA_FORMAT")), "")
    first = {"2": 1, "3": 0}.get(version.strip()[:1])
    if first is None:
        raise InputError(f"{path}: METADATA_FORMAT version is {shorten(version)!r}: DIMAP versions 2 and 3 are known")
    return RpcReading(
        rpc.shift(-first, -first),
        _scene_size(_domain(root), first),
        sensor=element_text(root, "METADATA_PROFILE") or "",
    )


def _find_rpc_file(path: str, product: Element) -> str:
    """Return the RPC file that a product file names; raise `InputError` that says what it is where it names none."""
    model = next((e for models in product.iter("Geoposition_Models") for e in models.iter("COMPONENT_PATH")), None)
    if model is None:
        mission = " ".join(filter(None, (element_text(product, name) for name in ("MISSION", "MISSION_INDEX"))))
        level = element_text(product, "PROCESSING_LEVEL") or element_text(product, "DATA_PROCESSING_LEVEL")
        raise InputError(
            f"{path}: a DIMAP product{f' of {shorten(mission)}' if mission else ''}"
            f"{f', level {shorten(level)}' if level else ''}, which names no RPC file: this product was delivered "
            "with orbit and attitudes or map coordinates instead; make an RPC from a grid of them with fit-rpc, or "
            "order the sensor product with RPC"
        )
    named = model.get("href", "").replace("\\", "/")
    file = siblings(path).get(named.removeprefix("./").lower())
    if file is None:
        raise InputError(f"{path}: names the RPC file {shorten(named, 80)!r}, which is not beside it: put it there")
    return file


def product_beside(rpc_file: str) -> str | None:
    """Return the product file ``DIM_x.XML`` beside ``RPC_x.XML``, None where there is none."""
    return siblings(rpc_file).get(_product_name(rpc_file))


def _product_name(rpc_file: str) -> str:
    return "dim_" + os.path.basename(rpc_file).lower().removeprefix("rpc_")


def _product_size(product: Element | None) -> tuple[int, int] | None:
    if product is None:
        return None
    return positive_size(element_text(product, "NCOLS"), element_text(product, "NROWS"))


def _scene_height(product: Element | None) -> float | None:
    """Return the ellipsoidal height (m) of the scene's middle."""
    centre = None if product is None else next((e for area in product.iter("Dataset_Extent")
                                                for e in area.iter("Center")), None)  # fmt: skip
    return None if centre is None else finite_number(element_text(centre, "H"))


def _first_pixel(root: Element, names: tuple[str, ...]) -> Element | None:
    return next((element for name in names for element in root.iter(name)), None)


def _domain(root: Element) -> dict[str, str]:
    element = _first_pixel(root, _IMAGE_DOMAIN)
    return {} if element is None else {child.tag: (child.text or "").strip() for child in element}


def _scene_size(domain: dict[str, str], first: int) -> tuple[int, int] | None:
    """Return the scene's size where the validity domain begins at the first pixel."""
    if domain.get("FIRST_COL") != str(first) or domain.get("FIRST_ROW") != str(first):
        return None
    last = positive_size(domain.get("LAST_COL"), domain.get("LAST_ROW"))
    return None if last is None else (last[0] - first + 1, last[1] - first + 1)


def _recognises(name: str, head: bytes) -> bool:
    if _DOCUMENT.search(head[:4000]):
        return True
    return name.startswith("rpc_") and name.endswith(".xml") and not isd.ISD.search(head)


def _is_product(head: bytes) -> bool:
    return _DOCUMENT.search(head[:4000]) is not None and not any(name.encode() in head for name in _GROUND_TO_IMAGE)


def _side_names(stem: str) -> tuple[str, ...]:
    """Return RPC_x.xml for IMG_x, its tiles IMG_x_R1C1 and groups of bands IMG_x_P_R1C1, and the image's own stem."""
    image = stem.removeprefix("img_")
    product = _TILE.sub("", image)
    names = [f"rpc_{name}.xml" for name in (product, _BANDS.sub("", product), image)]
    return tuple(dict.fromkeys([*names, f"{stem}_rpc.xml", f"{stem}.xml"]))


def tile_origin(image_path: str, side_file: str) -> Origin | None:
    """Return the scene's (sample, line) of the first pixel of a tile ``IMG_x_R2C3``; None for other names.

    The tile size stands in the product's ``DIM_x.XML``. Raises `InputError` where that is missing, but for the first
    tile, which begins with its scene.
    """
    match = _TILE.search(os.path.splitext(os.path.basename(image_path))[0].lower())
    if match is None:
        return None
    row, column = int(match[1]), int(match[2])
    if (row, column) == (1, 1):
        return 0.0, 0.0
    product = product_beside(side_file)
    if product is None:
        raise InputError(
            f"{image_path}: is a tile, and {_product_name(side_file)} with the tile size is not beside it: put it there"
        )
    size = next(read_xml(product).iter("NTILES_SIZE"), None)
    tile = None if size is None else positive_size(size.get("ncols"), size.get("nrows"))
    if tile is None:
        raise InputError(f"{product}: NTILES_SIZE with ncols and nrows is missing: get the file again")
    return float((column - 1) * tile[0]), float((row - 1) * tile[1])


READER = RpcReader("DIMAP XML", _side_names, _recognises, read, tile_origin, _is_product)

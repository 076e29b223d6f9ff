"""Items of a SpatioTemporal Asset Catalog (STAC) as images: their pixels, their RPC, and the position of the sun.

An item is a GeoJSON feature with named *assets*: files with address, media type and roles. Its image is the asset with
the role ``data``; if there are several, the user names one. STAC has no extension for RPCs. The RPC of an item is,
in this order,

1. fields ``rpc:line_off`` … ``rpc:samp_den_coeff`` of the image's asset, else of the item: GDAL's names of the RPC
   domain in lower case, numbers and lists of twenty numbers, positions from the centre of the first pixel;
2. an asset that is an RPC file: the one named as the image's with the suffix ``_rpc`` (as Planet names them), else one
   with ``rpc`` in its name, its roles or its address, else one with the role ``metadata``;
3. the RPC in the image file or next to it, as for any image.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any
from urllib.parse import unquote, urljoin, urlsplit

from ...foundation.errors import InputError, list_ids
from ..opening.files import read_json
from ..opening.item_images import ItemImage, StacItem
from ..rpc_files.fields import STAC_NAMES

ITEM, COLLECTION_OF_ITEMS = "Feature", "FeatureCollection"
_SCHEMES = {"s3": "/vsis3/", "gs": "/vsigs/", "az": "/vsiaz/", "oss": "/vsioss/"}
#: Media types and endings of images, and roles of assets that are no images.
_IMAGE_TYPES = (
    "image/tiff",
    "image/vnd.stac.geotiff",
    "image/jp2",
    "application/vnd.nitf",
    "image/nitf",
    "application/vnd.gdal.vrt",
)
_IMAGE_ENDINGS = (".tif", ".tiff", ".ntf", ".nitf", ".nsf", ".jp2", ".img", ".vrt")
_NO_IMAGES = {"thumbnail", "overview", "metadata", "mask", "data-mask", "cloud", "snow-ice", "water-mask"}


def images_of_items(name: str, log: Callable[[str], None]) -> list[ItemImage] | None:
    """Return the image of each item of a file, in the order of the file; None for a name that is no file of items.

    name : a file with an item, an item collection or a page of an API; ``STACIT:"FILE":asset=NAME`` if its items
    have several images; log : is called with a message if the file is one page of several

    Raises `InputError` if an item has no image, or several and none is named, and for a catalogue of items elsewhere.
    """
    # The syntax of GDAL's driver STACIT
    stated = re.fullmatch(r'STACIT:("?)(?P<file>.+?)\1:asset=(?P<asset>.+)', name)
    file, asset = (stated["file"], stated["asset"]) if stated else (name, None)
    is_json = urlsplit(file).path.lower().endswith((".json", ".geojson"))
    if not is_json or not (file.startswith("/vsi") or os.path.isfile(file)):
        if stated:
            raise InputError(f"{name}: there is no file {file} with items: name one (.json)")
        return None
    document = read_json(file, "items")
    kind = document.get("type") if isinstance(document, dict) else None
    if kind in ("Collection", "Catalog") and "stac_version" in document:
        raise InputError(
            f"{file}: is a {kind} that refers to items elsewhere: name its items, or save the answer to a search "
            "(an item collection)"
        )
    features = document.get("features") if kind == COLLECTION_OF_ITEMS else [document] if kind == ITEM else None
    if not isinstance(features, list):
        if stated:
            raise InputError(f"{file}: contains no STAC items: name an item or an item collection")
        return None
    if not features:
        raise InputError(f"{file}: is an item collection without items: search again")
    if any(link.get("rel") == "next" for link in _pick_dicts(document.get("links"))):
        log(f"{file}: is one page of several: only its {len(features)} items are taken; save the others too")
    return [_image_of(file, number, feature, kind == ITEM, asset) for number, feature in enumerate(features, start=1)]


def restore_image_paths(entries: Iterable[tuple[str, str, str | None]]) -> list[str]:
    """Return the image paths that an earlier run recorded, in their order, with the properties of their STAC items.

    entries : id, path, and specification of the item (`StacItem.named`); None for an image of no item

    Raises `InputError` if an item is not in its file any more.
    """
    items: dict[str, dict[str, ItemImage]] = {}
    images: list[str] = []
    for name, path, names in entries:
        if names is not None and names not in items:
            items[names] = {image.item.id: image for image in images_of_items(names, lambda _text: None) or ()}
        result = path if names is None else items[names].get(name)
        if result is None:
            raise InputError(f"{names}: has no item {name!r} any more, which an earlier run used: put it back")
        images.append(result)
    return images


def _image_of(file: str, number: int, feature: Any, single: bool, requested: str | None) -> ItemImage:
    """Return the image of an item; if it is ``single`` in its file, its relative addresses refer to that file."""
    if not isinstance(feature, dict) or not isinstance(feature.get("assets"), dict):
        raise InputError(f"{file}: feature {number} has no assets, it is no STAC item: name an item collection")
    name = feature.get("id")
    if not isinstance(name, str) or not name:
        raise InputError(f"{file}: item {number} has no id: correct the file")
    place_text = f"{file}, item {name!r}"
    if {"/", "\\", "\0"} & set(name) or name in (".", ".."):
        raise InputError(f"{place_text}: the id cannot be used as a file name of the results: correct the id")
    assets = {key: asset for key, asset in feature["assets"].items() if isinstance(asset, dict)}
    base = file if single else next(
        (link["href"] for link in _pick_dicts(feature.get("links"))
         if link.get("rel") == "self" and "://" in str(link.get("href"))), file,
    )  # fmt: skip
    properties = feature.get("properties")
    properties = properties if isinstance(properties, dict) else {}

    def path_of(key: str) -> str:
        href = assets[key].get("href")
        if not isinstance(href, str) or not href:
            raise InputError(f"{place_text}, asset {key!r}: has no href: correct the file")
        return href_path(href, base)

    place = file if file.startswith("/vsi") else os.path.abspath(file)
    image = requested  # the name of the asset that is the image; None where there is no image
    if requested is not None:
        if requested not in assets:
            raise InputError(
                f"{place_text}: has no asset {requested!r} (assets: {list_ids(assets)}): name one of these"
            )
    else:
        images = [key for key, asset in assets.items() if _is_image(asset)]
        result = [key for key in images if "data" in _roles_of(assets[key])] or images
        if len(result) > 1:
            raise InputError(
                f'{place_text}: has several images ({list_ids(result)}): name one, as STACIT:"FILE":asset={result[0]}'
            )
        image = result[0] if result else None
    rpc_files = tuple(path_of(key) for key in _rpc_assets(assets, image))
    if image is None:
        if not rpc_files:
            raise InputError(
                f"{place_text}: has no asset that is an image (assets: {list_ids(assets)}): name another item"
            )
        return ItemImage(rpc_files[0], StacItem(name, file, place, properties))
    fields = {key: properties[key] for key in STAC_NAMES.values() if key in properties}
    fields |= {key: assets[image][key] for key in STAC_NAMES.values() if key in assets[image]}
    names = f'STACIT:"{place}":asset={image}'
    return ItemImage(path_of(image), StacItem(name, file, names, properties, fields, rpc_files))


def _is_image(asset: Mapping[str, Any]) -> bool:
    media, href = str(asset.get("type") or "").partition(";")[0].strip().lower(), str(asset.get("href") or "")
    if _roles_of(asset) & _NO_IMAGES or _speaks_of_rpc(asset):
        return False
    return media in _IMAGE_TYPES or (not media and urlsplit(href).path.lower().endswith(_IMAGE_ENDINGS))


def _rpc_assets(assets: Mapping[str, Mapping[str, Any]], image: str | None) -> list[str]:
    """Return the names of the assets that may be the image's RPC file, the most probable first."""
    ranks: dict[str, int] = {}
    for key, asset in assets.items():
        name = urlsplit(str(asset.get("href") or "")).path.lower()
        if key == image or not name.endswith((".txt", ".rpb", ".xml", ".geom", ".json", ".rpc")):
            continue
        if key == f"{image}_rpc":
            ranks[key] = 0
        elif "rpc" in key.lower() or _speaks_of_rpc(asset):
            ranks[key] = 1
        elif "metadata" in _roles_of(asset):
            ranks[key] = 2
    return sorted(ranks, key=lambda key: ranks[key])


def _speaks_of_rpc(asset: Mapping[str, Any]) -> bool:
    name = os.path.basename(urlsplit(str(asset.get("href") or "")).path).lower()
    return "rpc" in _roles_of(asset) or name.endswith(".rpb") or re.search(r"(?<![a-z])rpc(?![a-z])", name) is not None


def _roles_of(asset: Mapping[str, Any]) -> set[str]:
    roles = asset.get("roles")
    return {str(role).lower() for role in roles} if isinstance(roles, list) else set()


def _pick_dicts(value: Any) -> Iterator[dict[str, Any]]:
    yield from (one for one in value if isinstance(one, dict)) if isinstance(value, list) else ()


def href_path(href: str, base: str) -> str:
    """Return the path by which GDAL opens an address.

    href : ``https://…``, ``s3://…``, ``gs://…``, ``az://…``, ``file:///…``, a path, one of GDAL's virtual paths; or
    a path relative to ``base``, the address or path of the file that contains it
    """
    if href.startswith("/vsi"):
        return href
    scheme = urlsplit(href).scheme.lower()
    if not scheme or len(scheme) == 1:  # one letter: the drive of a path
        if os.path.isabs(href):
            return href
        base = base.removeprefix("/vsicurl/")
        if "://" not in base:
            return os.path.normpath(os.path.join(os.path.dirname(base), href))
        relative = urlsplit(base)  # urljoin does not support s3
        absolute = urlsplit(urljoin(f"https://{relative.netloc}{relative.path}", href))
        return href_path(f"{relative.scheme}://{absolute.netloc}{absolute.path}", "")
    if scheme in ("http", "https"):
        return f"/vsicurl/{href}"
    if scheme == "file":
        return unquote(urlsplit(href).path)
    if scheme in _SCHEMES:
        return _SCHEMES[scheme] + href.partition("://")[2]
    raise InputError(f"{href}: addresses that begin with {scheme}: cannot be read: get the file, and name that")


def href_of(path: str, folder: str) -> str:
    """Return the address of a file for an item in a folder: relative in the same file system, otherwise complete.

    `href_path` is the inverse.
    """
    if path.startswith("/vsicurl/"):
        return path.removeprefix("/vsicurl/")
    place = folder.rstrip("/") + "/"
    if path.startswith(place):
        return f"./{path.removeprefix(place)}"
    for scheme, way in _SCHEMES.items():
        if path.startswith(way):
            return f"{scheme}://{path.removeprefix(way)}"
    if path.startswith("/vsi") or folder.startswith("/vsi"):
        return path if path.startswith("/vsi") else os.path.abspath(path)
    return os.path.relpath(path, folder).replace(os.sep, "/")

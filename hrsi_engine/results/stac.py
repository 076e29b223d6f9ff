"""Refined images as items of a SpatioTemporal Asset Catalog (STAC 1.1): one item per image, and all in one collection.

An item has the image's outline on the ground, time and sun of its acquisition, the viewing direction, the lineage of
its RPC (``processing``), its accuracy (``accuracy``), and the files with sizes and checksums (``file``). It also
contains the refined RPC, in the fields ``rpc:…`` that `io.catalogue.stac_items` reads, so that an item is sufficient if
the pixels are elsewhere; properties without a field in an extension have the prefix ``hrsi``.
"""

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from shapely.affinity import translate
from shapely.geometry import MultiPolygon, Polygon, box, mapping
from shapely.geometry.polygon import orient

from ..block.block import Image
from ..block.imaging_geometry import compute_footprint
from ..block.pointing import compute_gsd_m
from ..io.catalogue.lineage import file_entry
from ..io.catalogue.stac_items import href_of
from ..io.opening.item_images import item_of
from ..io.rasters.sun_angles import read_sun
from ..io.rpc_files.fields import STAC_NAMES, json_members
from ..refinement.model import RefitRPC
from .lineage import block_accuracy

STAC_VERSION = "1.1.0"
STAC_EXTENSIONS = {
    "view": "https://stac-extensions.github.io/view/v1.0.0/schema.json",
    "proj": "https://stac-extensions.github.io/projection/v2.0.0/schema.json",
    "processing": "https://stac-extensions.github.io/processing/v1.1.0/schema.json",
    "accuracy": "https://stac-extensions.github.io/accuracy/v1.0.0/schema.json",
    "file": "https://stac-extensions.github.io/file/v2.1.0/schema.json",
}
#: Properties of the satellite in an original item that are also valid for the refined image.
OF_SATELLITE = ("platform", "constellation", "mission", "instruments", "gsd")
MEDIA_TYPES = {
    ".tif": "image/tiff; application=geotiff", ".tiff": "image/tiff; application=geotiff", ".jp2": "image/jp2",
    ".ntf": "application/vnd.nitf", ".vrt": "application/vnd.gdal.vrt+xml", ".txt": "text/plain",
    ".rpb": "text/plain", ".xml": "application/xml", ".json": "application/json", ".html": "text/html",
}  # fmt: skip
SHA256 = "1220"  # prefix of a multihash: SHA-256, 32 bytes
EARLIEST = "1957-10-04T00:00:00Z"  # before any image from space, for unknown times


def describe_item(image: Image, refined: RefitRPC, report: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """Return an image with its refined RPC as a STAC item, ready for JSON, without its assets.

    report : complete except for times and written files; folder : folder of the item
    """
    rpc = refined.rpc
    outline = _orient_outline(compute_footprint(replace(image, rpc=rpc), image.middle_height_m))
    entry, source = report["images"][image.id], item_of(image.path)
    retained = (
        {} if source is None else {key: source.properties[key] for key in OF_SATELLITE if key in source.properties}
    )
    links = (
        []
        if source is None
        else [{"rel": "derived_from", "href": href_of(source.source, folder), "type": "application/geo+json"}]
    )
    # Time of acquisition; if it is not known, an interval up to the run's date
    times = (
        {"datetime": entry["acquired"]}
        if entry["acquired"] is not None
        else {"datetime": None, "start_datetime": EARLIEST, "end_datetime": report["date"]}
    )
    # Directions to the satellite and the sun from the middle of the image
    view = {}
    if entry["incidence_deg"] is not None:  # STAC's azimuth is that from the satellite to the scene
        view = {"view:incidence_angle": entry["incidence_deg"], "view:azimuth": (entry["azimuth_deg"] + 180.0) % 360.0}
    sun = read_sun(image.path, image.rpc) if image.path else None
    if sun is not None:
        view |= {"view:sun_azimuth": sun.angles.azimuth_deg % 360.0, "view:sun_elevation": sun.angles.elevation_deg}
    angles = {key: round(value, 4) for key, value in view.items()}
    # Accuracy predicted by the adjustment for the image, and that of the block by check points (or predicted)
    properties: dict[str, Any] = {}
    if rpc.err_bias is not None and rpc.err_rand is not None:
        item = float(np.hypot(rpc.err_bias, rpc.err_rand))
        properties = {
            "accuracy:geometric_x_stddev": item,
            "accuracy:geometric_y_stddev": item,
            "accuracy:geometric_rmse": float(np.sqrt(2.0)) * item,
        }
    properties = {key: round(value, 4) for key, value in properties.items() if np.isfinite(value)}
    block, accuracy_from = block_accuracy(report)
    valid = {f"hrsi:{name.lower()}_m": round(value, 4) for name, value in block.items() if value is not None}
    accuracy = properties | valid | ({"hrsi:accuracy_from": accuracy_from} if valid else {})
    return {
        "type": "Feature",
        "stac_version": STAC_VERSION,
        "stac_extensions": list(STAC_EXTENSIONS.values()),
        "id": image.id,
        "geometry": mapping(outline),
        "bbox": list(_bounding_box(outline)),
        "properties": {
            **times,
            "created": report["date"],
            **({"platform": image.sensor} if image.sensor else {}),
            "gsd": round(compute_gsd_m(image), 3),
            **retained,
            **angles,
            **_processing_properties(image, report),
            **accuracy,
            **json_members(rpc, STAC_NAMES),
        },
        "links": links,
    }


def _processing_properties(image: Image, report: Mapping[str, Any]) -> dict[str, Any]:
    images = len(report["images"])
    return {
        "processing:lineage": (
            f"RPC of {image.path or image.id} refined by HRSI {report['version']} ({report['algorithm']}): model "
            f"{report['model']}, {images} image{'s' if images > 1 else ''}, verdict {report['verdict']['level']}"
        ),
        "processing:software": {"HRSI": report["version"]},
        "hrsi:model": report["model"],
        "hrsi:verdict": report["verdict"]["level"],
        "hrsi:block": list(report["images"]),
    }


def describe_assets(image: Image, rpc_path: str, staged: str, folder: str) -> dict[str, Any]:
    """Return the files of a refined image as the assets of its STAC item.

    rpc_path : later path of its refined RPC; staged : present path of that file,
    whose size and checksum are stated
    folder : folder of the item: addresses below it or near it are relative to it
    """

    def make_asset(path: str, *roles: str) -> dict[str, Any]:
        asset: dict[str, Any] = {"href": href_of(path, folder), "roles": list(roles)}
        ending = path[path.rfind(".") :].lower()
        if ending in MEDIA_TYPES:
            asset["type"] = MEDIA_TYPES[ending]
        if path == rpc_path and os.path.isfile(staged):
            entry = file_entry(staged)
            asset["file:size"] = entry["size"]
            if entry["sha256"] is not None:
                asset["file:checksum"] = SHA256 + entry["sha256"]
        return asset

    is_sidecar, assets = rpc_path.upper().endswith(".TXT"), {}  # then the pixels are not copied
    if image.raster is not None:
        assets["image"] = make_asset(image.path if is_sidecar else rpc_path, "data")
        if image.size is not None:
            assets["image"]["proj:shape"] = [image.size[1], image.size[0]]
    if is_sidecar:
        assets["rpc"] = make_asset(rpc_path, "metadata", "rpc")
    return assets | {"report": {"href": "./report.json", "type": MEDIA_TYPES[".json"], "roles": ["metadata"]}}


def _orient_outline(outline: Polygon) -> Polygon | MultiPolygon:
    """Return an outline as in RFC 7946: counter-clockwise, in two parts if it crosses 180 degrees."""
    if outline.is_empty:
        return outline
    outline = translate(orient(outline), -360.0 * np.floor((outline.bounds[0] + 180.0) / 360.0))
    if outline.bounds[2] <= 180.0:
        return outline
    parts = [
        outline.intersection(box(-180.0, -90.0, 180.0, 90.0)),
        translate(outline.intersection(box(180.0, -90.0, 540.0, 90.0)), -360.0),
    ]
    return MultiPolygon([orient(part) for part in parts if part.geom_type == "Polygon"])


def _bounding_box(outline: Polygon | MultiPolygon) -> tuple[float, ...]:
    """Return west, south, east, north; west is larger than east if the outline crosses 180 degrees."""
    if outline.geom_type == "Polygon":
        return tuple(outline.bounds)
    bounds = [part.bounds for part in outline.geoms]
    return bounds[0][0], min(b[1] for b in bounds), bounds[-1][2], max(b[3] for b in bounds)

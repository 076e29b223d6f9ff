"""GCPs stored in an image file. GDAL counts their pixel and line from the upper left *corner* of the image.

GDAL numbers GCPs within an image, so ids that are empty or mere numbers get the image's id in front. GDAL cannot say
"no height": where all heights are exactly 0 they count as not given.
"""

import numpy as np
from osgeo import gdal

from ...foundation.errors import InputError
from ..opening.datasets import open_dataset
from ..rasters.images import image_id
from .table import PointReader, PointTable


def read(path: str, _layer: str = "") -> PointTable:
    """Return the GCPs of an image; raise `InputError` where it has none."""
    dataset, message = open_dataset(path)
    if dataset is None:
        raise InputError(f"{path}: cannot be opened as an image ({message}): check the file")
    gcps = dataset.GetGCPs()
    if not gcps:
        raise InputError(f"{path}: is an image without GCPs: name a point layer or CSV instead")
    image = image_id(path)
    height = np.array([gcp.GCPZ for gcp in gcps])
    columns = {
        "id": np.array([_gcp_name(image, gcp, number) for number, gcp in enumerate(gcps, start=1)], dtype=str),
        "image": np.full(len(gcps), image),
        "sample": np.array([gcp.GCPPixel for gcp in gcps]) - 0.5,
        "line": np.array([gcp.GCPLine for gcp in gcps]) - 0.5,
    }
    geometry = np.column_stack([
        [gcp.GCPX for gcp in gcps], [gcp.GCPY for gcp in gcps], height if height.any() else np.full(len(gcps), np.nan),
    ])  # fmt: skip
    reference = dataset.GetGCPSpatialRef()
    crs = reference.ExportToWkt(["FORMAT=WKT2_2019"]) if reference is not None else ""
    return PointTable(path, columns, tuple(columns), lambda row: f"GCP {row + 1}", geometry, crs)


def _gcp_name(image: str, gcp: gdal.GCP, number: int) -> str:
    name = str(gcp.Id).strip()
    return f"{image}-{name or number}" if not name or name.isdigit() else name


def _recognises(path: str, _gcp_name: str, _head: bytes) -> bool:
    return open_dataset(path)[0] is not None


READER = PointReader("GCPs in an image", _recognises, read)

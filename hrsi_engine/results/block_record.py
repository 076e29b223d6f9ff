"""The record of an adjusted block, ``block.json``: the data with which a later run can add images to the block.

In addition to the layers of ``block.gpkg``, which contain the points, it has the images with their cameras before the
adjustment, the estimated parameters with their covariance, and the pairs of images with common points::

    {"schema": 1, "model": "affine", "sigma0": 1.0,
     "images": [{"id": "A", "path": "/data/A.tif", "rpc": {"line_off": 0.0, …, "samp_den": [20 numbers]},
                 "values": [p numbers], "covariance": [[p x p numbers]]}],
     "parameters": ["sample_shift", …],
     "pairs": [["A", "B", 120]],
     "layers": {"ground_points": "block.gpkg|layername=ground_points", "image_points": …}}

The reduced normal matrix of all cameras is too large for text and is in a separate file (`joint_arrays`).
"""

import os
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from scipy import sparse

from ..adjustment.priors.earlier_cameras import JointCameras
from ..adjustment.result import Adjustment
from ..foundation.errors import InputError
from ..io.catalogue.block_records import POINT_LAYERS
from ..io.opening.item_images import item_entry


def make_record(result: Adjustment) -> dict[str, Any]:
    """Return the record of a result, ready for JSON."""
    p = len(result.model.parameters)
    covariance = result.cameras.covariance[:, :p, :p]
    ids_known = np.isfinite(covariance).all(axis=(1, 2))
    # Pairs of images with the number of points that were measured on both and kept
    rows, block = result.block.measurements, result.block
    rows_kept = result.weight > 0.0
    incidence = sparse.csr_matrix(
        (np.ones(int(rows_kept.sum()), dtype=np.int32), (rows.point[rows_kept], rows.image[rows_kept])),
        shape=(len(block.points), len(block.images)),
    )
    common = sparse.triu(incidence.T @ incidence, 1).tocoo()
    names = [image.id for image in block.images]
    pairs = [[names[a], names[b], int(n)] for a, b, n in zip(common.row, common.col, common.data, strict=True)]
    return {
        "schema": 1,
        "model": result.model.name,
        "sigma0": result.sigma0,
        "parameters": list(result.model.parameters),
        "images": [
            {
                "id": image.id,
                "path": os.path.abspath(image.path) if os.path.exists(image.path) else image.path,
                **item_entry(image.path),
                "rpc": {part.name: np.asarray(getattr(image.rpc, part.name)).tolist() for part in fields(image.rpc)},
                "values": values.tolist(),
                "covariance": normal.tolist() if ids_known[k] else None,
            }
            for k, (image, values, normal) in enumerate(
                zip(result.block.images, result.values, covariance, strict=True)
            )
        ],
        "pairs": pairs,
        "layers": POINT_LAYERS,
    }


def joint_arrays(joint: JointCameras) -> dict[str, np.ndarray]:
    """Return the joint estimates of cameras as arrays, by the names of their fields."""
    return {"schema": np.array(1), **{part.name: np.asarray(getattr(joint, part.name)) for part in fields(joint)}}


def read_joint_arrays(arrays: Mapping[str, np.ndarray], source: str) -> JointCameras:
    """Return the cameras from arrays as of `joint_arrays`; raise `InputError` if the arrays are inconsistent."""
    try:
        given = {part.name: arrays[part.name] for part in fields(JointCameras)}
        k, (c, p), b = len(given["images"]), given["values"].shape, len(given["blocks"])
        numbers = {"camera": (k,), "rows": (b,), "columns": (b,), "gcps": (k,)}
        floats = {"values": (c, p), "blocks": (b, p, p), "squares": (c, p, p)}
        is_valid = all(given[name].shape == shape and given[name].dtype.kind in "iu" for name, shape in numbers.items())
        is_valid &= all(given[name].shape == shape and np.isfinite(given[name]).all() for name, shape in floats.items())
        is_valid &= given["fixed"].shape == (c, p) and given["fixed"].dtype == bool and len(given["parameters"]) == p
        is_valid &= all(((given[name] >= 0) & (given[name] < c)).all() for name in ("camera", "rows", "columns"))
        is_valid = is_valid and bool((np.diff(given["rows"]) >= 0).all() and (given["rows"] <= given["columns"]).all())
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{source}: contains no camera parameters ({error!r}): adjust that block again") from None
    if not is_valid:
        raise InputError(f"{source}: its arrays are inconsistent: adjust that block again")
    names: dict[str, Any] = {name: tuple(map(str, given[name].tolist())) for name in ("images", "parameters")}
    return JointCameras(**{**given, **names})

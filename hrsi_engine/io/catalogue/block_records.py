"""Reading of the record of an adjusted block, as `results.block_record` makes it, from a result folder.

``block.json`` is for people and programs; the joint parameters and covariance of the cameras, a sparse matrix, are
in ``block_cameras.npz``, which `numpy.load` reads.
"""

import os
from dataclasses import dataclass

import numpy as np

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ..opening.files import read_json
from ..safety.array_files import DAMAGED, read_arrays

RECORD_FILE, CAMERAS_FILE = "block.json", "block_cameras.npz"
#: Layers of a block's points, relative to its folder.
POINT_LAYERS = {name: f"block.gpkg|layername={name}" for name in ("ground_points", "image_points")}


@dataclass(frozen=True, eq=False)
class ImageRecord:
    """An image of an adjusted block.

    item : specification of the STAC item that the image is from; None for an image of no item
    values, covariance : (p,) and (p, p) of the image's parameters; the covariance is None where it was not computed
    """

    id: str
    path: str
    item: str | None
    rpc: RPC
    values: np.ndarray
    covariance: np.ndarray | None


@dataclass(frozen=True, eq=False)
class BlockRecord:
    """Record of an adjusted block as read from its folder: model, images, and the layers of its points."""

    folder: str
    model: str
    images: tuple[ImageRecord, ...]

    def layer(self, name: str) -> str:
        """Return the path of a layer, one of `POINT_LAYERS`, in the block's folder."""
        return os.path.join(self.folder, POINT_LAYERS[name])


def read_record(folder: str) -> BlockRecord:
    """Return the block record of a result folder; raise `InputError` where it is missing or invalid."""
    path = os.path.join(folder, RECORD_FILE)
    if not os.path.exists(path):
        raise InputError(f"{folder}: contains no {RECORD_FILE}: name the output directory of an earlier adjustment")
    try:
        result = read_json(path, "report")
        images = tuple(
            ImageRecord(
                str(image["id"]),
                str(image["path"]),
                image.get("item"),
                RPC(**image["rpc"]),
                np.array(image["values"], dtype=np.float64),
                None if image["covariance"] is None else np.array(image["covariance"], dtype=np.float64),
            )
            for image in result["images"]
        )
        return BlockRecord(folder, str(result["model"]), images)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: is no record of a block ({error!r}): adjust that block again") from None


def read_cameras(folder: str) -> dict[str, np.ndarray]:
    """Return the joint parameters and covariance of a block's cameras; raise `InputError` without a valid file."""
    path = os.path.join(folder, CAMERAS_FILE)
    if not os.path.exists(path):
        raise InputError(
            f"{folder}: contains no {CAMERAS_FILE} with the joint accuracy of its cameras: adjust that block again, or "
            "set `earlier_cameras` to free"
        )
    try:
        return read_arrays(path)
    except DAMAGED as error:
        raise InputError(f"{path}: is damaged ({error}): adjust that block again") from None

"""Directories that hold one RPC an image: results of this tool or another one."""

import os
import re
from collections.abc import Sequence

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.rasters.images import image_id
from ...hrsi_engine.io.rpc_files import read_rpc_or_none, rpc_for_image, rpc_reader_of
from ..interface.declare import Log

NEVER_RPC = (".gpkg", ".json", ".html", ".csv", ".aux.xml", ".png", ".jpg", ".log", ".gpkg-wal", ".gpkg-shm")


def rpcs_of_folder(folder: str, images: Sequence[Image], log: Log) -> tuple[list[str], list[RPC]]:
    """Return files and RPCs that a directory holds for images; raise `InputError` where one is missing.

    For an image ``a.tif`` that is the RPC of ``a.tif``, of another file with the id ``a`` (``a.vrt``, ``a_RPC.TXT``),
    or of a file whose name has ``a`` in it as a word (``run-a.adjusted_rpc.xml``). The RPC of a whole scene is moved to
    the image's crop.
    """
    if not os.path.isdir(folder):
        raise InputError(f"{folder}: no such directory: `rpcs` needs NAME=DIR")
    names = sorted(name for name in os.listdir(folder) if not name.lower().endswith(NEVER_RPC))
    found = [_rpc_of(folder, names, image) for image in images]
    files = ", ".join(name for name, _ in found[:3]) + (", …" if len(found) > 3 else "")
    log(f"{folder}: {len(found)} RPCs ({files})")
    return [os.path.join(folder, name) for name, _ in found], [rpc for _, rpc in found]


def _rpc_of(folder: str, names: Sequence[str], image: Image) -> tuple[str, RPC]:
    """Return the file and the RPC of one image."""
    same = [name for name in names if name == os.path.basename(image.path)]
    of_id = [name for name in names if image_id(name).lower() == image.id.lower() and name not in same]
    word = re.compile(rf"(?<![A-Za-z0-9]){re.escape(image.id)}(?![A-Za-z0-9])", re.IGNORECASE)
    others = [name for name in names if word.search(name) and name not in same and name not in of_id]
    for name in (*same, *of_id, *others):
        path = os.path.join(folder, name)
        if os.path.isdir(path):
            continue
        try:
            if rpc_reader_of(path) is not None:
                return name, rpc_for_image(path, image.path).rpc
            reading = read_rpc_or_none(path)
        except InputError:
            if name not in others:
                raise
            continue  # something else that has the image's name in its own
        if reading is not None:
            return name, reading.rpc
    raise InputError(
        f"{folder}: holds no RPC for {image.id} ({image.id}.tif with RPC, {image.id}_RPC.TXT, {image.id}.RPB …): "
        "check the directory"
    )

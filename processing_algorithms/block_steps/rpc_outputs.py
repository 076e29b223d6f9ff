"""Where refined RPCs go: copies of the images, virtual images, ``_RPC.TXT`` files, or the images themselves."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.progress import Progress, advance, stage
from ...hrsi_engine.io.rpc_files import (
    Lineage,
    free_the_way,
    prepare_in_place,
    write_geotiff_copy,
    write_rpc_text,
    write_vrt,
)
from ...hrsi_engine.io.safety.transactions import Transaction
from ...hrsi_engine.refinement.model import RefitRPC

Writer = Callable[[str, str, RPC, Lineage, Progress], object]


#: By the choice of `write`: ending of the new file, and what writes it.
NEW_FILES: dict[str, tuple[str, Writer]] = {
    "copy": (".tif", lambda source, target, rpc, lineage, part: write_geotiff_copy(source, target, rpc, part, lineage)),
    "vrt": (".vrt", lambda source, target, rpc, lineage, part: write_vrt(source, target, rpc, lineage)),
    "sidecar": ("_RPC.TXT", lambda source, target, rpc, lineage, part: write_rpc_text(target, rpc, lineage)),
}
IN_PLACE, WRITE_NOTHING = "in-place", "none"
WITHOUT_PIXELS = "sidecar"  # an RPC file alone always gets a new RPC file


def plan_file_names(images: Sequence[Image], how: str) -> dict[str, str]:
    """Return the names of the new files with refined RPCs, by image id."""
    choices = {image.id: how if has_file(image) or how == WRITE_NOTHING else WITHOUT_PIXELS for image in images}
    return {name: name + NEW_FILES[choice][0] for name, choice in choices.items() if choice in NEW_FILES}


def _lineage_of(image: Image, items: Mapping[str, str]) -> Lineage:
    return Lineage({**items, "HRSI_SOURCE": os.path.basename(image.path)}, image.rpc)


def write_new_files(
    folder: Path, images: Sequence[Image], refined: Sequence[RefitRPC], how: str, items: Mapping[str, str],
    progress: Progress,
) -> dict[str, str]:  # fmt: skip
    """Write each image's refined RPC into a new file of ``folder``; return the file names by image id."""
    names = plan_file_names(images, how)
    for done, (image, new) in enumerate(zip(images, refined, strict=True)):
        if image.id not in names:
            continue
        part = stage(progress, done / len(images), (done + 1) / len(images))
        advance(part, 0.0, f"writing {image.id}")
        _, write = NEW_FILES[how if has_file(image) else WITHOUT_PIXELS]
        write(image.path, str(folder / names[image.id]), new.rpc, _lineage_of(image, items), part)
    return names


def clear_the_way(
    folder: str, names: Mapping[str, str], images: Sequence[Image], refined: Sequence[RefitRPC], changes: Transaction
) -> list[str]:
    """Have sidecars in ``folder`` set aside that would win over the RPCs of new copies; return notices."""
    notices: list[str] = []
    for image, new in zip(images, refined, strict=True):
        name = names.get(image.id, "")
        if name.endswith(NEW_FILES["copy"][0]):
            notices += free_the_way(os.path.join(folder, name), image.path, new.rpc, changes)
    return notices


def prepare_images(
    images: Sequence[Image], refined: Sequence[RefitRPC], changes: Transaction, items: Mapping[str, str],
    progress: Progress,
) -> list[str]:  # fmt: skip
    """Make the images themselves ready to take the refined RPCs, all together or none; return notices."""
    notices: list[str] = []
    with_pixels = images_with_pixels(images, refined)
    for done, (image, new) in enumerate(with_pixels):
        part = stage(progress, done / len(with_pixels), (done + 1) / len(with_pixels))
        advance(part, 0.0, f"writing {os.path.basename(image.path)}")
        notices += prepare_in_place(image.path, new.rpc, changes, part, _lineage_of(image, items))
    return notices


def images_with_pixels(images: Sequence[Image], refined: Sequence[RefitRPC]) -> list[tuple[Image, RefitRPC]]:
    """Return the images that are files with pixels, with their refined RPCs."""
    return [(image, new) for image, new in zip(images, refined, strict=True) if has_file(image)]


def has_file(image: Image) -> bool:
    """Tell whether an image has pixels in a file: not one that is an RPC alone, or comes from arrays."""
    return image.raster is not None and bool(image.path)

"""What the user names: images as files, patterns, lists, STAC items, deliveries; points as folders of results."""

import glob
import os
from collections.abc import Callable, Iterator, Sequence

from osgeo import gdal

from ...foundation.errors import InputError
from ..opening.budgets import FILE_BUDGETS, list_archive, require_delivery
from ..opening.datasets import open_dataset
from ..opening.files import open_raster, require_size
from ..rpc_files.find import product_reader_of, read_rpc, read_rpc_or_none, rpc_reader_of
from ..rpc_files.placement import find_placement_doubt
from .stac_items import images_of_items

LIST = "@"  #: prefix of a text file with one image in each line
PICTURE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp")  #: of images where no other has pixels; else of quick-looks
IMAGE_ENDINGS = (".tif", ".tiff", ".ntf", ".nitf", ".nsf", ".jp2", ".img", ".pix", ".vrt", ".h5")


def resolve_images(names: Sequence[str], log: Callable[[str], None]) -> tuple[str, ...]:
    """Return the image files for these names: patterns, folders, archives, lists and STAC items are expanded.

    Raises `InputError` for a name without any image with an RPC.
    """
    result: list[str] = []
    for name in names:
        # A folder, or an archive as a folder of GDAL's virtual file system, by its ending
        ways = {".zip": "/vsizip/", ".tar": "/vsitar/", ".tgz": "/vsitar/", ".tar.gz": "/vsitar/"}
        way = next((way for ending, way in ways.items() if name.lower().endswith(ending)), None)
        is_archive = way is not None and os.path.isfile(name)
        folder = name if os.path.isdir(name) else f"{way}{os.path.abspath(name)}" if is_archive else None
        if name.startswith(LIST) and not os.path.exists(name):
            result += resolve_images(_read_list(name.removeprefix(LIST)), log)
        elif folder is not None:
            images = _images_of_delivery(name, folder)
            log(f"{name}: {', '.join(os.path.relpath(image, folder) for image in images)}")
            result += images
        elif glob.has_magic(name) and not name.startswith("/vsi") and not os.path.exists(name):
            # A pattern (``*.tif``) that the shell has not replaced by the matching files
            files = sorted(file for file in glob.glob(name, recursive=True) if os.path.isfile(file))
            if not files:
                raise InputError(f"{name}: no file fits this pattern: check the folder and the ending")
            result += files
        elif (of_items := images_of_items(name, log)) is not None:
            result += of_items
        else:
            result.append(name)
    return tuple(result)


def resolve_points(name: str, layer: str = "") -> str:
    """Return the points file of a name; for the folder of a result, its GeoPackage (or the ``layer`` of it)."""
    layers = os.path.join(name, "block.gpkg")
    if not (os.path.isdir(name) and os.path.isfile(layers)):
        return name
    return f"{layers}|layername={layer}" if layer else layers


def _read_list(path: str) -> list[str]:
    """Return the lines of a list file; relative names refer to the folder of the list."""
    require_size(path, "names")
    try:
        with open(path, encoding="utf-8-sig") as file:
            lines = [line.strip() for line in file]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a list of images ({error}): name a text file") from None
    names = [line for line in lines if line and not line.startswith("#")]
    if not names:
        raise InputError(f"{path}: names no image: write one a line")
    placed = [name if "/vsi" in name else os.path.join(os.path.dirname(path), name) for name in names]
    for name, place in zip(names, placed, strict=True):
        if name.startswith(LIST) and not os.path.exists(place):
            raise InputError(f"{path}: names the list {name}: a list names images, folders and archives")
    return placed


def _images_of_delivery(name: str, folder: str) -> list[str]:
    """Return the images of a delivery; its RPC files alone only if it contains no images.

    A product file that GDAL opens replaces the tiles of which it consists; a product file without pixels replaces the
    RPC file that it names.
    """
    files = [os.path.join(folder, file) for file in _list_files(name, folder)]
    files = [file for file in files if not os.path.basename(file).startswith(".")]
    faults: list[str] = []
    products = [file for file in files if file.lower().endswith((".xml", ".dim")) and product_reader_of(file)]
    require_delivery(name, len(products), FILE_BUDGETS.delivery_in_vain, "files that describe products")
    tiled = set[str]()  # files that GDAL reads the products' pixels from
    for dataset in (open_dataset(product)[0] for product in products):
        tiled.update(os.path.abspath(part) for part in (dataset.GetFileList() or [] if dataset is not None else []))
    rasters = [file for file in files if file.lower().endswith(IMAGE_ENDINGS) and os.path.abspath(file) not in tiled]
    images = [*_with_rpc(name, [file for file in products if rpc_reader_of(file) is None] + rasters, faults)]
    if not images:
        pictures = [*_with_rpc(name, [file for file in files if file.lower().endswith(PICTURE_ENDINGS)], faults)]
        images = [one for one in pictures if find_placement_doubt(one, open_raster(one), read_rpc(one)) is None]
    if not images:
        names = [os.path.basename(file).lower() for file in products]
        names_of = {name.replace("dim_", "rpc_", 1) for name in names if name.startswith("dim_")}
        single = [
            one for one in files if os.path.basename(one).lower() not in names_of and not one.endswith(".aux.xml")
        ]
        texts = [file for file in single if _is_rpc_file(file)]
        images = [*_with_rpc(name, texts, faults)]
    if not images:
        reason = f" ({faults[0]})" if faults else ""
        raise InputError(f"{name}: contains no image with an RPC{reason}: name the images, or another folder")
    return sorted(images)


def _list_files(name: str, folder: str) -> list[str]:
    """Return the sorted paths of all files below a folder or in an archive, relative to it.

    Names that are not valid text are omitted, because GDAL cannot open them.
    """
    if folder.startswith("/vsi"):
        fixed = list_archive(name)
        packed, unfolded = os.path.getsize(name), sum(size for _name, size in fixed)
        if unfolded > max(FILE_BUDGETS.text_bytes, FILE_BUDGETS.packed_factor * packed):
            raise InputError(f"{name}: {packed} bytes that unfold to {unfolded} are no images: obtain it again")
        require_delivery(name, len(fixed))
        may_be = sum(one.lower().endswith((*IMAGE_ENDINGS, ".xml", ".dim")) for one, _size in fixed)
        require_delivery(name, may_be, FILE_BUDGETS.archive_images, "files that may be images")
        if any(one.count("/") > FILE_BUDGETS.delivery_depth for one, _size in fixed):
            raise InputError(
                f"{name}: contains folders deeper than {FILE_BUDGETS.delivery_depth}: unpack what you need"
            )
        names = [file for file in gdal.ReadDirRecursive(folder) or [] if isinstance(file, str)]
        return sorted(file for file in names if file[-1] != "/")
    result: list[str] = []
    visited = set[tuple[int, int]]()
    for place, folders, files in os.walk(folder, followlinks=True):
        status, relative = os.stat(place), os.path.relpath(place, folder)
        if (status.st_dev, status.st_ino) in visited or relative.count(os.sep) >= FILE_BUDGETS.delivery_depth:
            folders.clear()  # circular links, and folders deeper than any delivery has
            continue
        visited.add((status.st_dev, status.st_ino))
        result += [os.path.normpath(os.path.join(relative, file)) for file in files]
        require_delivery(name, len(result))
    return sorted(file for file in result if file.encode(errors="ignore").decode() == file)


def _is_rpc_file(file: str) -> bool:
    try:
        return rpc_reader_of(file) is not None
    except InputError:
        return False


def _with_rpc(name: str, files: Sequence[str], faults: list[str]) -> Iterator[str]:
    """Yield the files with an RPC; append the errors of the others to ``faults``, and stop if these are too many."""
    in_vain = 0
    for number, file in enumerate(files):
        try:
            if read_rpc_or_none(file) is not None:
                yield file
                continue
        except InputError as error:
            faults.append(str(error))
        in_vain += 1
        largest = FILE_BUDGETS.delivery_in_vain + number + 1 - in_vain
        require_delivery(name, in_vain, largest, "files that are no images with RPCs")

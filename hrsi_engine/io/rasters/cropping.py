"""Virtual images that are cut from one image or composed of several, and their storage with an RPC.

`pixel_view` shows an image in GIS software without warping: map x is the sample, map y the negative line.
"""

import hashlib
import os
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

import numpy as np
from osgeo import gdal

from ...block.block import Image
from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.progress import Progress
from ..opening.datasets import config_option, gdal_messages, metadata_of
from ..opening.files import open_raster
from ..rpc_files import tiff_tag
from ..rpc_files.crop import CropPlace
from ..rpc_files.fields import rpc_from_entries, rpc_from_numbers
from ..rpc_files.find import HEIGHT_ITEM, SENSOR_ITEM
from ..rpc_files.write import Lineage, save_geotiff, save_vrt
from .orthoimages import FORMATS, INTERNAL_MASK, OrthoFormat, copy_band_properties

VRT = "vrt"  #: as an alternative to `orthoimages.FORMATS`


class CropWindow(NamedTuple):
    """A window of an image (first sample and line, samples, lines), and the samples and lines after resampling."""

    bounds: tuple[int, int, int, int]
    size: tuple[int, int]

    @property
    def place(self) -> CropPlace:
        """Position and scale of the result in the image."""
        first, extent = np.reshape(np.array(self.bounds, dtype=np.float64), (2, 2))
        return CropPlace.from_corner(np.diag(extent / self.size), first)


def open_window(path: str, window: CropWindow, resampling: str) -> gdal.Dataset:
    """Return a window of an image as a virtual dataset, with the metadata that remain true.

    Overviews of the image are not used: their resampling is unknown, and averages of averages are displaced.
    """
    path = os.path.abspath(path) if os.path.exists(path) else path  # absolute, so that a VRT finds it from any folder
    original = source = open_raster(path)
    if window.size != window.bounds[2:] and original.GetRasterBand(1).GetOverviewCount():
        source = gdal.OpenEx(path, gdal.OF_RASTER, open_options=["OVERVIEW_LEVEL=NONE"])
    virtual = None
    with gdal_messages() as messages:
        virtual = gdal.Translate(
            "",
            source,
            format="VRT",
            srcWin=window.bounds,
            width=window.size[0],
            height=window.size[1],
            resampleAlg=resampling,
        )
    if virtual is None:
        raise InputError(f"{path}: cannot be read ({messages.reason}): obtain the file again")
    virtual.SetMetadata(metadata_of(original, "IMAGERY"), "IMAGERY")  # vendor's text on sensor and time
    for number in range(1, original.RasterCount + 1):  # without overviews GDAL loses band names
        virtual.GetRasterBand(number).SetDescription(original.GetRasterBand(number).GetDescription())
    return virtual


def join_images(paths: Sequence[str], first: np.ndarray, size: tuple[int, int]) -> gdal.Dataset:
    """Return images as one virtual dataset, with their first pixels at ``first (n, 2)``, later ones over earlier ones.

    Raises `InputError` if their bands differ.
    """
    paths = [os.path.abspath(path) if os.path.exists(path) else path for path in paths]
    datasets = [open_raster(path) for path in paths]
    bands = [
        [band_types.GetRasterBand(number + 1).DataType for number in range(band_types.RasterCount)]
        for band_types in datasets
    ]
    for path, band_types in zip(paths, bands, strict=True):
        if band_types != bands[0]:
            raise InputError(f"{path}: its bands are not those of {paths[0]}: give parts of one image")
    # Metadata that all images share are kept
    common_metadata = set.intersection(*(set(metadata_of(dataset).items()) for dataset in datasets))
    virtual = gdal.GetDriverByName("VRT").Create("", *size, 0)
    virtual.SetMetadata(dict(common_metadata))
    virtual.SetMetadata(metadata_of(datasets[0], "IMAGERY"), "IMAGERY")
    places = list(zip(paths, datasets, first.tolist(), strict=True))
    for number, kind in enumerate(bands[0], 1):
        virtual.AddBand(kind)
        band, origin = virtual.GetRasterBand(number), datasets[0].GetRasterBand(number)
        copy_band_properties(origin, band, origin.GetNoDataValue())
        _set_sources(band, str(number), places)
    if any(dataset.GetRasterBand(1).GetMaskFlags() == gdal.GMF_PER_DATASET for dataset in datasets):
        virtual.CreateMaskBand(gdal.GMF_PER_DATASET)
        _set_sources(virtual.GetRasterBand(1).GetMaskBand(), "mask,1", places)
    return virtual


def _set_sources(band: gdal.Band, source_band: str, places: Sequence[tuple[str, gdal.Dataset, list[int]]]) -> None:
    """Set the datasets at their places as the sources of a band of a VRT."""
    for number, (path, dataset, (sample, line)) in enumerate(places):
        size = f'xSize="{dataset.RasterXSize}" ySize="{dataset.RasterYSize}"'
        source = (
            f'<SimpleSource><SourceFilename relativeToVRT="0">{escape(path)}</SourceFilename>'
            f"<SourceBand>{source_band}</SourceBand>"
            f'<SrcRect xOff="0" yOff="0" {size}/><DstRect xOff="{sample}" yOff="{line}" {size}/></SimpleSource>'
        )
        band.SetMetadataItem(f"source_{number}", source, "new_vrt_sources")


def read_lineage(image: Image) -> Lineage:
    """Return an image's metadata on the refinement of its RPC, and its RPC before the refinement.

    Sensor and ground height are added if only side files state them.
    """
    path = image.path
    dataset = open_raster(path)
    items = {name: text for name, text in metadata_of(dataset).items() if name.startswith("HRSI_")}
    if image.sensor:
        items[SENSOR_ITEM] = image.sensor
    if image.stated_height_m is not None:
        items[HEIGHT_ITEM] = f"{image.stated_height_m:g}"
    original_items = metadata_of(dataset, tiff_tag.ORIGINAL_DOMAIN)
    numbers = tiff_tag.parse_original(path, original_items)
    if numbers is not None:
        return Lineage(items, rpc_from_numbers(path, numbers))
    return Lineage(items, rpc_from_entries(path, original_items) if "LINE_NUM_COEFF" in original_items else None)


def save_image(
    source: gdal.Dataset, target_path: str, rpc: RPC, form: OrthoFormat, lineage: Lineage, progress: Progress
) -> tuple[str, ...]:
    """Write a virtual image with its RPC, as a VRT or, by ``form``, with its own pixels; return notices for the log."""
    if form.name == VRT:
        save_vrt(source, target_path, rpc, lineage)
        return ()
    band = source.GetRasterBand(1)
    options = form.creation_options(band.DataType)
    if band.GetMetadataItem("NBITS", "IMAGE_STRUCTURE"):  # predictors need whole bytes
        options = [option for option in options if not option.startswith("PREDICTOR")]
    with config_option(*INTERNAL_MASK):
        return save_geotiff(
            source, target_path, rpc, driver=FORMATS[form.name][0], options=options, progress=progress, lineage=lineage
        )


def pixel_view(path: str) -> str:
    """Return a virtual image, without RPC, whose map coordinates are (sample, -line).

    It is in memory, for this process only. Raises `InputError` if the image cannot be opened.
    """
    name = f"/vsimem/hrsi/{hashlib.sha256(path.encode('utf-8')).hexdigest()}.vrt"
    status = gdal.VSIStatL(name)  # requested with every click
    if status is not None and os.path.exists(path) and status.mtime > os.path.getmtime(path):
        return name
    source = open_raster(path)
    view = None
    with gdal_messages() as messages:
        view = gdal.Translate(name, source, options=gdal.TranslateOptions(format="VRT", nogcp=True))
        if view is not None:
            view.SetProjection("")
            view.SetGeoTransform((-0.5, 1.0, 0.0, 0.5, 0.0, -1.0))
            view.SetMetadata({}, "RPC")
    if view is None:
        raise InputError(f"{path}: cannot be shown ({messages.reason}): check the file")
    del view
    return name

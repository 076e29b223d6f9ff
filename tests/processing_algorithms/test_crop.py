"""`crop`: the RPC of what is cut and resampled as GDAL, rasterio and rpcm read it, the pixels, and what is refused."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from long_tests import mark_beyond
from osgeo import gdal
from rasterio.transform import RPCTransformer
from rpc_samples import ground_grid, sample_rpc, write_image

import hrsi
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.processing_algorithms import run

CAMERA = sample_rpc(1)
SIZE = (403, 301)
EXACT_PX = 1e-6
#: Window (first sample and line, samples, lines) or None for all, and factor.
CASES = [(None, 0.37), (None, 1 / 3), (None, 0.5), (None, 2.0), (None, 1.0), ((40, 60, 200, 150), None),
         ((41, 3, 211, 149), 0.37), ((0, 0, 7, 5), 2.0), ((402, 300, 1, 1), None)]  # fmt: skip


def read_elsewhere(path: str, ground: np.ndarray) -> dict[str, np.ndarray]:
    """Return where other programs see ground points, in pixels from the corner ``(n, 2)``."""
    transformer = gdal.Transformer(gdal.Open(path), None, ["METHOD=RPC"])
    found = {"GDAL": np.array(transformer.TransformPoints(True, ground.tolist())[0])[:, :2]}
    with rasterio.open(path) as dataset, RPCTransformer(dataset.rpcs) as by_rasterio:
        lines, samples = by_rasterio.rowcol(*ground.T, op=float)
    found["rasterio"] = np.column_stack([samples, lines])
    try:
        import rpcm
    except ImportError:
        return found
    camera = rpcm.rpc_from_geotiff(path) if path.endswith(".tif") else None
    if camera is not None:
        found["rpcm"] = np.column_stack(camera.projection(*ground.T)) + 0.5
    return found


def crop(tmp_path: Path, image: Path, **options: Any) -> tuple[str, dict[str, Any]]:
    report = run("crop", images=[str(image)], output_dir=str(tmp_path / "out"), **options)
    (entry,) = report["images"].values()
    return entry["output"], report


@pytest.fixture
def image(tmp_path: Path) -> Path:
    write_image(tmp_path / "a.tif", CAMERA, size=SIZE)
    return tmp_path / "a.tif"


@pytest.mark.parametrize("format", ["gtiff", "cog", "vrt"])
@pytest.mark.parametrize(("window", "factor"), CASES)
def test_other_programs_see_the_original_camera(
    window: tuple[int, ...] | None, factor: float | None, format: str, image: Path, tmp_path: Path
) -> None:
    """A point at u of the window's width is at u of the result's, whoever reads it: no formula of ours in between."""
    text = None if window is None else ",".join(map(str, window))
    output, report = crop(tmp_path, image, window=text, factor=factor, format=format, compression="lzw")
    ground = ground_grid(CAMERA)
    made, first = gdal.Open(output), np.array((window or (0, 0))[:2])
    extent = np.array((window or (0, 0, *SIZE))[2:])
    scale = np.array([made.RasterXSize, made.RasterYSize]) / extent
    before = read_elsewhere(str(image), ground)
    for program, seen in read_elsewhere(output, ground).items():
        expected = (before[program] - first) * scale
        worst = float(np.abs(seen - expected).max())
        assert worst < EXACT_PX, program
    (entry,) = report["images"].values()
    assert (entry["samples"], entry["lines"]) == (made.RasterXSize, made.RasterYSize)
    assert entry["max_difference_px"] < EXACT_PX


def write_rich_image(path: Path) -> np.ndarray:
    """Write two 16-bit bands that say where they are, with mask, overviews, names and metadata; return the bands."""
    sample, line = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    bands = np.stack([1000 + 40 * sample, 2000 + 40 * line]).astype(np.uint16)
    memory = gdal.GetDriverByName("MEM").Create("", *SIZE, 2, gdal.GDT_UInt16)
    memory.WriteArray(bands)
    memory.SetMetadata({"TIFFTAG_DATETIME": "2020:01:02 10:30:00"})
    memory.GetRasterBand(2).SetDescription("near infrared")
    memory.GetRasterBand(2).SetScale(0.5)
    gdal.SetConfigOption("GDAL_TIFF_INTERNAL_MASK", "YES")
    made = gdal.GetDriverByName("GTiff").CreateCopy(str(path), memory, options=["COMPRESS=LZW"])
    made.CreateMaskBand(gdal.GMF_PER_DATASET)
    gdal.SetConfigOption("GDAL_TIFF_INTERNAL_MASK", None)
    mask = np.where(line < 100, 0, 255).astype(np.uint8)
    made.GetRasterBand(1).GetMaskBand().WriteArray(mask)
    made.BuildOverviews("NEAREST", [2, 4])  # which lie half a pixel off
    del made
    write_rpc_text(str(path.with_suffix(".RPB")), CAMERA, kind="rpb")
    return bands


@pytest.mark.parametrize("format", mark_beyond(2, "thorough", ["gtiff", "cog", "vrt"]))
@pytest.mark.parametrize("resampling", mark_beyond(2, "thorough", ["cubic", "bilinear", "lanczos", "cubicspline"]))
@pytest.mark.parametrize("factor", [0.37, 1 / 3, 0.5, 2.0])
def test_pixels_show_what_the_rpc_says(factor: float, resampling: str, format: str, tmp_path: Path) -> None:
    """Grey values that are positions come out where the RPC has them: no overview and no kernel moves the picture."""
    write_rich_image(tmp_path / "rich.tif")
    output, _ = crop(tmp_path, tmp_path / "rich.tif", factor=factor, resampling=resampling, format=format)
    made = gdal.Open(output)
    scale = np.array(SIZE) / [made.RasterXSize, made.RasterYSize]
    grey = made.ReadAsArray().astype(float)
    inner = np.s_[made.RasterYSize // 2 : -8, 8:-8]
    sample = (np.arange(made.RasterXSize) + 0.5) * scale[0] - 0.5
    line = (np.arange(made.RasterYSize) + 0.5) * scale[1] - 0.5
    off = np.stack([((grey[0] - 1000) / 40 - sample)[inner], ((grey[1] - 2000) / 40 - line[:, None])[inner]])
    assert np.abs(off.mean(axis=(1, 2))).max() < 0.02  # original px; whole grey values are 0.0125
    mask = made.GetRasterBand(1).GetMaskBand().ReadAsArray()
    assert abs(int(np.argmax(mask[:, 0] > 0)) - 100 / scale[1]) <= 1.0


def test_bands_masks_and_metadata_are_kept(tmp_path: Path) -> None:
    bands = write_rich_image(tmp_path / "rich.tif")
    output, _ = crop(tmp_path, tmp_path / "rich.tif", window="50,90,300,200")
    made = gdal.Open(output)
    np.testing.assert_array_equal(made.ReadAsArray(), bands[:, 90:290, 50:350])
    assert made.GetRasterBand(1).DataType == gdal.GDT_UInt16
    assert made.GetRasterBand(2).GetDescription() == "near infrared"
    assert made.GetRasterBand(2).GetScale() == 0.5
    assert made.GetMetadataItem("TIFFTAG_DATETIME") == "2020:01:02 10:30:00"
    assert made.GetMetadataItem("HRSI_CROP_WINDOW") == "50,90,300,200"
    mask = made.GetRasterBand(1).GetMaskBand().ReadAsArray()
    assert (mask[:10] == 0).all() and (mask[10:] == 255).all()
    assert read_rpc(output).rpc == CAMERA.shift(-50.0, -90.0)
    assert Path(output).parent.joinpath("report.json").exists()
    big, _ = crop(tmp_path, tmp_path / "rich.tif", factor=2.0, format="cog", overwrite=True)
    assert gdal.Open(big).GetRasterBand(1).GetOverviewCount() == 1
    assert json.loads((tmp_path / "out" / "report.json").read_text())["images"]["rich"]["samples"] == 806


@pytest.mark.parametrize("format", ["gtiff", "vrt"])
def test_a_refined_image_keeps_what_it_was(format: str, image: Path, tmp_path: Path) -> None:
    """The refinement's record stays, and the vendor's RPC comes back in the crop's pixels."""
    refined = CAMERA.shift(3.25, -1.5)
    write_rpc_text(str(tmp_path / "new_RPC.TXT"), refined)
    run("write-rpc", images=[str(image)], rpc=str(tmp_path / "new_RPC.TXT"), write="in-place")
    output, _ = crop(tmp_path, image, window="40,60,200,150", factor=0.37, format=format)
    size = np.array([gdal.Open(output).RasterXSize, gdal.Open(output).RasterYSize])
    ground = ground_grid(CAMERA)

    def expected(camera: RPC) -> np.ndarray:
        return (camera.project(ground) + 0.5 - [40, 60]) * size / [200, 150] - 0.5

    np.testing.assert_allclose(read_rpc(output).rpc.project(ground), expected(refined), atol=EXACT_PX)
    if format == "gtiff":
        run("write-rpc", images=[output], restore=True)
        np.testing.assert_allclose(read_rpc(output).rpc.project(ground), expected(CAMERA), atol=EXACT_PX)
    else:
        kept = gdal.Open(output).GetMetadata("HRSI_ORIGINAL_RPC")
        assert float(kept["SAMP_OFF"]) == pytest.approx((CAMERA.samp_off + 0.5 - 40) * size[0] / 200 - 0.5, abs=1e-9)


def test_a_sidecar_that_wins_is_the_one_that_counts(image: Path, tmp_path: Path) -> None:
    write_rpc_text(str(image.parent / "a_RPC.TXT"), CAMERA.shift(0.0, 5.0))
    output, _ = crop(tmp_path, image, window="40,60,200,150")
    assert read_rpc(output).rpc == CAMERA.shift(-40.0, -55.0)


def test_crops_of_crops_are_crops(image: Path, tmp_path: Path) -> None:
    once, _ = crop(tmp_path, image, window="47,69,100,80", factor=0.4)
    first, _ = crop(tmp_path / "1", image, window="40,60,200,150", format="vrt")
    second, _ = crop(tmp_path / "2", Path(first), window="7,9,100,80", factor=0.4)
    ground = ground_grid(CAMERA)
    seen = [read_rpc(path).rpc.project(ground) for path in (once, second)]
    np.testing.assert_allclose(*seen, atol=1e-9)
    np.testing.assert_array_equal(gdal.Open(once).ReadAsArray(), gdal.Open(second).ReadAsArray())


def test_an_extent_on_the_ground(image: Path, tmp_path: Path) -> None:
    """The window holds the box's corners at the height that is given, and hardly more."""
    lon, lat, height = CAMERA.long_off, CAMERA.lat_off, 320.0
    box = np.array([lon - 5e-4, lat - 3e-4, lon + 4e-4, lat + 2e-4])
    output, report = crop(tmp_path, image, extent=",".join(map(repr, box.tolist())), height=height)
    assert not report["warnings"]
    corners = np.array([[x, y, height] for x in box[::2] for y in box[1::2]])
    xy = read_rpc(output).rpc.project(corners)
    size = np.array([gdal.Open(output).RasterXSize, gdal.Open(output).RasterYSize])
    assert (xy > -0.5).all() and (xy < size - 0.5).all()
    assert (xy.min(axis=0) < 1.0).all() and (xy.max(axis=0) > size - 2.0).all()
    _, report = crop(tmp_path, image, extent=f"{lon - 1},{lat - 1},{lon + 1},{lat + 1}", overwrite=True)
    assert any("reaches beyond" in text for text in report["warnings"])
    assert any("give `dem` or `height`" in text for text in report["warnings"])
    utm = f"{lon - 5e-4},{lat - 3e-4},{lon + 4e-4},{lat + 2e-4} [EPSG:4326]"
    same, _ = crop(tmp_path, image, extent=utm, height=height, overwrite=True)
    assert read_rpc(same).rpc == read_rpc(output).rpc


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"window": "300,200,104,10"}, "does not lie in a"),
        ({"window": "-1,0,10,10"}, "does not lie in a"),
        ({"window": "0,0,0,10"}, "does not lie in a"),
        ({"window": "0,0,x,10"}, "four whole numbers"),
        ({"extent": "0,0,1,1", "height": 10.0}, "lies outside a"),
        ({"extent": "0,0,1"}, "west,south,east,north in degrees"),
        ({"window": "0,0,9,9", "extent": "0,0,1,1"}, "give one of them"),
        ({}, "the result is not defined"),
    ],
)
def test_what_cannot_be_cut_is_refused(options: dict[str, Any], words: str, image: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        crop(tmp_path, image, **options)
    assert not (tmp_path / "out").exists()


def test_an_rpc_file_alone(tmp_path: Path, real_data: Path) -> None:
    """The ISD XML of a WorldView-1 part has a size; a _RPC.TXT alone has none, which is said."""
    path = next((real_data / "wv1_tiles").glob("*P001.xml"))
    output, _ = crop(tmp_path, path, window="1000,2000,8000,4000", factor=0.25)
    camera = read_rpc(str(path)).rpc
    ground = camera.localize(np.array([[1001.5, 2001.5]]), camera.height_off).ground
    np.testing.assert_allclose(read_rpc(output).rpc.project(ground), [[0.0, 0.0]], atol=EXACT_PX)
    write_rpc_text(str(tmp_path / "b_RPC.TXT"), CAMERA)
    with pytest.raises(InputError, match="size of the image is not known"):
        crop(tmp_path, tmp_path / "b_RPC.TXT", factor=0.5, overwrite=True)


def test_an_image_in_memory_gives_its_rpc(tmp_path: Path) -> None:
    """Python alone knows such an image: there is no file whose pixels could be cut."""
    result = hrsi.crop(hrsi.open(np.zeros(SIZE[::-1]), rpc=CAMERA, id="m"), window="40,60,200,150", output_dir=tmp_path)
    assert read_rpc(result.report["images"]["m"]["output"]).rpc == CAMERA.shift(-40.0, -60.0)
    with pytest.raises(InputError, match="output_dir"):
        hrsi.crop(hrsi.open(np.zeros(SIZE[::-1]), rpc=CAMERA, id="m"), factor=0.5)


def test_what_only_side_files_tell_goes_along(tmp_path: Path) -> None:
    """The satellite's name decides about a priori sigmas: a crop of an image beside its ISD XML has it, too."""
    write_image(tmp_path / "wv.tif", CAMERA, size=SIZE)
    write_isd(tmp_path / "wv.XML")
    assert open_image(str(tmp_path / "wv.tif")).sensor == "WV02"
    for format in ("gtiff", "cog", "vrt"):
        output, _ = crop(tmp_path, tmp_path / "wv.tif", factor=0.5, format=format, overwrite=True)
        assert open_image(output).sensor == "WV02"


def write_isd(path: Path) -> None:
    """Write an ISD XML with a satellite's name and the size of `SIZE`."""
    from hrsi.hrsi_engine.io.rpc_files.xml_formats import isd_text

    size = f"<NUMCOLUMNS>{SIZE[0]}</NUMCOLUMNS><NUMROWS>{SIZE[1]}</NUMROWS>"
    path.write_text(isd_text(CAMERA).replace("<isd>", f"<isd><IMD><SATID>WV02</SATID>{size}</IMD>"))


def test_progress_and_cancel(image: Path, tmp_path: Path) -> None:
    """Progress only grows; a cancelled run leaves nothing, not even the folder."""
    told: list[float] = []
    run(
        "crop", images=[str(image)], factor=0.5, output_dir=str(tmp_path / "out"),
        progress=lambda fraction, _message="": told.append(fraction) or True,
    )  # fmt: skip
    assert told[-1] == 1.0 and all(first <= second for first, second in pairwise(told))
    with pytest.raises(Cancelled):
        run(
            "crop", images=[str(image)], factor=2.0, output_dir=str(tmp_path / "other"),
            progress=lambda fraction, _message="": False,
        )  # fmt: skip
    assert not (tmp_path / "other").exists()


def test_the_input_is_never_replaced(image: Path, tmp_path: Path) -> None:
    before = image.read_bytes()
    report = run("crop", images=[str(image)], factor=0.5, output_dir=str(tmp_path))
    run("crop", images=[report["images"]["a"]["output"]], factor=2.0, output_dir=str(tmp_path), overwrite=True)
    assert image.read_bytes() == before
    (tmp_path / "a_crop.tif").rename(tmp_path / "b_crop.tif")
    (tmp_path / "b_crop.tif").rename(tmp_path / "b.tif")
    (tmp_path / "b_crop.tif").symlink_to(tmp_path / "b.tif")
    with pytest.raises(InputError, match="is an input"):
        run("crop", images=[str(tmp_path / "b.tif")], factor=0.5, output_dir=str(tmp_path), overwrite=True)

"""`orthorectify`: pixels against gdalwarp's, formats, datums, what is kept and what is told."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from long_tests import mark_beyond
from osgeo import gdal

from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.ground.geoids import geoid_heights
from hrsi.hrsi_engine.io.rasters.ortho_warp import RESAMPLING
from hrsi.hrsi_engine.io.rasters.orthoimages import COMPRESSION, FORMATS
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.declarations import orthoimages as declared
from hrsi.processing_algorithms.declarations.orthoimages import OrthorectifyOptions
from hrsi.processing_algorithms.files.orthoimage_plan import open_ortho_terrain
from hrsi.processing_algorithms.interface.declare import fill_options
from hrsi.processing_algorithms.interface.option_groups import COMPRESSION_NAMES
from hrsi.tests.ortho.scenes import camera, rpc_image, write_dem
from hrsi.tests.simulated_blocks import LAT, LON


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two oblique images and a DEM below them."""
    folder = tmp_path_factory.mktemp("scene")
    rpc_image(folder / "a.tif", camera(0.35))
    rpc_image(folder / "b.tif", camera(-0.2))
    write_dem(folder / "dem.tif")
    return folder


def ortho(scene: Path, out: Path, images: str = "a", **options: Any) -> dict[str, Any]:
    given = {"dem": str(scene / "dem.tif"), "height_datum": "ellipsoidal", "report": False, "threads": 2, **options}
    return run("orthorectify", images=[str(scene / f"{name}.tif") for name in images], output_dir=str(out), **given)


def pixels(path: Path) -> np.ndarray:
    return np.asarray(gdal.Open(str(path)).ReadAsArray())


def warped(scene: Path, like: Path, source: str = "a.tif", **options: Any) -> np.ndarray:
    """Return what gdalwarp -rpc -et 0 makes on the pixels of an orthoimage."""
    dataset = gdal.Open(str(like))
    west, step, _, north, _, _ = dataset.GetGeoTransform()
    bounds = west, north - step * dataset.RasterYSize, west + step * dataset.RasterXSize, north
    result = gdal.Warp(
        "", str(scene / source), format="MEM", rpc=True, errorThreshold=0.0, dstSRS=dataset.GetProjection(),
        outputBounds=bounds, xRes=step, yRes=step, transformerOptions=[f"RPC_DEM={scene / 'dem.tif'}"],
        warpOptions=["XSCALE=1", "YSCALE=1"], **options,
    )  # fmt: skip
    return np.asarray(result.ReadAsArray())


@pytest.mark.parametrize("resampling", mark_beyond(2, "thorough", ["cubic", "near", "bilinear", "lanczos"]))
def test_pixels_are_gdalwarps(scene: Path, tmp_path: Path, resampling: str) -> None:
    """Exact positions give gdalwarp's grey values, but for its rounding of positions near the border."""
    ortho(scene, tmp_path, resampling=resampling, error_px=0.0, resolution=1.0)
    ours = pixels(tmp_path / "a_ortho.tif").astype(float)
    theirs = warped(scene, tmp_path / "a_ortho.tif", resampleAlg=resampling).astype(float)
    both = (ours > 0) & (theirs > 0)
    assert both.mean() > 0.5
    assert np.mean((ours > 0) != (theirs > 0)) < 1e-3
    assert np.mean(np.abs(ours - theirs)[both] > 1.0) < 1e-4


def test_an_allowed_error_changes_grey_values_little(scene: Path, tmp_path: Path) -> None:
    """0.05 px on a texture of 2000 grey values that changes by some 60 a pixel."""
    report = ortho(scene, tmp_path, resolution=1.0)
    ours = pixels(tmp_path / "a_ortho.tif").astype(float)
    theirs = warped(scene, tmp_path / "a_ortho.tif", resampleAlg="cubic").astype(float)
    both = (ours > 0) & (theirs > 0)
    assert np.percentile(np.abs(ours - theirs)[both], 99.0) < 5.0
    entry = report["images"]["a"]
    assert entry["checked"] > 500 and 0.0 < entry["position_error_max_px"] <= 0.05
    assert entry["shown_pixels"] == pytest.approx(np.count_nonzero(ours))


def test_a_dem_inside_the_image_gives_the_ground_that_it_covers(scene: Path, tmp_path: Path) -> None:
    """No pixel at the edge of the orthoimage has a height; those inside are the ones of a larger DEM."""
    dem = gdal.Open(str(scene / "dem.tif"))
    size = dem.RasterXSize
    part = [size // 2 - 15, size // 2 - 15, 30, 30]
    gdal.Translate(str(tmp_path / "part.tif"), dem, srcWin=part)
    whole = ortho(scene, tmp_path / "whole", resolution=1.0)
    inside = ortho(scene, tmp_path / "inside", resolution=1.0, dem=str(tmp_path / "part.tif"))
    ours = gdal.Open(inside["images"]["a"]["output"])
    west, step, _, north, _, _ = ours.GetGeoTransform()
    box = west, north, west + step * ours.RasterXSize, north - step * ours.RasterYSize
    theirs = gdal.Translate("", whole["images"]["a"]["output"], format="MEM", projWin=box).ReadAsArray()
    shown = ours.ReadAsArray() > 0
    assert shown.sum() > 20_000 and not shown[[0, -1]].any() and not shown[:, [0, -1]].any()
    # The border cells of the smaller DEM continue by half a cell, where the larger one has other heights
    assert np.mean((ours.ReadAsArray() != theirs)[shown]) < 0.1


def test_orthoimages_share_one_lattice(scene: Path, tmp_path: Path) -> None:
    report = ortho(scene, tmp_path, images="ab")
    assert report["grid"]["resolution"] == 1.0 and report["grid"]["crs"] == "EPSG:32755"
    origins = []
    for name in "ab":
        west, step, _, north, _, down = gdal.Open(str(tmp_path / f"{name}_ortho.tif")).GetGeoTransform()
        assert (step, down) == (1.0, -1.0)
        origins.append((west, north))
    assert all(value == round(value) for pair in origins for value in pair)
    assert origins[0] != origins[1]


@pytest.mark.parametrize("extent", ["union", "overlap"])
def test_one_extent_for_all(scene: Path, tmp_path: Path, extent: str) -> None:
    report = ortho(scene, tmp_path, images="ab", extent=extent, format="gtiff")
    assert report["images"]["a"]["bounds"] == report["images"]["b"]["bounds"]
    values = [pixels(tmp_path / f"{name}_ortho.tif") for name in "ab"]
    assert values[0].shape == values[1].shape
    shown = np.mean((values[0] > 0) & (values[1] > 0))
    assert shown > 0.6 if extent == "overlap" else shown < 0.6


def test_terrain_points_of_a_block_layer_lie_where_they_were_adjusted(tmp_path: Path) -> None:
    """The layer has fields of surveyed positions, too: empty for tie points, other heights for GCPs."""
    rows = [(f"T{k}", LON + 0.01 * (k % 2), LAT + 0.01 * (k // 2)) for k in range(4)]
    lines = ["id,role,lon,lat,height,survey_lon,survey_lat,survey_height"]
    lines += [f"{name},tie,{x},{y},50,,," for name, x, y in rows[:3]]
    lines += [f"{name},gcp,{x},{y},50,{x},{y},80" for name, x, y in rows[3:]]
    (tmp_path / "points.csv").write_text("\n".join(lines), encoding="utf-8")
    options = {"terrain_points": str(tmp_path / "points.csv"), "dem": None, "height": None, "ground_crs": None}
    terrain = open_ortho_terrain(
        fill_options(OrthorectifyOptions, options | {"height_datum": "ellipsoidal", "images": (), "output_dir": "out"})
    )
    assert surface_heights(terrain.surface, np.array([[LON + 0.005, LAT + 0.005]])) == pytest.approx(50.0)


def test_terrain_points_count_by_the_sigmas_of_their_adjusted_heights(tmp_path: Path) -> None:
    """Every third point lies 3 m too high and says so; ``sigma_h`` is how well it was surveyed, which is empty."""
    rows = [
        f"T{k},tie,{LON + 1e-4 * (k % 20)},{LAT + 1e-4 * (k // 20)},{53 if k % 3 == 0 else 50},"
        f"{5 if k % 3 == 0 else 0.2},"
        for k in range(400)
    ]
    head = "id,role,lon,lat,height,sigma_height_m,sigma_h"
    (tmp_path / "points.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    options = {"terrain_points": str(tmp_path / "points.csv"), "dem": None, "height": None, "ground_crs": None}
    terrain = open_ortho_terrain(
        fill_options(OrthorectifyOptions, options | {"height_datum": "ellipsoidal", "images": (), "output_dir": "out"})
    )
    places = np.random.default_rng(1).uniform([LON + 2e-4, LAT + 2e-4], [LON + 1.7e-3, LAT + 1.7e-3], (200, 2))
    assert np.abs(surface_heights(terrain.surface, places) - 50.0).max() < 0.2


def test_cloud_optimised_with_overviews(scene: Path, tmp_path: Path) -> None:
    ortho(scene, tmp_path)
    dataset = gdal.Open(str(tmp_path / "a_ortho.tif"))
    assert dataset.GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE") == "COG"
    assert dataset.GetRasterBand(1).GetBlockSize() == [512, 512] and dataset.GetRasterBand(1).GetNoDataValue() == 0.0


@pytest.mark.parametrize(("resampling", "mixed"), [("near", False), ("cubic", True)])
def test_overviews_mix_values_only_where_resampling_does(
    scene: Path, tmp_path: Path, resampling: str, mixed: bool
) -> None:
    ortho(scene, tmp_path, resampling=resampling, resolution=0.3)
    dataset = gdal.Open(str(tmp_path / "a_ortho.tif"))
    band = dataset.GetRasterBand(1)
    assert band.GetOverviewCount() >= 1
    full, half = band.ReadAsArray(), band.GetOverview(0).ReadAsArray()
    assert half.shape == tuple(-(-side // 2) for side in full.shape)
    rows, columns = (side // 2 for side in full.shape)
    one_of_four = (
        full[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2) == half[:rows, None, :columns, None]
    ).any(axis=(1, 3))
    assert (one_of_four.mean() > 0.7) != mixed  # of odd sides, the nearest one may lie just outside the four


@pytest.mark.parametrize(
    "gdal_type", mark_beyond(2, "thorough", [gdal.GDT_UInt16, gdal.GDT_Float32, gdal.GDT_Byte, gdal.GDT_Int16])
)
def test_bands_and_data_type_are_kept(scene: Path, tmp_path: Path, gdal_type: int) -> None:
    rpc_image(tmp_path / "m.tif", bands=3, gdal_type=gdal_type)
    ortho(tmp_path, tmp_path / "out", images="m", dem=str(scene / "dem.tif"))
    dataset = gdal.Open(str(tmp_path / "out" / "m_ortho.tif"))
    bands = [dataset.GetRasterBand(number) for number in (1, 2, 3)]
    assert {band.DataType for band in bands} == {gdal_type}
    assert [band.GetDescription() for band in bands] == ["band 1", "band 2", "band 3"]
    values = dataset.ReadAsArray().astype(float)
    nodata = bands[0].GetNoDataValue()
    shown = ~np.isnan(values[0]) if gdal_type == gdal.GDT_Float32 else values[0] != nodata
    assert 0.4 < shown.mean() < 1.0
    assert np.corrcoef(values[0][shown], values[1][shown])[0, 1] < 0.5  # other bands, not the first one thrice


def test_nodata_of_the_image_stays_nodata(scene: Path, tmp_path: Path) -> None:
    image = rpc_image(tmp_path / "n.tif")
    dataset = gdal.Open(image.path, gdal.GA_Update)
    dataset.GetRasterBand(1).SetNoDataValue(7)
    dataset.GetRasterBand(1).WriteArray(np.full((100, 100), 7), 200, 200)
    del dataset
    ortho(tmp_path, tmp_path / "out", images="n", dem=str(scene / "dem.tif"), resampling="cubic")
    made = gdal.Open(str(tmp_path / "out" / "n_ortho.tif"))
    values = made.ReadAsArray()
    assert made.GetRasterBand(1).GetNoDataValue() == 7
    assert values[values != 7].min() > 300  # nothing was mixed with 7
    middle = np.array(values.shape) // 2
    assert (values[middle[0] - 60 : middle[0] + 60, middle[1] - 60 : middle[1] + 60] == 7).mean() > 0.3


def test_dark_pixels_do_not_become_nodata(scene: Path, tmp_path: Path) -> None:
    image = rpc_image(tmp_path / "d.tif", gdal_type=gdal.GDT_Byte)
    dataset = gdal.Open(image.path, gdal.GA_Update)
    dataset.GetRasterBand(1).Fill(0)
    del dataset
    report = ortho(tmp_path, tmp_path / "out", images="d", dem=str(scene / "dem.tif"))
    values = pixels(tmp_path / "out" / "d_ortho.tif")
    assert set(np.unique(values)) == {0, 1}
    assert report["images"]["d"]["shown_pixels"] == np.count_nonzero(values) > 100_000


@pytest.mark.parametrize("form", ["cog", "gtiff"])
def test_a_mask_instead_of_nodata_is_in_the_same_file(scene: Path, tmp_path: Path, form: str) -> None:
    ortho(scene, tmp_path / "mask", nodata="mask", format=form, resolution=0.5)
    ortho(scene, tmp_path / "value", format=form, resolution=0.5)
    assert sorted(os.listdir(tmp_path / "mask")) == ["a_ortho.tif", "report.json"]
    dataset = gdal.Open(str(tmp_path / "mask" / "a_ortho.tif"))
    band = dataset.GetRasterBand(1)
    assert band.GetMaskFlags() == gdal.GMF_PER_DATASET
    mask = band.GetMaskBand().ReadAsArray()
    assert set(np.unique(mask)) == {0, 255}
    assert ((mask > 0) == (pixels(tmp_path / "value" / "a_ortho.tif") > 0)).mean() > 0.999


def test_nodata_within_the_range_of_grey_values(scene: Path, tmp_path: Path) -> None:
    """Where the image shows something, grey values that equal nodata move by one step, and nothing else changes."""
    ortho(scene, tmp_path / "mask", nodata="mask", resolution=0.5)
    ortho(scene, tmp_path / "value", nodata="1500", resolution=0.5)
    dataset = gdal.Open(str(tmp_path / "mask" / "a_ortho.tif"))
    shown, expected = dataset.GetRasterBand(1).GetMaskBand().ReadAsArray() > 0, dataset.ReadAsArray()
    values = pixels(tmp_path / "value" / "a_ortho.tif")
    assert ((values != 1500) == shown).all()
    same = expected[shown] == 1500
    assert same.sum() > 0 and (values[shown][same] == 1501).all()
    assert (values[shown][~same] == expected[shown][~same]).all()


def test_nothing_is_written_elsewhere(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither into the current directory, which may be a program's, nor into the images' folder."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    before = [os.stat(folder).st_mtime_ns for folder in (tmp_path / "here", scene)]
    ortho(scene, tmp_path / "out")
    assert [os.stat(folder).st_mtime_ns for folder in (tmp_path / "here", scene)] == before


def test_heights_above_the_geoid_are_converted(scene: Path, tmp_path: Path) -> None:
    """The same terrain, as ellipsoidal heights and above EGM96, gives the same orthoimage; taken wrongly, another."""
    try:
        undulation = float(geoid_heights(np.array([[LON, LAT, 0.0]]), "egm96")[0])
    except InputError:
        pytest.skip("the EGM96 grid is not installed")
    write_dem(tmp_path / "geoid.tif", lower=undulation)
    values = {}
    for name, dem, datum in (
        ("right", scene / "dem.tif", "ellipsoidal"), ("converted", tmp_path / "geoid.tif", "egm96"),
        ("wrong", tmp_path / "geoid.tif", "ellipsoidal"),
    ):  # fmt: skip
        ortho(scene, tmp_path / name, dem=str(dem), height_datum=datum, extent=BOX, resolution=1.0)
        values[name] = pixels(tmp_path / name / "a_ortho.tif").astype(float)
    shown = np.logical_and.reduce([v > 0 for v in values.values()])
    assert abs(undulation) > 2.0  # 0.7 px in this view
    assert np.abs(values["right"] - values["converted"])[shown].mean() < 5.0  # the geoid slopes by some cm
    assert np.abs(values["right"] - values["wrong"])[shown].mean() > 40.0


BOX = "524380,5255600,524600,5255800"


def test_extent_as_a_box(scene: Path, tmp_path: Path) -> None:
    report = ortho(scene, tmp_path, extent=BOX, resolution=0.5, format="gtiff", compression="none")
    assert report["images"]["a"]["bounds"] == [524380.0, 5255600.0, 524600.0, 5255800.0]
    assert pixels(tmp_path / "a_ortho.tif").shape == (400, 440)


def test_extent_in_another_crs(scene: Path, tmp_path: Path) -> None:
    """A box in degrees holds its corners on the map, and not a pixel more than its curved sides need."""
    west, south, east, north = map(float, BOX.split(","))
    to_degrees = pyproj.Transformer.from_crs(32755, 4326, always_xy=True)
    degrees = to_degrees.transform_bounds(west, south, east, north)
    extent = ",".join(map(repr, degrees)) + " [EPSG:4326]"
    bounds = ortho(scene, tmp_path, extent=extent, resolution=0.5, format="gtiff")["images"]["a"]["bounds"]
    x, y = pyproj.Transformer.from_crs(4326, 32755, always_xy=True).transform(
        [degrees[k] for k in (0, 0, 2, 2)], [degrees[k] for k in (1, 3, 1, 3)]
    )
    wanted = np.array([min(x), min(y), max(x), max(y)])
    assert np.abs(np.array(bounds) - wanted).max() < 0.51
    assert bounds[0] <= west and bounds[1] <= south and bounds[2] >= east and bounds[3] >= north


def test_terrain_from_points(scene: Path, tmp_path: Path) -> None:
    from hrsi.tests.ortho.test_point_surface import points

    rows = [f"{k},{lon},{lat},{height}" for k, (lon, lat, height) in enumerate(points(3000).tolist())]
    (tmp_path / "points.csv").write_text("\n".join(["id,lon,lat,height", *rows]))
    report = ortho(scene, tmp_path / "out", dem=None, terrain_points=str(tmp_path / "points.csv"), extent=BOX)
    ortho(scene, tmp_path / "dem", extent=BOX)
    a, b = (pixels(tmp_path / name / "a_ortho.tif").astype(float) for name in ("out", "dem"))
    assert np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.98
    assert any("interpolated between points" in text for text in report["warnings"])


def test_flat_ground_is_warned_about(scene: Path, tmp_path: Path) -> None:
    report = ortho(scene, tmp_path, dem=None, height=230.0, height_datum="layer")
    assert any("assumed to be flat" in text and "3.6 m" in text for text in report["warnings"])  # 10 m times the tilt


def test_gaps_of_the_dem_are_told_and_filled(scene: Path, tmp_path: Path) -> None:
    path = write_dem(tmp_path / "gaps.tif")
    dataset = gdal.Open(path, gdal.GA_Update)
    heights = dataset.ReadAsArray()
    middle = len(heights) // 2
    heights[middle : middle + 4, middle : middle + 4] = np.nan
    dataset.GetRasterBand(1).WriteArray(heights)
    del dataset
    told = ortho(scene, tmp_path / "gaps", dem=path)["images"]["a"]["unknown_pixels"]
    assert told == pytest.approx(5 * 8.2 * 5 * 11.1, rel=0.3)  # cells around a gap have no bilinear height
    assert ortho(scene, tmp_path / "filled", dem=path, fill_gaps=6)["images"]["a"]["unknown_pixels"] == 0


# ---- again -----------------------------------------------------------------------------------------------------------


def test_finished_orthoimages_are_kept(scene: Path, tmp_path: Path) -> None:
    first = ortho(scene, tmp_path, images="ab")
    stamps = [os.stat(tmp_path / f"{name}_ortho.tif").st_mtime_ns for name in "ab"]
    os.remove(tmp_path / "b_ortho.tif")
    again = ortho(scene, tmp_path, images="ab")
    assert [again["images"][name]["status"] for name in "ab"] == ["kept", "made"]
    assert os.stat(tmp_path / "a_ortho.tif").st_mtime_ns == stamps[0]
    assert again["images"]["a"]["position_error_max_px"] == first["images"]["a"]["position_error_max_px"]


def test_other_options_need_overwrite(scene: Path, tmp_path: Path) -> None:
    ortho(scene, tmp_path)
    with pytest.raises(InputError, match="`overwrite`"):
        ortho(scene, tmp_path, resampling="bilinear")
    assert ortho(scene, tmp_path, resampling="bilinear", overwrite=True)["images"]["a"]["status"] == "made"


def test_a_changed_rpc_is_noticed(scene: Path, tmp_path: Path) -> None:
    image = rpc_image(tmp_path / "c.tif")
    dem = str(scene / "dem.tif")
    ortho(tmp_path, tmp_path / "out", images="c", dem=dem)
    write_rpc_text(str(tmp_path / "c_RPC.TXT"), image.rpc.shift(3.0, 0.0))  # a sidecar wins over the tag
    report = ortho(tmp_path, tmp_path / "out", images="c", dem=dem, overwrite=True)
    assert report["images"]["c"]["status"] == "made"


def test_cancelling_leaves_finished_images_only(scene: Path, tmp_path: Path) -> None:
    def until_half(fraction: float, message: str = "") -> bool:
        return fraction < 0.7

    with pytest.raises(Cancelled, match="1 of 2"):
        run(
            "orthorectify", images=[str(scene / "a.tif"), str(scene / "b.tif")], dem=str(scene / "dem.tif"),
            height_datum="ellipsoidal", output_dir=str(tmp_path), progress=until_half,
        )  # fmt: skip
    assert sorted(os.listdir(tmp_path)) == ["a_ortho.tif"]
    report = ortho(scene, tmp_path, images="ab")
    assert [report["images"][name]["status"] for name in "ab"] == ["kept", "made"]


@pytest.mark.parametrize("compression", sorted(COMPRESSION))
def test_formats_hold_the_same_pixels(scene: Path, tmp_path: Path, compression: str) -> None:
    """Chunks smaller than a tile, too: here two image pixels and more lie in one of the map."""
    for form in FORMATS:
        ortho(scene, tmp_path / form, resolution=2.5, format=form, compression=compression)
    cog, gtiff = (gdal.Open(str(tmp_path / form / "a_ortho.tif")) for form in ("cog", "gtiff"))
    for dataset in (cog, gtiff):
        found = dataset.GetMetadataItem("COMPRESSION", "IMAGE_STRUCTURE")
        assert (found or "none").lower() == compression
    assert (cog.ReadAsArray() == gtiff.ReadAsArray()).all() and cog.ReadAsArray().max() > 0


def test_coarse_orthoimages_are_means(scene: Path, tmp_path: Path) -> None:
    """At eight times the pixel size noise of single pixels averages out; its kernel covers the whole pixel."""
    image = rpc_image(tmp_path / "w.tif")
    dataset = gdal.Open(image.path, gdal.GA_Update)
    noise = np.random.default_rng(1).normal(1000.0, 200.0, (500, 520))
    dataset.GetRasterBand(1).WriteArray(noise)
    del dataset
    ortho(tmp_path, tmp_path / "out", images="w", dem=str(scene / "dem.tif"), resolution=8.0, resampling="bilinear")
    values = pixels(tmp_path / "out" / "w_ortho.tif").astype(float)
    assert values[values > 0].std() < 40.0


# ---- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dem": None}, "height of the ground: give `dem`"),
        ({"height": 3.0}, "`height` and `dem` both define"),
        ({"crs": "EPSG:0"}, "`crs`"),
        ({"extent": "1,2,3"}, "`extent`"),
        ({"extent": f"{BOX} [EPSG:0]"}, "`extent`: unknown .* 'EPSG:0'"),
        ({"extent": f"{BOX} [EPSG:4326]"}, "no box in the orthoimages' CRS"),
        ({"extent": "0,0,10,10"}, "does not overlap a"),
        ({"nodata": "300000"}, "UInt16 pixels, which cannot represent it"),
        ({"nodata": "none"}, "neither a number nor mask"),
    ],
)
def test_faults_are_told(scene: Path, tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ortho(scene, tmp_path, **options)
    assert not os.listdir(tmp_path)


def test_an_rpc_file_alone_has_no_pixels(scene: Path, tmp_path: Path) -> None:
    write_rpc_text(str(tmp_path / "x_RPC.TXT"), camera())
    with pytest.raises(InputError, match="without pixels"):
        run("orthorectify", images=[str(tmp_path / "x_RPC.TXT")], height=200.0, output_dir=str(tmp_path / "out"))


def test_choices_are_the_engines() -> None:
    assert set(declared.RESAMPLING_NAMES) == set(RESAMPLING)
    assert set(declared.FORMAT_NAMES) == set(FORMATS)
    assert set(COMPRESSION_NAMES) == set(COMPRESSION)


@pytest.mark.parametrize("resampling", sorted(RESAMPLING))
def test_every_kernel_shows_the_image(scene: Path, tmp_path: Path, resampling: str) -> None:
    ortho(scene, tmp_path, extent=BOX, resolution=2.0, resampling=resampling, format="gtiff", compression="none")
    values = pixels(tmp_path / "a_ortho.tif")
    assert (values > 0).all() and 1000 < values.mean() < 2500


def test_changed_pixels_are_noticed_though_size_and_time_are_the_same(scene: Path, tmp_path: Path) -> None:
    """Of the image and of the DEM: nothing made from others is kept."""
    for name in ("a.tif", "dem.tif"):
        (tmp_path / name).write_bytes((scene / name).read_bytes())
    dem = str(tmp_path / "dem.tif")
    ortho(tmp_path, tmp_path / "out", dem=dem)
    for name in ("a.tif", "dem.tif"):
        status = os.stat(tmp_path / name)
        dataset = gdal.Open(str(tmp_path / name), gdal.GA_Update)
        pixels = dataset.GetRasterBand(1).ReadAsArray()
        pixels[7, 7] += 1
        dataset.GetRasterBand(1).WriteArray(pixels)
        del dataset
        os.utime(tmp_path / name, ns=(status.st_atime_ns, status.st_mtime_ns))
        with pytest.raises(InputError, match="made from other files"):
            ortho(tmp_path, tmp_path / "out", dem=dem)
        assert ortho(tmp_path, tmp_path / "out", dem=dem, overwrite=True)["images"]["a"]["status"] == "made"

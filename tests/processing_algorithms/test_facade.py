"""What `import hrsi` offers: functions made from the declarations; whatever holds points or images in, tables out."""

import csv
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numpy as np
import pyproj
import pytest
import rasterio
from make_stubs import stubs
from rpc_samples import sample_rpc, write_image
from shapely.geometry import Point

import hrsi
from hrsi import hrsi_engine
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.facade.calls import function_name

HOBART = Path(__file__).resolve().parents[2] / "examples" / "hobart"
IMAGES = [str(HOBART / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)]
GCPS, MEASURED = HOBART / "hobart_ground_points.csv", HOBART / "hobart_image_points.csv"
CONTROL = ["H003", "H022", "H024", "H035", "H048", "H058", "H077", "H098", "H103", "H105"]
BLOCK = {"height_datum": "ellipsoidal", "gcp_ids": CONTROL, "model": "shift"}


def columns(path: Path) -> dict[str, list[str]]:
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


class Table:
    """A table with columns by name and, as of GeoPandas, points with a CRS."""

    def __init__(self, values: dict, places: list | None = None, crs: str = ""):
        self.columns = [*values, *(["geometry"] if places else [])]
        self._values = values
        self.index = range(len(next(iter(values.values()))))
        if places:
            self.geometry, self.crs = places, pyproj.CRS(crs)

    def __getitem__(self, name: str):
        if name == "geometry":
            return self.geometry
        return np.array(self._values[name], dtype=object)

    def __len__(self) -> int:
        return len(self.index)


@pytest.fixture(scope="module")
def adjusted() -> hrsi.Result:
    return hrsi.adjust(IMAGES, gcps=GCPS, image_points=MEASURED, **BLOCK)


# ---- the face itself -------------------------------------------------------------------------------------------------


def test_import_loads_no_package():
    """The folder is QGIS's plugin too: looking at it must be quick and need nothing."""
    heavy = "{'numpy', 'osgeo', 'qgis', 'pandas'}"
    code = f"import sys, hrsi; dir(hrsi); hrsi.classFactory; assert not {heavy} & {{*sys.modules}}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_every_algorithm_is_a_function():
    for name, algorithm in REGISTRY.items():
        function = getattr(hrsi, function_name(name))
        assert function_name(name) in dir(hrsi)
        assert function.__doc__.partition("\n")[0]
        if name not in ("project", "localize"):
            parameters = inspect.signature(function).parameters
            assert set(parameters) == {param.key for param in algorithm.params} | {"progress"}
            assert all(
                parameters[param.key].default == param.default for param in algorithm.params if not param.required
            )


def test_public_names_are_no_modules():
    """A name of a face is what it says, whatever has been imported before: `residuals` is a function."""
    found = list(walk_packages(hrsi_engine.__path__, "hrsi.hrsi_engine."))
    faces = [hrsi, hrsi_engine, *(import_module(module.name) for module in found if module.ispkg)]
    for module in found:
        import_module(module.name)
    for face in faces:
        modules = [name for name in getattr(face, "__all__", ()) if inspect.ismodule(getattr(face, name))]
        assert modules == [], face.__name__


def test_stubs_are_of_now():
    """`python scripts/make_stubs.py` writes them."""
    stale = [path for path, text in stubs().items() if path.read_text(encoding="utf-8") != text]
    assert stale == []


@pytest.mark.programs
def test_types_are_seen(tmp_path: Path):
    pytest.importorskip("mypy")
    (tmp_path / "user.py").write_text(
        "import hrsi\n"
        "result = hrsi.triangulate(['a.tif'], gcps='gcps.gpkg', model='affine')\n"
        "reveal_type(result)\n"
        "reveal_type(hrsi.open('a.tif'))\n"
        "hrsi.triangulate(['a.tif'], modle='affine')\n"
        "hrsi.adjust(['a.tif'], model='afine')\n",
        encoding="utf-8",
    )
    (tmp_path / "hrsi").symlink_to(Path(__file__).resolve().parents[2])
    words = [sys.executable, "-m", "mypy", "--follow-imports=silent", "--ignore-missing-imports", "--no-incremental"]
    words += ["--no-site-packages", "user.py"]
    told = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False).stdout
    shown = re.findall(r'Revealed type is "([^"]+)"', told)
    assert [name.replace("builtins.", "").rpartition(".")[2] for name in shown] == ["Result", "Image"], told
    assert 'Unexpected keyword argument "modle"' in told
    assert 'Argument "model" to "adjust" has incompatible type' in told


# ---- what goes in ----------------------------------------------------------------------------------------------------


def test_what_holds_the_points_does_not_matter(adjusted: hrsi.Result):
    """A file, columns, a table with UTM positions, opened images and columns of the engine give the same block."""
    ground, image = columns(GCPS), columns(MEASURED)
    lonlat = zip(*(map(float, ground[name]) for name in ("lon", "lat")), strict=True)
    to_utm = pyproj.Transformer.from_crs(4326, 32755, always_xy=True)
    places = [Point(*to_utm.transform(*place)) for place in lonlat]
    utm = Table({"id": ground["id"], "height": ground["height"]}, places, "EPSG:32755")
    engine = hrsi.GroundPoints(
        ground["id"], np.column_stack([np.array(ground[name], dtype=float) for name in ("lon", "lat", "height")])
    )
    xy = np.column_stack([np.array(image[name], dtype=float) for name in ("sample", "line")])
    for gcps, measured in (
        (ground, image),
        (utm, Table({name: image[name] for name in ("id", "image", "sample", "line")})),
        (engine, hrsi.ImagePoints(image["id"], image["image"], xy)),
    ):
        again = hrsi.adjust(hrsi.open(IMAGES), gcps=gcps, image_points=measured, **BLOCK)
        for axis in ("east", "north", "height"):  # the UTM round trip and the layers' kinds of points move it by less
            key = f"rmse_{axis}_m"
            assert again.report["check"][key] == pytest.approx(adjusted.report["check"][key], abs=1e-4)


def test_refine_from_arrays_is_the_engine():
    ground, image = columns(GCPS), columns(MEASURED)
    place = {name: row for row, name in enumerate(ground["id"])}
    rows = [row for row, name in enumerate(image["image"]) if name == "hobart_ikonos_1" and image["id"][row] in CONTROL]
    known = np.array([[float(ground[n][place[image["id"][row]]]) for n in ("lon", "lat", "height")] for row in rows])
    xy = np.array([[float(image[name][row]) for name in ("sample", "line")] for row in rows])
    result = hrsi.refine(IMAGES[0], gcps=known, image_points=xy, model="affine", height_datum="ellipsoidal")
    expected = hrsi.refine_rpc(hrsi.read_rpc(IMAGES[0]), known, xy, model="affine")
    assert result.rpcs["hobart_ikonos_1"].project(known) == pytest.approx(expected.rpc.project(known), abs=1e-6)
    assert len(repr(expected)) < 200


def test_images_in_memory(tmp_path: Path):
    """Pixels in arrays with an RPC do as their file does; a dataset of rasterio stands for its file."""
    write_image(tmp_path / "a.tif", sample_rpc(), size=(64, 48))
    with rasterio.open(tmp_path / "a.tif") as dataset:
        held = hrsi.open(dataset.read(1), rpc=tmp_path / "a.tif", id="a")
        results = [hrsi.rpc_info(source) for source in (tmp_path / "a.tif", dataset, held)]
    first, *others = (result.report["images"] for result in results)
    for other in others:
        assert other["a"]["gsd_sample_m"] == pytest.approx(first["a"]["gsd_sample_m"])
    assert held.pixels.read(3, 2, 5, 4)[0].shape == (4, 5)


def test_project_and_localize_arrays():
    image = hrsi.open(IMAGES[0])
    ground = np.array([[147.3, -42.88, 50.0], [147.31, -42.87, 80.0]])
    xy = hrsi.project(image, ground)
    assert xy == pytest.approx(image.rpc.project(ground))
    assert hrsi.project(IMAGES[0], ground[:, :2], height=50.0)[0] == pytest.approx(xy[0])
    assert hrsi.project(image, ground[0]).shape == (2,)
    assert hrsi.localize(image, np.column_stack([xy, ground[:, 2]])) == pytest.approx(ground, abs=1e-8)
    assert hrsi.localize(image, xy[:1], height=50.0)[0] == pytest.approx(ground[0], abs=1e-8)
    table = hrsi.localize(image, {"sample": xy[:, 0], "line": xy[:, 1], "height": ground[:, 2]}).points
    assert np.asarray(table["lon"]) == pytest.approx(ground[:, 0], abs=1e-8)


def test_tables_of_pandas(adjusted: hrsi.Result):
    pandas = pytest.importorskip("pandas")
    ground, image = (pandas.read_csv(path) for path in (GCPS, MEASURED))
    again = hrsi.adjust(IMAGES, gcps=ground.set_index("id"), image_points=image, **BLOCK)
    assert again.report["check"] == adjusted.report["check"]
    assert isinstance(again.residuals, pandas.DataFrame) and len(again.points) == 71


def test_tables_of_geopandas_come_back_so(adjusted: hrsi.Result):
    geopandas = pytest.importorskip("geopandas")
    pandas = pytest.importorskip("pandas")
    rows = pandas.read_csv(GCPS)
    places = geopandas.points_from_xy(rows["lon"], rows["lat"], rows["height"])
    ground = geopandas.GeoDataFrame(rows.drop(columns=["lon", "lat", "height"]), geometry=places, crs="EPSG:4326")
    again = hrsi.adjust(IMAGES, gcps=ground, image_points=MEASURED, **BLOCK)
    assert isinstance(again.points, geopandas.GeoDataFrame)
    assert again.points.crs is not None and len(again.points) == len(adjusted.points)
    assert again.table("residuals_utm").crs.is_projected
    seen = hrsi.project(IMAGES[0], ground, height_datum="ellipsoidal")
    assert repr(seen).startswith(f"<project: {len(ground)} points with id")
    assert seen.points.crs == ground.crs
    same = ground.assign(id=ground["id"].astype(str)).set_index("id").geometry
    assert all(row.geometry.equals(same[str(row.id)]) for row in seen.points.itertuples())
    pixels = pandas.DataFrame({name: seen.points[name] for name in ("id", "image", "sample", "line")})
    back = hrsi.localize(IMAGES[0], pixels, height=float(rows["height"].iloc[0]))
    assert not isinstance(back.points, geopandas.GeoDataFrame)  # a plain table was given


def test_rpcs_of_a_result_are_evaluated(adjusted: hrsi.Result):
    rpcs = hrsi.adjust(IMAGES, gcps=GCPS, image_points=MEASURED, **BLOCK).rpcs
    by_cameras, by_result = (
        hrsi.evaluate(IMAGES, rpcs={"refined": one}, tracks=MEASURED, gcps=GCPS, height_datum="ellipsoidal")
        for one in (rpcs, adjusted)
    )
    one, other = (result.report["sets"]["refined"] for result in (by_cameras, by_result))
    assert one["images"].keys() == other["images"].keys() == rpcs.keys()
    assert one["control"]["points"] == 71 and one["control"] == other["control"]


def test_numbers_with_gaps_and_ids_as_floats():
    """Tables keep whole numbers as floats where others are missing: 7.0 is the id 7."""
    table = Table({"id": [7.0, 8.0], "lon": [147.3, 147.31], "lat": [-42.88, -42.87], "height": [50, None]})
    with pytest.raises(hrsi.HrsiError, match=r"row 1 \(id '8'\): has no height"):
        hrsi.project(IMAGES[0], table)


# ---- what is wrong ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "told", "call"),
    [
        (TypeError, "hrsi.adjust has no parameter modle; did you mean model", lambda: hrsi.adjust(IMAGES, modle="x")),
        (TypeError, "hrsi.adjust: missing a required argument: 'images'", lambda: hrsi.adjust()),
        (hrsi.HrsiError, "^sigma_image 'x' is not a number", lambda: hrsi.adjust(IMAGES, sigma_image="x")),
        (hrsi.HrsiError, "needs output_dir; see help", lambda: hrsi.crop(IMAGES[0])),
        (hrsi.HrsiError, r"Give image files, or measured points \(tie_points",
         lambda: hrsi.triangulate(IMAGES)),
        (hrsi.HrsiError, "sigma_dem needs a DEM: name it with dem",
         lambda: hrsi.adjust(IMAGES, gcps=GCPS, image_points=MEASURED, sigma_dem=2.0)),
        (hrsi.HrsiError, "points have no heights", lambda: hrsi.project(IMAGES[0], [[147.3, -42.88]])),
        (hrsi.HrsiError, "belongs to one image", lambda: hrsi.project(IMAGES, [[147.3, -42.88, 1.0]])),
        (hrsi.HrsiError, r"array \(3, 4\)", lambda: hrsi.adjust(IMAGES[0], gcps=np.zeros((3, 4)))),
        (hrsi.HrsiError, "differ in length", lambda: hrsi.adjust(IMAGES, gcps={"id": [1, 2], "lon": [1.0]})),
        (hrsi.HrsiError, "needs `rpc`", lambda: hrsi.open(np.zeros((4, 4)))),
        (hrsi.HrsiError, "`sigma_px` has the shape", lambda: hrsi.ImagePoints(["A"], "i", [[1, 2]], [1.0, 2.0])),
    ],
)  # fmt: skip
def test_errors_name_arguments(error: type[Exception], told: str, call):
    with pytest.raises(error, match=told):
        call()


# ---- what comes out --------------------------------------------------------------------------------------------------


def test_result_shows_itself(adjusted: hrsi.Result):
    assert adjusted.verdict == "ok" and len(repr(adjusted)) < 250 and "CE90" in repr(adjusted)
    assert "check (RMSE)" in adjusted.summary() and "--" not in adjusted.summary()
    page = adjusted._repr_html_()
    assert "<table>" in page and "check" in page and len(page) < 5000


def test_result_has_tables(adjusted: hrsi.Result):
    """The residuals of the table are the figures of the report."""
    table = adjusted.residuals
    level, role, east = (np.asarray(table[name]) for name in ("level", "role", "residual_east_m"))
    check = east[(level == "ground") & (role == "check")].astype(float)
    assert np.sqrt(np.mean(check**2)) == pytest.approx(adjusted.report["check"]["rmse_east_m"], rel=1e-9)
    points = adjusted.points
    assert len(points["id"]) == 71 and set(points) >= {"lon", "lat", "height", "sigma_east_m"}
    assert [outline.geom_type for outline in adjusted.images["geometry"]] == ["Polygon"] * 3
    assert set(adjusted.rpcs) == {f"hobart_ikonos_{number}" for number in (1, 2, 3)}
    with pytest.raises(hrsi.HrsiError, match=r"no table 'residual'.*residuals_wgs84"):
        adjusted.table("residual")


def test_result_without_a_folder_goes_with_it():
    made = hrsi.adjust(IMAGES, gcps=GCPS, image_points=MEASURED, **BLOCK)
    folder = made.folder
    assert folder.is_dir()
    del made
    assert not folder.exists()


def test_result_is_read_again(tmp_path: Path):
    hrsi.adjust(IMAGES, gcps=GCPS, image_points=MEASURED, output_dir=tmp_path / "run", report=False, **BLOCK)
    moved = (tmp_path / "run").rename(tmp_path / "moved")
    again = hrsi.read_result(moved)
    assert again.verdict == "ok" and len(again.rpcs) == 3 and "images" in again.tables
    assert len(hrsi.rpc_info(again, height=50.0).report["images"]) == 3  # a moved result stands for its images, too
    with pytest.raises(hrsi.HrsiError, match=r"report\.json"):
        hrsi.read_result(tmp_path)


def test_no_rpcs_says_why():
    made = hrsi.adjust(IMAGES, gcps=GCPS, image_points=MEASURED, write="none", **BLOCK)
    with pytest.raises(hrsi.HrsiError, match="wrote no refined RPC: none was asked for"):
        _ = made.rpcs


def test_reprs_are_short(adjusted: hrsi.Result):
    image = hrsi.open(IMAGES[0])
    block = hrsi_engine.assemble([image], [], [hrsi.ImagePoints(["A"], image.id, [[1.0, 2.0]])])
    for thing in (image, image.rpc, block, block.points, block.measurements, hrsi.read_rpc(IMAGES[0]), adjusted):
        assert len(repr(thing)) < 250


def test_a_block_is_drawn_with_the_residuals_of_its_layer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The arrows after are those of the layer, those before are of the delivered RPCs; without matplotlib: an error."""
    pytest.importorskip("matplotlib").use("Agg")
    result = hrsi.adjust(IMAGES, gcps=GCPS, image_points=MEASURED, output_dir=tmp_path / "out", report=True)
    before, after = (axis.collections[0] for axis in result.plot().axes)
    table = result.image_points
    length = np.hypot(table["residual_sample_px"], table["residual_line_px"])
    np.testing.assert_allclose(np.hypot(after.U, after.V), length[length > 0.0])
    image, rows = hrsi.open(IMAGES[0]), np.asarray(table["image"]) == "hobart_ikonos_1"
    place = np.column_stack([np.asarray(table[name])[rows] for name in ("lon", "lat", "height")])
    moved = np.asarray(table["sample"])[rows] - image.rpc.project(place)[:, 0]
    assert np.isin(moved.round(6), np.round(before.U, 6)).all()
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(hrsi.HrsiError, match="needs matplotlib"):
        result.plot()
    with pytest.raises(hrsi.HrsiError, match="no adjusted block"):
        hrsi.project(IMAGES[0], {"id": ["1"], "lon": [147.3], "lat": [-42.88], "height": [1.0]}).plot()


def test_orthoimages_of_a_result_need_no_folder(tmp_path: Path):
    """A result in memory goes on into orthoimages that go with their own result."""
    words = "--images 2 --size 200 --gcps 6 --checks 4 --ties 0 --quiet --output-dir"
    assert main(["simulate", *words.split(), str(tmp_path / "block")]) == 0
    block, heights = tmp_path / "block", {"height_datum": "ellipsoidal"}
    adjusted = hrsi.adjust(
        sorted(block.glob("image_*.tif")), gcps=block / "ground_points.csv", image_points=block / "image_points.csv",
        **heights,
    )  # fmt: skip
    made = hrsi.orthorectify(adjusted, dem=block / "dem.tif", **heights)
    assert [file.name for file in made.files if file.suffix == ".tif"] == ["image_1_ortho.tif", "image_2_ortho.tif"]

"""The documentation says what the program does: pages of the algorithms, commands in texts, printed numbers, links."""

import importlib.util
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from osgeo import gdal
from rpc_samples import write_image
from simulated_blocks import oblique_rpc

from hrsi.benchmarks.adjust_speed import simulated
from hrsi.benchmarks.clean_verdicts import matched
from hrsi.benchmarks.command_speed import write_folder
from hrsi.benchmarks.speed_guard import HRSI, measure_cpu
from hrsi.hrsi_engine import check_block, open_image
from hrsi.hrsi_engine.adjustment import adjust
from hrsi.hrsi_engine.adjustment.external.heights import HEIGHTS
from hrsi.hrsi_engine.adjustment.outcome.area_accuracy import AREA_ACCURACY
from hrsi.hrsi_engine.block.orthoimage import DEM
from hrsi.hrsi_engine.foundation.robust_scale import ROBUST
from hrsi.hrsi_engine.ground.geoids import GEOID
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.surface.dem import dem_sigma_m
from hrsi.hrsi_engine.surface.grid_surface import GridSurface
from hrsi.processing_algorithms import REGISTRY, run
from hrsi.processing_algorithms.command_line.command_parser import COMMANDS, LINE_PARAMS, algorithm_parser
from hrsi.processing_algorithms.interface.declare import POSITIONAL_KINDS, Algorithm, spell_arguments, value_facts
from hrsi.processing_algorithms.interface.options import check_options

ROOT = Path(__file__).resolve().parents[1]
ALGORITHMS = pytest.mark.parametrize("algorithm", REGISTRY.values(), ids=lambda algorithm: algorithm.name)
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if page.parent.name != "algorithms"),
]
CODE = re.compile(r"^```(?:sh)?\n(.*?)^```", re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def site() -> ModuleType:
    """The extension that writes the algorithms' pages."""
    spec = importlib.util.spec_from_file_location("algorithm_pages", ROOT / "docs" / "site" / "algorithm_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@ALGORITHMS
def test_page_and_help_agree_with_the_declaration(algorithm: Algorithm, site: ModuleType, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    page = _plain(site.algorithm_page(algorithm).replace("\\|", "|").replace("`", ""))
    shown = _plain(algorithm_parser(algorithm).format_help())
    for param in algorithm.params:
        spelling = f"--{param.name}" if param.kind not in POSITIONAL_KINDS else param.metavar
        for text in (page, shown):
            assert spelling in text
            assert _plain(spell_arguments(param.help, algorithm.params)) in text
            assert all(_plain(fact) in text for fact in value_facts(param)), param.name
    assert set(
        re.findall(r"(?<![\w-])--(?!no-)[a-z][a-z0-9-]*", site.algorithm_page(algorithm).split("\n## ", 1)[1])
    ) >= {f"--{param.name}" for param in algorithm.params if param.kind not in POSITIONAL_KINDS}


def _plain(text: str) -> str:
    """Return text without what line breaks add; the help page may break words at their dashes."""
    return re.sub(r"\s+", "", text)


def commands() -> list[tuple[str, str]]:
    """Return page and words of every `hrsi` command in the texts' code."""
    found = []
    for page in PAGES:
        for block in CODE.findall(page.read_text(encoding="utf-8")):
            for line in block.replace("\\\n", " ").splitlines():
                words = line.split("#")[0].strip()
                if re.match(r"(\S*/)?hrsi\s", words) and "[options]" not in words:
                    found.append((str(page.relative_to(ROOT)), words))
    return found


@pytest.mark.parametrize(("page", "command"), commands())
def test_commands_in_texts_are_right(page: str, command: str):
    """Options exist and take the values; the files need not be there."""
    _, name, *words = shlex.split(command)
    if name.startswith("-") or "--help" in words:
        assert name in ("--help", "--version") or name in REGISTRY
        return
    if name in COMMANDS:
        return
    given = algorithm_parser(REGISTRY[name]).parse_words(words)
    own = {param.key for param in LINE_PARAMS}
    check_options(REGISTRY[name], {key: value for key, value in given.items() if key not in own})


def _find_numbers(page: str, sentence: str) -> list[float]:
    """Return the numbers of a sentence of a page, which has to be there once; ``#`` stands for each number."""
    text = " ".join((ROOT / "docs" / page).read_text(encoding="utf-8").split())
    pattern = re.escape(sentence).replace(re.escape("#"), r"([\d.]*\d)")
    [match] = re.finditer(pattern, text)
    return [float(number) for number in match.groups()]


def test_sentences_state_the_limits_of_the_code():
    """Figures of sentences on accuracy, surfaces and geoids are those of the code, not copies that were true once."""
    gsds = AREA_ACCURACY.determined_gsds
    assert _find_numbers("verdict.md", "the predicted LE90 more than # times GSD × B/H") == [gsds]
    limits = _find_numbers(
        "verdict.md", "With pixels of # m, the limit of LE90 is # m at 24° (B/H #), and # m at 6.5° (B/H #)"
    )
    pixel_m, *pairs = limits
    for limit_m, base_to_height in (pairs[:2], pairs[2:]):
        assert limit_m == pytest.approx(gsds * pixel_m * base_to_height, rel=0.05)
    assert _find_numbers("verdict.md", "by more than # standard deviations of the pointing") == [ROBUST.outlier]
    assert _find_numbers("what-it-cannot-detect.md", "# standard deviations of heights by RPCs") == [ROBUST.outlier]
    assert HEIGHTS.dem_whole == 0.8  # "four fifths" of the page and of the option
    [option] = [param for param in REGISTRY["adjust"].params if param.name == "sigma-surface"]
    assert "four fifths of it common to all heights" in option.help
    assert not _find_numbers("how-to/surface.md", "Four fifths of it are a common error of all heights in their weight")
    share, cell_m = _find_numbers("how-to/surface.md", "by default # m plus a tenth of its cell size (3.3 m for # m)")
    assert dem_sigma_m(cell_m) == pytest.approx(share + 0.1 * cell_m)
    assert GEOID.substitute_sigma_m == _find_numbers("how-to/heights.md", "counts with # m (standard deviation)")[0]


def test_errors_of_a_dem_have_the_shares_of_the_page():
    shares = _find_numbers(
        "reference.md", "# sigma for a part of the area (a quarter of each side, at least 500 m), and # sigma for all"
    )
    assert shares == [DEM.by_part, DEM.by_all]


@pytest.mark.real
@pytest.mark.thorough
def test_points_on_four_images_are_those_of_the_pages(real_data: Path):
    """Ties of two dates of Kahramanmaras, of which the command holds out every tenth: by 5 % and 0.01 px."""
    [number, rms_px] = _find_numbers("many_dates.md", "# points are found on all four with # px RMS")
    assert _find_numbers("matching.md", "2: 6165, 0.088; 3: 476, 0.214; 4: #, # |") == [number, rms_px]
    result = adjust(
        matched("kahramanmaras_phr4", [f"{when}_event_img{k}.tif" for when in ("pre", "post") for k in (1, 2)])
    )
    rays, rows = result.block.rays_per_point(), result.block.measurements
    used = (result.weight > 0.0) & result.has_residual & (rays[rows.point] == 4)
    assert 0.9 * np.count_nonzero(rays == 4) == pytest.approx(number, rel=0.05)
    assert np.sqrt(np.mean(np.sum(result.residual_px[used] ** 2, axis=1))) == pytest.approx(rms_px, abs=0.01)


@pytest.mark.parametrize("place", ["in the image", "next to it"])
def test_a_crop_is_read_as_the_page_states(place: str, tmp_path: Path):
    """GDAL writes the RPC of the scene into a crop or beside it: its positions are those of the scene, moved."""
    assert not _find_numbers(
        "how-to/deliveries.md", "A crop with the RPC of the scene is also read, in the image or next to it, if its "
        "geotransform (without CRS) has its origin."
    )  # fmt: skip
    scene, origin = oblique_rpc(0.3, -0.2), (1200.0, 2500.0)
    write_rpc_text(str(tmp_path / "scene_RPC.TXT"), scene)
    write_image(tmp_path / "scene.tif", None, size=(8, 8))
    crop = gdal.GetDriverByName("GTiff").Create(str(tmp_path / "crop.tif"), 300, 200)
    crop.SetGeoTransform((origin[0], 1.0, 0.0, origin[1], 0.0, 1.0))
    if place == "in the image":
        crop.SetMetadata(gdal.Open(str(tmp_path / "scene.tif")).GetMetadata("RPC"), "RPC")
    else:
        shutil.copy(tmp_path / "scene_RPC.TXT", tmp_path / "crop_RPC.TXT")
    del crop
    ground = scene.localize(np.array([[1300.0, 2600.0]]), 200.0).ground
    xy = open_image(str(tmp_path / "crop.tif")).rpc.project(ground)
    assert xy == pytest.approx(np.array([[100.0, 100.0]]), abs=1e-6)


@pytest.mark.parametrize("part", [0.15, 0.25])
def test_a_dem_with_gaps_is_reported_from_the_fifth_of_the_page(part: float):
    """A part of the pixels, in the west, has no height; a fifth is the limit."""
    assert not _find_numbers("verdict.md", "The DEM has no heights for more than a fifth of the area of the images.")
    views = lab.make_along_track_views(lab.SENSORS["pleiades"], 2, (6000, 6000))
    block = lab.simulate_block(lab.SceneSpec(relief_m=2.0), views, lab.PointCounts(4, 0, 60)).block
    height = float(np.nanmedian(block.points.ground[:, 2]))
    pixels = [image.rpc.localize(image.grid_px(60, 60), height).ground for image in block.images]
    edge = np.quantile(np.concatenate(pixels)[:, 0], part)
    south_west = np.concatenate(pixels)[:, :2].min(axis=0) - 0.02
    heights = np.full((400, 400), height)
    heights[:, south_west[0] + 1e-3 * np.arange(400) < edge] = np.nan
    surface = GridSurface.from_array(heights, tuple(south_west), (1e-3, 1e-3))
    assert ("dem-coverage" in {reason.code for reason in check_block(block, surface=surface)}) == (part > 0.2)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("page", "sentence", "of_row"),
    [("matching.md", "| 5000² | 50 | # |", "pair"), ("protocols/large_blocks.md", "| 30 | # # | | # |", "block")],
)
def test_processor_times_are_those_of_the_pages(page: str, sentence: str, of_row: str, tmp_path: Path):
    """The smallest row of each table, within a factor of two: processors of other machines differ, and so does load."""
    *points, stated_s = _find_numbers(page, sentence)
    if of_row == "pair":
        command = [sys.executable, "benchmarks/tie_points_speed.py", str(tmp_path), "--sizes", "5000", "--layouts"]
        printed = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
        seconds = float(re.search(r"([\d.]+) s CPU \(", printed)[1])
    else:
        write_folder(simulated(30, per_image=round((1000.0 * points[0] + points[1]) / 30.0)), tmp_path)
        images = [str(path) for path in sorted((tmp_path / "rpcs").iterdir())]
        files = ["--gcps", f"{tmp_path}/ground_points.csv", "--image-points", f"{tmp_path}/image_points.csv"]
        options = ["--height-datum", "ellipsoidal", "--output-dir", str(tmp_path / "adjusted")]
        seconds = measure_cpu((*HRSI, "adjust", "-q", *images, *files, *options))
    assert 0.5 * stated_s < seconds < 2.0 * stated_s


def test_the_cost_of_jitter_is_that_of_its_table():
    low, high = _find_numbers("jitter.md", "takes # to # times the processor time with `--jitter auto`")
    page = (ROOT / "docs" / "jitter.md").read_text(encoding="utf-8")
    table = page.split("<!-- cost: made by jitter_cost.py -->")[1].split("<!--")[0]
    ratios = [float(row.split("|")[-2]) for row in table.splitlines() if re.search(r"\d +\|$", row)]
    assert (low, high) == pytest.approx((min(ratios), max(ratios)), abs=0.05)


@pytest.mark.programs
def test_tutorial_prints_what_it_says(tmp_path: Path):
    """The numbers of the Hobart tutorial are those of its command."""
    text = (ROOT / "docs" / "tutorial" / "hobart.md").read_text(encoding="utf-8")
    command = next(words for page, words in commands() if page.endswith("hobart.md") and "triangulate" in words)
    words = [str(ROOT / word) if word.startswith("examples/") else word for word in shlex.split(command)[2:]]
    options = algorithm_parser(REGISTRY["triangulate"]).parse_words(words)
    report = run("triangulate", **(options | {"output_dir": str(tmp_path / "result"), "report": False}))
    rows = re.findall(r"^(control|check) \(RMSE\)\s+(\d+)\s+([\d.]+)\s+([\d.]+)\s+([\d.]+)", text, re.MULTILINE)
    assert [row[0] for row in rows] == ["control", "check"]
    for role, points, *rmse in rows:
        found = report[role]
        assert int(points) == found["points"]
        assert [float(value) for value in rmse] == pytest.approx(
            [found[f"rmse_{axis}_m"] for axis in ("east", "north", "height")], abs=0.0006
        )  # the last printed digit


@pytest.mark.programs
def test_site_builds_without_warnings(tmp_path: Path):
    pytest.importorskip("sphinx")
    call = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-d", str(tmp_path / "trees")]
    done = subprocess.run(
        [*call, str(ROOT / "docs"), str(tmp_path / "site")], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "<math" in (tmp_path / "site" / "theory" / "rpc.html").read_text(encoding="utf-8")
    page = (tmp_path / "site" / "algorithms" / "triangulate.html").read_text(encoding="utf-8")
    assert "--gcp-ids" in page
    texts = [path.read_text(encoding="utf-8") for path in (tmp_path / "site").rglob("*.html")]
    assert not [found for text in texts for found in re.findall(r"[–—][a-z]{2,}-?[a-z]*", text)]  # --option is no dash
    assert "hrsi.triangulate" in (tmp_path / "site" / "python.html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="https?://[^"]*\.(js|css)"', page)  # nothing is fetched from elsewhere

"""The documentation says what the program does: pages of the algorithms, commands in texts, printed numbers, links."""

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from hrsi.benchmarks.clean_verdicts import matched
from hrsi.hrsi_engine.adjustment import adjust
from hrsi.hrsi_engine.adjustment.external.heights import HEIGHTS
from hrsi.hrsi_engine.adjustment.outcome.area_accuracy import AREA_ACCURACY
from hrsi.hrsi_engine.block.orthoimage import DEM
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground import geoids
from hrsi.hrsi_engine.ground.geoids import GEOID
from hrsi.hrsi_engine.results.verdict.significance import EFFECT
from hrsi.hrsi_engine.surface.dem import dem_sigma_m
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
    assert _find_numbers("verdict.md", "by more than # standard deviations of the pointing") == [EFFECT.doubtful_factor]
    assert _find_numbers("what-it-cannot-detect.md", "# standard deviations of heights by RPCs") == [
        EFFECT.doubtful_factor
    ]
    assert HEIGHTS.dem_whole == 0.8  # "four fifths" of the page and of the option
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


def test_a_missing_geoid_is_replaced_as_the_page_states(monkeypatch: pytest.MonkeyPatch):
    """By the finest installed model, with its name; without any grid it is an error, never zero."""
    assert not _find_numbers("how-to/heights.md", "the finest installed model replaces it")
    assert not _find_numbers("how-to/heights.md", "Without any grid it is an error.")
    monkeypatch.setattr(geoids, "_open_grid", lambda file: file == geoids.GEOID_GRIDS["egm96"][0] or None)
    assert geoids.find_geoid("egm2008") == geoids.Geoid("egm96", geoids.GEOID_GRIDS["egm96"][0], "egm2008")
    monkeypatch.setattr(geoids, "_open_grid", lambda file: None)
    with pytest.raises(InputError, match="not installed"):
        geoids.find_geoid("egm2008")


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

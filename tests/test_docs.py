"""The documentation says what the program does: pages of the algorithms, commands in texts, printed numbers, links."""

from __future__ import annotations

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

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

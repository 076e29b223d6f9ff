"""Code in the documentation runs: commands and Python, in the order of the page, on data that the repository has.

A block that cannot run has a comment above it, ``<!-- not run: reason -->``. Links lead somewhere.
"""

import ast
import contextlib
import glob
import io
import json
import os
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from long_tests import mark_beyond

from examples import COMMANDS
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.command_line import cli

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if page.parent.name != "algorithms"),
]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
FENCE = re.compile(r"^(?P<indent> *)```(?P<kind>\w*)\n(?P<body>.*?)^ *```$", re.DOTALL | re.MULTILINE)
MARK = re.compile(r"<!-- not run: (\S.*) -->\s*$")
COMMAND = re.compile(r"^\s*(\S*/)?(hrsi|make|python\S*|pip|gdal\w+|apt\S*|conda|docker) ", re.MULTILINE)


#: Algorithms that the five tasks run with the same files; tie points are found by triangulate.
DONE_BY_TASKS = {"simulate", "tie-points", "refine-rpc", "triangulate", "evaluate", "orthorectify", "ortho-check"}


class Code(NamedTuple):
    """A block of code: its language, text, and why it is not run; empty where it is."""

    kind: str
    text: str
    reason: str


def code_of(page: Path) -> list[Code]:
    """Return the commands and programs of a page; those of the recipes run in copies (`test_recipes`)."""
    if page.name == "heirs.md":
        return []
    text = page.read_text(encoding="utf-8")
    found = []
    for fence in FENCE.finditer(text):
        kind, body = fence["kind"], fence["body"].replace(f"\n{fence['indent']}", "\n").removeprefix(fence["indent"])
        if kind in ("sh", "python") or (not kind and COMMAND.search(body) and "[options]" not in body):
            mark = MARK.search(text[: fence.start()])
            found.append(Code(kind or "sh", body, mark[1] if mark else ""))
    return found


def run_commands(text: str) -> None:
    """Run the `hrsi` commands of a text; nothing else may be among them."""
    for line in filter(str.strip, text.replace("\\\n", " ").splitlines()):
        program, *words = shlex.split(line, comments=True)
        assert program == "hrsi", line
        spread = [name for word in words for name in (sorted(glob.glob(word)) or [word])]
        assert cli.main(spread) == 0, line


@pytest.fixture
def place(tmp_path: Path, monkeypatch) -> Path:
    """A folder that has the repository's examples and nothing else."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


TASKS = ROOT / "docs" / "tasks.md"
RUN = [page for page in PAGES if page != TASKS and any(not code.reason for code in code_of(page))]


@pytest.mark.parametrize("page", mark_beyond(2, "thorough", RUN), ids=lambda page: str(page.relative_to(ROOT)))
def test_code_runs(page: Path, place: Path, capsys):
    run_page(page)
    capsys.readouterr()


def run_page(page: Path) -> None:
    """Run what a page has, but for what is marked."""
    for code in code_of(page):
        if code.reason:
            continue
        if code.kind == "python":
            exec(compile(code.text, str(page), "exec"), {"__name__": "page"})
        else:
            run_commands(code.text)


@pytest.fixture(scope="module")
def worked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the five tasks were done."""
    folder = tmp_path_factory.mktemp("tasks")
    (folder / "examples").symlink_to(ROOT / "examples")
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        run_page(TASKS)
    return folder


@pytest.mark.programs
def test_tasks_are_done(worked: Path):
    """Commands and Python leave what the page says."""
    for name in ("refined/hobart_ikonos_1_RPC.TXT", "pair/image_3.tif", "triangulated/image_1.tif"):
        assert (worked / name).is_file()
    orthoimages = [sorted(path.name for path in (worked / name).glob("*.tif")) for name in ("ortho", "ortho_in_python")]
    assert orthoimages[0] == orthoimages[1] and len(orthoimages[0]) == 3
    # What the page says of the pair's verdict is what the report of the run says
    [(level, code)] = re.findall(r"verdict of this pair is \*(\w+)\* \(\[([\w-]+)\]", TASKS.read_text(encoding="utf-8"))
    verdict = json.loads((worked / "pair" / "report.json").read_text(encoding="utf-8"))["verdict"]
    assert verdict["level"] == level and code in {reason["code"] for reason in verdict["reasons"]}


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in DONE_BY_TASKS])
@pytest.mark.programs
def test_examples_of_algorithms_run(name: str, worked: Path, capsys):
    """The commands on the algorithms' pages; `docs/site/examples.py` keeps what they print."""
    with contextlib.chdir(worked):
        assert cli.main([name, *shlex.split(COMMANDS[name])]) == 0
    assert (ROOT / "docs" / "examples" / f"{name}.txt").read_text(encoding="utf-8").strip()
    capsys.readouterr()


def test_every_algorithm_has_an_example():
    assert set(COMMANDS) == set(REGISTRY)
    assert {path.stem for path in (ROOT / "docs" / "examples").glob("*.txt")} == set(REGISTRY)


@pytest.mark.parametrize("notebook", mark_beyond(1, "programs", NOTEBOOKS), ids=lambda path: path.stem)
def test_notebook_runs(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    """Its cells, in order and in its own folder, as a notebook runs them; what a cell shows can be shown."""
    examples = tmp_path / "examples"
    shutil.copytree(ROOT / "examples", examples, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.chdir(examples / "notebooks")
    document = json.loads(notebook.read_text(encoding="utf-8"))
    cells = [cell for cell in document["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    names: dict = {"__name__": "__main__"}
    for cell in cells:
        tree = ast.parse("".join(cell["source"]), str(notebook))
        shown = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, str(notebook), "exec"), names)
        if shown is not None:
            value = eval(compile(ast.Expression(shown.value), str(notebook), "eval"), names)
            display = getattr(value, "_repr_html_", None) or getattr(value, "_repr_svg_", None) or value.__repr__
            assert display is not None and len(str(display())) > 3
    capsys.readouterr()


def test_there_are_four_notebooks():
    assert len(NOTEBOOKS) == 4


def test_tasks_are_short():
    """Each of the five tasks is ten lines of Python or less."""
    programs = [code.text for code in code_of(TASKS) if code.kind == "python"]
    assert len(programs) == 5
    assert all(len([line for line in text.splitlines() if line.strip()]) <= 10 for text in programs)


# ---- links -----------------------------------------------------------------------------------------------------------


def anchors_of(page: Path) -> set[str]:
    """Return the anchors of a page's headings."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path):
    wrong = []
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in target:
            wrong += [] if re.fullmatch(r"https://[\w.-]+\.[a-z]{2,}(/[\w./%~#?=&+-]*)?", target) else [target]
            continue
        name, _, anchor = target.partition("#")
        there = (page.parent / name) if name else page
        if there.parent.name == "algorithms":  # made when the site is built
            continue
        exists = there.exists() and (not anchor or there.suffix != ".md" or anchor in anchors_of(there))
        wrong += [] if exists else [target]
    assert wrong == []


# ---- packages --------------------------------------------------------------------------------------------------------


def test_dockerfile_installs_what_set_up_does():
    text = (ROOT / "packaging" / "Dockerfile").read_text(encoding="utf-8")
    lines = [line for line in text.replace("\\\n", " ").splitlines() if line and not line.startswith("#")]
    known = {"FROM", "RUN", "COPY", "ENV", "USER", "WORKDIR", "ENTRYPOINT", "CMD"}
    assert lines[0].startswith("FROM debian:12") and {line.split()[0] for line in lines} <= known
    script = (ROOT / "scripts" / "set_up.sh").read_text(encoding="utf-8")
    wanted = set(re.search(r'RUN_PACKAGES="([^"$]+)"', script)[1].split())
    install = re.search(r"--no-install-recommends(.*?)&&", text.replace("\\\n", " "), re.DOTALL)[1]
    assert set(install.split()) == wanted
    for line in lines:
        if line.startswith(("ENTRYPOINT", "CMD")):
            json.loads(line.split(maxsplit=1)[1])
    assert lines.index("USER hrsi") > max(index for index, line in enumerate(lines) if line.startswith("COPY"))


def test_conda_recipe_requires_what_the_project_does():
    recipe = yaml.safe_load((ROOT / "packaging" / "conda" / "meta.yaml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {"dask": "dask-core", "opencv-python-headless": "py-opencv"}
    stated = [*project["dependencies"], *project["optional-dependencies"]["fast"]]
    wanted = dict(re.match(r"([\w-]+)(>=[\d.]+)", text).groups() for text in stated)
    given = dict(text.split() for text in recipe["requirements"]["run"])
    assert {names.get(name, name): bound for name, bound in wanted.items()}.items() <= given.items()
    assert given["python"] == project["requires-python"] and "gdal" in given
    assert os.path.samefile(ROOT / "packaging" / "conda" / recipe["source"]["path"], ROOT)

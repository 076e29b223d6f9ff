"""Whatever ids, file names, layers, coordinate systems and messages hold: pages show it as text, in Chromium too.

Every algorithm that writes a page runs on files and ids that try to break out of it.
"""

import base64
import csv
import hashlib
import json
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.io.pages import report as pages
from hrsi.processing_algorithms import run
from hrsi.tests.io.test_report_in_browser import browse, chromium, console

__all__ = ["chromium"]

#: Ends an attribute, a title, a style and a comment, and begins what would run; valid in a file's name.
EVIL_NAME = 'e"\'--><img src=x onerror=console.error("broke-out")><svg onload=console.error("broke-out")>&lt{{7*7}}'
EVIL = f"</title></style></svg>{EVIL_NAME}<script>console.error('broke-out')</script>&amp;"
MARK = "broke-out"
TAGS = {
    "html", "head", "meta", "title", "style", "body", "header", "section", "h1", "h2", "h3", "h4", "p", "b", "br",
    "i", "ul", "ol", "li", "dl", "dt", "dd", "div", "span", "table", "thead", "tbody", "tr", "th", "td", "figure",
    "figcaption", "details", "summary", "a", "code", "footer", "main", "svg", "g", "path", "polygon", "polyline",
    "circle", "ellipse", "line", "rect", "text", "image", "tspan", "clippath", "defs", "em", "strong", "caption",
    "nav", "aside", "button", "fieldset", "input", "label", "legend", "option", "pre", "select", "time", "use",
}  # fmt: skip
#: Templates that are parts of the others.
FRAME = {"page", "warnings", "lineage", "verdict", "explained", "pictures"}
#: Attributes that load something or lead somewhere, and what of it a page may.
LINKS = ("href", "src", "xlink:href", "action", "srcset")
OWN = ("#", "data:image/png;base64,", "data:image/jpeg;base64,")


class Inspection(HTMLParser):
    """Collects what a page must not hold, and its text."""

    def __init__(self) -> None:
        super().__init__()
        self.faults: list[str] = []
        self.text = ""
        self.policy = ""
        self.scripts: list[str] = []
        self._in_script = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._in_script = tag == "script"
        if tag == "script" and not attrs:
            self.scripts.append("")  # the policy has to name it
        elif tag not in TAGS and (tag, dict(attrs)) != ("script", {"type": "application/json", "id": "page-data"}):
            self.faults.append(f"<{tag}>")
        for name, value in attrs:
            text = (value or "").strip().lower()
            if name.startswith("on") or (name == "style" and "url(" in text) or "javascript:" in text:
                self.faults.append(f"{tag} {name}={value}")
            if name in LINKS and not text.startswith(OWN):
                self.faults.append(f"{tag} {name}={value}")
        named = dict(attrs)
        if tag == "meta" and named.get("http-equiv"):
            self.policy += named.get("content") or ""

    def handle_endtag(self, tag: str) -> None:
        self._in_script = False

    def handle_data(self, data: str) -> None:
        if self._in_script and self.scripts:
            self.scripts[-1] += data
        self.text += data


def inspect(page: str) -> Inspection:
    found = Inspection()
    found.feed(page)
    found.close()
    return found


def rewritten(path: Path, target: Path, change: Callable[[dict[str, str]], None]) -> str:
    """Copy a CSV file with each row changed."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        change(row)
    with target.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return str(target)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block whose folder, images and points have hostile names."""
    plain = tmp_path_factory.mktemp("plain") / "block"
    run("simulate", output_dir=str(plain), size=320, gcps=9, checks=6, ties=40, seed=2)
    hostile = tmp_path_factory.mktemp("hostile") / EVIL_NAME
    hostile.mkdir()
    for number in (1, 2):
        shutil.copyfile(plain / f"image_{number}.tif", hostile / f"{EVIL_NAME}{number}.tif")
    shutil.copyfile(plain / "dem.tif", hostile / f"{EVIL_NAME}dem.tif")

    def rename(row: dict[str, str]) -> None:
        row["id"] += EVIL
        if "image" in row:
            row["image"] = EVIL_NAME + row["image"].removeprefix("image_")
        if row["id"].startswith("C000002") and "sample" in row:
            row["sample"] = str(float(row["sample"]) + 12.0)  # a gross error has a chip of its own

    for table in ("ground_points", "image_points"):
        rewritten(plain / f"{table}.csv", hostile / f"{table}.csv", rename)
    return hostile


def triangulate(folder: Path, out: Path) -> None:
    run("triangulate", images=images(folder), output_dir=str(out), gcps=str(folder / "ground_points.csv"),
        image_points=str(folder / "image_points.csv"), tie_points="none", model="auto")  # fmt: skip


def refine(folder: Path, out: Path) -> None:
    run("refine-rpc", images=images(folder), output_dir=str(out), gcps=str(folder / "ground_points.csv"),
        image_points=str(folder / "image_points.csv"), compare=True, write="none")  # fmt: skip


def match(folder: Path, out: Path) -> None:
    run("match", images=images(folder), output_dir=str(out), threads=1)


def measure(folder: Path, out: Path) -> None:
    run("measure-targets", images=images(folder), points=str(folder / "image_points.csv"), output_dir=str(out))


def register(folder: Path, out: Path) -> None:
    run("register", images=images(folder), image_points=str(folder / "image_points.csv"), output_dir=str(out))


def orthorectify(folder: Path, out: Path) -> None:
    run("orthorectify", images=images(folder), dem=str(folder / f"{EVIL_NAME}dem.tif"), output_dir=str(out))


def check_orthoimages(folder: Path, out: Path) -> None:
    run("orthorectify", images=images(folder), dem=str(folder / f"{EVIL_NAME}dem.tif"), output_dir=str(out / EVIL_NAME))
    made = sorted(str(path) for path in (out / EVIL_NAME).glob("*_ortho.tif"))
    run("ortho-check", images=made, output_dir=str(out))


def evaluate(folder: Path, out: Path) -> None:
    run("evaluate", images=images(folder), tracks="none", image_points=str(folder / "image_points.csv"),
        gcps=str(folder / "ground_points.csv"), height_datum="ellipsoidal", output_dir=str(out))  # fmt: skip


def model_surface(folder: Path, out: Path) -> None:
    triangulate(folder, out / EVIL_NAME)
    run("surface-model", result=str(out / EVIL_NAME), output_dir=str(out / "surface"))
    shutil.copytree(out / "surface", out, dirs_exist_ok=True)


def run_project(folder: Path, out: Path) -> None:
    """A project with a hostile title; names of images come into its chapters as into the pages of their steps."""
    file = folder / "project.toml"
    listed = {"title": EVIL_NAME, "client": EVIL, "images": images(folder), "gcps": str(folder / "ground_points.csv"),
              "image_points": str(folder / "image_points.csv"), "output_dir": str(out)}  # fmt: skip
    lines = [f"{key} = {json.dumps(value)}" for key, value in listed.items()]  # TOML writes texts as JSON does
    file.write_text("\n".join([*lines, "[triangulate]", 'tie_points = "none"', "[orthorectify]", "skip = true"]))
    run("run", project=str(file))


def images(folder: Path) -> list[str]:
    return [str(folder / f"{EVIL_NAME}{number}.tif") for number in (1, 2)]


#: What writes a page, by the template that it uses.
WRITERS: dict[str, list[Callable[[Path, Path], None]]] = {
    "report": [triangulate, refine], "match": [match], "targets": [measure], "registration": [register],
    "orthoimages": [orthorectify], "misregistration": [check_orthoimages], "evaluation": [evaluate],
    "surface": [model_surface], "project": [run_project],
}  # fmt: skip
CASES = [(template, writer) for template, writers in WRITERS.items() for writer in writers]


class Results(dict[str, Path]):
    """The results, by the name of their writer; each is written when it is first asked for."""

    def __init__(self, folder: Path, out: Path):
        super().__init__()
        self.folder, self.out = folder, out

    def __missing__(self, name: str) -> Path:
        self[name] = self.out / name / EVIL_NAME
        self[name].parent.mkdir()
        next(writer for _, writer in CASES if writer.__name__ == name)(self.folder, self[name])
        return self[name]


@pytest.fixture(scope="module")
def written(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Results:
    return Results(folder, tmp_path_factory.mktemp("out"))


def test_every_template_has_a_writer_here():
    folder = Path(pages.__file__).parent / "templates"
    assert {path.name.partition(".")[0] for path in folder.glob("*.html.j2")} - FRAME == set(WRITERS)


@pytest.mark.parametrize(
    ("template", "writer"), mark_beyond(1, "wrong_inputs", CASES), ids=lambda case: getattr(case, "__name__", case)
)
def test_hostile_names_are_text(template: str, writer: Callable[[Path, Path], None], written: Results):
    """The page has no tag or attribute but its own, shows the name as it is, and bars what would be loaded or run."""
    found = inspect((written[writer.__name__] / "report.html").read_text(encoding="utf-8"))
    links = {f"a href={step}/report.html" for step in ("triangulated", "evaluation")}  # pages of its own steps
    assert set(found.faults) <= (links if template == "project" else set())
    assert EVIL_NAME in found.text
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in found.scripts]
    allowed = " ".join(f"'sha256-{value}'" for value in hashes)
    assert found.policy == f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {allowed}"
    templates = Path(pages.__file__).parent / "templates"
    own = {path.read_text(encoding="utf-8") for path in templates.glob("*.js")}
    assert found.scripts and set(found.scripts) <= own  # nothing of a report is in a script that runs


def poisoned(value: Any) -> Any:
    """Return a report whose texts all are hostile, and which has an entry under a hostile name beside the others."""
    if isinstance(value, str):
        return EVIL
    if isinstance(value, list):
        return [poisoned(item) for item in value]
    if not isinstance(value, dict):
        return value
    found = {key: poisoned(item) for key, item in value.items()}
    if value and all(isinstance(item, type(next(iter(value.values())))) for item in value.values()):
        found[EVIL] = next(iter(found.values()))
    return found


@pytest.mark.parametrize(
    ("template", "writer"), mark_beyond(1, "wrong_inputs", CASES), ids=lambda case: getattr(case, "__name__", case)
)
def test_every_text_of_a_report_is_escaped(
    template: str, writer: Callable[[Path, Path], None], written: Results, tmp_path: Path
):
    """Also those that no input can make hostile today."""
    report = json.loads((written[writer.__name__] / "report.json").read_text(encoding="utf-8"))
    pages.write_page(str(tmp_path / "page.html"), f"{template}.html.j2", poisoned(report))
    found = inspect((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert found.faults == []
    assert EVIL in found.text


@pytest.mark.programs
def test_chromium_runs_nothing_of_it(chromium: str, written: Results, tmp_path: Path):
    """All pages in frames of one, without their policy, so that escaping alone has to hold; one that fails is heard."""
    names = []
    for _, writer in CASES:
        name = writer.__name__
        page = (written[name] / "report.html").read_text(encoding="utf-8")
        (tmp_path / f"{name}.html").write_text(re.sub(r"<meta http-equiv[^>]*>", "", page), encoding="utf-8")
        names.append(f"{name}.html")
    frames = tmp_path / "frames.html"
    frames.write_text("".join(f'<iframe src="{name}" width="900" height="2000"></iframe>' for name in names))
    assert not [line for line in console(browse(chromium, frames, tmp_path / "a", "--dump-dom")) if MARK in line]
    (tmp_path / names[-1]).write_text(EVIL, encoding="utf-8")
    heard = console(browse(chromium, frames, tmp_path / "b", "--virtual-time-budget=2000", "--dump-dom"))
    assert len([line for line in heard if MARK in line]) >= 2


@pytest.mark.programs
def test_the_policy_stops_what_escaping_would_let_through(chromium: str, written: Results, tmp_path: Path):
    page = (written["match"] / "report.html").read_text(encoding="utf-8").replace("</body>", f"{EVIL}</body>")
    (tmp_path / "page.html").write_text(page, encoding="utf-8")
    lines = console(browse(chromium, tmp_path / "page.html", tmp_path / "a", "--dump-dom"))
    assert lines and all("Content Security Policy" in line for line in lines)


@pytest.mark.thorough
def test_tables_keep_ids_to_the_letter(folder: Path, written: Results, tmp_path: Path):
    """A table is for programs, which join by id: what a spreadsheet would take for a formula is written as it is."""

    def rename(row: dict[str, str]) -> None:
        row["id"] = f'=HYPERLINK("http://x","{row["id"]}")'

    table = rewritten(folder / "image_points.csv", tmp_path / "image_points.csv", rename)
    run("measure-targets", images=images(folder), points=table, output_dir=str(tmp_path / "out"))
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert report["targets"] and all(target["id"].startswith('=HYPERLINK("http://x","') for target in report["targets"])

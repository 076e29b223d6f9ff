"""The report in a real browser: it shows report.json's numbers, without a console message, on a desk and on a phone.

The pictures stay in ``build/report`` for whoever wants to look at them.
"""

from __future__ import annotations

import csv
import html
import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hrsi.hrsi_engine.io.pages import figure
from hrsi.processing_algorithms import run

REPOSITORY = Path(__file__).resolve().parents[2]
PICTURES = REPOSITORY / "build" / "report"
CELL = re.compile(r'data-key="([^"]*)" data-value="([^"]*)">([^<]*)<')
TELL_WIDTH = "<script>parent.postMessage(document.documentElement.scrollWidth + ' of ' + innerWidth, '*')</script>"
FRAME = """<!DOCTYPE html><html><head><title></title><style>body {{ margin: 0 }} iframe {{ border: 0 }}</style>
<script>addEventListener("message", event => document.title = event.data)</script></head>
<body><iframe src="report.html" width="{width}" height="{height}" scrolling="no"></iframe></body></html>"""


@pytest.fixture(scope="session")
def chromium() -> str:
    """The browser; without it, skip, or fail where CI is true."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        reason = "no Chromium: apt-get install chromium"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    return program


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result with pixels, tie points, check points and one gross error, for which there is a chip."""
    block, out = tmp_path_factory.mktemp("block") / "block", tmp_path_factory.mktemp("report") / "out"
    run("simulate", output_dir=str(block), size=320, gcps=9, checks=6, ties=60, seed=2)
    rows = list(csv.DictReader((block / "image_points.csv").open(encoding="utf-8", newline="")))
    wrong = next(row for row in rows if row["id"] == "C000002")
    wrong["sample"] = str(float(wrong["sample"]) + 12.0)
    with (block / "image_points.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    run(
        "triangulate", images=[str(block / f"image_{number}.tif") for number in (1, 2)], output_dir=str(out),
        gcps=str(block / "ground_points.csv"), image_points=str(block / "image_points.csv"), tie_points="none",
        model="auto", write="none",
    )  # fmt: skip
    return out


@pytest.fixture(params=["simulated", "hobart_result"])
def result(request: pytest.FixtureRequest) -> Path:
    return request.getfixturevalue(request.param)


def browse(chromium: str, page: Path, profile: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Open a page in the browser without a window; what the page logs is in stderr."""
    command = [
        chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr",
        f"--user-data-dir={profile}", *arguments, page.as_uri(),
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)


def console(finished: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in finished.stderr.splitlines() if "CONSOLE" in line]


def shown_numbers(dom: str) -> Iterator[tuple[list[Any], Any, str]]:
    """Give where each number stands in report.json, its value, and what the page writes."""
    for key, value, text in CELL.findall(dom):
        yield json.loads(html.unescape(key)), json.loads(html.unescape(value)), html.unescape(text)


def entry(report: Any, key: list[Any]) -> Any:
    """Return what stands at a place of the report; None where there is no such place."""
    for part in key:
        report = report[part] if isinstance(report, list) else (report or {}).get(part)
    return report


def test_numbers_are_those_of_report_json(chromium: str, result: Path, tmp_path: Path) -> None:
    finished = browse(chromium, result / "report.html", tmp_path, "--dump-dom")
    report = json.loads((result / "report.json").read_text(encoding="utf-8"))
    numbers = list(shown_numbers(finished.stdout))
    assert console(finished) == []
    for key, value, text in numbers:
        assert value == entry(report, key), key
        digits = {figure(value, digits, unit) for digits in range(6) for unit in ("", "m", "s")}
        assert text in digits, (key, value, text)
    places = {tuple(key) for key, _, _ in numbers}
    known = {(role, f"rmse_{axis}") for role in ("control", "check") for axis in ("east_m", "height_m", "line_px")}
    wanted = {("sigma0",), ("observations",), ("check", "ce90_m"), ("check", "le90_m"), *known}
    wanted |= {("check", "predicted", "rmse_east_m"), ("normalised_residuals", "line", "std")}
    wanted |= {("images", name, "rpc_fit_max_px") for name in report["images"]}
    assert wanted <= places
    print(f"{result.parent.name}: {len(numbers)} numbers of report.json on the page, no console message")


def test_the_console_is_heard(chromium: str, tmp_path: Path) -> None:
    """The test above can fail: a page's error reaches it."""
    page = tmp_path / "page.html"
    page.write_text("<script>console.error('heard'); undefinedFunction()</script>", encoding="utf-8")
    assert len(console(browse(chromium, page, tmp_path / "profile", "--dump-dom"))) >= 2


def test_what_the_page_shows(simulated: Path) -> None:
    """Warnings come first; there is a plot of each kind, and a chip of the gross error with its pixels."""
    report = json.loads((simulated / "report.json").read_text(encoding="utf-8"))
    page = (simulated / "report.html").read_text(encoding="utf-8")
    assert [row["id"] for row in report["outliers"]] == ["C000002"]
    chips = re.findall(r'<figure><svg class="chip".*?<figcaption>(.*?)</figcaption>', page, re.DOTALL)
    assert chips == [f"C000002, {report['outliers'][0]['image']}"]
    assert page.count("data:image/png;base64,") == 1
    assert page.count('class="plot"') == 4  # histogram and Q-Q of samples and lines
    assert page.count('class="coverage"') == 2
    assert page.count('aria-label="Residuals"') == 2
    assert report["model_choice"]["reason"] in html.unescape(page)
    if report["warnings"]:
        assert page.index("Warnings") < page.index("<h2>Adjustment")


@pytest.mark.parametrize(("name", "width", "height"), [("desk", 1100, 5600), ("phone", 390, 7600)])
def test_fits_the_screen(chromium: str, simulated: Path, tmp_path: Path, name: str, width: int, height: int) -> None:
    """The page is not wider than the screen (wide tables scroll within it); its picture stays.

    The browser's own window cannot be as narrow as a phone, so the page is shown in a frame of that width.
    """
    PICTURES.mkdir(parents=True, exist_ok=True)
    text = (simulated / "report.html").read_text(encoding="utf-8")
    text = re.sub(r"<meta http-equiv[^>]*>", "", text)  # it would stop the script that tells the width
    (tmp_path / "report.html").write_text(text.replace("</body>", f"{TELL_WIDTH}</body>"), encoding="utf-8")
    frame = tmp_path / "frame.html"
    frame.write_text(FRAME.format(width=width, height=height), encoding="utf-8")
    window = f"--window-size={max(width, 500)},{height}"
    browse(chromium, frame, tmp_path / "a", window, f"--screenshot={PICTURES / f'report_{name}.png'}")
    dom = browse(chromium, frame, tmp_path / "b", window, "--virtual-time-budget=2000", "--dump-dom").stdout
    needed, there = map(int, re.search(r"<title>(\d+) of (\d+)</title>", dom).groups())
    assert there == width
    assert needed <= there
    assert (PICTURES / f"report_{name}.png").stat().st_size > 50_000


def test_print(chromium: str, simulated: Path, tmp_path: Path) -> None:
    printed = PICTURES / "report.pdf"
    PICTURES.mkdir(parents=True, exist_ok=True)
    browse(chromium, simulated / "report.html", tmp_path, "--no-pdf-header-footer", f"--print-to-pdf={printed}")
    pages = len(re.findall(rb"/Type\s*/Page\b", printed.read_bytes()))
    assert 2 <= pages <= 8

"""The report in a real browser: its numbers are report.json's; it can be used by mouse and keyboard, and printed.

The pictures stay in ``build/report`` for whoever wants to look at them.
"""

import csv
import itertools
import json
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, chromium_program
from osgeo import gdal

from hrsi.hrsi_engine.io.pages.report import digits_by_sigma, figure
from hrsi.processing_algorithms import run

REPOSITORY = Path(__file__).resolve().parents[2]
PICTURES = REPOSITORY / "build" / "report"
NUMBERS = """[...document.querySelectorAll("[data-key]")].map(
    (cell) => [JSON.parse(cell.dataset.key), JSON.parse(cell.dataset.value), cell.textContent])"""
SHOWN = '[...document.querySelectorAll("#block-map .pt")].filter((p) => getComputedStyle(p).display !== "none")'
#: Texts whose contrast to what is behind them is below what WCAG 2.1 (1.4.3) asks for: 4.5, of large ones 3.
PALE = """(() => {
  const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const light = (colour) => {
    const linear = (v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    const [r, g, b] = numbers(colour).map((v) => linear(v / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = getComputedStyle(at).backgroundColor;
      if (numbers(colour)[3] !== 0) return colour;
    }
  };
  const pale = [];
  for (const element of document.querySelectorAll("body *:not(script):not(style)")) {
    const told = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!told || !element.getClientRects().length) continue;
    const style = getComputedStyle(element), inside = element.closest("svg");
    const [a, b] = [light(inside ? style.fill : style.color), light(behind(element))].sort((x, y) => y - x);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < (large ? 3 : 4.5)) pale.push(`${element.tagName} ${element.className}: ${ratio.toFixed(2)}`);
  }
  return pale;
})()"""


@pytest.fixture(scope="session")
def chromium() -> str:
    """The browser; without it, skip, or fail where CI is true."""
    program = chromium_program()
    if program is None:
        reason = "no Chromium: apt-get install chromium"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    return program


@pytest.fixture(scope="module")
def browser(chromium: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as running:
        yield running


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


@pytest.fixture
def page(browser: Browser, simulated: Path) -> Browser:
    """The simulated block's page, freshly opened."""
    browser.open(simulated / "report.html")
    return browser


def browse(chromium: str, page: Path, profile: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Open a page in a browser of its own without a window; what the page logs is in stderr."""
    command = [
        chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr",
        f"--user-data-dir={profile}", *arguments, page.as_uri(),
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)


def console(finished: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in finished.stderr.splitlines() if "CONSOLE" in line]


def report_of(result: Path) -> dict[str, Any]:
    return json.loads((result / "report.json").read_text(encoding="utf-8"))


def entry(report: Any, key: list[Any]) -> Any:
    """Return what stands at a place of the report; None where there is no such place."""
    for part in key:
        report = report[part] if isinstance(report, list) else (report or {}).get(part)
    return report


def test_numbers_are_those_of_report_json(browser: Browser, result: Path) -> None:
    browser.open(result / "report.html")
    report = report_of(result)
    numbers = browser.value(NUMBERS)
    assert browser.messages == []
    for key, value, text in numbers:
        assert value == entry(report, key), key
        value = entry(report, key)  # JavaScript's 0 may be an integer or not
        if value is None:
            assert text == "", key
        elif key[2:3] == ["parameters"]:
            assert text == digits_by_sigma(value, entry(report, [*key[:4], "sigma"]))
        else:
            assert text in {figure(value, digits, unit) for digits in range(6) for unit in ("", "m", "px")}, (key, text)
    places = {tuple(key) for key, _, _ in numbers}
    known = {(role, f"rmse_{axis}") for role in ("control", "check") for axis in ("east_m", "height_m", "line_px")}
    wanted = {("sigma0",), ("observations",), ("check", "ce90_m"), ("check", "le90_m"), *known}
    wanted |= {("check", "predicted", "rmse_east_m"), ("normalised_residuals", "line", "std")}
    wanted |= {("images", name, "rpc_fit_max_px") for name in report["images"]}
    wanted |= {("control_points", 0, "east_m"), ("check_points", 0, "sigma_height_m")}
    assert wanted <= places


def numbers_in(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?[\d.]+", text)]


def test_messages_are_heard(browser: Browser, tmp_path: Path) -> None:
    """The tests here can fail: a page's error reaches them."""
    page = tmp_path / "page.html"
    page.write_text("<script>console.error('heard'); undefinedFunction()</script>", encoding="utf-8")
    browser.open(page)
    browser.value("1")
    assert len(browser.messages) >= 2


def test_it_opens_with_what_was_reached(simulated: Path) -> None:
    """Verdict, its sentence and the key figures stand before all else; then the map, and chips of all known points."""
    report, page = report_of(simulated), (simulated / "report.html").read_text(encoding="utf-8")
    text = page[page.index("<body>") :]
    order = [report["verdict"]["level"].capitalize(), report["verdict"]["sentence"], "CE90", "<h2>Notes", "<h2>Map"]
    order += ["<h2>Accuracy", "<h2>Images", "<h2>Pairs", "<h2>Points in the images", "<h2>How it was made"]
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    assert [row["id"] for row in report["outliers"]] == ["C000002"]
    known = report["control"]["points"] + report["check"]["points"]
    blocks = page.split('<div class="point"')[1:]  # of a point side by side: a chip for each of its images
    assert {block.count('<svg class="chip"') for block in blocks} == {len(report["images"])}
    assert known < len(blocks) <= known + 12  # all known ones, and the worst tie points
    assert page.count('id="picture-') == 2
    axes = sum(axis in profile for profile in report["line_profiles"].values() for axis in ("across", "along"))
    assert axes >= len(report["images"])
    assert page.count('class="plot"') == 2 + 2 * axes  # histograms of samples and lines; profiles and their spectra
    assert page.count('<svg class="card"') == 2


@pytest.mark.programs
def test_a_row_leads_to_the_map_and_the_map_to_the_row(page: Browser, simulated: Path) -> None:
    worst = report_of(simulated)["check_points"][0]
    page.value("for (const part of document.querySelectorAll('#known details')) part.open = true")
    page.click(f"#known tr:has(a[data-point='{worst['id']}']) td")
    assert page.value("document.querySelector('#block-map').dataset.chosen") == worst["id"]
    assert page.value("Number(document.querySelector('#block-map').dataset.zoom)") >= 4.0
    told = page.value("document.querySelector('#map-point').textContent")
    east, north, up = (f"{worst[name]:.2f}".replace("-", "−") for name in ("east_m", "north_m", "height_m"))
    assert f"E {east}, N {north}, H {up} m" in told
    # in both images: the arrow on the card, and the chip
    assert page.value("document.querySelectorAll('.cards .v.chosen').length") == 2
    assert page.value("document.querySelectorAll('#chips figure.chosen').length") == 2
    # and back: a point on the map opens its table and marks its row
    page.click("#zoom-all")
    assert page.value("document.querySelector('#block-map').dataset.zoom") == "1"
    page.click("#block-map .pt.gcp .dot")
    chosen = page.value("document.querySelector('#block-map').dataset.chosen")
    assert chosen.startswith("G")
    rows = "[...document.querySelectorAll('tr.chosen')].map((row) => row.querySelector('a').dataset.point)"
    assert set(page.value(rows)) == {chosen}
    page.click(".cards .v.check")
    assert page.value("document.querySelector('#block-map').dataset.chosen").startswith("C")
    assert page.messages == []


@pytest.mark.programs
def test_filters_and_colours(page: Browser, simulated: Path) -> None:
    report = report_of(simulated)
    count = {role: report[name]["points"] for role, name in (("gcp", "control"), ("check", "check"), ("tie", "ties"))}

    def shown() -> int:
        return page.value(f"{SHOWN}.length")

    assert shown() == sum(count.values())
    for role in ("tie", "check"):
        page.click(f"#map-roles input[value={role}]")
    assert shown() == count["gcp"]
    page.click("#map-roles input[value=check]")
    page.select("#map-flag", "1")
    assert page.value(f"{SHOWN}.map((p) => p.querySelector('title').textContent.split(' ')[0])") == ["C000002"]
    page.select("#map-flag", "")
    page.click("#map-roles input[value=tie]")
    # the points of one image are those whose panel names it
    page.select("#map-image", "0")
    data = page.value("document.getElementById('page-data').textContent")
    rows = json.loads(data)["measurements"]
    on_first = {point for point, image in zip(rows["point"], rows["image"], strict=True) if image == 0}
    assert shown() == len(on_first)
    assert page.value("document.querySelectorAll('.footprint.chosen').length") == 1
    page.select("#map-image", "")
    before = page.value("getComputedStyle(document.querySelector('.pt.tie .dot')).fill")
    for by in ("residual", "sigma", "rays"):
        page.select("#map-colour", by)
        assert page.value("getComputedStyle(document.querySelector('.pt.tie .dot')).fill") != before
        assert page.value("document.querySelector('#map-ramp').textContent").strip()
    page.select("#map-colour", "")
    assert page.value("getComputedStyle(document.querySelector('.pt.tie .dot')).fill") == before
    page.select("#map-arrows", "lift")
    assert page.value("getComputedStyle(document.querySelector('.arrow.flat')).display") == "none"
    assert page.value("getComputedStyle(document.querySelector('.arrow.lift')).display") != "none"
    assert page.messages == []


@pytest.mark.programs
def test_arrows_are_the_residuals_of_report_json(page: Browser, simulated: Path) -> None:
    """Their lengths on the drawing, by the key beneath, are those of the residuals in report.json."""
    report = report_of(simulated)
    key = page.value("document.querySelector('text.scale:not(.length)').textContent")
    metres = {"m": 1.0, "cm": 0.01, "mm": 0.001}
    number, unit = re.search(r"residual of ([\d.]+) (\w+)", key).groups()
    start, _, tip = numbers_in(page.value("document.querySelectorAll('path.scale')[1].getAttribute('d')"))[:3]
    per_metre = (tip - start) / (float(number) * metres[unit])
    for row in report["control_points"][:5]:
        is_it = f"(p) => p.querySelector('title').textContent.startsWith('{row['id']} ')"
        mark = f"[...document.querySelectorAll('.pt')].find({is_it})"
        path = page.value(f"{mark}.querySelector('.arrow.flat')?.getAttribute('d')")
        if path is not None:
            drawn = np.array(numbers_in(path)[2:4]) / per_metre
            np.testing.assert_allclose(drawn, [row["east_m"], -row["north_m"]], atol=0.15 / per_metre)


@pytest.mark.programs
def test_move_and_zoom(page: Browser) -> None:
    def state() -> list[float]:
        return page.value(
            "document.querySelector('#block-map .view').getAttribute('transform').match(/-?[\\d.]+/g).map(Number)"
        )

    scale = page.value("document.querySelector('text.length').textContent")
    assert state()[0] == 1.0
    page.wheel("#block-map", -300.0)
    assert state()[0] == 1.0  # the wheel alone scrolls the page
    page.wheel("#block-map", -300.0, control=True)
    page.click("#zoom-in")
    zoom, *_, x, y = state()
    assert zoom > 2.0
    assert page.value("document.querySelector('text.length').textContent") != scale
    assert page.value("document.querySelectorAll('.graticule text').length") >= 2
    page.drag("#block-map", 60.0, 30.0)
    assert state()[-2] > x and state()[-1] > y
    page.hover("#block-map")
    lon_lat = re.findall(r"-?\d+\.\d+", page.value("document.querySelector('#map-place').textContent"))
    assert [float(value) for value in lon_lat[:2]] == pytest.approx([43.53, 5.45], abs=0.01)
    page.click("#zoom-out")
    page.click("#zoom-all")
    assert state() == [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]


@pytest.mark.programs
def test_keyboard_alone(page: Browser) -> None:
    """From the top: skip to the content, come to the map, zoom, go from point to point, leave it again."""
    page.press("Tab")
    assert page.value("document.activeElement.className") == "skip"
    seen = []
    for _ in range(60):
        page.press("Tab")
        seen.append(page.value("document.activeElement.id"))
        if seen[-1] == "block-map":
            break
    assert seen[-1] == "block-map"
    assert [name for name in seen if name.startswith("zoom")] == ["zoom-in", "zoom-out", "zoom-all"]
    page.press("+")
    assert page.value("Number(document.querySelector('#block-map').dataset.zoom)") == 2.0
    page.press("n")
    first = page.value("document.querySelector('#block-map').dataset.chosen")
    page.press("n")
    assert page.value("document.querySelector('#block-map').dataset.chosen") not in ("", first)
    page.press("p")
    assert page.value("document.querySelector('#block-map').dataset.chosen") == first
    page.press("Escape")
    assert page.value("document.querySelector('#block-map').dataset.chosen") == ""
    page.press("Tab")
    assert page.value("document.activeElement.id") != "block-map"
    page.value("document.querySelector('table.sortable thead button').focus()")
    page.press("Enter")
    assert page.value("document.activeElement.closest('th').getAttribute('aria-sort')") == "ascending"


@pytest.mark.programs
def test_tables_are_sorted_by_their_numbers(page: Browser, simulated: Path) -> None:
    selector = "#known details:first-of-type table"
    page.value(f"document.querySelector('{selector}').closest('details').open = true")
    column = f"[...document.querySelectorAll('{selector} tbody tr')].map((row) => Number(row.cells[1].dataset.value))"
    page.click(f"{selector} thead th:nth-child(2) button")
    found = page.value(column)
    assert found == sorted(row["east_m"] for row in report_of(simulated)["control_points"])
    page.click(f"{selector} thead th:nth-child(2) button")
    assert page.value(column) == found[::-1]


@pytest.mark.programs
def test_what_the_images_show(page: Browser) -> None:
    visible = (
        "[...document.querySelectorAll('.cards .{}')].filter((g) => getComputedStyle(g).display !== 'none').length"
    )
    assert page.value(visible.format("vectors")) == 2
    page.select("#cards-arrows", "field")
    assert page.value(visible.format("vectors")) == 0
    assert page.value(visible.format("field")) == 2


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.programs
def test_it_can_be_read(browser: Browser, result: Path, dark: bool) -> None:
    browser.open(result / "report.html", dark=dark)
    browser.value("for (const part of document.querySelectorAll('details')) part.open = true")
    assert browser.value(PALE) == []
    browser.value("document.querySelector('.note').style.color = '#999999'")
    assert len(browser.value(PALE)) == int(not dark)  # what is too pale is seen


@pytest.mark.programs
def test_those_who_hear_it(page: Browser) -> None:
    """Headings without a gap, tables with headings of rows and columns, names for pictures and controls."""
    levels = page.value("[...document.querySelectorAll('h1, h2, h3')].map((h) => Number(h.tagName[1]))")
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
    assert page.value("document.documentElement.lang") == "en"
    for unnamed in (
        "svg:not([role=img]):not([role=application]):not([aria-hidden])", "svg[role]:not([aria-label])",
        "thead th:not([scope])", "main tbody tr > th:not([scope])", "button:empty:not([aria-label])", "img:not([alt])",
        "[role=region]:not([aria-label])",
    ):  # fmt: skip
        assert page.value(f"document.querySelectorAll({json.dumps(unnamed)}).length") == 0, unnamed
    assert page.value("[...document.querySelectorAll('select, input')].every((e) => e.closest('label'))")
    ids = page.value("[...document.querySelectorAll('[id]')].map((e) => e.id)")
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize(
    ("name", "width", "phone"), [("wall", 2560, False), ("desk", 1400, False), ("phone", 390, True)]
)
@pytest.mark.programs
def test_fits_the_screen(browser: Browser, result: Path, name: str, width: int, phone: bool) -> None:
    """The page is not wider than the screen (wide tables scroll within it); its picture stays."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    browser.open(result / "report.html", width, 844, phone=phone)
    browser.value("for (const part of document.querySelectorAll('details')) part.open = true")
    assert browser.value("[document.documentElement.scrollWidth, innerWidth]") == [width, width]
    picture = PICTURES / f"report_{result.parent.name}_{name}.png"
    browser.picture(picture)
    assert picture.stat().st_size > 50_000


@pytest.mark.programs
def test_print(page: Browser, simulated: Path) -> None:
    """The report is printed on few pages: closed tables with their worst rows, the map as a whole; no appendix."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    printed = PICTURES / "report.pdf"
    page.click("#zoom-in")
    closed = "document.querySelectorAll('details:not([open])').length"
    zoom = "document.querySelector('#block-map').dataset.zoom"
    page.value(f"addEventListener('beforeprint', () => {{ window.seen = [{closed}, {zoom}]; }})")
    page.print(printed)
    assert page.value("window.seen") == [0, "1"]
    assert page.value(zoom) == "2"  # and is as it was afterwards
    content = printed.read_bytes()
    pages = len(re.findall(rb"/Type\s*/Page\b", content))
    assert 4 <= pages <= 8
    page.command("Emulation.setEmulatedMedia", media="print", features=[])
    hidden = "[...document.querySelectorAll({})].filter((e) => e.getClientRects().length).length"
    assert page.value(hidden.format('".controls, nav, #map-point, .appendix"')) == 0
    assert page.value(hidden.format('".verdict"')) == 1
    titles = "[...document.querySelectorAll('section:not(.appendix) > h2')]"
    headings = page.value(f"{titles}.map((e) => e.getClientRects().length)")
    assert len(headings) >= 7 and min(headings) == 1
    rows = "[...t.tBodies[0].rows].filter((r) => r.getClientRects().length).length"
    assert max(page.value(f"[...document.querySelectorAll('table')].map((t) => {rows})")) <= 12
    page.command("Emulation.setEmulatedMedia", media="", features=[])


@pytest.fixture(scope="module")
def ten_images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result of ten images without pixels."""
    block, out = tmp_path_factory.mktemp("ten") / "block", tmp_path_factory.mktemp("ten") / "out"
    run(
        "simulate", output_dir=str(block), images=10, along=[float(angle) for angle in range(-24, 33, 6)], gcps=6,
        checks=20, ties=300, pixels=False, seed=2,
    )  # fmt: skip
    run(
        "adjust", images=sorted(map(str, block.glob("image_*_RPC.TXT"))), output_dir=str(out),
        gcps=str(block / "ground_points.csv"), image_points=str(block / "image_points.csv"), height_datum="ellipsoidal",
    )  # fmt: skip
    return out


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The overall result of a project: three images with pixels, all four steps, one GCP 20 m off."""
    folder = tmp_path_factory.mktemp("project") / "block"
    run("simulate", output_dir=str(folder), images=3, along="-12,0,12", size=256, gcps=6, checks=6, ties=0, relief=60.0)
    text = (folder / "ground_points.csv").read_text()
    lon = re.search(r"^G\d+,gcp,([\d.]+)", text, re.MULTILINE)
    (folder / "ground_points.csv").write_text(text.replace(lon[1], f"{float(lon[1]) + 0.00025:.9f}", 1))
    (folder / "project.toml").write_text(
        'images = ["image_1.tif", "image_2.tif", "image_3.tif"]\ngcps = "ground_points.csv"\nimage_points = '
        '"image_points.csv"\nheight_datum = "ellipsoidal"\ndem = "dem.tif"\n[evaluate]\ntracks = "none"\n'
    )
    run("run", project=str(folder))
    return folder / "result"


@pytest.mark.programs
@pytest.mark.parametrize("block", ["hobart_result", "ten_images", "project"])
def test_number_of_printed_pages(browser: Browser, request: pytest.FixtureRequest, tmp_path: Path, block: str) -> None:
    """A client's report has 4 to 8 pages for 3 to 10 images, overall reports too; none is cut, none nearly empty."""
    browser.open(request.getfixturevalue(block) / "report.html")
    browser.print(tmp_path / "report.pdf")
    assert 4 <= len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "report.pdf").read_bytes())) <= 8
    if gdal.GetDriverByName("PDF") is None:
        pytest.skip("this GDAL reads no PDF")
    check_pages(list(printed_pages(tmp_path / "report.pdf")))


def check_pages(pages: list[np.ndarray]) -> None:
    """The margins of all pages are white, and each page but the last has ink on a third of its height."""
    per_mm = pages[0].shape[1] / A4_MM[0]
    margin = int((MARGIN_MM - 1.0) * per_mm)
    for number, page in enumerate(pages, 1):
        assert page.shape[0] / per_mm == pytest.approx(A4_MM[1], abs=2.0)
        edges = (page[:margin], page[-margin:], page[:, :margin], page[:, -margin:])
        assert min(edge.min() for edge in edges) > 250, f"page {number} is printed beyond its margin"
        lines = np.flatnonzero((page < 200).any(axis=1))
        reach = (lines.max() - lines.min()) / page.shape[0] if len(lines) else 0.0
        assert reach > (0.33 if number < len(pages) else 0.02), f"page {number} is nearly empty"


@pytest.mark.programs
def test_links_within_a_page_have_their_targets(
    project: Path, simulated: Path, hobart_result: Path, ten_images: Path
) -> None:
    """Pages of all steps, the overall page, and pages without a map: no link to nowhere, no id twice."""
    pages = [*project.rglob("report.html"), *(one / "report.html" for one in (simulated, hobart_result, ten_images))]
    assert len(pages) == 8
    for path in pages:
        text = path.read_text(encoding="utf-8")
        ids = re.findall(r'\bid="([^"]+)"', text)
        assert len(ids) == len(set(ids)), path
        assert set(re.findall(r'href="#([^"]*)"', text)) <= set(ids), path
    assert "doubtful" in (project / "report.html").read_text(encoding="utf-8")  # with ids in its reasons


#: Tables and pictures that reach beyond the printed width, with how far.
BEYOND = """[...document.querySelectorAll("table, svg, pre, .tiles, .verdict")].map(
    (e) => [e.tagName, e.getBoundingClientRect().right]).filter(([, right]) => right > innerWidth + 1)"""
A4_MM, MARGIN_MM = (210.0, 297.0), 14.0


def printed_pages(file: Path) -> Iterator[np.ndarray]:
    """Yield the pages of a PDF as grey pixels, rendered by Poppler (through GDAL)."""
    count = len(re.findall(rb"/Type\s*/Page\b", file.read_bytes()))
    for number in range(1, count + 1):
        page = gdal.OpenEx(f"PDF:{number}:{file}", open_options=["DPI=60"])
        yield page.ReadAsArray()[:3].min(axis=0)


@pytest.mark.programs
def test_print_cuts_nothing(browser: Browser, result: Path) -> None:
    """On A4 nothing is wider than the page: by the layout, and by the white margins of the pages as printed."""
    browser.open(result / "report.html", width=round((A4_MM[0] - 2.0 * MARGIN_MM) / 25.4 * 96.0))
    browser.value("for (const part of document.querySelectorAll('details')) part.open = true")
    browser.command("Emulation.setEmulatedMedia", media="print", features=[])
    assert browser.value(BEYOND) == []
    assert browser.value("getComputedStyle(document.querySelector('thead')).display") == "table-header-group"
    browser.command("Emulation.setEmulatedMedia", media="", features=[])
    browser.open(result / "report.html")
    browser.print(printed := PICTURES / f"report_{result.parent.name}.pdf")
    if gdal.GetDriverByName("PDF") is None:
        pytest.skip("this GDAL reads no PDF")
    pages = list(printed_pages(printed))
    check_pages(pages)

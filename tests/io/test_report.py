"""Reports: valid JSON for programs, one complete and safe HTML file for people."""

import json
import math
import os
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shapely.geometry import Polygon

from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.drawing.block_figures import ReportFigures, draw_figures
from hrsi.hrsi_engine.drawing.block_map import BlockMap, TieField, draw_map
from hrsi.hrsi_engine.drawing.target_chips import encode_png
from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.foundation.json_values import json_lines, json_ready
from hrsi.hrsi_engine.io.pages.report import digits_by_sigma, duration, figure, write_report_html, write_report_json

EVIL = '<script>alert("1")</script>&'


def report() -> dict[str, Any]:
    """Return a report of schema 1 with NumPy values, NaN and an id that tries to break out."""
    known = {
        "points": np.int64(30), "rmse_east_m": 0.43, "rmse_north_m": np.float32(0.5), "rmse_height_m": np.nan,
        "rmse_sample_px": np.inf, "rmse_line_px": 0.4,
    }  # fmt: skip
    image = {
        "path": "/data/a.tif", "output": None, "observations": 71, "before_rmse_sample_px": 3.2,
        "before_rmse_line_px": 4.1, "rmse_sample_px": 0.3, "rmse_line_px": 0.3, "rpc_fit_max_px": 2.1e-6,
        "parameters": {"shift_sample": {"value": 3.25, "sigma": 0.05}},
    }  # fmt: skip
    return {
        "schema": 1, "algorithm": "triangulate", "version": "0.1.0", "seconds": {"total": 12.5}, "model": "affine",
        "converged": np.bool_(True), "iterations": 3, "sigma0": 1.02, "observations": 123456, "unknowns": 12,
        "redundancy": 1178.5, "images": {"img_01": image, EVIL: image}, "control": known,
        "check": known | {"ce90_m": 0.812, "le90_m": 1.8},
        "ties": {"points": 3, "observations": 9, "before_rmse_px": 0.58, "rmse_px": 0.18},
        "parameters": {"shift_sample": {"unit": "px", "meaning": EVIL}},
        "outliers": [{"id": EVIL, "image": "img_01", "statistic": 7.3}], "warnings": [EVIL],
        "verdict": {
            "level": "doubtful", "sentence": "2 images, tie points 0.18 px RMSE",
            "reasons": [
                {"code": "few-ties", "level": "doubtful", "message": EVIL, "advice": "give `gcps`", "images": [EVIL],
                 "points": [f"P{k}" for k in range(40)]},
                {"code": "no-such-code", "level": "doubtful", "message": "more", "advice": "look", "images": [],
                 "points": []},
            ],
        },
        "settings": {"gcp_ids": ["A", "B"], "images": EVIL},
    }  # fmt: skip


def block_map() -> BlockMap:
    ring = np.array([[147.18, -42.78], [147.38, -42.77], [147.40, -42.97], [147.19, -42.97]])
    lonlat = np.array([[147.25, -42.85], [147.30, -42.90], [147.32, -42.92], [np.nan, np.nan]])
    roles = np.array([Role.GCP, Role.CHECK, Role.TIE, Role.CHECK])
    residual = np.array([[0.3, 0.0], [0.0, 0.5], [np.nan, np.nan], [1.0, 1.0]])
    return BlockMap(
        {"img_01": Polygon(ring), EVIL: Polygon(ring + 0.02)},
        lonlat,
        roles,
        residual,
        np.array(["A", EVIL, "T", "lost"]),
    )


class Outline(HTMLParser):
    """Collect tags and text; complain about tags that do not match."""

    VOID = frozenset({"meta", "br", "input"})

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


def outline(path: Path) -> Outline:
    parser = Outline()
    parser.feed(path.read_text(encoding="utf-8"))
    assert parser.open == []
    return parser


def test_json_is_valid_and_plain(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    write_report_json(str(path), report())

    def refuse(name: str) -> None:
        raise AssertionError(name)  # NaN and Infinity are no JSON

    loaded = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    assert loaded["control"]["rmse_height_m"] is None
    assert loaded["control"]["rmse_sample_px"] is None
    assert loaded["control"]["points"] == 30
    assert loaded["converged"] is True
    assert loaded["images"][EVIL]["observations"] == 71
    assert list(loaded) == list(report())
    assert os.listdir(tmp_path) == ["report.json"]


@pytest.mark.parametrize(
    "value",
    [{}, {"none": {}, "nothing": [], "text": "a\nb ä", "number": 1.5},
     {"images": {"A\n": {"x": [1, {"y": math.nan}]}, "ü": {"x": np.arange(3)}}},
     {7: [Role.CHECK, None, {"a": {"b": 1}}], "array": np.array([0.5, np.inf]), "set": {1.5}, "role": Role.GCP},
     {"odd": [{3: np.float64("nan"), 4: np.float32(0.5)}, {"path": Path("a"), "pair": (np.int64(1), np.bool_(True))}]}],
)  # fmt: skip
def test_a_report_has_a_line_for_each_item(value: dict[Any, Any]) -> None:
    text, ready = json_lines(value), json_ready(value)
    assert json.loads(text) == ready
    lines = [line.strip().removesuffix(",") for line in text.split("\n")]
    for held in ready.values():
        if isinstance(held, list):
            assert all(json.dumps(item, ensure_ascii=False) in lines for item in held)
        if isinstance(held, dict):
            assert all(json.dumps({name: item}, ensure_ascii=False)[1:-1] in lines for name, item in held.items())


def test_json_ready_knows_what_reports_hold() -> None:
    value = {1: np.array([1.5, np.nan]), "role": Role.CHECK, "path": Path("a"), "set": (np.str_("x"), None, True)}
    assert json_ready(value) == {"1": [1.5, None], "role": 1, "path": "a", "set": ["x", None, True]}


def test_html_is_complete_and_escaped(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report_html(str(path), report(), draw_figures(ReportFigures(map=block_map())))
    page = outline(path)
    text = path.read_text(encoding="utf-8")
    assert page.tags.count("script") == 1  # HRSI's own, without a source; which one the policy tells
    assert " src=" not in text
    assert "http://" not in text
    assert "https://" not in text
    assert page.text.count(EVIL) >= 5  # warning, image, outlier, setting, map
    for wanted in ("0.430", "0.812", "<\u202f0.00001", "shift_sample", "--gcp-ids", "A, B", "12.5", "123\u202f456"):
        assert wanted in page.text, wanted
    assert page.text.index("2 images, tie points") < page.text.index("σ₀")


def test_html_of_a_bare_report(tmp_path: Path) -> None:
    """Keys may be missing: other algorithms write other reports."""
    path = tmp_path / "report.html"
    write_report_html(str(path), {"algorithm": "adjust", "version": "0.1", "images": {}, "warnings": []})
    page = outline(path)
    assert "Warnings" not in page.text
    assert "svg" not in page.tags
    assert "not tested" in page.text


def test_compared_models_are_tabulated(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    entry = {"control": report()["control"], "check": report()["check"]}
    write_report_html(str(path), report() | {"models": {"shift": entry, "affine": entry}})
    text = outline(path).text
    assert "Models compared" in text
    assert text.count("shift") >= 3


def test_arrows_and_scale_of_the_map() -> None:
    """The 90th percentile arrow is 45 units long; east is right, north is up."""
    data = block_map()
    svg = draw_map(data).svg
    parser = Outline()
    parser.feed(svg)
    assert parser.open == []
    typical = np.percentile([0.3, 0.5, np.sqrt(2.0)], 90.0)
    lines = [line for line in svg.splitlines() if 'class="arrow flat"' in line]
    vectors = []
    for line in lines:
        path = line.split('class="arrow flat" d="M')[1]
        start, tip = (np.array(p.split(","), dtype=float) for p in path.split("L")[:2])
        vectors.append(tip - start)
    np.testing.assert_allclose(vectors, np.array([[0.3, 0.0], [0.0, -0.5]]) * 45.0 / typical, atol=0.11)
    assert "nan" not in svg


def test_a_map_across_the_date_line_and_of_one_point() -> None:
    ring = np.array([[179.9, 10.0], [-179.9, 10.0], [-179.9, 9.9], [179.9, 9.9]])
    data = BlockMap(
        {"a": Polygon(ring)}, np.array([[180.0, 9.95]]), np.array([1]), np.array([[0.1, 0.1]]), np.array(["p"])
    )
    assert "2 km on the ground" in draw_map(data).svg  # 0.2 degrees at 10 degrees north are 22 km
    lone = BlockMap({}, np.array([[5.0, 44.0]]), np.array([0]), np.array([[0.0, 0.0]]), np.array(["p"]))
    assert 'class="pt gcp"' in draw_map(lone).svg
    nothing = BlockMap({}, np.empty((0, 2)), np.empty(0), np.empty((0, 2)), np.empty(0))
    assert draw_map(nothing).svg == ""


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.12345, "0.123"),
        (1.2e-5, "0.000"),
        (0.0, "0.000"),
        (-6.23e-4, "−0.001"),
        (-1e-5, "0.000"),
        (1234567, "1\u202f234\u202f567"),
        (-25432.1, "−25\u202f432.100"),
        ("x", "x"),
    ],
)
def test_figures(value: Any, text: str) -> None:
    assert figure(value) == text


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (4.647430806, 0.184267, "4.65"),
        (-1234.5678, 12.3, "−1\u202f235"),
        (-0.0046, 0.21, "0.00"),
        (2.204e-5, 3.1e-6, "2.20·10⁻⁵"),
        (1.2e-6, 3.1e-5, "0.1·10⁻⁵"),
        (0.5, None, "0.500"),
        (None, 0.1, "–"),
    ],
)
def test_an_estimate_has_the_digits_that_its_sigma_allows(value: Any, sigma: Any, text: str) -> None:
    """Two digits of the sigma, as the GUM (JCGM 100:2008, 7.2.6) has it."""
    assert digits_by_sigma(value, sigma) == text


def test_what_should_be_small_is_told_to_be() -> None:
    assert figure(2.1e-6, 5) == "<\u202f0.00001"
    assert (duration(0.58), duration(135.7)) == ("0.6\u00a0s", "2 min 15 s")


def test_many_tie_points_are_drawn_as_cells() -> None:
    """Every tie point is in a cell, which has the figures of its points: the root mean square of their residuals."""
    rng = np.random.default_rng(4)
    lonlat = np.column_stack([rng.uniform(5.0, 5.1, 20000), rng.uniform(43.0, 43.1, 20000)])
    ties = TieField(lonlat, np.full(20000, 0.3), np.full(20000, 2.0), np.repeat([2, 4], 10000))
    known = np.array([[5.05, 43.05]])
    drawn = draw_map(BlockMap({}, known, np.array([0]), np.array([[0.1, 0.1]]), np.array(["G"]), ties=ties))
    cells = drawn.data["cells"]
    assert sum(cells["count"]) == 20000
    assert drawn.svg.count("data-c=") == len(cells["count"]) <= 61 * 61
    assert set(cells["residual"]) == {0.3}
    assert set(cells["sigma"]) == {2.0}
    assert np.average(cells["rays"], weights=cells["count"]) == pytest.approx(3.0, abs=0.01)
    assert len(drawn.svg) < 600_000


def test_degrees_of_the_map_and_back() -> None:
    """The polynomials of the page's script lead from the drawing to degrees and back, over 300 km too."""
    ring = np.array([[4.0, 60.0], [9.0, 60.0], [9.0, 62.5], [4.0, 62.5]])
    points = np.array([[4.5, 60.3], [6.5, 61.2], [8.9, 62.4]])
    drawn = draw_map(
        BlockMap({"a": Polygon(ring)}, points, np.zeros(3, int), np.zeros((3, 2)), np.array(["a", "b", "c"]))
    )
    place = np.array([
        [float(number) for number in line.split("translate(")[1].split(")")[0].split()]
        for line in drawn.svg.splitlines() if 'class="pt gcp"' in line
    ])  # fmt: skip
    assert_maps(drawn.data["toDrawing"], points - drawn.data["origin"], place, 2.0)  # drawing units, of 900
    back = assert_maps(drawn.data["toDegrees"], place / 100.0, points - drawn.data["origin"], 0.02)
    assert back.shape == (3, 2)


def assert_maps(terms: list[list[float]], uv: np.ndarray, expected: np.ndarray, within: float) -> np.ndarray:
    """Evaluate polynomials of 1, u, v, u², uv, v² and compare."""
    u, v = uv.T
    found = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v]) @ np.array(terms).T
    np.testing.assert_allclose(found, expected, atol=within)
    return found


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    for write in (write_report_json, write_report_html):
        with pytest.raises(OutputError, match="cannot be written"):
            write(str(tmp_path / "none" / "report"), report())


def test_chip_pixels_are_a_png_that_others_read() -> None:
    grey = np.random.default_rng(3).integers(0, 256, (37, 52)).astype(np.uint8)
    decoded = cv2.imdecode(np.frombuffer(encode_png(grey), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded, grey)


def test_verdict_opens_the_page_and_leads_to_its_explanation(tmp_path: Path) -> None:
    """Reasons stand before all figures, escaped; a code with a section of docs/verdict.md links to its text below."""
    write_report_html(str(tmp_path / "report.html"), report())
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.index("2 images, tie points 0.18 px RMSE") < page.index("<dt>CE90") < page.index("<h2>Notes")
    assert EVIL not in page
    assert "give <code>gcps</code>" in page
    assert "P11 … (40 in all)" in outline(tmp_path / "report.html").text
    assert page.index('href="#about-few-ties"') < page.index('id="about-few-ties"')
    assert "an error in one of them cannot be detected" in page[page.index('id="about-few-ties"') :]
    assert "#about-no-such-code" not in page

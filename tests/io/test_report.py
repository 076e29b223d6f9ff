"""Reports: valid JSON for programs, one complete and safe HTML file for people."""

from __future__ import annotations

import json
import os
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shapely.geometry import Polygon

from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.drawing.block_map import block_map_svg
from hrsi.hrsi_engine.drawing.target_chips import png_bytes
from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.foundation.json_values import json_ready
from hrsi.hrsi_engine.io.pages import figure
from hrsi.hrsi_engine.io.report import BlockMap, write_report_html, write_report_json

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
        "outliers": [{"id": EVIL, "image": "img_01", "statistic": 7.3}], "warnings": [EVIL],
        "verdict": {
            "level": "doubtful", "sentence": "2 images tied to 0.18 px",
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

    VOID = frozenset({"meta", "br"})

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


def test_json_ready_knows_what_reports_hold() -> None:
    value = {1: np.array([1.5, np.nan]), "role": Role.CHECK, "path": Path("a"), "set": (np.str_("x"), None, True)}
    assert json_ready(value) == {"1": [1.5, None], "role": 1, "path": "a", "set": ["x", None, True]}


def test_html_is_complete_and_escaped(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report_html(str(path), report(), block_map())
    page = outline(path)
    text = path.read_text(encoding="utf-8")
    assert "script" not in page.tags
    assert "<script" not in text
    assert "http://" not in text
    assert "https://" not in text
    assert page.text.count(EVIL) >= 5  # warning, image, outlier, setting, map
    for wanted in ("0.430", "0.812", "7.3", "2.10e-06", "shift_sample", "--gcp-ids", "A, B", "12.5", "123\u202f456"):
        assert wanted in page.text, wanted
    assert page.text.index("Warnings") < page.text.index("sigma0")


def test_html_of_a_bare_report(tmp_path: Path) -> None:
    """Keys may be missing: other algorithms write other reports."""
    path = tmp_path / "report.html"
    write_report_html(str(path), {"algorithm": "adjust", "version": "0.1", "images": {}, "warnings": []})
    page = outline(path)
    assert "Warnings" not in page.text
    assert "svg" not in page.tags
    assert "None." in page.text


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
    svg = block_map_svg(data)
    parser = Outline()
    parser.feed(svg)
    assert parser.open == []
    typical = np.percentile([0.3, 0.5, np.sqrt(2.0)], 90.0)
    lines = [line for line in svg.splitlines() if 'class="arrow gcp"' in line or 'class="arrow check"' in line]
    vectors = []
    for line in lines:
        start, tip = (np.array(p.split(","), dtype=float) for p in line.split('d="M')[1].split("L")[:2])
        vectors.append(tip - start)
    np.testing.assert_allclose(vectors, np.array([[0.3, 0.0], [0.0, -0.5]]) * 45.0 / typical, atol=0.11)
    assert "nan" not in svg


def test_a_map_across_the_date_line_and_of_one_point() -> None:
    ring = np.array([[179.9, 10.0], [-179.9, 10.0], [-179.9, 9.9], [179.9, 9.9]])
    data = BlockMap(
        {"a": Polygon(ring)}, np.array([[180.0, 9.95]]), np.array([1]), np.array([[0.1, 0.1]]), np.array(["p"])
    )
    assert "2 km on the ground" in block_map_svg(data)  # 0.2 degrees at 10 degrees north are 22 km
    lone = BlockMap({}, np.array([[5.0, 44.0]]), np.array([0]), np.array([[0.0, 0.0]]), np.array(["p"]))
    assert "circle" in block_map_svg(lone)
    nothing = BlockMap({}, np.empty((0, 2)), np.empty(0), np.empty((0, 2)), np.empty(0))
    assert block_map_svg(nothing) == ""


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.12345, "0.123"),
        (1.2e-5, "1.20e-05"),
        (0.0, "0.000"),
        (-0.00123, "-1.23e-03"),
        (1234567, "1\u202f234\u202f567"),
        ("x", "x"),
    ],
)
def test_figures(value: Any, text: str) -> None:
    assert figure(value) == text


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    for write in (write_report_json, write_report_html):
        with pytest.raises(OutputError, match="cannot be written"):
            write(str(tmp_path / "none" / "report"), report())


def test_chip_pixels_are_a_png_that_others_read() -> None:
    grey = np.random.default_rng(3).integers(0, 256, (37, 52)).astype(np.uint8)
    decoded = cv2.imdecode(np.frombuffer(png_bytes(grey), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded, grey)


def test_verdict_opens_the_page_and_leads_to_its_explanation(tmp_path: Path) -> None:
    """Reasons stand before all figures, escaped; a code with a section of docs/verdict.md links to its text below."""
    write_report_html(str(tmp_path / "report.html"), report())
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.index("2 images tied to 0.18 px") < page.index("Warnings") < page.index("<h2>Adjustment</h2>")
    assert EVIL not in page
    assert "give <code>gcps</code>" in page
    assert "P11 … (40 in all)" in page
    assert page.index('href="#about-few-ties"') < page.index('id="about-few-ties"')
    assert "an error in one of them would not show" in page[page.index('id="about-few-ties"') :]
    assert "#about-no-such-code" not in page

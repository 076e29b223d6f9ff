"""A column is declared once, and tables, files, titles and documentation have it from there.

What is given and not declared, or declared and not given, is an error that says what to do.
"""

import re
import sqlite3
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from list_layers import declared_classes
from osgeo import gdal

from hrsi.hrsi_engine.io.geopackage.declared_layers import ImagePointRows, ResidualRows, TiePointRows
from hrsi.hrsi_engine.io.geopackage.layer_styles import NEEDED, STYLES, default_style
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.geopackage.typed_rows import FloatColumn, LayerRows, column

ROOT = Path(__file__).resolve().parents[2]
CLASSES = declared_classes()
VALUES = {str: np.array(["a", "b"]), float: np.array([0.5, np.nan]), int: np.array([3, 4]), bool: np.array([1, 0]) > 0}


def columns_of(rows: type[LayerRows]) -> dict[str, np.ndarray]:
    """Return two rows of sound values."""
    return {name: VALUES[said.kind] for name, said in rows.declared.items()}


@pytest.mark.parametrize("rows", CLASSES)
def test_columns_that_are_not_as_declared_are_refused(rows: type[LayerRows]) -> None:
    sound = columns_of(rows)
    assert list(rows(**sound)) == list(rows.declared)
    with pytest.raises(
        TypeError,
        match=rf"`{rows.__name__}` of {rows.__module__.rpartition('.')[2]}.py does not declare the column 'mood'",
    ):
        rows(**sound, mood=VALUES[float])
    for name, said in rows.declared.items():
        assert said.description
        with pytest.raises(TypeError, match=f"declares the column '{name}', which is not given: give it"):
            rows(**{other: values for other, values in sound.items() if other != name})
        wrong = VALUES[float] if said.kind is not float else VALUES[str]
        with pytest.raises(TypeError, match=f"declares '{name}' as {said.kind.__name__}"):
            rows(**{**sound, name: wrong})


def test_columns_of_one_length() -> None:
    sound = columns_of(TiePointRows)
    with pytest.raises(TypeError, match="differ in length"):
        TiePointRows(**{**sound, "height": np.zeros(3)})


def test_rows_of_a_level_have_its_columns_and_no_others() -> None:
    sound = columns_of(ResidualRows)
    common = {name: sound[name] for name, said in ResidualRows.declared.items() if not said.level and name != "level"}
    on_ground = {name: sound[name] for name, said in ResidualRows.declared.items() if said.level == "ground"}
    rows = ResidualRows.of_level("ground", 2, **common, **on_ground)
    assert np.isnan(rows.residual_sample_px).all() and rows.level.tolist() == ["ground", "ground"]
    with pytest.raises(TypeError, match="'residual_sample_px' for another level than 'ground'"):
        ResidualRows.of_level("ground", 2, **common, **on_ground, residual_sample_px=np.zeros(2))
    with pytest.raises(TypeError, match="does not declare the column 'mood'"):
        ResidualRows.of_level("ground", 2, **common, **on_ground, mood=np.zeros(2))
    with pytest.raises(TypeError, match="declares the column 'residual_east_m', which is not given"):
        ResidualRows.of_level("ground", 2, **common)
    both = rows.concatenate(rows)
    assert len(both.flag) == len(both.residual_east_m) == 4


def test_a_declared_column_is_in_file_form_and_description(tmp_path: Path) -> None:
    """The one line of a new column: here in a class of its own."""

    class WiderRows(ImagePointRows):
        """Image points with the time of their line."""

        time_s: FloatColumn = column("Seconds since the first line", "s")

    rows = WiderRows(**columns_of(ImagePointRows), time_s=np.array([1.0, 2.0]))
    path = tmp_path / "block.gpkg"
    write_geopackage(str(path), [Layer("image_points", "PointZ", 4979, np.zeros((2, 3)), rows)])
    dataset = gdal.OpenEx(str(path))
    assert [feature.GetField("time_s") for feature in dataset.GetLayerByName("image_points")] == [1.0, 2.0]
    with sqlite3.connect(path) as database:
        ((text,),) = database.execute("SELECT description FROM gpkg_data_columns WHERE column_name = 'time_s'")
        ((said,),) = database.execute("SELECT description FROM gpkg_contents WHERE table_name = 'image_points'")
        ((qml,),) = database.execute("SELECT styleQML FROM layer_styles WHERE f_table_name = 'image_points'")
    assert (text, said) == ("Seconds since the first line, s", "Image points with the time of their line")
    titles = {alias.get("field"): alias.get("name") for alias in ET.fromstring(qml).iter("alias")}
    assert titles["time_s"] == "Time s (s)" and titles["residual_line_px"] == "Residual line (px)"


def test_empty_layers_have_the_declared_types(tmp_path: Path) -> None:
    path = tmp_path / "empty.gpkg"
    empty = TiePointRows(**dict.fromkeys(TiePointRows.declared, np.empty(0)))
    write_geopackage(str(path), [Layer("tie_points", "PointZ", 4979, np.zeros((0, 3)), empty)])
    dataset = gdal.OpenEx(str(path))
    definition = dataset.GetLayerByName("tie_points").GetLayerDefn()
    types = {definition.GetFieldDefn(k).GetName(): definition.GetFieldDefn(k).GetTypeName() for k in range(6)}
    assert (types["id"], types["views"], types["height"]) == ("String", "Integer64", "Real")


class _Recorder(dict):
    """Columns that remember which of them a style looked at."""

    asked: set[str]

    def __getitem__(self, name: str) -> object:
        self.asked.add(name)
        return super().__getitem__(name)


@pytest.mark.parametrize("layer", STYLES)
def test_styles_name_declared_columns_only(layer: str) -> None:
    """In Python, and in the expressions of the QML: ``"residual_east_m"``, ``attr="reason"``."""
    name = layer.removesuffix("_utm").removesuffix("_wgs84")
    fitting = [rows for rows in CLASSES if rows.layer == name and NEEDED.get(layer, set()) <= rows.declared.keys()]
    assert fitting, f"no class of declared_layers.py has the layer of the style {layer!r}"
    for rows in fitting:
        if name == "residuals" and "first_sample" in rows.declared:
            continue  # those of `register` are a table without geometry, and have no style
        words = {"level": ["ground", "image"], "role": ["gcp", "tie"], "reason": ["", "far"]}
        known = {name: np.array(two) for name, two in words.items() if name in rows.declared}
        fields = _Recorder(columns_of(rows) | known)
        fields.asked = set()
        style = default_style(layer, fields, 1e4)
        texts = [text for part in ET.fromstring(style.qml).iter() for key, text in part.attrib.items() if key != "name"]
        in_qml = {found for text in texts for found in re.findall(r'"(\w+)"', text)}
        assert fields.asked | in_qml <= rows.declared.keys()


def test_the_page_is_what_is_declared() -> None:
    found = subprocess.run(
        [sys.executable, ROOT / "scripts/list_layers.py", "--check"], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr

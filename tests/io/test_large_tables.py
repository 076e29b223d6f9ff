"""A table written column by column is what Python's `csv` reads back, and a large block's layers are a selection."""

import csv
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.points import Role
from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.io.geopackage.layer_tables import read_layer_table, replace_layers
from hrsi.hrsi_engine.io.geopackage.layers import write_geopackage
from hrsi.hrsi_engine.io.large_tables import read_large_table, write_large_table
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.point_files.kept_columns import COMPLETE_FILES
from hrsi.hrsi_engine.results.layers import block_layers
from hrsi.hrsi_engine.results.residuals import compute_residuals
from hrsi.hrsi_engine.results.tables import iterate_tables, select_rows


def test_every_kind_of_column_is_read_back(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    count = 3000
    table = {
        "id": np.array([f"P{row}" for row in range(count)]),
        "text": np.array(["", "Ångström", 'a "b", c', "line\nbreak", "点"])[np.arange(count) % 5],
        "lon": random.uniform(-180.0, 180.0, count),
        "sample": random.normal(size=count) * 10.0 ** random.integers(-7, 6, count),
        "missing": np.where(random.random(count) < 0.3, np.nan, -0.5), "nothing": np.full(count, np.inf),
        "integer": random.integers(-(2**40), 2**40, count), "flag": random.random(count) < 0.5,
    }  # fmt: skip
    chunks = [{name: column[part] for name, column in table.items()} for part in (slice(0, 1200), slice(1200, None))]
    write_large_table(str(tmp_path / "t.csv"), chunks)
    with open(tmp_path / "t.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(table) and len(rows) == count
    for name, step in (("lon", 1e-10), ("sample", 1e-6), ("missing", 1e-6)):
        found = np.array([float(row[name]) if row[name] else np.nan for row in rows])
        np.testing.assert_allclose(found, table[name], rtol=0.0, atol=0.501 * step)
    for name in ("id", "text"):
        assert [row[name] for row in rows] == table[name].tolist()
    for name in ("integer", "flag"):
        assert [int(row[name]) for row in rows] == table[name].astype(int).tolist()
    assert {row["nothing"] for row in rows} == {""}
    columns = read_large_table(str(tmp_path / "t.csv"))
    assert columns["text"].tolist() == table["text"].tolist() and columns["flag"].tolist() == table["flag"].tolist()
    np.testing.assert_array_equal(np.isnan(columns["missing"]), np.isnan(table["missing"]))


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"t\.csv"):
        write_large_table(str(tmp_path / "none" / "t.csv"), [{"id": np.arange(3)}])


@pytest.mark.parametrize(("count", "least", "most"), [(100_000, 100_000, 100_000), (2_000_000, 10_000, 100_000)])
def test_layers_of_a_usual_block_are_complete_and_those_of_millions_are_drawn_at_once(
    count: int, least: int, most: int
) -> None:
    """Fifty images with 2000 measurements each; QGIS draws a hundred thousand points in a second."""
    block = mock.Mock(known=np.zeros(count, dtype=bool))
    block.points.role, block.measurements.point = np.full(count, Role.TIE), np.arange(count)
    result = mock.Mock(block=block, positions=np.zeros((count, 3)), has_residual=~block.known)
    assert least <= len(select_rows(result, mock.Mock(statistic=np.linspace(0.0, 3.0, count))).measurements) <= most


def test_of_many_image_points_the_layers_show_a_selection_and_readers_get_all(tmp_path: Path) -> None:
    """The layers have the worst and the known points; whoever names a layer gets the same points as of a full one."""
    block, _, _ = blocks.block(gcps=6, checks=5, ties=300)
    result = adjust(block, AdjustOptions(model="shift"))
    left, ids = compute_residuals(result), [image.id for image in block.images]
    shown = select_rows(result, left, largest=500, sample=100)
    assert not shown.is_complete and 100 <= len(shown.measurements) < 180 and shown.count == len(block.measurements)
    statistic = np.nan_to_num(left.statistic)
    known = np.flatnonzero(block.known[block.measurements.point])
    assert {*np.argsort(statistic)[-50:].tolist(), *known.tolist()} <= set(shown.measurements.tolist())
    (tmp_path / "all").mkdir()
    file, full_file = str(tmp_path / "block.gpkg"), str(tmp_path / "all" / "block.gpkg")
    write_geopackage(file, block_layers(result, left, (), shown))
    write_geopackage(full_file, block_layers(result, left))
    for name, parts in iterate_tables(result, left, shown).items():
        write_large_table(str(tmp_path / COMPLETE_FILES[name]), parts)
    assert len(read_layer_table(file, "image_points")["sample"]) == shown.count
    for adjusted in (False, True):
        given, full = (
            read_points(f"{path}|layername=image_points", image_ids=ids, adjusted=adjusted).image
            for path in (file, full_file)
        )
        assert given is not None and full is not None and given.ids.tolist() == full.ids.tolist()
        np.testing.assert_allclose(given.xy, full.xy, rtol=0.0, atol=6e-7)
        points, all_points = (
            read_points(f"{path}|layername=ground_points", adjusted=adjusted).ground for path in (file, full_file)
        )
        assert points is not None and all_points is not None and points.ids.tolist() == all_points.ids.tolist()
        np.testing.assert_allclose(points.ground, all_points.ground, rtol=0.0, atol=6e-7)
        np.testing.assert_allclose(points.sigma_m, all_points.sigma_m, rtol=0.0, atol=6e-7)
    replace_layers(file, block_layers(result, left))  # a session saves all rows into the file
    assert not list(tmp_path.glob("*.csv"))

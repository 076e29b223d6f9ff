"""A table written column by column is what Python's `csv` reads back, and a large block's layers are a selection."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.io.large_tables import read_large_table, write_large_table


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

"""CSV files that NumPy's reader understands say what the reader of all others says, bit for bit."""

from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import csv_text

HEAD = "id,image,sample,line\n"


def both(path: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, np.ndarray] | str]:
    """Return the columns, or the error, by each reader."""
    found: list[dict[str, np.ndarray] | str] = []
    by_numpy = csv_text._columns_by_numpy
    for reader in (lambda *_file: None, by_numpy):
        monkeypatch.setattr(csv_text, "_columns_by_numpy", reader)
        try:
            found.append(csv_text.read(str(path)).columns)
        except InputError as error:
            found.append(str(error))
    return found


def same(first: dict[str, np.ndarray] | str, second: dict[str, np.ndarray] | str) -> bool:
    if isinstance(first, str) or isinstance(second, str):
        return first == second
    return first.keys() == second.keys() and all(
        first[name].dtype == second[name].dtype and first[name].tobytes() == second[name].tobytes() for name in first
    )


def numbers(count: int) -> list[str]:
    """Return numbers of every size and length, as Python and others write them."""
    random = np.random.default_rng(7)
    values = random.normal(size=count) * 10.0 ** random.integers(-30, 30, count)
    forms = [
        repr,
        "{:.3f}".format,
        "{:.17g}".format,
        "{:e}".format,
        "{:+.1E}".format,
        "{:.0f}".format,
        "{:.25f}".format,
    ]
    return [forms[row % len(forms)](value) for row, value in enumerate(values.tolist())]


def test_numbers_are_those_of_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = [
        *numbers(20_000),
        "-0",
        "0",
        ".5",
        "5.",
        "-.25",
        "1e22",
        "1e23",
        "9007199254740993",
        "123456789012345678901",
    ]
    path = tmp_path / "points.csv"
    path.write_text(HEAD + "".join(f"P{row},A,{text},{row}\n" for row, text in enumerate(texts)))
    by_numpy = both(path, monkeypatch)[1]
    assert isinstance(by_numpy, dict)
    assert by_numpy["sample"].tobytes() == np.array([float(text) for text in texts]).tobytes()


def test_blocks_are_put_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_text, "_NUMPY_ROWS", 100)
    path = tmp_path / "points.csv"
    path.write_text("# a comment\n" + HEAD + "\n".join(f"P{row},IMG_{row % 7},{row}.25, {-row}" for row in range(999)))
    assert csv_text._columns_by_numpy(str(path), "utf-8", ",", 4, {"id": 0, "sample": 2}) is not None
    plain, by_numpy = both(path, monkeypatch)
    assert same(plain, by_numpy) and len(plain["id"]) == 999  # type: ignore[index]


@pytest.mark.parametrize("rows", [
    "A,I,1,2\r\nB,I,3,4\r\n", "A,I,1,2\n\n  \nB,I,3,4", "A,I,,\nB,I,nan,NULL\n", '"A, b",I,1,2\n', "Å,I,1,2\n",
    "A,I,1,2\nB,I,3\n", "A,I,1,2,\n", "A,I,1,2,5\n", "A,I,1_000,2\n", "A,I,0x1,2\n", "A,I,1e,2\n", "A,I,inf,2\n",
    "A,I,1e999,2\n", "A,I,1 2,3\n", ",,,\nA,I,1,2\n", "A,I,1,2\rB,I,3,4\r", "A,I,1\x00,2\n",
    " A ,\tI\t, 1 ,2 \n", "A,I,--1,2\n",
    "A,I,1,2\n# no comment here\n", f"A,{'I' * 300},1,2\n", "",
])  # fmt: skip
def test_what_is_not_plain_is_left_to_the_other_reader(
    rows: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes((HEAD + rows).encode())
    plain, by_numpy = both(path, monkeypatch)
    assert same(plain, by_numpy), (plain, by_numpy)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_separators(separator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "points.csv"
    for number in ("1.5", "1,5"):
        path.write_text((HEAD + "A,I,N,2\nB,I,N,4\n").replace(",", separator).replace("N", number))
        plain, by_numpy = both(path, monkeypatch)
        assert same(plain, by_numpy) and plain["sample"].tolist() == [1.5, 1.5]  # type: ignore[index]

"""The public API is described, and the check that says so sees what is missing."""

import pytest

pytest.importorskip("numpydoc")
import check_docstrings

from hrsi.hrsi_engine.adjustment import AdjustOptions
from hrsi.hrsi_engine.io.point_files.csv_text import write_csv
from hrsi.hrsi_engine.surface.grid_surface import ConstantHeight


def public_api() -> dict[str, object]:
    return check_docstrings.public_api()


def test_the_faces_show_what_a_user_starts_from():
    names = {name.removeprefix(f"{check_docstrings.ENGINE}.") for name in public_api()}
    assert {
        "camera.rpc.RPC.project",
        "block.assembly.assemble",
        "adjustment.solver.adjust",
        "io.rasters.images.open_image",
    } <= names


def undescribed(first, second=1):
    """Return nothing that is told."""
    raise ValueError(first)


def test_missing_sections_are_seen(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(write_csv, "__doc__", "Write a table.\n\nParameters\n----------\npath : str\n    The file.")
    found = list(check_docstrings.faults_of("hrsi.hrsi_engine.io.point_files.csv_text.write_csv", write_csv))
    assert found == ["PR01 header, rows not described"]
    assert check_docstrings.raises(undescribed) == {"ValueError"}


def test_options_and_methods_of_a_protocol_are_described_elsewhere():
    assert {"model", "reject_sigma"} <= check_docstrings.told_by_options(AdjustOptions)
    assert check_docstrings.AS_ANOTHER.match(ConstantHeight.heights.__doc__ or "")[1] == "HeightSurface.heights"

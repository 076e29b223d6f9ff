"""The report's page stays small however many observations a block has: what is drawn is thinned."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hrsi.processing_algorithms import run

MOST_BYTES = 2_000_000


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("block") / "block"
    run("simulate", output_dir=str(folder), size=1000, gcps=8, checks=10, ties=4000, pixels=False, seed=5)
    return folder


def page_of(block: Path, out: Path, ties: int) -> tuple[int, int]:
    """Return the observations of a block with its first tie points only, and the bytes of its page."""
    header, *rows = (block / "image_points.csv").read_text(encoding="utf-8").splitlines()
    tie_rows = [row for row in rows if row.startswith("T")]
    kept = [row for row in rows if not row.startswith("T")] + tie_rows[: 2 * ties]
    out.mkdir()
    table = out / "points.csv"
    table.write_text("\n".join([header, *kept, ""]), encoding="utf-8")
    run(
        "adjust", images=[str(path) for path in sorted(block.glob("image_*_RPC.TXT"))],
        gcps=str(block / "ground_points.csv"), image_points=str(table), output_dir=str(out / "result"),
        model="shift", write="none", height_datum="ellipsoidal",
    )  # fmt: skip
    report = json.loads((out / "result" / "report.json").read_text(encoding="utf-8"))
    return report["observations"], (out / "result" / "report.html").stat().st_size


def test_page_does_not_grow_with_the_block(block: Path, tmp_path: Path) -> None:
    few, small = page_of(block, tmp_path / "few", 500)
    many, large = page_of(block, tmp_path / "many", 4000)
    print(f"{few} observations: {small / 1e3:.0f} kB; {many} observations: {large / 1e3:.0f} kB")
    assert many > 6 * few
    assert large < 1.3 * small < MOST_BYTES

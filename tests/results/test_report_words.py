"""What the report tells beside numbers: units and meanings, sensors and times, colours that everybody tells apart."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.refinement.model_table import describe_parameter
from hrsi.hrsi_engine.refinement.models import MODELS
from hrsi.hrsi_engine.results.block_results import describe_acquisition


def test_every_parameter_has_unit_and_meaning() -> None:
    for model in MODELS.values():
        for name in model.parameters:
            told = describe_parameter(name)
            assert told["unit"] in {"px", "px/px", "px/px²", "m", "rad"} and told["meaning"], name
    assert describe_parameter("sample_l") == {
        "unit": "px/px",
        "meaning": "correction of the sample, proportional to line",
    }
    assert describe_parameter("p_1") == {"unit": "", "meaning": ""}


@pytest.mark.parametrize(
    ("name", "sensor", "acquired"),
    [("IMG_PHR1B_P_201308051042194_SEN.tif", "Pleiades", "2013-08-05T10:42:19Z"), ("plain.tif", None, None)],
)
def test_acquisition_is_told_where_a_name_or_delivery_states_it(
    tmp_path: Path, name: str, sensor: str | None, acquired: str | None
) -> None:
    path = tmp_path / name
    write_image(path, sample_rpc(), size=(64, 48))
    assert describe_acquisition(open_image(str(path))) == {"sensor": sensor, "acquired": acquired}


# ---- colours ---------------------------------------------------------------------------------------------------------

#: Simulation of colour blindness, for linear RGB (Machado, Oliveira and Fernandes 2009, severity 1).
BLINDNESS = {
    "none": np.eye(3),
    "protan": np.array([[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]]),
    "deutan": np.array([[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]]),
    "tritan": np.array([[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]]),
}  # fmt: skip


def lab(colour: str, seen_with: np.ndarray) -> np.ndarray:
    """Return CIE L*a*b* (D65) of a colour as seen."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.clip(seen_with @ np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4), 0.0, 1.0)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = to_xyz @ linear / [0.9505, 1.0, 1.089]
    f = [value ** (1 / 3) if value > 0.008856 else 7.787 * value + 16 / 116 for value in (x, y, z)]
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def palettes() -> Iterator[dict[str, str]]:
    css = Path(__file__).resolve().parents[2] / "hrsi_engine" / "io" / "pages" / "templates" / "page.css"
    for line in css.read_text(encoding="utf-8").splitlines():
        if "--gcp:" in line:
            parts = (part.split(":") for part in line.strip().rstrip(";").split(";"))
            yield {name.strip(): value.strip() for name, value in parts}


@pytest.mark.parametrize("kind", BLINDNESS)
def test_colours_of_points_differ_for_the_colour_blind(kind: str) -> None:
    """Two colours 20 apart in CIE 1976 are told apart at a glance (a just noticeable difference is 2.3)."""
    for palette in palettes():
        seen = {name: lab(palette[f"--{name}"], BLINDNESS[kind]) for name in ("gcp", "check", "tie", "outlier")}
        apart = {(a, b): np.linalg.norm(seen[a] - seen[b]) for a, b in combinations(seen, 2)}
        assert min(apart.values()) > 20.0, apart

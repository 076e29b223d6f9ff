"""Options whose effect no other test shows: another value gives other layers, tables or rasters than the default."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gdal_files import write_raster
from long_tests import mark_beyond
from osgeo import gdal

from hrsi.hrsi_engine.io.geopackage.layer_tables import geopackage_layers, read_layer_table
from hrsi.processing_algorithms import run

HOBART = Path(__file__).resolve().parents[2] / "examples" / "hobart"
SIMULATED = {"size": 64, "gcps": 12, "checks": 0, "ties": 20, "pixels": False}
Runs = Callable[[str, dict[str, Any]], dict[str, Any]]
LASER = {"laser_passes": 1}
FREE_DEM = {"free_dem": 20.0}
FREE_ORTHO = {"free_ortho": 5.0}


def contents(folder: Path) -> dict[str, Any]:
    """Return what a run has written, but for reports, which repeat the options."""
    found = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == ".gpkg":
            for layer in geopackage_layers(str(path)):
                table = read_layer_table(str(path), layer)
                found[f"{path.name} {layer}"] = repr([(n, c.tolist()) for n, c in table.items() if n != "geometry"])
        elif path.suffix in (".csv", ".TXT"):
            found[path.name] = path.read_text(encoding="utf-8")
        elif path.suffix == ".tif":
            found[path.name] = gdal.Open(str(path)).ReadAsArray().tobytes()
    return found


@pytest.fixture(scope="module")
def without(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """What a run writes without the option; the same run is made once."""
    known: dict[str, dict[str, Any]] = {}

    def run_once(algorithm: str, options: dict[str, Any]) -> dict[str, Any]:
        key = repr((algorithm, options))
        if key not in known:
            folder = tmp_path_factory.mktemp("without") / "out"
            run(algorithm, **options, output_dir=str(folder))
            known[key] = contents(folder)
        return known[key]

    return run_once


@pytest.mark.parametrize(("base", "option"), mark_beyond(3, "thorough", [
    ({}, {"gcp_blunders": 0.5}), ({"gcp_blunders": 0.5}, {"blunder_size": 90.0}),
    ({"wrong_heights": 0.5}, {"wrong_height_size": 99.0}),
    ({}, {"vendor_position": "40,40,40"}), ({}, {"vendor_position_drift": "9,9,9"}),
    ({}, {"vendor_attitude_drift": "1e-3,1e-3,1e-3"}),
    (LASER, {"laser_segment": 100.0}), ({}, FREE_DEM),
    (FREE_DEM, {"free_dem_trees": 0.9}), (FREE_DEM, {"free_dem_tree_height": 60.0}),
    (FREE_DEM, {"free_dem_noise": 9.0}), (FREE_DEM, {"free_dem_common": 9.0}),
    (FREE_DEM, {"free_dem_correlation": 0.0}), (FREE_DEM, {"free_dem_place": 9.0}), ({}, FREE_ORTHO),
    ({}, {"landform": "flat"}),
    (FREE_ORTHO, {"free_ortho_error": 30.0}),
    (FREE_ORTHO, {"free_ortho_corner": 9.0}), (FREE_ORTHO, {"free_ortho_change": 0.9}),
]), ids=str)  # fmt: skip
def test_simulate(base: dict[str, Any], option: dict[str, Any], tmp_path: Path, without: Runs) -> None:
    run("simulate", **SIMULATED | base | option, output_dir=str(tmp_path / "out"))
    assert contents(tmp_path / "out") != without("simulate", SIMULATED | base)


@pytest.mark.parametrize("option", [
    {"kappa": 0.2}, {"threshold": 1.0}, {"super_threshold": 1.0}, {"super_share": 0.5}, {"mask_saturated": False},
], ids=str)  # fmt: skip
def test_interest_points(option: dict[str, Any], tmp_path: Path) -> None:
    """An image of steps and noise, a part of which is saturated."""
    random = np.random.default_rng(3)
    grey = (
        100.0 + 60.0 * np.kron(random.integers(0, 2, (16, 16)), np.ones((16, 16))) + random.normal(0.0, 4.0, (256, 256))
    )
    grey[40:120, 40:120] = np.where(random.random((80, 80)) < 0.9, 255.0, grey[40:120, 40:120])
    path = write_raster(tmp_path / "image.tif", np.clip(grey, 0, 255).astype(np.uint8))
    for name, options in (("without", {}), ("with", option)):
        run("interest-points", images=[path], detector="harris", **options, output_dir=str(tmp_path / name))
    assert contents(tmp_path / "with") != contents(tmp_path / "without")


@pytest.mark.parametrize("option", [{"sigma_gcp_xy": 5.0}, {"sigma_gcp_h": 9.0}], ids=str)
def test_adjust(option: dict[str, Any], tmp_path: Path, without: Runs) -> None:
    base = {
        "images": [str(HOBART / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)],
        "gcps": str(HOBART / "hobart_ground_points.csv"), "image_points": str(HOBART / "hobart_image_points.csv"),
        "gcp_ids": "H003,H022,H024,H035", "report": False,
    }  # fmt: skip
    run("adjust", **base, **option, output_dir=str(tmp_path / "out"))
    assert contents(tmp_path / "out") != without("adjust", base)

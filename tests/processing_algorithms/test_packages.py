"""The plugin runs on what a stock QGIS brings: other packages serve matching or one option, or make it faster."""

import sys

import pytest
from measure_structure import Product

#: What QGIS's installers and packages bring.
STOCK = {"numpy", "scipy", "osgeo", "pyproj", "shapely", "jinja2", "markupsafe", "qgis", "processing"}
#: Modules that are loaded only where their package is there; cv2 is imported by name (`foundation.lazy_names`).
WITH_PACKAGE = {
    "numba": {
        "adjustment.equations.elimination_kernels", "camera.compiled_rpc",
        "foundation.compiled_code",
        "measurement.window_matching.lsm_kernels",
        "ortho.ray_kernels",
        "refinement.compiled_cameras",
    },
    "distributed": {"foundation.workers.cluster", "foundation.workers.scheduling"},
    "rasterio": {"camera.rpc"},
    "pyarrow": {"io.laser_files"},
    "laspy": {"io.surfaces"},
}  # fmt: skip


@pytest.fixture(scope="module")
def importers(product: Product) -> dict[str, set[str]]:
    """The modules that import each outside package, by its first name."""
    found: dict[str, set[str]] = {}
    for one in product.imports:
        if not one.inside:
            found.setdefault(one.target.partition(".")[0], set()).add(one.module)
    return found


@pytest.mark.parametrize("package", WITH_PACKAGE)
def test_packages_that_a_qgis_may_lack_have_one_door(importers: dict[str, set[str]], package: str):
    assert importers[package] == {f"hrsi_engine.{name}" for name in WITH_PACKAGE[package]}


def test_all_else_is_what_a_stock_qgis_brings(importers: dict[str, set[str]]):
    own = {"hrsi"}
    assert set(importers) - set(sys.stdlib_module_names) - own == STOCK | set(WITH_PACKAGE)

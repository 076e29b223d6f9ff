"""The plugin runs on what a stock QGIS brings: other packages make it faster, or serve one option."""

from __future__ import annotations

import ast
import sys

import pytest
from measure_structure import Product

#: What QGIS's installers and packages bring.
STOCK = {"numpy", "scipy", "osgeo", "pyproj", "shapely", "jinja2", "markupsafe", "qgis", "processing"}
#: Modules that are loaded only where their package is there: each has a plain counterpart, or one option needs it.
WITH_PACKAGE = {
    "cv2": {
        "foundation.opencv_filters", "measurement.tile_matching.features",
        "measurement.interest_points.level_regions",
    },
    "numba": {
        "adjustment.equations.elimination_kernels", "camera.compiled_rpc",
        "foundation.compiled_code",
        "measurement.window_matching.lsm_kernels",
        "refinement.compiled_cameras",
    },
    "distributed": {"foundation.workers.cluster", "foundation.workers.scheduling"},
    "rasterio": {"camera.rpc"},
    "pyarrow": {"io.laser_files"},
    "laspy": {"io.surfaces"},
}  # fmt: skip


def outside_packages(tree: ast.AST) -> set[str]:
    """Return the first names of the packages that a module imports, relative ones left out."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").partition(".")[0])
    return found


@pytest.mark.parametrize("package", WITH_PACKAGE)
def test_packages_that_a_qgis_may_lack_have_one_door(product: Product, package: str):
    modules = {name for name, source in product.sources.items() if package in outside_packages(source.tree)}
    assert modules == {f"hrsi_engine.{name}" for name in WITH_PACKAGE[package]}


def test_all_else_is_what_a_stock_qgis_brings(product: Product):
    found = set().union(*(outside_packages(source.tree) for source in product.sources.values()))
    own = {"hrsi"}
    assert found - set(sys.stdlib_module_names) - own == STOCK | set(WITH_PACKAGE)

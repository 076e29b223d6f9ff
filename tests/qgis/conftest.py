"""Fixtures of the QGIS tests, which run in a process of their own: ``pytest tests/qgis --import-mode=importlib``."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsApplication

from hrsi.hrsi_engine.io.rasters.images import close_images
from hrsi.plugin.provider import HrsiProvider
from hrsi.tests.qgis.tiny import TINY


@pytest.fixture(scope="module")
def tiny_provider(qgis_processing: None) -> Iterator[HrsiProvider]:
    """The provider with the tiny algorithm alone."""
    provider = HrsiProvider({TINY.name: TINY})
    QgsApplication.processingRegistry().addProvider(provider)
    yield provider
    QgsApplication.processingRegistry().removeProvider(provider)


@pytest.fixture(scope="module")
def hrsi_provider(qgis_processing: None) -> Iterator[HrsiProvider]:
    """The provider with everything that HRSI registers."""
    provider = HrsiProvider()
    QgsApplication.processingRegistry().addProvider(provider)
    yield provider
    QgsApplication.processingRegistry().removeProvider(provider)
    close_images()  # before the end of GDAL, which the plugin of pytest brings about before that of Python


@pytest.fixture
def run_tiny(tiny_provider: HrsiProvider, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Run the tiny algorithm through Processing and return the options that the engine got."""
    import processing

    def run(**parameters: Any) -> dict[str, Any]:
        given = {"IMAGES": ["a_RPC.TXT"], "OUTPUT_DIR": str(tmp_path / "out")} | parameters
        result = processing.run("hrsi:tinytest", given)
        return json.loads(Path(result["REPORT"]).read_text(encoding="utf-8"))["options"]

    return run

"""Algorithms that reach OpenCV say so: a QGIS may lack it, and not all need it as they do Shapely."""

from __future__ import annotations

import pytest

from hrsi.processing_algorithms import REGISTRY
from hrsi.tests.test_imports import ALL_IMPORTS, MODULES


def reached_from(start: str) -> set[str]:
    """Return the modules of the package that one imports, directly or through others, at any time."""
    seen, open_ones = set(), {start}
    while open_ones:
        module = open_ones.pop()
        seen.add(module)
        open_ones |= {found.target for found in ALL_IMPORTS if found.module == module and found.inside} - seen
    return seen & MODULES


@pytest.mark.parametrize("name", REGISTRY)
def test_packages_are_those_that_the_imports_reach(name: str):
    reached = reached_from(f"processing_algorithms.{name.replace('-', '_')}")
    needs_opencv = any(found.target == "cv2" for found in ALL_IMPORTS if found.module in reached and not found.inside)
    assert ("cv2" in REGISTRY[name].packages) == needs_opencv

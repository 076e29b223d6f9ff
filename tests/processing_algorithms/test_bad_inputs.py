"""Every algorithm refuses or tells bad input, of every kind, at every input, and bad output folders.

The inputs come from the declarations. benchmarks/bad_inputs.py prints the whole matrix; left out here are kinds that
are told by what is read, not by that it cannot be.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from bad_inputs import OUTPUTS, Case, cases, judge, judge_output, reads_pixels
from every_algorithm import GRID, inputs_of
from long_tests import mark_beyond

from hrsi.processing_algorithms import REGISTRY

KINDS = {"missing", "empty", "wrong type", "too long name", "/vsizip"}  # what every input must bear
OUTPUT_KINDS = ("output: in a read-only folder", "output: is a file")


@pytest.fixture(scope="module")
def scene(sound_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(sound_inputs, tmp_path_factory.mktemp("own") / "scene"))


def is_quick(case: Case) -> bool:
    """Return whether a case is for the tests: geoid grids are read in one place, and matching takes its time."""
    if case.role == GRID:
        return case.kind == "missing"
    return case.kind in KINDS and not (case.kind == "/vsizip" and reads_pixels(case.algorithm))


#: All their inputs are those of `adjust`, `tie-points` and `gcps-from-reference`.
AS_OTHERS = ("triangulate", "match")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.wrong_inputs) if name in AS_OTHERS else name for name in REGISTRY]
)
def test_inputs(scene: Path, tmp_path: Path, name: str) -> None:
    algorithm, wrong, count = REGISTRY[name], [], 0
    for key in inputs_of(algorithm):
        for case in cases(algorithm):
            if case.key == key and is_quick(case):
                outcome = judge(case, scene, tmp_path / str(count), set())
                count += outcome is not None
                wrong += [f"{case}: {fault} ({outcome.text[:300]})" for fault in outcome.wrong] if outcome else []
    assert wrong == []
    assert count >= 5 or not inputs_of(algorithm)


@pytest.mark.parametrize("name", [name for name in REGISTRY if "output_dir" in REGISTRY[name].defaults()])
@pytest.mark.parametrize("kind", mark_beyond(1, "wrong_inputs", OUTPUT_KINDS))
def test_output_folders(scene: Path, tmp_path: Path, name: str, kind: str) -> None:
    assert kind in OUTPUTS
    outcome = judge_output(REGISTRY[name], kind, scene, tmp_path / "case")
    assert outcome.wrong == [], outcome.text

"""Every algorithm refuses or tells bad input, of every kind, at every input, and bad output folders.

The inputs come from the declarations. ``make fuzz`` tries the whole matrix; left out otherwise are kinds that are told
by what is read, not by that it cannot be.
"""

import shutil
from pathlib import Path

import pytest
from bad_inputs import OUTPUTS, Case, cases, hanging, hanging_server, judge, judge_output, reads_pixels, sound_telling
from every_algorithm import GRID, inputs_of
from hypothesis import settings
from long_tests import mark_beyond

from hrsi.processing_algorithms import REGISTRY

KINDS = {"missing", "empty", "wrong type", "too long name", "/vsizip"}  # what every input must bear
OUTPUT_KINDS = ("output: in a read-only folder", "output: is a file")


@pytest.fixture(scope="module")
def scene(sound_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(sound_inputs, tmp_path_factory.mktemp("own") / "scene"))


def is_fuzz() -> bool:
    """Return whether ``make fuzz`` runs."""
    return settings().max_examples > 1000


def is_quick(case: Case) -> bool:
    """Return whether a case is for every test run: geoid grids are read in one place, and matching takes its time."""
    if is_fuzz():
        return True
    if case.role == GRID:
        return case.kind == "missing"
    return case.kind in KINDS and not (case.kind == "/vsizip" and reads_pixels(case.algorithm))


#: All their inputs are those of `adjust`, `tie-points` and `gcps-from-reference`.
AS_OTHERS = ("triangulate", "match")


@pytest.mark.fuzz
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.wrong_inputs) if name in AS_OTHERS else name for name in REGISTRY]
)
def test_inputs(scene: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm, wrong, count = REGISTRY[name], [], 0
    monkeypatch.setenv("GDAL_HTTP_TIMEOUT", "1")
    with hanging_server() as address:
        for key, role in inputs_of(algorithm).items():
            told = sound_telling(algorithm, key, scene, tmp_path / key) if is_fuzz() else set()
            chosen = [case for case in cases(algorithm) if case.key == key and is_quick(case)]
            chosen += [Case(algorithm, key, role, "hanging /vsicurl", hanging(address))] * is_fuzz()
            for case in chosen:
                outcome = judge(case, scene, tmp_path / str(count), told)
                count += outcome is not None
                wrong += [f"{case}: {fault} ({outcome.text[:300]})" for fault in outcome.wrong] if outcome else []
    assert wrong == []
    assert count >= 5 or not inputs_of(algorithm)


@pytest.mark.fuzz
@pytest.mark.parametrize("name", [name for name in REGISTRY if "output_dir" in REGISTRY[name].defaults()])
@pytest.mark.parametrize("kind", mark_beyond(1, "wrong_inputs", list(OUTPUTS) if is_fuzz() else OUTPUT_KINDS))
def test_output_folders(scene: Path, tmp_path: Path, name: str, kind: str) -> None:
    outcome = judge_output(REGISTRY[name], kind, scene, tmp_path / "case")
    assert outcome.wrong == [], outcome.text

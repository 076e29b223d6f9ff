"""What a result says of its making: date, command, inputs with their hashes, options, CRS, versions."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from every_algorithm import make_scene, sound_options, words_of

from hrsi.hrsi_engine.foundation.version import VERSION
from hrsi.hrsi_engine.io import lineage
from hrsi.hrsi_engine.io.lineage import file_entry, without_secrets
from hrsi.processing_algorithms import REGISTRY, run
from hrsi.processing_algorithms.interface.command_parser import algorithm_parser
from hrsi.processing_algorithms.interface.options import checked_options

EPOCH, DATE = "1767225600", "2026-01-01T00:00:00Z"
#: Algorithms that take long for what is looked at here; the others go the same way.
SLOW = {"match", "tie-points", "gcps-from-reference", "evaluate", "triangulate"}
WITH_FOLDER = [name for name, algorithm in REGISTRY.items() if "output_dir" in algorithm.defaults()]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    make_scene(folder)
    return folder


@pytest.mark.parametrize("name", [name for name in WITH_FOLDER if name not in SLOW and name != "write-rpc"])
def test_report_tells_its_run(name: str, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything that it takes to follow a run, under the same names for every algorithm."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", EPOCH)
    algorithm = REGISTRY[name]
    given = sound_options(algorithm, scene) | {"output_dir": str(tmp_path / "out")}
    run(name, **{key: value for key, value in given.items() if key in algorithm.defaults()})
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["schema"], report["algorithm"], report["version"], report["date"]) == (1, name, VERSION, DATE)
    assert report["crs"]["positions"] == "EPSG:4979"
    assert {"gdal", "proj", "numpy", "python"} <= report["versions"].keys() and report["platform"]
    # The command, read as the command line reads it, gives the same options again
    program, first, *words = shlex.split(report["command"])
    assert (program, first) == ("hrsi", name)
    again = checked_options(algorithm, algorithm_parser(algorithm).parse_words(words))
    assert again == checked_options(algorithm, report["options"])
    # Every file that was named is there with its hash, which another program computes
    named = [text for text in map(str, _flat(report["options"].values())) if os.path.isfile(text)]
    entries = {entry["path"]: entry for entry in report["inputs"]}
    assert set(named) <= entries.keys()
    for path, entry in entries.items():
        assert entry["sha256"] == hashlib.sha256(Path(path).read_bytes()).hexdigest()
        assert entry["size"] == os.path.getsize(path) and entry["option"] in algorithm.defaults()


def _flat(values) -> list:
    return [item for value in values for item in (value if isinstance(value, list) else [value])]


def test_command_line_is_recorded_as_typed(scene: Path, tmp_path: Path) -> None:
    algorithm = REGISTRY["rpc-info"]
    words = [*words_of(algorithm, sound_options(algorithm, scene)), "--output-dir", str(tmp_path / "an out")]
    subprocess.run([sys.executable, "-m", "hrsi", *words], check=True, capture_output=True, cwd=tmp_path)
    report = json.loads((tmp_path / "an out" / "report.json").read_text())
    assert shlex.split(report["command"]) == ["hrsi", *words]
    assert report["directory"] == str(tmp_path)


def test_input_has_its_crs_and_side_files(scene: Path, tmp_path: Path) -> None:
    image = tmp_path / "a.tif"
    image.write_bytes((scene / "image_1.tif").read_bytes())
    (tmp_path / "a_RPC.TXT").write_bytes((scene / "cameras" / "image_1_RPC.TXT").read_bytes())
    entries = lineage.input_entries({"images": [str(image), "auto"], "dem": [str(scene / "geoid.tif"), str(image)]})
    assert [(entry["option"], Path(entry["path"]).name, entry["crs"]) for entry in entries] == [
        ("images", "a.tif", None), ("images", "a_RPC.TXT", None), ("dem", "geoid.tif", "EPSG:4326"),
    ]  # fmt: skip


def test_large_file_is_sampled_and_a_change_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lineage, "WHOLE_BYTES", 2**20)
    path = tmp_path / "large.bin"
    content = bytearray(os.urandom(24 * 2**20))
    path.write_bytes(content)
    before = file_entry(str(path))
    assert before["sha256"] is None and len(before["sampled_sha256"]) == 64
    os.utime(path, (0, 0))  # a copy has another time, and is the same input
    assert file_entry(str(path))["sampled_sha256"] == before["sampled_sha256"]
    content[12 * 2**20 : 12 * 2**20 + 200_000] = bytes(200_000)
    path.write_bytes(content)
    assert file_entry(str(path))["sampled_sha256"] != before["sampled_sha256"]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("PG:host=a user=me password=secret dbname=b", "PG:host=a user=me password=*** dbname=b"),
        ("/vsicurl/https://me:secret@host/a.tif", "/vsicurl/https://me:***@host/a.tif"),
        ("tls://10.0.0.1:8786 a:b@c.tif", "tls://10.0.0.1:8786 a:b@c.tif"),
    ],
)
def test_no_password_gets_into_a_report(text: str, shown: str) -> None:
    assert without_secrets(text) == shown

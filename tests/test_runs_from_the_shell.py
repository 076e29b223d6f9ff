"""Runs as a person starts them: dry, logged, repeated, on patterns and lists, and each example of the help pages."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from every_algorithm import sound_options, words_of
from long_tests import mark_beyond

from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.interface.declare import Algorithm

BLOCK = [
    "--gcps",
    "block/ground_points.csv",
    "--image-points",
    "block/image_points.csv",
    "--height-datum",
    "ellipsoidal",
]
ADJUST = ["adjust", "block/image_1.tif", "block/image_2.tif", *BLOCK]
#: Examples that match images: seconds each, and the tests of their algorithms run the same.
MATCHING = {"match", "tie-points", "gcps-from-reference", "triangulate", "run"}


@pytest.fixture(scope="module")
def block(sound_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds ``block``, as the examples of the help pages take it, and a table of correspondences."""
    folder = tmp_path_factory.mktemp("work")
    shutil.copytree(sound_inputs, folder / "block")
    shutil.copy(folder / "block" / "points.csv", folder / "grid.csv")
    return folder


@pytest.fixture
def work(block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of one's own to work in, with the block in it."""
    (tmp_path / "w").mkdir()
    shutil.copytree(block / "block", tmp_path / "w" / "block")
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"


class Done(NamedTuple):
    """How a run ended, and what it said."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def hrsi(capsys: pytest.CaptureFixture[str]):
    """Run words as the command line does, in this process: starting one takes longer than most of these runs."""
    return lambda *words: Done(main(list(words)), *capsys.readouterr())


def command(*words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command itself."""
    return subprocess.run([sys.executable, "-m", "hrsi", *words], capture_output=True, text=True, cwd=cwd, timeout=100)


def in_folder(algorithm: Algorithm, folder: Path) -> list[str]:
    """Return the words with which an algorithm writes into a folder, or its only file there."""
    if "output_dir" in algorithm.defaults():
        return ["--output-dir", str(folder)]
    folder.mkdir()
    return ["--output", str(folder / "output")]


def files_of(folder: Path) -> dict[str, tuple[int, int]]:
    """Return everything below a folder with its size and time of change."""
    return {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(folder.rglob("*"))}


# ---- examples --------------------------------------------------------------------------------------------------------


@pytest.mark.programs
def test_examples_of_the_help_pages_run(block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """In the order in which they build on one another; patterns are not replaced by a shell here."""
    # Without the copies of the block's images below it: an example that takes the folder would find each id twice
    shutil.copytree(block, tmp_path / "work", ignore=shutil.ignore_patterns("adjusted", "delivered"))
    monkeypatch.chdir(tmp_path / "work")
    for part in (1, 2):  # a strip is delivered in parts
        assert main(["crop", "block/image_1.tif", "--window", f"0,{80 * (part - 1)},160,80", "--output-dir", "delivery",
                     "--overwrite"]) == 0  # fmt: skip
        os.replace("delivery/image_1_crop.tif", f"delivery/image_1_P00{part}.TIF")
    for name in ("adjust", *(name for name in REGISTRY if name != "adjust")):
        assert REGISTRY[name].examples, name
        for example in REGISTRY[name].examples:
            *before, command = example.split(" | ")
            program, *words = shlex.split(command)
            assert program == "hrsi" and words[0] == name
            if name == "simulate":  # the block is there
                words = [word if word != "block" else "again" for word in words]
            if before:
                monkeypatch.setattr("sys.stdin", os.fdopen(_piped(" ".join(shlex.split(before[0])[1:]))))
            words += ["--dry-run"] if name in MATCHING else []
            assert main(words) == 0, (example, capsys.readouterr().err)


def _piped(text: str) -> int:
    reader, writer = os.pipe()
    os.write(writer, f"{text}\n".encode())
    os.close(writer)
    return reader


# ---- dry runs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", REGISTRY)
def test_dry_run_of_every_algorithm_writes_nothing(name: str, block: Path, tmp_path: Path, capsys) -> None:
    algorithm = REGISTRY[name]
    options = {key: value for key, value in sound_options(algorithm, block / "block").items() if key != "no_report"}
    words = [*words_of(algorithm, options), "--dry-run", "--json"]
    if "output_dir" in algorithm.defaults():
        words += ["--output-dir", str(tmp_path / "not" / "made")]
    before = files_of(block)
    assert main(words) == 0, capsys.readouterr().err
    report = json.loads(capsys.readouterr().out)
    assert report["dry_run"] and report["algorithm"] == name
    assert report["verdict"]["level"] in ("ok", "doubtful")
    assert report["counts"] and all(count > 0 or "finished" in what for what, count in report["counts"].items())
    assert files_of(block) == before
    assert not (tmp_path / "not").exists()


@pytest.mark.parametrize(
    "name", mark_beyond(3, "thorough", [name for name in REGISTRY if name not in MATCHING | {"evaluate", "simulate"}])
)
def test_dry_run_names_the_files_that_the_run_writes(name: str, block: Path, tmp_path: Path, capsys) -> None:
    algorithm = REGISTRY[name]
    options = {key: value for key, value in sound_options(algorithm, block / "block").items() if key != "no_report"}
    words = [*words_of(algorithm, options), *in_folder(algorithm, tmp_path / "out")]
    assert main([*words, "--dry-run", "--json"]) == 0, capsys.readouterr().err
    files = {os.path.basename(entry["path"]) for entry in json.loads(capsys.readouterr().out)["files"]}
    assert main([*words, "--quiet"]) in (0, 3), capsys.readouterr().err
    assert files == {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["--gcps", "block/nothing.csv"], "nothing.csv"),
        (["--image-points", "block/ground_points.csv"], "no point is measured"),
        (["--output-dir", "block/dem.tif"], "block/dem.tif is a file"),
        (["--output-dir", "block"], "block"),
    ],
)
def test_dry_run_finds_what_the_run_would_trip_over(words: list[str], fragment: str, work: Path, hrsi) -> None:
    (work / "block" / "report.json").write_text("{}")
    before = files_of(work)
    done = hrsi(*ADJUST, "--output-dir", "out", "--dry-run", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert fragment in done.stderr.splitlines()[-1]
    assert files_of(work) == before


def test_dry_run_of_implausible_inputs_ends_with_2(work: Path, hrsi) -> None:
    """Samples and lines in each other's column: what the plausibility tests find, before any adjustment."""
    table = (work / "block" / "image_points.csv").read_text()
    swapped = re.sub(r"\bsample,line\b", "line,sample", table)
    assert swapped != table
    (work / "block" / "image_points.csv").write_text(swapped)
    done = hrsi(*ADJUST, "--output-dir", "out", "--dry-run")
    assert done.returncode == 2, done.stdout
    assert "Verdict of the checks: unusable" in done.stdout and "ERROR: the inputs are wrong" in done.stderr
    assert not (work / "out").exists()


# ---- the log ---------------------------------------------------------------------------------------------------------

LINE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ (START|PROGRESS|INFO|WARNING|RESULT|ERROR|END) +\S.*\n")


def test_log_gets_whole_lines_of_every_run(work: Path, hrsi) -> None:
    log = work / "runs.log"
    log.write_text("what stood there\nand a half li")
    assert hrsi(*ADJUST, "--output-dir", "out", "--log", str(log)).returncode == 0
    assert hrsi(*ADJUST, "--output-dir", "out", "--log", str(log)).returncode == 2  # is there already
    assert hrsi("adjust", "--iteratons", "3", f"--log={log}").returncode == 2  # does not even start
    first, second, *lines = log.read_text().splitlines(keepends=True)
    assert (first, second) == ("what stood there\n", "and a half li\n")
    assert all(LINE.fullmatch(line) for line in lines)
    kinds = [line.split()[1] for line in lines]
    assert kinds.count("START") == 3 and kinds.count("END") == 1 and kinds.count("ERROR") == 2
    text = "".join(lines)
    assert "PROGRESS 100 % done" in text and "already contains a result" in text and "--iteratons" in text
    assert "Verdict: ok" in text


def test_log_has_the_end_of_an_interrupted_run(work: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "hrsi", "simulate", "--size", "6000", "--output-dir", "big", "--log", "log.txt"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    for _ in range(600):
        if Path("log.txt").exists() and "PROGRESS" in Path("log.txt").read_text():
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    assert process.wait(20) == 143
    lines = Path("log.txt").read_text().splitlines(keepends=True)
    assert all(LINE.fullmatch(line) for line in lines)
    assert "ERROR    terminated" in lines[-1]


@pytest.mark.parametrize(
    "target", ["block/image_points.csv", "block/image_2.tif", "block/dem.tif", "no/such/folder.log"]
)
def test_log_damages_no_file(target: str, work: Path, hrsi) -> None:
    before = files_of(work / "block")
    done = hrsi(*ADJUST, "--output-dir", "out", "--log", target)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"--log {target}" in done.stderr
    assert files_of(work / "block") == before


# ---- again -----------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_rerun_in_another_folder_gives_the_same(work: Path, tmp_path: Path, hrsi) -> None:
    assert hrsi(*ADJUST, "--output-dir", "out").returncode == 0
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    done = command("rerun", str(work / "out" / "report.json"), cwd=elsewhere)
    assert done.returncode == 0, done.stderr
    assert "all 4 inputs are as they were" in done.stderr
    first, second = (json.loads((folder / "out" / "report.json").read_text()) for folder in (work, elsewhere))
    differing = {key for key in first if first[key] != second[key]} | (second.keys() - first.keys())
    # the operations name the files by their paths, as inputs do
    paths = set(
        ["command", "directory", "options", "settings", "seconds", "inputs", "images", "rerun_of", "crs_operations"]
    )
    assert differing == paths | ({"date"} if first["date"] != second["date"] else set())
    for name, entry in first["images"].items():
        same = {key for key in entry if key not in ("path", "output")}
        assert {key: entry[key] for key in same} == {key: second["images"][name][key] for key in same}
    for name in ("image_1.tif", "image_2.tif"):
        assert _rpc_of(work / "out" / name) == _rpc_of(elsewhere / "out" / name)
    assert second["rerun_of"]["changed_inputs"] == [] and second["rerun_of"]["date"] == first["date"]


def _rpc_of(path: Path) -> dict:
    from osgeo import gdal

    return gdal.Open(str(path)).GetMetadata("RPC")


def test_rerun_with_other_options_names_changed_inputs(work: Path, hrsi) -> None:
    assert hrsi(*ADJUST, "--output-dir", "out").returncode == 0
    points = work / "block" / "image_points.csv"
    points.write_text(points.read_text() + "\n")
    done = hrsi("rerun", "out", "--model", "shift", "--output-dir", "shifted")
    assert done.returncode == 0, done.stderr
    assert f"warning: {points} has changed since" in done.stderr
    report = json.loads((work / "shifted" / "report.json").read_text())
    assert report["model"] == "shift"
    assert report["rerun_of"]["changed_inputs"] == [str(points)]
    assert report["settings"]["gcps"].endswith("ground_points.csv")


def test_rerun_finds_what_was_moved_with_the_report(work: Path, tmp_path: Path, hrsi) -> None:
    assert hrsi("rpc-info", "@list.txt", "--height", "200", "--output-dir", "a/info").returncode == 2  # no such list
    (work / "list.txt").write_text("block/image_1.tif\nblock/image_2.tif\n")
    assert hrsi("rpc-info", "@list.txt", "--height", "200", "--output-dir", "a/info").returncode == 0
    work.rename(tmp_path / "moved")
    os.chdir(tmp_path / "moved")
    done = hrsi("rerun", "a/info/report.json", "--output-dir", "b")
    assert done.returncode == 0, done.stderr
    assert len(json.loads(Path("b/report.json").read_text())["images"]) == 2


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["rerun"], "hrsi rerun report.json"),
        (["rerun", "--output-dir", "x"], "hrsi rerun report.json"),
        (["rerun", "nothing.json"], "nothing.json"),
        (["rerun", "other.json"], "does not contain the options"),
        (["rerun", "hidden.json", "--output-dir", "x"], "keeps no passwords: give --gcps again"),
    ],
)
def test_rerun_says_what_it_lacks(words: list[str], fragment: str, work: Path, hrsi) -> None:
    (work / "other.json").write_text('{"schema": 1, "algorithm": "adjust"}')
    hidden = {"algorithm": "adjust", "options": {"images": ["a.tif"], "gcps": "PG:password=***"}}
    (work / "hidden.json").write_text(json.dumps(hidden))
    done = hrsi(*words)
    assert (done.returncode, done.stdout) == (2, "")
    assert fragment in done.stderr.splitlines()[-1]


def test_rerun_never_replaces_unasked(work: Path, hrsi) -> None:
    assert hrsi(*ADJUST, "--output-dir", "out", "--overwrite").returncode == 0
    before = files_of(work / "out")
    done = hrsi("rerun", "out/report.json")
    assert done.returncode == 2 and "already contains a result" in done.stderr
    assert files_of(work / "out") == before


# ---- images, help ----------------------------------------------------------------------------------------------------


def test_pattern_that_no_shell_replaced(work: Path, hrsi) -> None:
    done = hrsi("rpc-info", "block/image_?.tif", "--height", "200", "--json")
    assert list(json.loads(done.stdout)["images"]) == ["image_1", "image_2"]
    (work / "block" / "image_[1].tif").write_bytes((work / "block" / "image_1.tif").read_bytes())
    done = hrsi("rpc-info", "block/image_[1].tif", "--height", "200", "--json")  # a file of that very name
    assert list(json.loads(done.stdout)["images"]) == ["image_[1]"]
    done = hrsi("rpc-info", "block/*.jp2", "--height", "200")
    assert done.returncode == 2 and "block/*.jp2: no file fits this pattern" in done.stderr


def test_help_word_and_misspelt_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["adjust", "--help"]) == 0
    page = capsys.readouterr().out
    assert main(["help", "adjust"]) == 0
    assert capsys.readouterr().out == page
    assert "examples:\n  hrsi adjust " in page
    for words in (["help"], ["help", "--help"]):
        assert main(words) == 0
        assert capsys.readouterr().out.startswith("usage: hrsi ALGORITHM")
    for command in ("init", "rerun", "completion", "help"):
        assert main(["help", command]) == 0
        assert capsys.readouterr().out.startswith(f"usage: hrsi {command}")
    for word, meant in (("triangluate", "triangulate"), ("reruns", "rerun"), ("completions", "completion")):
        assert main([word]) == 2
        assert f"did you mean {meant}" in capsys.readouterr().err
    assert main(["help", "ajust"]) == 2
    assert "did you mean adjust" in capsys.readouterr().err

"""Two runs at once on one output folder: the second is refused, and the first one's result is whole."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bad_inputs import faults_of_error, run_words
from every_algorithm import sound_options, words_of

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.safety.transactions import LOCK, only_writer, recover_folders
from hrsi.processing_algorithms import REGISTRY


@pytest.fixture(scope="module")
def scene(sound_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(sound_inputs, tmp_path_factory.mktemp("own") / "scene"))


@pytest.mark.parametrize("name", [name for name in REGISTRY if "output_dir" in REGISTRY[name].defaults()])
def test_the_second_run_is_refused(scene: Path, tmp_path: Path, name: str) -> None:
    """Every algorithm that writes into a folder, while another run does."""
    output = tmp_path / "out"
    words = words_of(REGISTRY[name], sound_options(REGISTRY[name], scene) | {"output_dir": str(output)})
    with only_writer(str(output)):
        code, _, err = run_words(words)
        assert code == 2 and "another run writes there now" in err
        assert faults_of_error(code, err, {str(output)}) == []
        assert [path.name for path in output.iterdir()] == [LOCK]
    assert not output.exists()


def test_two_command_lines_at_once(scene: Path, tmp_path: Path) -> None:
    """Started together: one result, whole; whoever came second was refused or found it there."""
    output = tmp_path / "a" / "out"
    words = words_of(REGISTRY["adjust"], sound_options(REGISTRY["adjust"], scene) | {"output_dir": str(output)})
    command = [sys.executable, "-m", "hrsi.processing_algorithms.command_line.cli", *words]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    said = [process.communicate(timeout=120)[1] for process in both]
    assert sorted(process.returncode for process in both) == [0, 2]
    refusal = said[0] if both[0].returncode else said[1]
    assert "another run writes there now" in refusal or "already contains a result" in refusal
    names = ["block.gpkg", "block.json", "block_cameras.npz", "image_1.tif", "image_2.tif", "report.json"]
    assert sorted(path.name for path in output.iterdir()) == names


HOLDER = """
import sys, time
from hrsi.hrsi_engine.io.safety.transactions import only_writer
with only_writer(sys.argv[1]):
    print("held", flush=True)
    time.sleep(60)
"""


def test_the_lock_dies_with_its_owner(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(folder)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    with pytest.raises(InputError, match="another run"), only_writer(str(folder)):
        pass
    recover_folders([str(folder)])
    assert (folder / LOCK).exists()  # of a living run
    process.send_signal(signal.SIGKILL)
    process.wait(timeout=20)
    with only_writer(str(folder)):
        assert (folder / LOCK).exists()
    assert list(folder.iterdir()) == []


def test_folders_that_stay_empty_go_again(tmp_path: Path) -> None:
    with only_writer(str(tmp_path / "a" / "b")):
        pass
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    with only_writer(str(tmp_path / "mine")):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]  # was there before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_whoever_waits_gets_the_folder(tmp_path: Path) -> None:
    """Many processes take the folder again and again, each alone: none sees another's file in it."""
    folder = tmp_path / "out"
    children = []
    for _ in range(4):
        child = os.fork()
        if child == 0:
            taken = 0
            try:
                while taken < 40:
                    try:
                        with only_writer(str(folder)):
                            mine = folder / "mine"
                            mine.touch(exist_ok=False)
                            time.sleep(0.0002)
                            mine.unlink()
                            taken += 1
                    except InputError as error:
                        if "another run" not in str(error):
                            os._exit(2)
                        time.sleep(0.0003)
                os._exit(0)
            except BaseException:
                os._exit(1)
        children.append(child)
    assert [os.waitpid(child, 0)[1] for child in children] == [0, 0, 0, 0]

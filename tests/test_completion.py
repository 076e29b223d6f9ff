"""Completion as the shells themselves do it: bash, and zsh and fish where they are installed."""

import os
import pty
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.command_line.completion import SHELLS, completion_script
from hrsi.processing_algorithms.interface.declare import POSITIONAL_KINDS

CASES = [
    ("hrsi tri", {"triangulate"}),
    ("hrsi ortho", {"orthorectify", "ortho-check"}),
    ("hrsi help re", {"refine-rpc", "register"}),
    ("hrsi completion ", {"bash", "zsh", "fish"}),
    ("hrsi triangulate --gc", {"--gcps", "--gcp-ids", "--gcp-epoch"}),
    ("hrsi adjust --dry", {"--dry-run"}),
    ("hrsi triangulate --write ", {"copy", "in-place", "vrt", "sidecar", "resampled", "none"}),
    ("hrsi simulate --sensor ple", {"pleiades"}),
    ("hrsi triangulate --gcps poi", {"points.csv"}),
    ("hrsi rpc-info a.tif im", {"image_1.tif"}),
    ("hrsi rerun rep", {"report.json"}),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with files to complete, and the scripts."""
    folder = tmp_path_factory.mktemp("completion")
    for name in ("image_1.tif", "points.csv", "report.json"):
        (folder / name).touch()
    (folder / "result").mkdir()
    for shell in SHELLS:
        (folder / f"script.{shell}").write_text(completion_script(shell, REGISTRY))
    return folder


def in_bash(folder: Path, *words: str) -> set[str]:
    """Return what bash's completion function answers for words, the last of which is being typed."""
    code = 'source ./script.bash; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _hrsi; printf \'%s\\n\' "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "--norc", "-c", code, "bash", *words], cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return set(done.stdout.split())


@pytest.mark.parametrize(("line", "offered"), CASES)
def test_bash(folder: Path, line: str, offered: set[str]) -> None:
    assert in_bash(folder, *line.split(" ")) == offered


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("hrsi", "triangulate", "--write", "=", "co"), {"copy"}),  # bash breaks words at =
        (("hrsi", "triangulate", "@po"), {"@points.csv"}),
        (("hrsi", "triangulate", "--sigma-dem", ""), set()),  # a number
        (("hrsi", "triangulate", "--output-dir", "r"), {"result"}),  # folders only
        (("hrsi", "triangulate", "--tie-points", "no"), {"none"}),
        (("hrsi", "triangulate", "--tie-points", "poi"), {"points.csv"}),
    ],
)
def test_bash_in_detail(folder: Path, words: tuple[str, ...], offered: set[str]) -> None:
    assert in_bash(folder, *words) == offered


def test_bash_knows_every_option_of_every_algorithm(folder: Path) -> None:
    for name, algorithm in REGISTRY.items():
        expected = {f"--{param.name}" for param in algorithm.params if param.kind not in POSITIONAL_KINDS}
        assert expected <= in_bash(folder, "hrsi", name, "-"), name


def _typed(command: list[str], lines: list[str], wanted: str, cwd: Path) -> str:
    """Return what a shell on a pseudo terminal shows when lines are typed, until it shows what is wanted."""
    process, terminal = pty.fork()
    if process == 0:
        os.chdir(cwd)
        os.environ.update(TERM="dumb", PS1="> ", PROMPT="> ")
        os.execvp(command[0], command)
    shown = b""
    try:
        for line in lines:
            os.write(terminal, line.encode())
            ended = time.monotonic() + (5.0 if line is lines[-1] else 0.7)
            while time.monotonic() < ended and wanted not in _plain(shown):
                if select.select([terminal], [], [], 0.1)[0]:
                    shown += os.read(terminal, 4096)
    finally:
        os.close(terminal)
        os.waitpid(process, 0)
    return _plain(shown)


def _plain(shown: bytes) -> str:
    """Return what stands on the screen where zsh takes back the blank behind a completed word."""
    return shown.decode(errors="replace").replace(" \x08", "")


def test_bash_completes_at_the_prompt(folder: Path) -> None:
    """A person types, presses Tab, and the words are there."""
    lines = ["source ./script.bash\n", "hrsi tri\t--wri\t"]
    assert "hrsi triangulate --write" in _typed(["bash", "--norc", "-i"], lines, "triangulate --write", folder)


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
def test_fish(folder: Path) -> None:
    asked = "; ".join(f"complete -C '{line}'; echo ====" for line, _ in CASES)
    done = subprocess.run(["fish", "--no-config", "-c", f"source script.fish; {asked}"], cwd=folder,
                          capture_output=True, text=True)  # fmt: skip
    answers = done.stdout.split("====\n")
    for (line, offered), answer in zip(CASES, answers, strict=False):
        assert {text.split("\t")[0] for text in answer.splitlines()} == offered, (line, done.stderr)


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
@pytest.mark.parametrize(
    ("typed", "shown"),
    [("hrsi tri\t", "hrsi triangulate"), ("hrsi triangulate --wri\tcop\t", "--write copy"),
     ("hrsi triangulate --gcps poi\t", "points.csv"), ("hrsi triangulate --tie-points no\t", "--tie-points none"),
     ("hrsi triangulate --tie-points poi\t", "--tie-points points.csv")],
)  # fmt: skip
def test_zsh_completes_at_the_prompt(folder: Path, typed: str, shown: str) -> None:
    lines = ["autoload -U compinit; compinit -u -D; source ./script.zsh\n", typed]
    assert shown in _typed(["zsh", "-f", "-i"], lines, shown, folder)


def test_unknown_shell(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="did you mean bash"):
        completion_script("bsh", REGISTRY)
    assert main(["completion"]) == 2
    assert "bash|zsh|fish" in capsys.readouterr().err

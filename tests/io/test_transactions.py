"""Changes of several files happen all or not at all, and what dead writers leave goes."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.foundation.interruption import signals_as_exceptions
from hrsi.hrsi_engine.io.output_dir import stage_folder
from hrsi.hrsi_engine.io.safety import replacing, transactions
from hrsi.hrsi_engine.io.safety.replacing import is_dead, open_hidden_folder, sweep, temporary_folder, temporary_name
from hrsi.hrsi_engine.io.safety.transactions import Transaction, only_writer, recover_folders

COUNT = 6
GONE = f"{replacing._machine_name()}-{2**22 + 1}-1"  # a process that there is not
JOURNAL = f".hrsi-journal-{GONE}-01234567.json"


def fill(changes: Transaction, folders: list[Path], text: str) -> None:
    """Have files of that text made in every folder, over those of an earlier text; the mark of it is removed."""
    for folder in folders:
        for number in range(COUNT):
            Path(changes.new_file(str(folder / f"{number}.txt"))).write_text(text)
        changes.remove(str(folder / "old.mark"))


@pytest.fixture
def folders(tmp_path: Path) -> list[Path]:
    made = [tmp_path / name for name in ("results", "images", "others")]
    for folder in made:
        folder.mkdir()
        for number in range(COUNT):
            (folder / f"{number}.txt").write_text("old")
        (folder / "old.mark").write_text("")
    return made


def state_of(folders: list[Path]) -> set[str]:
    """Return the texts that are found; fail where anything hidden is left."""
    assert [path for folder in folders for path in folder.iterdir() if path.name.startswith(".")] == []
    marks = {(folder / "old.mark").exists() for folder in folders}
    texts = {(folder / f"{number}.txt").read_text() for folder in folders for number in range(COUNT)}
    assert len(marks) == 1 and (marks == {True}) == (texts == {"old"})
    return texts


def test_all_changes_happen(folders: list[Path]) -> None:
    with Transaction(str(folders[0])) as changes:
        fill(changes, folders, "new")
        assert {path.read_text() for folder in folders for path in folder.glob("[0-9].txt")} == {"old"}
        changes.commit()
    assert state_of(folders) == {"new"}


def test_the_journal_lies_with_the_files_where_results_go_to_a_virtual_file_system(folders: list[Path]) -> None:
    with Transaction("/vsimem/results") as changes:
        fill(changes, folders, "new")
        changes.commit()
    assert state_of(folders) == {"new"}


def test_nothing_happens_without_a_commit(folders: list[Path]) -> None:
    with Transaction(str(folders[0])) as changes:
        fill(changes, folders, "new")
    assert state_of(folders) == {"old"}


KILLED = """
import os, signal, sys
from pathlib import Path
from hrsi.hrsi_engine.io.safety import transactions
from hrsi.tests.io.test_transactions import fill
step, folders = int(sys.argv[1]), [Path(name) for name in sys.argv[2:]]
done = 0
def counted(function):
    def call(*words, **more):
        global done
        done += 1
        if done > step:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*words, **more)
    return call
transactions.os.replace, transactions.os.remove = counted(os.replace), counted(os.remove)
with transactions.Transaction(str(folders[0])) as changes:
    fill(changes, folders, "new")
    changes.commit()
"""


@pytest.mark.parametrize("step", mark_beyond(3, "killed", [0, 6, 28, 1, 4, 5, 9, 16, 23, 26, 200]))
@pytest.mark.parametrize("found_from", mark_beyond(1, "killed", [0, 1, 2]))
def test_killed_at_any_step_all_or_none(folders: list[Path], step: int, found_from: int) -> None:
    """The process is killed before its (step + 1)th rename or removal; the next run comes upon one of the folders."""
    command = [sys.executable, "-c", KILLED, str(step), *map(str, folders)]
    modules = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    status = subprocess.run(command, check=False, env={**os.environ, "PYTHONPATH": modules}).returncode
    committed = step > 4  # two signposts and the journal: a renaming each, and a removal that finds nothing
    assert status == (-signal.SIGKILL if step < 200 else 0)
    recover_folders([str(folders[found_from])])
    recover_folders(map(str, folders))  # the hidden files of the other folders go when somebody comes there
    assert state_of(folders) == ({"new"} if committed else {"old"})


def test_a_journal_from_elsewhere_touches_no_other_folder(folders: list[Path]) -> None:
    """A folder that came with a journal may not rename files of other folders."""
    delivered, own = folders[0], folders[1]
    payload = delivered / ".x.txt"
    payload.write_text("evil")
    steps = [["rename", str(payload), str(own / "0.txt")], ["remove", str(own / "1.txt"), ""]]
    (delivered / JOURNAL).write_text(json.dumps({"writer": GONE, "steps": steps, "signposts": [str(own / "2.txt")]}))
    recover_folders([str(delivered)])
    assert (own / "0.txt").read_text() == "old" and (own / "1.txt").exists() and (own / "2.txt").exists()
    assert not (delivered / JOURNAL).exists()


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"writer": 3}', '{"writer": "x", "steps": 5}', "\0" * 100])
def test_damaged_journals_are_harmless(tmp_path: Path, content: str) -> None:
    (tmp_path / JOURNAL).write_text(content)
    (tmp_path / "a.txt").write_text("a")
    recover_folders([str(tmp_path)])
    assert (tmp_path / "a.txt").read_text() == "a"


def test_living_writers_are_left_alone(tmp_path: Path) -> None:
    living = Path(temporary_name(str(tmp_path / "a.tif")))
    living.write_text("")
    folder = temporary_folder(str(tmp_path))
    assert sweep(str(tmp_path)) == [] and living.exists() and Path(folder).is_dir()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_the_making_of_a_folder_leaves_none(tmp_path: Path, number: signal.Signals) -> None:
    """It comes in the very moment in which a folder, the lock's file or a hidden folder has been made."""
    calls = [end_of_a_call(tmp_path, number, count) for count in range(1, 7)]
    assert calls == ["mkdir", "mkdir", "open", "mkdir", "mkdir", None]  # two folders, the lock, two hidden folders
    assert {path.name for path in tmp_path.rglob("*")} == {"above", "out", "a.txt"}


def end_of_a_call(parent: Path, number: signal.Signals, count: int) -> str | None:
    """Write a result, and raise a signal as the n-th making call returns; return which that was."""
    folder, made = str(parent / "above" / "out"), []

    def signalling(_frame: object, event: str, called: object) -> None:
        if event != "c_return" or called not in (os.mkdir, os.open):
            return
        made.append(getattr(called, "__name__", ""))
        if len(made) == count:
            sys.setprofile(None)
            signal.raise_signal(number)

    sys.setprofile(signalling)
    try:
        with (
            signals_as_exceptions(),
            only_writer(folder),
            stage_folder(folder, ()) as stage,
            open_hidden_folder(folder),
        ):
            sys.setprofile(None)
            (stage / "a.txt").write_text("a")
    except KeyboardInterrupt:
        assert list(parent.iterdir()) == [], made
        return made[-1]
    finally:
        sys.setprofile(None)
    return None


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_fork_writes_under_its_own_number() -> None:
    """What a process keeps of itself is not what its forks are."""
    own = replacing.writer()
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.write(writing, replacing.writer().encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(reading, 1000).decode().split("-")[1] == str(child) != own.split("-")[1] == str(os.getpid())
    os.close(reading), os.close(writing)


def test_dead_writers_files_go(tmp_path: Path) -> None:
    """A number that no process has, and our own number with another beginning."""
    for pid, began in ((2**22 + 1, 1), (os.getpid(), 1)):
        words = f"{replacing._machine_name()}-{pid}-{began}"
        (tmp_path / f".a.{words}-0123abcd.tmp.tif").write_text("")
        (tmp_path / f".hrsi-unfinished-{words}-x").mkdir()
    (tmp_path / ".mine.tmp.tif").write_text("")
    elsewhere = tmp_path / ".a.00000000-12-1-0123abcd.tmp.tif"  # of another machine, and fresh
    elsewhere.write_text("")
    assert is_dead(str(tmp_path / f".a.{replacing._machine_name()}-{2**22 + 1}-1-0123abcd.tmp.tif"))
    assert len(sweep(str(tmp_path))) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([elsewhere.name, ".mine.tmp.tif"])


@pytest.mark.parametrize(("days", "dead"), [(1.0, False), (90.0, True)])
def test_unfinished_files_of_another_machine_stay_for_some_days(tmp_path: Path, days: float, dead: bool) -> None:
    """Whether it runs is not known there: a run may take a day, and nothing stays for a quarter of a year."""
    path = tmp_path / ".a.00000000-12-1-0123abcd.tmp.tif"
    path.touch()
    began = time.time() - 86_400.0 * days
    os.utime(path, (began, began))
    assert is_dead(str(path)) == dead


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_takes_no_journal_changes_nothing(folders: list[Path]) -> None:
    folders[2].chmod(0o500)
    with Transaction(str(folders[0])) as changes:
        changes.rename(str(folders[2] / "0.txt"), str(folders[2] / "moved.txt"))
        with pytest.raises(OutputError, match="nothing was changed"):
            changes.commit()
    folders[2].chmod(0o700)
    assert state_of(folders) == {"old"}


def test_failing_journal_changes_nothing(folders: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: str, content: object) -> None:
        raise OSError(28, "No space left on device", path)

    monkeypatch.setattr(transactions, "_write_journal", refuse)
    with Transaction(str(folders[0])) as changes:
        fill(changes, folders, "new")
        with pytest.raises(OutputError, match="nothing was changed"):
            changes.commit()
    assert state_of(folders) == {"old"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_wait_until_all_changes_are_made(folders: list[Path], monkeypatch, number: signal.Signals) -> None:
    """A signal in the midst of the renames: all of them happen, then it does what it does."""
    replace, came = os.replace, []
    before = signal.signal(number, lambda *_: came.append((folders[2] / "5.txt").read_text()))

    def interrupted(old: str, new: str) -> None:
        if new == str(folders[1] / "2.txt"):
            signal.raise_signal(number)
        replace(old, new)

    monkeypatch.setattr(transactions.os, "replace", interrupted)
    try:
        with Transaction(str(folders[0])) as changes:
            fill(changes, folders, "new")
            changes.commit()
    finally:
        signal.signal(number, before)
    assert came == ["new"] and state_of(folders) == {"new"}


def test_what_could_not_be_put_in_place_is_by_the_next_run(tmp_path: Path, monkeypatch) -> None:
    """The disk fails in the midst of the renames of a result: the next run, of this process too, finishes them."""
    folder, replace = tmp_path / "out", os.replace

    def failing(old: str, new: str) -> None:
        if new.endswith("report.json"):  # the last one
            raise OSError(5, "Input/output error", new)
        replace(old, new)

    monkeypatch.setattr(transactions.os, "replace", failing)
    names = {"a.txt", "b.txt", "report.json"}

    def write() -> None:
        with stage_folder(str(folder), ()) as stage:
            for name in names:
                (stage / name).write_text(name)

    with pytest.raises(OutputError, match="run again to finish"):
        write()
    assert {name for name in names if (folder / name).exists()} == {"a.txt", "b.txt"}
    monkeypatch.setattr(transactions.os, "replace", replace)
    recover_folders([str(folder)])
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".hrsi-unfinished")} == names

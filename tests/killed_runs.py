"""Runs that are ended at any moment, of everything that writes: what is found then, and after the next run.

A process that has loaded everything forks; the child runs one command line and is ended by KILL, TERM or INT: half of
them from outside at a random time, half exactly before a random one of its changes of files (Python's audit events), so
that the narrow moments between two renames are met too. ``killed_runs.py KILLS SEED WRITER …`` ends each of these
writers so many times.
"""

import hashlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from every_algorithm import make_scene, sound_options, words_of
from osgeo import gdal, ogr

from hrsi.hrsi_engine.foundation.interruption import quit_on_signals
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.hrsi_engine.io.safety.transactions import recover_folders
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.block_steps.tie_search import UNFINISHED
from hrsi.processing_algorithms.command_line.cli import main

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
#: Exit code of a run that was ended, as `os.waitpid` tells it: minus the signal, or the command line's own.
CODES = {signal.SIGKILL: {-9}, signal.SIGTERM: {143}, signal.SIGINT: {130}}
CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate", "os.chmod", "shutil.rmtree"}
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
IN_WRITING = 0.8  # share of the moments that lie after the first change of a file
LONGEST_S = 300
SHIFTED = "shifted"
IMAGES = ("image_1.tif", "image_2.tif", "image_3.tif")  # the last one for `write-rpc`


@dataclass(frozen=True)
class Writer:
    """A command line that writes: an algorithm, and how it writes where it can choose."""

    algorithm: str
    how: str = ""
    restore: bool = False

    def __str__(self) -> str:
        return " ".join(filter(None, (self.algorithm, self.how, "restore" if self.restore else "")))

    def words(self, scene: Path, output: Path) -> list[str]:
        algorithm = REGISTRY[self.algorithm]
        options = sound_options(algorithm, scene)
        options |= {"write": self.how} if self.how else {}
        if "threads" in algorithm.defaults():
            options["threads"] = 1
        if self.algorithm == "write-rpc":  # several images, each with another RPC than its own
            options["images"] = [str(scene / name) for name in IMAGES]
            options["rpc"] = str(scene / SHIFTED)
        if self.restore:
            options["restore"] = True
        elif not (self.algorithm == "write-rpc" and self.how == "in-place"):
            options["output_dir"] = str(output)
        return words_of(algorithm, options)


def add_shifted_rpcs(scene: Path) -> None:
    """Write RPC files of the images, 3 px beside their own, into a folder of the scene; and a third image."""
    (scene / SHIFTED).mkdir(exist_ok=True)
    shutil.copy(scene / IMAGES[0], scene / IMAGES[2])
    for name in IMAGES:
        rpc = read_rpc(str(scene / name)).rpc
        write_rpc_text(str(scene / SHIFTED / name.replace(".tif", "_RPC.TXT")), rpc.shift(3.0, -2.0))


def writers() -> Iterator[Writer]:
    """Return everything that writes, from the declarations."""
    for name, algorithm in REGISTRY.items():
        how = algorithm.param("write").choices if "write" in algorithm.defaults() else ("",)
        yield from (Writer(name, choice) for choice in how)
    yield Writer("write-rpc", restore=True)


@dataclass
class Measured:
    """A whole run: seconds until the first change of a file and until the end, number of changes, files by name."""

    first_s: float
    whole_s: float
    changes: int
    made: dict[str, str]


@dataclass
class Kill:
    """What became of a run that was ended: ``wrong`` names every fault, ``state`` what the next run found."""

    writer: Writer
    number: signal.Signals
    code: int
    state: str
    wrong: list[str] = field(default_factory=list)


def is_change(event: str, args: tuple[Any, ...]) -> bool:
    """Return whether an audit event changes files."""
    if event == "open":
        return isinstance(args[0], (str, bytes)) and isinstance(args[2], int) and bool(args[2] & WRITING)
    return event in CHANGES


def run_forked(words: list[str], folder: Path, at_change: int = 0, number: signal.Signals | None = None) -> int:
    """Start a command line in a child; return its process. It ends itself before a change of files where asked to."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS[1:])  # until the child is ready for them
    child = os.fork()
    if child:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS[1:])
        return child
    code = 99
    try:
        quit_on_signals()  # as the program `hrsi` does before and after its work
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS[1:])
        for descriptor, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        began, seen, first = time.monotonic(), 0, 0.0

        def watch(event: str, args: tuple[Any, ...]) -> None:
            nonlocal seen, first
            if is_change(event, args):
                seen += 1
                first = first or time.monotonic() - began
                if number is not None and seen == at_change:
                    os.kill(os.getpid(), number)

        sys.addaudithook(watch)
        code = main(words)
        quit_on_signals()
        whole = time.monotonic() - began
        counts = seen
        (folder / "measured.json").write_text(json.dumps([first or whole, whole, counts]))
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def wait_for(child: int) -> int:
    """Return the exit code of a child, minus the signal that ended it."""
    end = time.monotonic() + LONGEST_S
    while time.monotonic() < end:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return 98  # it hung


# ---- what lies in folders --------------------------------------------------------------------------------------------


def content_of(file: Path) -> str:
    """Return what a whole file holds, without what differs from run to run (times); raise where it is not whole."""
    if file.suffix in (".json",):
        return ",".join(sorted(json.loads(file.read_text())))
    if file.suffix == ".gpkg":
        source = ogr.Open(str(file))
        layers = [source.GetLayer(number) for number in range(source.GetLayerCount())]
        return ",".join(f"{layer.GetName()}:{len([feature.GetFID() for feature in layer])}" for layer in layers)
    if file.suffix in (".tif", ".vrt"):
        dataset = gdal.Open(str(file))
        sums = [dataset.GetRasterBand(number + 1).Checksum() for number in range(dataset.RasterCount)]
        rpc = dataset.GetMetadata("RPC")
        return f"{dataset.RasterXSize} {dataset.RasterYSize} {sums} {sorted(rpc.items())}"
    if file.suffix == ".npz":
        with np.load(file, allow_pickle=False) as arrays:
            return ",".join(
                f"{name}: {_rounded(arrays[name])}" for name in sorted(arrays.files) if name != "mark"
            )  # of the bytes of a GeoPackage, which hold the time
    if file.name.endswith("_RPC.TXT"):  # what it does: an RPC of a small image has many sets of coefficients
        rpc = read_rpc(str(file)).rpc
        steps = np.array([[0.0, 0.0, 0.0], [0.8, 0.8, 0.8], [-0.8, 0.8, -0.8]])
        scales = [rpc.long_scale, rpc.lat_scale, rpc.height_scale]
        return _rounded(rpc.project([rpc.long_off, rpc.lat_off, rpc.height_off] + steps * scales))
    if file.suffix == ".html":
        return str(file.read_text().rstrip().endswith("</html>"))
    lines = [line for line in file.read_bytes().splitlines() if not line.startswith(b"HRSI_DATE")]
    return hashlib.sha256(b"\n".join(lines)).hexdigest()


def _rounded(values: np.ndarray) -> str:
    """Return values without the rounding of floating point sums, which depends on where in memory they lie."""
    return str(np.round(values, 4).tolist() if values.dtype.kind == "f" else values.tolist())


def contents(folder: Path) -> dict[str, str]:
    """Return the visible files below a folder and what each holds; ``damaged`` for one that is not whole."""
    found = {}
    for file in sorted(folder.rglob("*")) if folder.exists() else []:
        parts = file.relative_to(folder).parts
        if file.is_file() and not any(part.startswith(".") for part in parts) and parts[0] != UNFINISHED:
            try:
                found["/".join(parts)] = content_of(file)
            except Exception as error:
                found["/".join(parts)] = f"damaged: {error}"
    return found


def hidden_in(*folders: Path) -> list[str]:
    """Return hidden files and folders, but for those in what a search keeps for the next run."""
    found = [path.relative_to(folder) for folder in folders if folder.exists() for path in folder.rglob(".*")]
    return [str(path) for path in found if path.parts[0] != UNFINISHED]


def tree(*folders: Path) -> dict[str, int]:
    """Return every path below folders, hidden ones too, with its mode bits."""
    paths = [path for folder in folders for path in (folder, *folder.rglob("*")) if path.exists()]
    return {str(path): path.stat().st_mode for path in paths}


def cameras(scene: Path) -> list[Any]:
    return [read_rpc(str(scene / name)).rpc for name in IMAGES]


def sources(scene: Path) -> dict[str, str]:
    """Return the hash of every input but the images that are written in place."""
    return {
        str(file.relative_to(scene)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(scene.rglob("*")) if file.is_file() and not file.name.startswith(".")
    }  # fmt: skip


# ---- one writer ------------------------------------------------------------------------------------------------------


class Target:
    """A writer with inputs of its own, measured in a whole run."""

    def __init__(self, writer: Writer, scene: Path, folder: Path) -> None:
        self.writer, self._original, self.folder = writer, scene, folder
        self.scene, self.output = folder / "in", folder / "out"
        self.in_place = writer.how == "in-place" or writer.restore
        folder.mkdir(parents=True)
        self.before = self.lay_out()
        self.words = writer.words(self.scene, self.output)
        code = wait_for(run_forked(self.words, folder))
        if code != 0:
            raise AssertionError(f"{writer} does not run: {code} {(folder / 'stderr').read_text()[-500:]}")
        first, whole, changes = json.loads((folder / "measured.json").read_text())
        self.measured = Measured(first, whole, changes, contents(self.output))
        self.changed_to = cameras(self.scene)
        self.after = sources(self.scene)
        self.tree = tree(self.scene, self.output)

    def lay_out(self) -> dict[str, str]:
        """Make the inputs anew, and the output folder go; return the inputs' hashes."""
        for place in (self.scene, self.output):
            shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self._original, self.scene)
        if self.writer.restore:
            words = words_of(REGISTRY["write-rpc"], {
                "write": "in-place", "rpc": str(self.scene / SHIFTED),
                "images": [str(self.scene / name) for name in IMAGES],
            })  # fmt: skip
            if main([*words, "--quiet"]):
                raise AssertionError("cannot write in place")
        self.unchanged = cameras(self.scene)
        return sources(self.scene)

    def kill(self, number: signal.Signals, rng: random.Random) -> Kill:
        """End a run at a random moment, look at what is found, run again, and look once more."""
        before = self.lay_out()
        measured, by_change = self.measured, rng.random() < 0.5 and self.measured.changes > 0
        if by_change:
            child = run_forked(self.words, self.folder, rng.randint(1, measured.changes), number)
        else:
            child = run_forked(self.words, self.folder)
            late = rng.random() < IN_WRITING
            time.sleep(rng.uniform(measured.first_s, measured.whole_s) if late else rng.uniform(0.0, measured.first_s))
            os.kill(child, number)
        code = wait_for(child)
        said = (self.folder / "stderr").read_text()
        kill = Kill(self.writer, number, code, "")
        if code not in CODES[number] | {0}:
            kill.wrong.append(f"exit code {code}")
        if "Traceback" in said or "fault of HRSI" in said:
            kill.wrong.append(f"traceback: {said[-300:]}")
        # Immediately: inputs as they were (those that are written in place: the old or the new camera)
        self._look_at_inputs(kill, before, "at once")
        kill.wrong += [f"half-written {name}" for name, text in contents(self.output).items() if "damaged" in text]
        # After what is left of it was finished: all or nothing, images and report alike
        recover_folders([str(self.scene), *([str(self.output)] if self.output.exists() else [])])
        self._look_at_inputs(kill, before, "when finished")
        hidden = hidden_in(self.scene, self.output)
        kill.wrong += [f"hidden: {', '.join(hidden[:3])}"] if hidden else []
        found, changed = contents(self.output), cameras(self.scene) != self.unchanged
        each = [now == old for now, old in zip(cameras(self.scene), self.unchanged, strict=True)]
        if self.writer.algorithm != "write-rpc":
            each.pop()
        if self.in_place and len(set(each)) > 1:
            kill.wrong.append("mixed: some images have the new camera")
        whole = found.keys() == measured.made.keys()
        one_by_one = self.writer.algorithm in ("orthorectify", "write-rpc")  # each file for itself
        if found and not whole and not one_by_one:
            kill.wrong.append(f"half a result: {', '.join(found)}")
        if self.in_place and self.writer.algorithm != "write-rpc" and changed != ("report.json" in found):
            kill.wrong.append("images changed without a report" if changed else "report without changed images")
        kill.state = "whole" if whole and (changed or not self.in_place) else "nothing" if not found else "part"
        # The next run: done, or refused because the result is there; nothing left over, the result that a run gives
        code = wait_for(run_forked(self.words, self.folder))
        said = (self.folder / "stderr").read_text()
        if code != 0 and not (code == 2 and whole):
            kill.wrong.append(f"the next run ends with {code}: {said[-300:]}")
        left = hidden_in(self.scene, self.output)
        left += [UNFINISHED] if (self.output / UNFINISHED).exists() else []
        kill.wrong += [f"left over: {', '.join(left[:3])}"] if left else []
        now = tree(self.scene, self.output)  # from outside: every path that an undisturbed run does not leave
        others = [name for name in {**now, **self.tree} if now.get(name) != self.tree.get(name)]
        kill.wrong += [f"left over, missing or of another mode: {', '.join(others[:3])}"] if others else []
        again = contents(self.output)
        if again != measured.made:
            differ = [name for name in {**again, **measured.made} if again.get(name) != measured.made.get(name)]
            kill.wrong.append(f"another result: {', '.join(differ)}")
        if cameras(self.scene) != self.changed_to:
            kill.wrong.append("the next run leaves other cameras")
        return kill

    def _look_at_inputs(self, kill: Kill, before: dict[str, str], when: str) -> None:
        now = sources(self.scene)
        allowed = set(IMAGES) if self.in_place else set()
        own = self.after.keys() - before.keys()  # sidecars of images written in place
        damaged = [
            name for name in {**before, **now} if before.get(name) != now.get(name) and name not in allowed | own
        ]
        kill.wrong += [f"input damaged {when}: {', '.join(damaged)}"] if damaged else []
        for name, camera, old, new in zip(IMAGES, cameras(self.scene), self.unchanged, self.changed_to, strict=True):
            if camera not in (old, new):
                kill.wrong.append(f"{name} has a third camera {when}")


def load_everything(chosen: Sequence[Writer], scene: Path, folder: Path) -> None:
    """Run each algorithm once in this process, so that its children have all loaded and compiled; without threads."""
    cv2.setNumThreads(1)
    for writer in {writer.algorithm: writer for writer in chosen}.values():
        place = folder / str(writer).replace(" ", "_")
        shutil.copytree(scene, place / "in")
        with open(os.devnull, "w") as nowhere:
            before = sys.stderr, sys.stdout
            sys.stderr = sys.stdout = nowhere
            try:
                main([*writer.words(place / "in", place / "out"), "--quiet"])
            finally:
                sys.stderr, sys.stdout = before
        shutil.rmtree(place)


def end_runs(names: Sequence[str], kills: int, seed: int) -> int:
    """End writers whose names hold a word, by each signal in turn; print what happened; return the number of faults."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    chosen = [one for one in writers() if any(name in str(one) for name in names)]
    rng, wrong, codes = random.Random(seed), 0, set()
    place = Path(tempfile.mkdtemp(prefix="hrsi-kills-"))
    try:
        make_scene(place / "scene")
        add_shifted_rpcs(place / "scene")
        load_everything(chosen, place / "scene", place / "loaded")
        for writer in chosen:
            target = Target(writer, place / "scene", place / str(writer).replace(" ", "_"))
            for turn in range(kills):
                kill = target.kill(SIGNALS[turn % len(SIGNALS)], rng)
                codes.add(f"{kill.number.name} {kill.code}")
                wrong += bool(kill.wrong)
                print(f"{writer}: {kill.number.name} {kill.code} {kill.state} {'; '.join(kill.wrong)}", flush=True)
            shutil.rmtree(target.folder)
    finally:
        shutil.rmtree(place)
    print(f"{kills * len(chosen)} runs ended, {wrong} with any fault, by {', '.join(sorted(codes))}")
    return wrong


if __name__ == "__main__":
    sys.exit(min(end_runs(sys.argv[3:], int(sys.argv[1]), int(sys.argv[2])), 1))

"""Bad input as a matrix: every algorithm, every input that it declares, every kind of fault.

Each case is one command line, run in this process, and judged: an error is one line that names the file (or what it
holds) with the right exit code, inputs keep every byte, and the output folder holds nothing.
"""

import contextlib
import ctypes
import hashlib
import io
import os
import resource
import shutil
import socket
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from every_algorithm import DEM, FOLDER, GRID, IMAGES, POINTS, REFERENCE, RPC_FILE, inputs_of, sound_options, words_of
from gdal_files import spatial_reference
from osgeo import gdal

from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text
from hrsi.processing_algorithms.block_steps.tie_search import UNFINISHED
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.interface.declare import Algorithm

# ---- faults ----------------------------------------------------------------------------------------------------------

Fault = Callable[[Path, Path], str]  # sound file, folder of the case -> what is given instead


def copied(sound: Path, folder: Path) -> Path:
    """Return a copy of a file or folder of the scene under its own name, so that it stands for the same image."""
    target = folder / sound.name
    (shutil.copytree if sound.is_dir() else shutil.copy)(sound, target)
    return target


def missing(sound: Path, folder: Path) -> str:
    return str(folder / sound.name)


def empty(sound: Path, folder: Path) -> str:
    target = folder / sound.name
    target.mkdir() if sound.is_dir() else target.write_bytes(b"")
    return str(target)


def truncated(sound: Path, folder: Path) -> str:
    """Half of a file: a text ends inside a row."""
    target = copied(sound, folder)
    for file in [target] if target.is_file() else sorted(target.iterdir()):
        content = file.read_bytes()
        half = len(content) // 2
        file.write_bytes(content[: content.rindex(b",", 0, half) + 1] if file.suffix == ".csv" else content[:half])
    return str(target)


def wrong_type(sound: Path, folder: Path) -> str:
    """A table where an image is expected, an image where a table is, a file where a folder is."""
    other = sound.parent / ("points.csv" if sound.suffix == ".tif" else "dem.tif")
    if sound.parent.name == "cameras":
        other = sound.parent.parent / "dem.tif"
    shutil.copy(other, folder / sound.name)
    return str(folder / sound.name)


def changed_rpc(change: Callable[[str, float], object]) -> Fault:
    """A camera whose numbers are changed: in an RPC file, or in one beside a copy of the image, where it counts."""

    def make(sound: Path, folder: Path) -> str:
        target = copied(sound, folder)
        text = target
        if target.suffix == ".tif":
            text = folder / f"{target.stem}_RPC.TXT"
            write_rpc_text(str(text), open_image(str(sound)).rpc)
        values = dict(line.split(": ") for line in text.read_text().splitlines() if ": " in line)
        numbers = {key: float(value.split()[0]) for key, value in values.items() if key[:4] in RPC_WORDS}
        swapped = {key: numbers[SWAPPED[key]] if key in SWAPPED else value for key, value in numbers.items()}
        given = {key: change(key, value) for key, value in (swapped if change is swap else numbers).items()}
        text.write_text("".join(f"{key}: {value}\n" for key, value in given.items()))
        return str(target)

    return make


RPC_WORDS = {"LINE", "SAMP", "LAT_", "LONG", "HEIG"}
SWAPPED = {"LAT_OFF": "LONG_OFF", "LONG_OFF": "LAT_OFF", "LAT_SCALE": "LONG_SCALE", "LONG_SCALE": "LAT_SCALE"}


def swap(_key: str, value: float) -> float:
    return value


def changed_raster(values: float | None = None, crs: int = 0, east: float = 0.0, nodata: float | None = None) -> Fault:
    """A raster of floats: one value everywhere, another CRS for the same numbers, or far to the east."""

    def make(sound: Path, folder: Path) -> str:
        target = folder / sound.name
        form = {} if values is None else {"outputType": gdal.GDT_Float32}
        rpc = gdal.Open(str(sound)).GetMetadata("RPC")
        gdal.Translate(str(target), str(sound), noData=nodata, **form)
        dataset = gdal.Open(str(target), gdal.GA_Update)
        if rpc:
            dataset.SetMetadata(rpc, "RPC")
        if dataset.GetProjection():
            dataset.SetProjection(spatial_reference(f"EPSG:{crs or 4979}").ExportToWkt())
        if east:
            place = dataset.GetGeoTransform()
            dataset.SetGeoTransform((place[0] + east, *place[1:]))
        if values is not None:
            dataset.GetRasterBand(1).WriteArray(np.full((dataset.RasterYSize, dataset.RasterXSize), values, "f4"))
        return str(target)

    return make


Row = dict[str, str]


def changed_rows(change: Callable[[list[Row]], list[Row]]) -> Fault:
    """A table whose rows are changed."""

    def make(sound: Path, folder: Path) -> str:
        head, *lines = sound.read_text().splitlines()
        names = head.split(",")
        rows = change([dict(zip(names, line.split(","), strict=True)) for line in lines])
        (folder / sound.name).write_text("\n".join([head, *(",".join(row.values()) for row in rows)]) + "\n")
        return str(folder / sound.name)

    return make


MOVED = {"lon": 10.0, "sample": 1e5}  # degrees, px
PLACES = ("lon", "lat", "height", "sample", "line")


def one_row(value: str) -> Fault:
    """The third row has a value for its latitude and for its line."""

    def change(rows: list[Row]) -> list[Row]:
        rows[2] |= {key: value for key in ("lat", "line") if key in rows[2]}
        return rows

    return changed_rows(change)


def all_rows(change: Callable[[str, float], object]) -> Fault:
    """Every position is changed."""

    def changed(key: str, text: str) -> str:
        value = change(key, float(text))
        return text if value == float(text) else str(value)  # what stays the same is written the same

    return changed_rows(
        lambda rows: [row | {key: changed(key, row[key]) for key in PLACES if key in row} for row in rows]
    )


def repeated(rows: list[Row]) -> list[Row]:
    """The third row again, at another place."""
    other = {key: str(float(value) + {"lat": 0.01, "line": 50.0}.get(key, 0.0)) if key in PLACES else value
             for key, value in rows[2].items()}  # fmt: skip
    return [*rows, other]


def with_a_name(name: str, deep: int = 1) -> Fault:
    """The sound file in folders of a name."""

    def make(sound: Path, folder: Path) -> str:
        place = folder.joinpath(*[name] * deep)
        place.mkdir(parents=True)
        return str(copied(sound, place))

    return make


def too_long(sound: Path, folder: Path) -> str:
    return str(folder / ("n" * 300 + sound.suffix))


def zipped(sound: Path, folder: Path) -> str:
    """The sound file inside an archive."""
    with zipfile.ZipFile(folder / "delivery.zip", "w") as archive:
        for file in [sound] if sound.is_file() else sound.iterdir():
            archive.write(file, file.relative_to(sound.parent))
    return f"/vsizip/{folder}/delivery.zip/{sound.name}"


def twice(sound: Path, folder: Path) -> str:
    return str(copied(sound, folder))


NAN, HUGE = float("nan"), 1e30
RPC_FAULTS: dict[str, Fault] = {
    "wrong CRS": changed_rpc(swap),
    "NaN": changed_rpc(lambda key, value: NAN if key == "LINE_NUM_COEFF_2" else value),
    "huge": changed_rpc(lambda key, value: 1e300 if key == "LINE_OFF" else value),
    "negative": changed_rpc(lambda key, value: -value if key == "LAT_SCALE" else value),
}
RASTER_FAULTS: dict[str, Fault] = {
    "wrong CRS": changed_raster(crs=32631), "NaN": changed_raster(NAN), "huge": changed_raster(HUGE),
    "negative": changed_raster(-32768.0), "non-overlapping": changed_raster(east=10.0),
}  # fmt: skip
#: By role: the faults that only it can have.
OF_ROLE: dict[str, dict[str, Fault]] = {
    IMAGES: RPC_FAULTS | {
        "non-overlapping": changed_rpc(lambda key, value: value + 10.0 if key == "LONG_OFF" else value),
        "nodata everywhere": changed_raster(0.0, nodata=0.0), "duplicate": twice,
    },
    DEM: RASTER_FAULTS | {"nodata everywhere": changed_raster(-9999.0, nodata=-9999.0)},
    REFERENCE: RASTER_FAULTS | {"nodata everywhere": changed_raster(0.0, nodata=0.0)},
    POINTS: {
        "wrong CRS": all_rows(lambda key, value: value * 111_000.0 if key in ("lon", "lat") else value),
        "NaN": one_row("nan"), "huge": one_row("1e300"),
        "negative": all_rows(lambda key, value: value - (1e5 if key in ("height", "sample", "line") else 0.0)),
        "non-overlapping": all_rows(lambda key, value: value + MOVED.get(key, 0.0)),
        "nodata everywhere": all_rows(lambda key, value: ""), "duplicate": changed_rows(repeated),
    },
    RPC_FILE: RPC_FAULTS | {"nodata everywhere": changed_rpc(lambda key, value: 0.0)},
    GRID: {
        "NaN": changed_raster(NAN), "huge": changed_raster(HUGE), "non-overlapping": changed_raster(east=90.0),
        "nodata everywhere": changed_raster(-32768.0, nodata=-32768.0),
    },
    FOLDER: {},
}  # fmt: skip
#: Faults that any file can have.
OF_ALL: dict[str, Fault] = {
    "missing": missing, "empty": empty, "truncated": truncated, "wrong type": wrong_type,
    "Unicode": with_a_name("Ölüdeniz 測量 ✓"), "spaces": with_a_name(" a  b "), "long path": with_a_name("d" * 200, 6),
    "too long name": too_long, "/vsizip": zipped,
}  # fmt: skip


@contextlib.contextmanager
def hanging_server() -> Iterator[str]:
    """Yield the address of a server that takes connections and never answers."""
    with socket.create_server(("127.0.0.1", 0), backlog=64) as server:
        yield f"/vsicurl/http://127.0.0.1:{server.getsockname()[1]}"


def hanging(address: str) -> Fault:
    """The file as a server promises it that hangs."""
    return lambda sound, folder: f"{address}/{sound.name}"


# ---- cases and their judgement ---------------------------------------------------------------------------------------

REFUSED, TOLD, SILENT, WRONG = "refused", "told", "done", "wrong"
NO_FILE = {
    "missing",
    "empty",
    "wrong type",
    "too long name",
    "hanging /vsicurl",
}  #: must be refused, with the file's name
GOOD = {"Unicode", "spaces", "long path", "/vsizip"}  #: must be done
NO_ARCHIVE = (GRID, FOLDER, RPC_FILE)  #: roles that need not be read from an archive: refused is right, too


@dataclass(frozen=True)
class Case:
    """One command line with one fault: the input's key and role, and what the fault makes of it."""

    algorithm: Algorithm
    key: str
    role: str
    kind: str
    fault: Fault

    def __str__(self) -> str:
        return f"{self.algorithm.name} {self.key}: {self.kind}"


@dataclass
class Outcome:
    """How a case ended: what it was, and every way in which that is wrong."""

    what: str
    text: str
    wrong: list[str] = field(default_factory=list)
    seconds: float = 0.0


def cases(algorithm: Algorithm) -> Iterator[Case]:
    """Return every input of an algorithm with every fault that it can have."""
    for key, role in inputs_of(algorithm).items():
        for kind, fault in (OF_ALL | OF_ROLE[role]).items():
            yield Case(algorithm, key, role, kind, fault)


def run_words(words: list[str]) -> tuple[int, str, str]:
    """Run a command line in this process; return exit code, stdout and stderr, libraries' chatter too."""
    out, err = io.StringIO(), io.StringIO()
    with chatter() as said, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(words)
        except BaseException as error:  # what the command line lets through would be a traceback
            code, _ = 99, err.write(f"Traceback: {error!r}")
    return code, out.getvalue(), err.getvalue() + "".join(said)


@contextlib.contextmanager
def chatter() -> Iterator[list[str]]:
    """Collect what libraries write to the process's stderr, past Python."""
    said: list[str] = []
    with tempfile.TemporaryFile() as file:
        before = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            said.append(file.read().decode(errors="replace"))


def digests(*folders: Path) -> dict[str, str]:
    """Return the hash of every file below folders."""
    files = [file for folder in folders for file in sorted(folder.rglob("*")) if file.is_file()]
    return {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def error_lines(err: str) -> list[str]:
    """Return the lines of stderr from the error on."""
    lines = err.splitlines()
    first = next((number for number, line in enumerate(lines) if line.startswith("ERROR:")), len(lines))
    return lines[first:]


def faults_of_error(code: int, err: str, names: set[str]) -> list[str]:
    """Return what is wrong with how a command line was refused; one of the names must be told."""
    lines = error_lines(err)
    wrong = [] if len(lines) == 1 else [f"{len(lines)} lines of error"]
    text = lines[0] if lines else ""
    if "Traceback" in err or "fault of HRSI" in text:
        wrong.append("traceback")
    if code not in (1, 2):
        wrong.append(f"exit code {code}")
    if not any(name in text for name in names):
        wrong.append("the file is not named")
    return wrong


def left_behind(output: Path, algorithm: Algorithm) -> list[str]:
    """Return what lies in an output folder, but for what the algorithm keeps there on purpose."""
    kept = KEPT.get(algorithm.name, lambda name: False)
    names = [str(path.relative_to(output)) for path in output.rglob("*")]
    return [name for name in names if not kept(name) or Path(name).name.startswith(".")]


def judge(case: Case, scene: Path, folder: Path, told_of_sound: set[str]) -> Outcome | None:
    """Run a case in a folder of its own; say how it ended, and whether that is right.

    None where an input has nothing that this fault could touch: image points have no longitudes.
    """
    inputs, output = folder / "in", folder / "out"
    inputs.mkdir(parents=True)
    options = sound_options(case.algorithm, scene, case.key)
    sound = options[case.key]
    sound_file = sound[-1] if isinstance(sound, list) else sound
    bad = case.fault(Path(sound_file), inputs)
    options[case.key] = [*sound[: -1 if case.kind != "duplicate" else None], bad] if isinstance(sound, list) else bad
    if (
        case.kind in OF_ROLE[case.role]
        and Path(bad).read_bytes() == Path(sound_file).read_bytes()
        and len(list(inputs.iterdir())) == 1
        and case.kind != "duplicate"
    ):
        return None
    options["output_dir"] = str(output)
    before = digests(scene, inputs)
    code, out, err = run_words(words_of(case.algorithm, options))
    changed = {name for name, value in digests(scene, inputs).items() if before.get(name) != value}
    gone = before.keys() - digests(scene, inputs).keys()
    own = {name for name in changed if case.key == "work_dir"}  # what is kept there is a result
    if code not in (0, 3):
        names = {Path(bad).stem, f"--{case.key.replace('_', '-')}"}
        if case.kind not in NO_FILE:  # what lies in a file is told by the images that it does not fit
            names |= {Path(image).stem for image in options.get("images", [])} | {"two images", "window"}
        outcome = Outcome(REFUSED, "\n".join(error_lines(err)), faults_of_error(code, err, names))
        if case.kind in NO_FILE and code != 2:
            outcome.wrong.append(f"exit code {code} for a faulty file")
        if case.kind in GOOD and not (case.kind == "/vsizip" and case.role in NO_ARCHIVE):
            outcome.wrong.append("refused")
        left = left_behind(output, case.algorithm)
        outcome.wrong += [f"left behind: {', '.join(left[:4])}"] if left else []
    else:
        told = told_lines(err, out, inputs, scene) - told_of_sound
        outcome = Outcome(TOLD if told or code == 3 else SILENT, "; ".join(sorted(told)))
        if case.kind in NO_FILE and not is_harmless(case):
            outcome.wrong.append("not refused")
        elif case.kind not in GOOD and outcome.what == SILENT and not is_harmless(case):
            outcome.wrong.append("not told")
        if "Traceback" in err:
            outcome.wrong.append("traceback")
        hidden = [path.name for path in output.rglob(".*")]
        outcome.wrong += [f"left behind: {hidden}"] if hidden else []
        if not (output / "report.json").exists() and "report" not in case.algorithm.name and output.exists():
            outcome.wrong += [] if case.algorithm.name == "write-rpc" else ["no report"]
    outcome.wrong += [f"inputs changed: {sorted(changed - own | gone)}"] if changed - own or gone else []
    return outcome


def told_lines(err: str, out: str, *folders: Path) -> set[str]:
    """Return what was told, warnings and reasons, without the names of folders."""
    told = {line for line in (err + out).splitlines() if any(word in line for word in TELLING)}
    for folder in folders:
        told = {line.replace(str(folder), "") for line in told}
    return told


TELLING = ("warning", "doubtful:", "unusable:", "no match", "ambiguous", "nan")
#: Faults that do no harm, by algorithm, input and kind (empty: any), and why.
HARMLESS: dict[tuple[str, str, str], str] = {
    ("", "work_dir", "missing"): "is made",
    ("", "work_dir", "empty"): "is filled",
    ("", "work_dir", "truncated"): "damaged parts are found anew",
    ("", "images", "negative"): "an axis that runs the other way is a camera like any other",
    ("write-rpc", "images", ""): "writes the camera that it is given",
    ("write-rpc", "rpc", ""): "writes the camera that it is given",
    ("interest-points", "images", "wrong CRS"): "its points are in pixels",
    ("interest-points", "images", "non-overlapping"): "its points are in pixels",
    ("match", "images", "wrong CRS"): "needs no camera",
    ("match", "images", "non-overlapping"): "needs no camera",
    ("register", "images", "wrong CRS"): "the affine part takes up what cameras are off",
    ("register", "images", "non-overlapping"): "the affine part takes up what cameras are off",
    ("project", "points", "negative"): "takes no image coordinates",
    ("localize", "points", "wrong CRS"): "takes no longitudes and latitudes",
    ("localize", "points", "duplicate"): "each row is a question of its own",
    ("fit-rpc", "points", "non-overlapping"): "any place on Earth will do",
    ("fit-rpc", "points", "duplicate"): "rows have no ids there: it is one more point",
}
#: What lies in an output folder after a refusal, on purpose: finished parts for the next run, and what was found.
KEPT: dict[str, Callable[[str], bool]] = {
    "tie-points": lambda name: name.startswith(UNFINISHED),
    "triangulate": lambda name: name.startswith(UNFINISHED),
    "orthorectify": lambda name: name.endswith("_ortho.tif"),
    "match": lambda name: True,
}
READ_PIXELS = {
    "adjust", "evaluate", "gcps-from-reference", "interest-points", "match", "measure-targets", "ortho-check",
    "orthorectify", "refine-rpc", "tie-points", "triangulate",
}  # fmt: skip
PIXEL_FAULTS = ("truncated", "nodata everywhere")


def is_harmless(case: Case) -> bool:
    """Return whether a fault does not concern what an algorithm does, so that nothing need be told of it."""
    if case.role == IMAGES and case.kind in PIXEL_FAULTS and not reads_pixels(case.algorithm):
        return True
    names = [(name, case.key, kind) for name in ("", case.algorithm.name) for kind in ("", case.kind)]
    return any(name in HARMLESS for name in names)


def reads_pixels(algorithm: Algorithm) -> bool:
    """Return whether an algorithm looks at the grey values of its images."""
    return algorithm.name in READ_PIXELS


def sound_telling(algorithm: Algorithm, key: str, scene: Path, folder: Path) -> set[str]:
    """Run an algorithm on sound inputs, which must succeed; return what it tells of them."""
    options = sound_options(algorithm, scene, key) | {"output_dir": str(folder / "out")}
    code, out, err = run_words(words_of(algorithm, options))
    if code != 0:
        raise AssertionError(f"{algorithm.name} does not run on sound inputs ({code}): {err[-500:]}")
    return told_lines(err, out, folder, scene)


# ---- where results go ------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def without_privileges() -> Iterator[None]:
    """Have permissions of files count for root, too: without the capability to override them (Linux)."""
    if os.geteuid() != 0:
        yield
        return
    library, header = ctypes.CDLL(None, use_errno=True), (ctypes.c_uint32 * 2)(0x20080522, 0)
    data = (ctypes.c_uint32 * 6)()
    if library.capget(header, data):
        raise OSError(ctypes.get_errno(), "capget")
    effective = data[0]
    data[0] = effective & ~0b110  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    library.capset(header, data)
    try:
        yield
    finally:
        data[0] = effective
        library.capset(header, data)


@contextlib.contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Let nothing be written into a folder."""
    folder.chmod(0o555)
    try:
        with without_privileges():
            yield
    finally:
        folder.chmod(0o755)


@contextlib.contextmanager
def disk_of(bytes_left: int) -> Iterator[None]:
    """Let no file grow beyond some bytes, as on a disk that is full then."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_left, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


#: Output folders by kind: the folder below that of the case, what holds meanwhile, whether the run is to succeed.
OUTPUTS: dict[str, tuple[str, Callable[[Path], contextlib.AbstractContextManager[None]], bool]] = {
    "output: read-only folder": ("out", read_only, False),
    "output: in a read-only folder": ("out/below", lambda output: read_only(output.parent), False),
    "output: is a file": ("file", lambda output: contextlib.nullcontext(), False),
    "output: below a file": ("file/below", lambda output: contextlib.nullcontext(), False),
    "output: too long name": ("n" * 300, lambda output: contextlib.nullcontext(), False),
    "output: full disk at once": ("out", lambda output: disk_of(0), False),
    "output: full disk at 1 kB": ("out", lambda output: disk_of(1000), False),
    "output: full disk at 30 kB": ("out", lambda output: disk_of(30_000), False),
    "output: Unicode": ("Ölüdeniz 測量 ✓", lambda output: contextlib.nullcontext(), True),
    "output: spaces": (" a  b ", lambda output: contextlib.nullcontext(), True),
    "output: long path": ("/".join(["d" * 200] * 6), lambda output: contextlib.nullcontext(), True),
}


def judge_output(algorithm: Algorithm, kind: str, scene: Path, folder: Path, how: str = "") -> Outcome:
    """Run an algorithm on sound inputs into a bad output folder; say how it ended, and whether that is right."""
    name, meanwhile, good = OUTPUTS[kind]
    output = folder / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "file").write_text("mine")
    if name.startswith("out"):
        (folder / "out").mkdir()
    options = sound_options(algorithm, scene) | {"output_dir": str(output)} | ({"write": how} if how else {})
    before, mine = digests(scene), (folder / "file").read_text()
    with meanwhile(output):
        code, _, err = run_words(words_of(algorithm, options))
    if good and not ("long" in kind and code in (1, 2) and faults_of_error(code, err, {"512"}) == []):
        outcome = Outcome(SILENT, "", [] if code == 0 else [f"refused: {err[-300:]}"])
        outcome.wrong += [f"left behind: {hidden}" for hidden in output.rglob(".*")]
    elif code == 0:  # what a tiny disk holds, it holds whole
        outcome = Outcome(SILENT, "", [] if "full disk" in kind and kind[-1] == "B" else ["not refused"])
    else:
        outcome = Outcome(
            REFUSED, "\n".join(error_lines(err)), faults_of_error(code, err, {str(output), output.name, "--output-dir"})
        )
        left = left_behind(folder / "out", algorithm) if name.startswith("out") else []
        outcome.wrong += [f"left behind: {', '.join(left[:4])}"] if left else []
    outcome.wrong += ["inputs changed"] if digests(scene) != before or (folder / "file").read_text() != mine else []
    return outcome

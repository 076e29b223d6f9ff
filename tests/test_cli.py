"""The command line as `interface.md` promises it: streams, exit codes, one-line errors, cancelling."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond
from osgeo import gdal
from rpc_samples import write_image

from hrsi.hrsi_engine.foundation.version import VERSION
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.command_line import cli
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.command_line.command_parser import algorithm_parser
from hrsi.processing_algorithms.interface.declare import POSITIONAL_KINDS
from hrsi.tests.sample_algorithm import SAMPLE

BAR = "0...10...20...30...40...50...60...70...80...90...100 - done.\n"


@pytest.fixture
def hrsi(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    """Run ``hrsi sample --output-dir … WORDS`` and return the exit code, stdout and stderr."""

    def run(*words: str) -> tuple[int, str, str]:
        code = main(["sample", "--output-dir", str(tmp_path / "out"), *words], {SAMPLE.name: SAMPLE})
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def given(hrsi):
    """Run the sample algorithm and return the options that reached it."""

    def run(*words: str) -> dict:
        code, out, err = hrsi("--json", "--quiet", *words)
        assert (code, err) == (0, "")
        return json.loads(out)["options"]

    return run


def assert_one_error(result: tuple[int, str, str], code: int, *fragments: str) -> None:
    """The run failed with this exit code and one line on stderr that holds the fragments, below what was logged."""
    got, out, err = result
    *_, line = err.splitlines()
    assert (got, out) == (code, "")
    assert err.count("ERROR: ") == 1
    assert line.startswith("ERROR: ")
    assert "Traceback" not in err
    for fragment in fragments:
        assert fragment in line


def test_what_was_made_is_on_stdout_all_else_on_stderr(hrsi, tmp_path):
    code, out, err = hrsi("a.tif", "b.tif")
    assert (code, out) == (0, f"{tmp_path / 'out' / 'result.txt'}\n")
    assert err == "a message\n" + BAR + "2 images\n"


def test_a_path_is_printed_once(tmp_path, capsys):
    """The summary of `simulate` lists its files; they are outputs, so stdout has them and stderr does not."""
    words = ["simulate", "--images", "2", "--size", "100", "--gcps", "3", "--checks", "0", "--ties", "0"]
    assert main([*words, "--output-dir", str(tmp_path / "block")]) == 0
    made, told = (stream.splitlines() for stream in capsys.readouterr())
    assert str(tmp_path / "block" / "image_1.tif") in made
    assert len(made) == len(set(made))
    assert not set(made) & set(told)


def test_quiet_prints_errors_only(hrsi):
    assert hrsi("--quiet", "a.tif") == (0, "", "")
    assert_one_error(hrsi("--quiet", "a.tif", "--iterations", "x"), 2, "--iterations")


def test_letters_for_output_folder_and_quiet():
    words = algorithm_parser(REGISTRY["crop"]).parse_words(["a.tif", "-q", "-o", "out"])
    assert words == algorithm_parser(REGISTRY["crop"]).parse_words(["a.tif", "--quiet", "--output-dir", "out"])
    assert (words["quiet"], words["output_dir"]) == (True, "out")


def test_json_is_one_document_and_nothing_else(hrsi):
    code, out, err = hrsi("--json", "--fail", "chatter", "a.tif")
    assert code == 0
    assert json.loads(out)["algorithm"] == "sample"
    assert "a library that prints" in err


def test_options_reach_the_algorithm_converted(given):
    options = given(
        "a b.tif", "--gcps", "my points.gpkg|layername=gcps", "--gcp-ids", "H1, H2,,7", "--model", "affine",
        "--iterations", "3", "--height", "12.5", "--no-report", "--overwrite", "c.tif", "--threads", "2",
    )  # fmt: skip
    assert options["images"] == ["a b.tif", "c.tif"]
    assert options["gcps"] == "my points.gpkg|layername=gcps"
    assert options["gcp_ids"] == ["H1", "H2", "7"]
    assert (options["model"], options["iterations"], options["height"]) == ("affine", 3, 12.5)
    assert (options["report"], options["overwrite"], options["threads"]) == (False, True, 2)
    assert "dem" not in options  # settings hold what was given or has a default


@pytest.mark.parametrize("text", ["-3", "-3.5", "-.5", "-1e2"])
def test_negative_numbers(given, text):
    assert given("a.tif", "--height", text)["height"] == float(text)
    assert given("a.tif", f"--height={text}")["height"] == float(text)


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        ([], ["IMAGE", "--help"]),
        (["a.tif", "--iteration", "3"], ["--iteration;", "did you mean --iterations"]),  # no abbreviations
        (["a.tif", "-x"], ["-x"]),
        (["a.tif", "--gcps"], ["--gcps", "expected one argument"]),
        (["a.tif", "--gcps", ""], ["--gcps", "file name"]),
        (["a.tif", "--iterations", "many"], ["--iterations 'many'", "whole number"]),
        (["a.tif", "--iterations", "0"], ["--iterations 0", "minimum 1"]),
        (["a.tif", "--height", "9001"], ["--height 9001", "maximum 9000 m"]),
        (["a.tif", "--height", "nan"], ["--height 'nan'", "not a number"]),
        (["a.tif", "--model", "afine"], ["--model 'afine'", "shift, affine", "did you mean affine"]),
        (["a.tif", "--report=yes"], ["--report"]),
        (["a.tif", "--fail", "input"], ["no field 'id'; rename"]),
    ],
)
def test_wrong_usage_and_input(hrsi, words, fragments):
    assert_one_error(hrsi(*words), 2, *[fragment.rstrip(";") for fragment in fragments])


@pytest.mark.parametrize(
    ("failure", "code", "fragments"),
    [
        ("singular", 1, ["image B", "measure points on it"]),
        ("cancelled", 130, ["cancelled"]),
        ("bug", 1, ["unexpected KeyError", "report it", "HRSI_DEBUG=1"]),
        ("disk", 1, ["No space left on device", "out/report.json"]),
        ("memory", 1, ["out of memory", "--threads"]),
        ("package", 1, ["cv2", "README.md"]),
    ],
)
def test_failures_of_the_algorithm(hrsi, failure, code, fragments):
    assert_one_error(hrsi("a.tif", "--fail", failure), code, *fragments)


def test_debug_shows_the_traceback(hrsi, monkeypatch):
    monkeypatch.setenv("HRSI_DEBUG", "1")
    _, _, err = hrsi("a.tif", "--fail", "bug")
    assert "Traceback" in err


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        ([], ["no algorithm given", "hrsi --help"]),
        (["smaple"], ["'smaple'", "did you mean sample"]),
        (["--quiet", "sample"], ["--quiet", "before the algorithm"]),
    ],
)
def test_wrong_algorithm(words, fragments, capsys):
    code = main(words, {SAMPLE.name: SAMPLE})
    assert_one_error((code, *capsys.readouterr()), 2, *fragments)


def test_version(capsys):
    assert main(["--version"]) == 0
    first, *libraries = capsys.readouterr().out.splitlines()
    assert first == f"hrsi {VERSION}"
    told = dict(line.split(maxsplit=1) for line in libraries)
    assert told["gdal"] == gdal.__version__ and told["numpy"] == np.__version__
    assert {"proj", "scipy", "shapely", "python"} <= told.keys()


def test_help_lists_algorithms_by_group(capsys):
    other = replace(SAMPLE, name="other", group="Elsewhere", summary="Another one")
    assert main(["--help"], {"sample": SAMPLE, "other": other}) == 0
    out = capsys.readouterr().out
    assert re.search(r"^Tests:\n  sample +Reports 100 % of its options$", out, re.MULTILINE)
    assert re.search(r"^Elsewhere:\n  other +Another one$", out, re.MULTILINE)


def test_help_of_an_algorithm(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    assert main(["sample", "--help-all"], {"sample": SAMPLE}) == 0
    out = capsys.readouterr().out
    assert out.startswith("usage: hrsi sample [options] IMAGE...\n\nReports 100 % of its options\n\nFirst paragraph.")
    headings = re.findall(r"^([a-z ]+):$", out, re.MULTILINE)
    assert headings == ["images", "options", "output", "advanced options", "common options"]
    assert "--iterations" in out.partition("advanced options:")[2]
    flat = " ".join(out.split())
    assert "Model [one of shift, affine; default shift]" in flat
    assert "Height above the ellipsoid [unit m; at least -500; at most 9000; default 0]" in flat
    assert "--report, --no-report Write a report [default yes]" in flat


@pytest.mark.parametrize("name", REGISTRY)
def test_help_shows_few_options_first(name, capsys):
    """At most twelve, among them all that are required; programs get every one."""
    assert main([name, "--help"]) == 0
    out = capsys.readouterr().out
    option = re.compile(r"^  (?:-\w [^,]*, |-\w, )?(--[a-z][a-z0-9-]*|[A-Z]+(?= {2,}|$))", re.MULTILINE)
    shown = option.findall(out)
    assert 0 < len(shown) <= 12, shown
    params = REGISTRY[name].params
    assert {f"--{param.name}" for param in params if param.required and param.kind not in POSITIONAL_KINDS} <= {*shown}
    assert set(REGISTRY[name].main) <= {param.name for param in params}
    assert out.index("example") < option.search(out).start()
    assert main([name, "--json-usage"]) == 0
    declared = json.loads(capsys.readouterr().out)
    assert {param.name for param in params} <= {option["name"] for option in declared["options"]}


@pytest.mark.parametrize(
    ("start", "number", "code", "word"),
    mark_beyond(
        1,
        "killed",
        [
            ("hrsi", signal.SIGINT, 130, "interrupted"),
            ("hrsi.processing_algorithms.command_line.cli", signal.SIGINT, 130, "interrupted"),
            ("hrsi", signal.SIGTERM, 143, "terminated"),
        ],
    ),
)
def test_a_signal_while_modules_load_gives_one_line(tmp_path, start, number, code, word):
    """From the moment on that SIGTERM is caught (the system tells), through the loading of NumPy, OpenCV and GDAL."""
    for delay_s in (0.0, 0.02, 0.1, 0.3, 0.8):
        out_dir = tmp_path / f"out{delay_s}"
        words = ["simulate", "--size", "9000", "--output-dir", str(out_dir)]
        process = subprocess.Popen(
            [sys.executable, "-m", start, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        _wait_for_handler(process.pid)
        time.sleep(delay_s)
        process.send_signal(number)
        out, err = process.communicate(timeout=30)
        assert (process.returncode, out) == (code, ""), (delay_s, err)
        assert [line.startswith(f"ERROR: {word}") for line in err.splitlines() if "ERROR" in line] == [True], err
        assert "Traceback" not in err and "Exception ignored" not in err, (delay_s, err)
        assert not out_dir.exists() or not list(out_dir.iterdir())


def _wait_for_handler(process_id: int) -> None:
    """Wait until a process catches SIGTERM, which Python itself does not."""
    for _ in range(4000):
        status = Path(f"/proc/{process_id}/status").read_text()
        caught = next(line.split()[1] for line in status.splitlines() if line.startswith("SigCgt"))
        if int(caught, 16) & 1 << signal.SIGTERM - 1:
            return
        time.sleep(0.002)
    raise AssertionError("SIGTERM is not caught")


@pytest.mark.parametrize("module", ["foundation.lazy_names", "foundation.interruption", "foundation.thresholds"])
def test_an_interrupt_before_the_first_module_gives_no_traceback(tmp_path, module):
    """The signal comes while HRSI's first modules are looked up, before its own handler exists."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == 'hrsi.hrsi_engine.{module}': os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    done = subprocess.run([sys.executable, "-m", "hrsi", "--version"], capture_output=True, text=True, timeout=60,
                          env={**os.environ, "PYTHONPATH": str(tmp_path)})  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


def test_an_interrupt_that_was_swallowed_comes_again():
    """Python drops exceptions in finalisers and prints them; this one is raised again where it can be caught."""
    code = (
        "import signal, time\n"
        "from hrsi.hrsi_engine.foundation.interruption import ending, signals_as_exceptions\n"
        "class Careless:\n"
        "    def __del__(self): signal.raise_signal(signal.SIGINT); time.sleep(0)\n"
        "with signals_as_exceptions():\n"
        "    try:\n"
        "        careless = Careless(); del careless\n"
        "        time.sleep(20); print('slept')\n"
        "    except KeyboardInterrupt:\n"
        "        print(ending())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30)
    assert done.stdout == "(130, 'interrupted; no half-written file is left')\n"
    assert done.stderr == ""


def test_an_interrupt_while_an_error_is_told(monkeypatch, capsys):
    """The signal comes, or comes again, when the work has ended with another error that is being told."""

    def interrupted(*_words):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(cli, "spell_arguments", interrupted)
    assert cli.main(["no-such-algorithm"]) == 130
    assert capsys.readouterr().err == "ERROR: interrupted; no half-written file is left\n"


def test_an_interrupt_at_the_very_end(monkeypatch, capsys):
    """The signal comes while the handlers of the caller are put back: they are, all of them."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    set_handler, came = signal.signal, []

    def interrupted(number, handler):
        if handler in before and not came:
            came.append(number)
            signal.raise_signal(signal.SIGINT)
        return set_handler(number, handler)

    monkeypatch.setattr(signal, "signal", interrupted)
    assert cli.main(["--version"]) == 130
    assert came
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    assert capsys.readouterr().err == "ERROR: interrupted; no half-written file is left\n"


def test_console_command_and_broken_pipe():
    """The installed command runs, and a reader that stops early makes no noise."""
    command = Path(sys.executable).with_name("hrsi")
    done = subprocess.run(f"'{command}' --help | true", shell=True, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_rpc_info_loads_only_what_it_uses(tmp_path: Path):
    """An image is described without SciPy, numba, OpenCV and Jinja2."""
    write_image(tmp_path / "image.tif", blocks.images(1)[0].rpc)
    code = (
        "import sys; from hrsi.processing_algorithms.command_line.cli import main; "
        "code = main(['rpc-info', '--quiet', sys.argv[1]]); "
        "print([m for m in ('scipy', 'numba', 'cv2', 'jinja2') if m in sys.modules], code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "image.tif")], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[] 0"


@pytest.mark.parametrize("words", [[], ["--help"], ["adjust", "--help"], ["completion", "bash"]])
def test_starts_quickly_without_heavy_libraries(words: list[str]):
    """Help, errors and completion come at once: nothing but the algorithms' own runs loads NumPy, OpenCV or GDAL."""
    code = (
        f"import sys; from hrsi.processing_algorithms.command_line.cli import main; main({words}); "
        "print([m for m in ('numpy', 'scipy', 'cv2', 'osgeo', 'qgis', 'shapely') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
